"""Small inputs on which strangers found the product wrong, each with its right value or the sentence that it gets.

tests/data/cases has the inputs; README.md there and README in each folder tell what happened and what is right.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import DATA
from helpers.scenes import skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.render.lint.finding import Finding
from mitsuba_sensor.render.scene.scene import inspect_scene
from mitsuba_sensor.render.variants import choose_variant, use

CASES = DATA / "cases"
Check = Callable[[], None]
CHECKS: dict[str, Check] = {}
"""Name of a case, the beginning of its file's or folder's name → what must hold."""

PENDING = {
    *("09", "11", "12", "13"),
    *("2026-11-29_01", "2026-11-29_04", "2026-11-29_05", "2026-11-29_06"),
    *("2026-11-29_10", "2026-11-29_11", "2026-11-29_12"),
    *("2026-11-29_14",),
}
"""Cases that have no row yet."""


def case(name: str) -> Callable[[Check], Check]:
    """Enter the decorated check into the table."""

    def enter(check: Check) -> Check:
        CHECKS[name] = check
        return check

    return enter


def names_of_inputs() -> set[str]:
    """The numbers that inputs begin with: 01, 2026-11-29_01."""
    names = (re.match(r"(2026-11-29_)?\d\d(?=_)", path.name) for path in CASES.iterdir())
    return {name.group() for name in names if name}


def found(scene: Path, camera: str) -> list[Finding]:
    """What lint finds in a scene that is black or wrong."""
    use(choose_variant("scalar_spectral"))
    findings = inspect_scene(scene, ms.load_camera(camera), {})
    return [one for one in findings if one.level != "note"]


def rendered(scene: Path, camera: str, **options: Any) -> ms.Irradiance:
    """A small render of a scene."""
    asked = {"width": 8, "spp": 16, "variant": "scalar_spectral", "denoise": False, **options}
    return ms.render(scene, camera, ms.Exposure(0.01), seed=1, progress=False, **asked)


@case("01")
def prb_is_path() -> None:
    """Of both the mean over the picture, within 5 standard errors: chance fails one seed in a million."""
    variant = skip_unless_usable("llvm_ad_spectral")
    options = {"variant": variant, "wavelength_nm": 550, "spp": 64}
    scene = CASES / "01_prb_small_film.xml"
    prb = rendered(scene, "konnik_table1", **options)
    path = rendered(scene, "konnik_table1", integrator="path", **options)
    error = np.hypot(prb.standard_error, path.standard_error).astype(float)
    off = (prb.data.astype(float) - path.data).sum()
    assert abs(off) < 5 * np.sqrt((error**2).sum()) + 1e-6 * path.data.sum()


@case("02")
def a_default_emitter_is_d65() -> None:
    (finding,) = found(CASES / "02_default_emitter.xml", "rgbir_2mp")
    assert finding.level == "black" and "is black outside 360 to 830 nm" in finding.what


@case("03")
def the_sky_is_lit_from_320_to_720_nm() -> None:
    """Rendered at 340 nm, where it has light; refused at 800 nm, where it has none."""
    scene = CASES / "03_sunsky.xml"
    assert rendered(scene, "rgbir_2mp", wavelength_nm=340).data.mean() > 0
    with pytest.raises(ms.InputError, match="black outside 320 to 720 nm"):
        rendered(scene, "rgbir_2mp", wavelength_nm=800)
    assert any("outside 320 to 720 nm" in one.what for one in found(scene, "rgbir_2mp"))


@case("04")
def a_reflectance_in_percent_makes_light() -> None:
    """What is called wrong is wrong: a convex surface of reflectance 40 is 40 times as bright as the sky."""
    scene = CASES / "04_reflectance_percent.xml"
    (finding,) = found(scene, "konnik_table1")
    assert "'reflectance' in 1 place is as large as 40" in finding.what
    assert "percent" in finding.remedy
    light = rendered(scene, "konnik_table1", wavelength_nm=550).data
    assert light.max() / light[0, 0, 0] > 30


@case("05")
def a_metal_is_told_where_its_table_ends() -> None:
    notes = rendered(CASES / "05_conductor_nir.xml", "rgbir_2mp", bandwidth_nm=100).notes
    (note,) = (one for one in notes if "Mitsuba's table of 'Cr'" in one)
    assert "885.57 nm" in note and "its first and last values are held beyond" in note


@case("07")
def a_missing_attribute_is_refused() -> None:
    with pytest.raises(ms.InputError, match="has no attribute 'vertex_albedo'"):
        found(CASES / "07_attribute_missing.xml", "konnik_table1")


@case("2026-11-29_03")
def materials_that_depolarise_are_named() -> None:
    folder = CASES / "2026-11-29_03_plastic_polarizers"
    for kind in ("plastic", "principled", "roughdielectric", "roughplastic", "thindielectric"):
        (finding,) = found(folder / f"pol_{kind}.xml", "sony_imx250mzr")
        assert f"Mitsuba depolarises what {kind!r} reflects" in finding.what
        assert "pplastic" in finding.remedy and "dielectric" in finding.remedy
        assert found(folder / f"pol_{kind}.xml", "konnik_table1") == []
    assert found(folder / "pplastic_right.xml", "sony_imx250mzr") == []
    options = {"wavelength_nm": 550, "spp": 1, "variant": "scalar_spectral_polarized"}
    notes = rendered(folder / "pol_plastic.xml", "sony_imx250mzr", **options).notes
    assert any("Mitsuba depolarises what 'plastic'" in note for note in notes)


@case("2026-11-29_08")
def a_medium_needs_an_integrator_that_renders_it() -> None:
    """5 units of fog of 0.2 leave exp(−1) of the light in the middle; 4 standard errors of 6 400 paths are 7 %."""
    scene = CASES / "2026-11-29_08_path_ignores_medium" / "scene.xml"
    (finding,) = found(scene, "konnik_table1")
    assert "integrator 'path' renders no media" in finding.what
    assert "volpath" in finding.remedy
    options = {"wavelength_nm": 550, "spp": 100}
    vacuum = rendered(scene, "konnik_table1", **options)
    assert any("renders no media" in note for note in vacuum.notes)
    fog = rendered(scene, "konnik_table1", integrator="volpath", **options)
    assert not any("media" in note for note in fog.notes)
    assert fog.data.mean() / vacuum.data.mean() == pytest.approx(np.exp(-1), rel=0.07)


@case("2026-11-29_09")
def an_area_emitter_without_a_shape_is_told() -> None:
    scene = CASES / "2026-11-29_09_area_emitter_without_shape" / "scene.xml"
    (finding,) = found(scene, "konnik_table1")
    assert "emitter 'area' is in no shape and gives no light" in finding.what
    assert finding.where == "line 6"


@case("2026-11-29_16")
def a_picture_as_a_lamp_is_no_d65() -> None:
    """The note is true: at 455 nm over 755 nm the picture is flat, <rgb> has the ratio of D65, and at 855 nm none."""
    folder, bands = CASES / "2026-11-29_16_picture_as_lamp", (455, 755)
    picture, rgb = (
        [rendered(folder / name, "rgbir_2mp", wavelength_nm=nm).data.mean() for nm in bands]
        for name in ("ir_tex.xml", "ir_rgb.xml")
    )
    assert picture[0] / picture[1] == pytest.approx(1, rel=0.02)
    assert rgb[0] / rgb[1] == pytest.approx(2.135, rel=0.02)  # CIE D65: 117.41 and 54.99
    options = {"wavelength_nm": 855}
    assert rendered(folder / "ir_tex.xml", "rgbir_2mp", **options).data.mean() > 0
    with pytest.raises(ms.InputError, match="has no light in the bands"):
        rendered(folder / "ir_rgb.xml", "rgbir_2mp", **options)
    notes = rendered(folder / "ir_tex.xml", "rgbir_2mp", bandwidth_nm=100).notes
    assert any(
        "a texture as a light in 1 place is not multiplied by D65" in one for one in notes
    )


def test_each_input_has_a_row() -> None:
    assert {*CHECKS} | PENDING == names_of_inputs()


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_case(name: str) -> None:
    CHECKS[name]()
