"""Media that a render leaves out: which integrators render them, and where the sensor is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import scalar_first, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.render.lint.built_checks import VOLUMETRIC
from mitsuba_sensor.render.lint.finding import Finding
from mitsuba_sensor.render.scene.plugin_names import gradient_integrators
from mitsuba_sensor.render.scene.scene import inspect_scene
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA = ms.load_camera("konnik_table1")
NO_SPECTRA = "volprim_rf_basic"
INTEGRATORS = ("path", "direct", "volpath", "volpathmis", *gradient_integrators())
FOG = (
    '<medium type="homogeneous" id="fog"><float name="sigma_t" value="0.2"/>'
    '<float name="albedo" value="0"/></medium>'
)
VOLPATH = '<integrator type="volpath"/>'
WALL = (
    '<shape type="rectangle"><transform name="to_world"><scale value="50"/><rotate y="1" angle="180"/>'
    '<translate z="{}"/></transform><emitter type="area"><spectrum name="radiance" value="1e-3"/></emitter></shape>'
)
INSIDE = '<ref name="medium" id="fog"/>'


def cube(scale: float, z: float = 0.0, inside: str = '<ref name="interior" id="fog"/>') -> str:
    place = f'<scale value="{scale}"/><translate z="{z}"/>'
    return f'<shape type="cube"><bsdf type="null"/><transform name="to_world">{place}</transform>{inside}</shape>'


def told(folder: Path, *elements: str, more: str = "") -> list[Finding]:
    """Findings about media."""
    path = write_scene(folder, scene_text(*elements, more=more))
    return [one for one in inspect_scene(path, CAMERA, {}) if "medi" in one.what]


def test_those_called_volumetric_are_those_in_which_fog_absorbs() -> None:
    """Plain Mitsuba: 2 units of fog of 0.2 leave exp(−0.4), 1024 paths within 4 standard errors. The others leave all
    light, or none of it, where they end at the boundary."""
    mi = use(choose_variant(skip_unless_usable("llvm_ad_spectral")))
    fog = {"type": "homogeneous", "sigma_t": {"type": "uniform", "value": 0.2}}
    fog["albedo"] = {"type": "uniform", "value": 0.0}
    band = {"type": "spectrum", "value": [(400.0, 1.0), (700.0, 1.0)]}
    film = {"type": "specfilm", "width": 4, "height": 4, "band": band}
    turned = mi.ScalarTransform4f().translate([0, 0, 6]).rotate([0, 1, 0], 180).scale(9)
    lamp = {"type": "area", "radiance": {"type": "uniform", "value": 1.0}}
    place = mi.ScalarTransform4f().translate([0, 0, 4])
    box = {"type": "cube", "bsdf": {"type": "null"}, "interior": fog, "to_world": place}
    scene = {
        "type": "scene",
        "wall": {"type": "rectangle", "to_world": turned, "lamp": lamp},
        "sensor": {"type": "perspective", "fov": 1.0, "film": film},
        "box": box,
    }
    absorbed = set[str]()
    for kind in sorted({*INTEGRATORS} - {NO_SPECTRA}):
        integrator = mi.load_dict({"type": kind})
        whole = mi.load_dict({**scene, "integrator": integrator})
        share = float(np.mean(np.array(mi.render(whole, spp=64, seed=1)))) / 300
        if share == pytest.approx(math.exp(-0.4), abs=0.06):
            absorbed |= {type(integrator).__name__, integrator.class_name()} & {*VOLUMETRIC}
        else:
            assert share in (pytest.approx(1, rel=1e-3), 0.0), kind
            assert not {type(integrator).__name__, integrator.class_name()} & {*VOLUMETRIC}
    assert absorbed == {*VOLUMETRIC}


@pytest.mark.parametrize("integrator", ["path", "direct", "aov", None])
def test_an_integrator_that_renders_no_media_is_told(
    tmp_path: Path, integrator: str | None
) -> None:
    use(choose_variant("scalar_spectral"))
    element = "" if integrator is None else f'<integrator type="{integrator}"/>'
    (finding,) = told(tmp_path, FOG, WALL.format(6), cube(1, 3), element)
    assert finding.level == "wrong" and "renders no media" in finding.what
    assert "volpath" in finding.remedy
    assert told(tmp_path, FOG, WALL.format(6), cube(1, 3), VOLPATH) == []


PLACES = [
    ((cube(9), WALL.format(6)), INSIDE, None),
    ((cube(9), WALL.format(6)), "", "inside a medium without a reference"),
    ((cube(1, 3), WALL.format(6)), "", None),
    ((cube(1, 3), WALL.format(6)), INSIDE, "refers to a medium and is outside of it"),
    ((cube(9, inside=""), WALL.format(6)), INSIDE, None),  # fog without an end
    ((cube(9, inside=""), WALL.format(6)), "", "belongs to no shape"),
    (
        (cube(9), cube(2, inside='<ref name="exterior" id="fog"/>')),
        "",
        None,  # in a hollow of the fog
    ),
]


@pytest.mark.parametrize(("shapes", "reference", "sentence"), PLACES)
@scalar_first
def test_a_sensor_refers_to_the_medium_that_it_is_in(
    tmp_path: Path, variant: str, shapes: tuple[str, ...], reference: str, sentence: str | None
) -> None:
    use(choose_variant(skip_unless_usable(variant)))
    sky = '<emitter type="constant"/>'
    findings = told(tmp_path, FOG, *shapes, sky, VOLPATH, more=reference)
    assert len(findings) == (sentence is not None)
    assert all(sentence in one.what for one in findings if sentence)


def test_prbvolpath_begins_in_a_vacuum(tmp_path: Path) -> None:
    """The finding is true: the fog between the sensor and the wall is not there."""
    use(choose_variant(skip_unless_usable("llvm_ad_spectral")))
    elements = (FOG, WALL.format(5), cube(9))
    prb, volpath = '<integrator type="prbvolpath"/>', VOLPATH
    (finding,) = told(tmp_path, *elements, prb, more=INSIDE)
    assert "'prbvolpath' begins in a vacuum" in finding.what
    options: Any = {"spp": 64, "wavelength_nm": 550, "progress": False, "denoise": False}
    lights = [
        ms.render(scene_text(*elements, one, more=INSIDE), CAMERA, ms.Exposure(0.01), **options)
        for one in (prb, volpath)
    ]
    assert lights[0].data.mean() > 2 * lights[1].data.mean()
