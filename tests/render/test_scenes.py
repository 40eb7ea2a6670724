"""Scenes: the shipped ones have their stated exposure, others load in any form, broken ones are one sentence."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import (
    BALL,
    SCENES,
    SHIPPED,
    SKY,
    scalar_first,
    scene_text,
    skip_unless_usable,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor.cli.flag_names import with_flags
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.load.scene import load_scene
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
BANDS = box_bands(CAMERA, np.array([400.0, 500.0, 600.0, 700.0]))
WALL = """<shape type="rectangle">{bsdf}<transform name="to_world">
<scale value="9"/><rotate y="1" angle="180"/><translate z="4"/></transform></shape>"""
PICTURE = """<bsdf type="diffuse"><texture type="bitmap" name="reflectance">
<string name="filename" value="{name}"/>{more}</texture></bsdf>"""
FLAT = '<emitter type="constant"><spectrum name="radiance" value="360:1, 830:1"/></emitter>'


def ready(variant: str = "scalar_spectral") -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


def radiance(folder: Path, text: str, spp: int = 64, **options: Any) -> np.ndarray:
    """Mean radiance in each band [W m⁻² sr⁻¹ nm⁻¹], (8, 12, 3)."""
    scene = load_scene(write_scene(folder, text), BANDS, {}, **options)
    return scene.render(1, spp, (0, 8)).astype(float) / BANDS.bandwidths_nm


# Shipped scenes.


def fill(name: str, spp: int, size: tuple[int, int]) -> np.ndarray:
    """Detected electrons over full well, at 0.1 s, (H, W)."""
    asked: Any = {
        "spp": spp,
        "bandwidth_nm": 50,
        "variant": "scalar_spectral",
        "denoise": False,
    }
    parameters = dict(zip(("width", "height"), size, strict=True))
    light = ms.render(SCENES / f"{name}.xml", CAMERA, EXPOSURE, parameters=parameters, **asked)
    photons = ms.collect(light, CAMERA, EXPOSURE).mean
    return (photons * CAMERA.qe(light.wavelengths_nm)[0]).sum(
        axis=-1
    ) / CAMERA.pixel.full_well_e


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load_without_a_note_and_in_plain_mitsuba(name: str) -> None:
    """Nothing of ours has to be replaced, and nothing is black in 360 to 830 nm."""
    mi, path = ready(), SCENES / f"{name}.xml"
    bands = box_bands(CAMERA, np.array([360.0, 830.0]))
    assert load_scene(path, bands, {"width": 8, "height": 8}).notes == ()
    assert mi.load_file(str(path), width="8", height="8").sensors()


@pytest.mark.parametrize("name", (*SHIPPED, "one_file", "first_frame", "night_crossing"))
def test_every_parameter_of_a_shipped_scene_is_explained(name: str) -> None:
    """Each <default> follows a comment, or another <default> of the same comment; size and level are among them."""
    text = (SCENES / f"{name}.xml").read_text(encoding="utf-8")
    names = re.findall(r'<default name="(\w+)"', text)
    explained = re.findall(r"-->\s*((?:<default[^>]*/>\s*)+)", text)
    assert re.findall(r'<default name="(\w+)"', "".join(explained)) == names
    assert {"width", "height"} < set(names)


def test_shipped_scenes_are_well_exposed() -> None:
    """The white back wall of the Cornell box at 30 to 50 % of full well, its lamp far above (wall mean good to 1 %);
    the median of the still life between a tenth and a half, and under a tenth of its pixels saturate."""
    box, still = fill("cornell_box", 16, (64, 64)), fill("still_life", 16, (36, 24))
    assert 0.30 < box[16:40, 36:48].mean() < 0.50 and box[7:9, 28:36].min() > 5
    assert 0.1 < np.median(still) < 0.5 and (still > 1).mean() < 0.1


def test_step_wedge_is_linear_from_dark_to_beyond_saturation() -> None:
    """64 equal steps: exactly 0, then a straight line to 1.2 full wells, every step within 1 % (0.1 % of error)."""
    steps = fill("step_wedge", 256, (64, 16)).mean(axis=0)
    assert steps[0] == 0 and steps[-1] == pytest.approx(1.2, abs=0.02)
    rise = steps[1:] / np.arange(1, 64)
    np.testing.assert_allclose(rise, rise.mean(), rtol=1e-2)


# Scenes of other people.


def test_foreign_rgb_scene_renders_and_the_user_is_told(tmp_path: Path) -> None:
    """rgb colours, hdrfilm, gaussian filter, independent sampler, two sensors, an aov integrator: all still loads."""
    red = '<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.1, 0.1"/></bsdf>'
    text = scene_text(
        '<emitter type="constant"><rgb name="radiance" value="0.01"/></emitter>',
        BALL.format(bsdf=red),
        '<integrator type="aov"><string name="aovs" value="d:depth"/><integrator type="path"/></integrator>',
        '<sensor type="perspective"/>',
        film='<rfilter type="gaussian"/>',
        more='<sampler type="independent"/>',
    )
    asked: Any = {"spp": 16, "bandwidth_nm": 100, "variant": "scalar_spectral"}
    light = ms.render(write_scene(tmp_path, text), CAMERA, EXPOSURE, **asked)
    notes, facts = ("\n".join(said) for said in (light.notes, light.statistics.facts))
    for replaced in ("'hdrfilm'", "'gaussian'", "'independent'"):
        assert replaced in facts and replaced not in notes
    assert "'aov' replaced" in notes and "2 sensors" in notes
    assert light.data.shape == (8, 12, 3) and (light.data > 0).all()
    assert light.data[4, 6, 2] > 3 * light.data[4, 6, 0], "650 nm far above 450 nm"


@scalar_first
def test_pictures_are_the_light_and_the_colours_that_they_hold(
    tmp_path: Path, variant: str
) -> None:
    """A map of 0.5 shines as <rgb value="0.5"> does, in every band; a wall under a sky of radiance 1 is as bright as
    its reflectance, 0.2 in the left half and 0.6 in the right (64 samples, within 2 %)."""
    mi = ready(variant)
    mi.Bitmap(np.full((4, 8, 3), 0.5, np.float32)).write(str(tmp_path / "sky.exr"))
    sky = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    even = '<emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>'
    mapped, even = (
        radiance(tmp_path, scene_text(x), 256).mean(axis=(0, 1)) for x in (sky, even)
    )
    np.testing.assert_allclose(mapped, even, rtol=0.02)
    picture = np.full((2, 2, 3), 0.2, np.float32)
    picture[:, 1] = 0.6
    mi.Bitmap(picture).write(str(tmp_path / "halves.exr"))
    nearest = '<string name="filter_type" value="nearest"/>'
    wall = WALL.format(bsdf=PICTURE.format(name="halves.exr", more=nearest))
    light = radiance(tmp_path, scene_text(FLAT, wall), 256)
    halves = sorted((light[:, :6].mean(), light[:, 6:].mean()))
    np.testing.assert_allclose(halves, (0.2, 0.6), rtol=0.02)


def test_an_old_scene_is_what_mitsuba_s_own_upgrade_makes_of_it() -> None:
    """Format 0.6: parameters in camelCase are understood, with a note; an element that is not is refused, and the
    sentence says of which format the scene is."""
    ready()
    ball = BALL.format(
        bsdf='<bsdf type="diffuse"><rgb name="{}" value="0.1, 0.2, 0.3"/></bsdf>'
    )
    axis = '<string name="{}" value="y"/>'
    old = scene_text(SKY, ball.format("diffuseReflectance"), more=axis.format("fovAxis"))
    old = old.replace("3.0.0", "0.6.0")
    new = scene_text(SKY, ball.format("reflectance"), more=axis.format("fov_axis"))
    scenes = [load_scene(text, BANDS, {}) for text in (old, new)]
    a, b = (scene.render(1, 4, (0, 8)) for scene in scenes)
    np.testing.assert_array_equal(a, b)
    told = [any("Mitsuba 0.6.0" in note for note in scene.notes) for scene in scenes]
    assert told == [True, False]
    with pytest.raises(ms.InputError, match=r"format of Mitsuba 0\.6\.0"):
        load_scene(old.replace("<rgb", "<srgb"), BANDS, {})


def shape(kind: str, inside: str = "") -> str:
    return scene_text(SKY, f'<shape type="{kind}">{inside}</shape>')


def bsdf(kind: str) -> str:
    return scene_text(SKY, BALL.format(bsdf=f'<bsdf type="{kind}"/>'))


def coloured(kind: str) -> str:
    """A ball whose colour is a plugin without parameters."""
    texture = f'<texture type="{kind}" name="reflectance"/>'
    return scene_text(SKY, BALL.format(bsdf=f'<bsdf type="diffuse">{texture}</bsdf>'))


MESH, RADIUS = '<string name="filename" value="no.ply"/>', '<float name="radius" value="{}"/>'
BROKEN = [
    ("", "No document element"),
    ('<scene version="3.0.0"><sensor', "Error parsing"),
    ("<scene></scene>", "version"),
    ('<bsdf version="3.0.0" type="diffuse"/>', "holds no scene"),
    ('<scene version="3.0.0"></scene>', '<sensor type="perspective">'),
    (scene_text(), "add an emitter"),
    (scene_text(SKY, "<blob/>"), "<blob>"),
    (shape("spher"), "Did you mean 'sphere'?"),
    (bsdf("rough_plastic"), "Did you mean 'roughplastic'?"),
    (scene_text(SKY, '<integrator type="pathtracer"/>'), "Did you mean 'ptracer'?"),
    (scene_text(SKY, '<integrator type="prb"/>'), "integrator='path'"),
    (shape("diffuse"), "does not match the expected type"),
    (shape("sphere", RADIUS.replace("radius", "radios").format(3)), "radios"),
    (shape("sphere", RADIUS.format("$r")), "-D name=value"),
    (shape("sphere", RADIUS.format("abc")), "abc"),
    (shape("sphere", '<ref id="gone"/>'), "gone"),
    (shape("ply", MESH), "no.ply"),
    (scene_text(SKY, BALL.format(bsdf=PICTURE.format(name="wood.png", more=""))), "wood.png"),
    (coloured("bitmap"), "a bitmap without a filename"),
    (coloured("irregular"), "irregular"),
    (scene_text(SKY, '<include filename="no.xml"/>'), "no.xml"),
    (scene_text(SKY, film='<integer name="crop_width" value="99"/>'), "crop"),
    (scene_text(SKY, film='<float name="crop_width" value="2.5"/>'), "2.5; it must be a whole"),
    (scene_text(SKY.replace("360:", "750:")), "no light in the bands"),
    (scene_text(SKY, '<integrator type="depth"/>'), "integrator"),
    (scene_text(SKY, '<integrator type="ptracer"/>'), "integrator"),
    (scene_text(SKY, sensor='<sensor type="irradiancemeter"/>'), "takes no image; it must be one of perspective"),
    (scene_text(SKY, sensor='<sensor type="batch"/>'), "move its sensors into the scene"),
    (scene_text(SKY, sensor='<sensor type="fisheye"/>'), "must be one of perspective"),
    (shape("ply").replace("3.0.0", "2.0.0"), "format of Mitsuba 2.0.0"),
    (scene_text(SKY, "<shape").replace("3.0.0", "0.5.0"), "format of Mitsuba 0.5.0"),
    (bsdf("ward").replace("3.0.0", "0.6.0"), "format of Mitsuba 0.6.0"),
    *((bsdf(kind), "for unpolarised light") for kind in ("polarizer", "circular", "retarder", "measured_polarized")),
]  # fmt: skip


@pytest.mark.parametrize(("text", "words"), BROKEN)
def test_a_broken_scene_is_one_sentence(tmp_path: Path, text: str, words: str) -> None:
    ready()
    path = write_scene(tmp_path, text)
    with pytest.raises(ms.InputError) as caught:
        load_scene(path, BANDS, {})
    said = str(caught.value)
    assert words in said and "\n" not in said and str(path) in said


ERRORS = [(text, words) for text, words in BROKEN if words != "no light in the bands"]
"""For the command lint, whose finding is light outside the bands."""


@pytest.mark.parametrize(("text", "words"), one_in(9, ERRORS, several=True))
def test_a_broken_scene_is_exit_code_2(
    tmp_path: Path, cli: Callable[..., Any], text: str, words: str
) -> None:
    done = cli("lint", write_scene(tmp_path, text), "--variant", "scalar_spectral")
    said = " ".join(done.stderr.split())
    assert done.exit_code == 2 and said.startswith("error: "), done.output
    assert with_flags(words) in said and said.endswith((".", "?"))


def test_the_sensor_that_an_error_proposes_works_when_pasted(tmp_path: Path) -> None:
    ready()
    with pytest.raises(ms.InputError, match="has no sensor; add one") as caught:
        load_scene(write_scene(tmp_path, scene_text(SKY, sensor="")), BANDS, {})
    element = re.search(r"<sensor.*</sensor>", str(caught.value))
    assert element
    pasted = scene_text(SKY, element[0], sensor="")
    assert load_scene(write_scene(tmp_path, pasted), BANDS, {}).view.half_width > 0


def test_all_missing_files_are_named_at_once(tmp_path: Path) -> None:
    """Three of them, with their lines, in one sentence; a file that is there is not."""
    ready().Bitmap(np.ones((2, 2, 3), np.float32)).write(str(tmp_path / "here.exr"))
    meshes = [f'\n<shape type="ply">{MESH.replace("no", name)}</shape>' for name in "ab"]
    names = ("here.exr", "wood.png")
    pictures = [WALL.format(bsdf=PICTURE.format(name=name, more="")) for name in names]
    said = r"lacks 3 files: a\.ply \(line 3\), b\.ply \(line 4\), wood\.png"
    with pytest.raises(ms.InputError, match=said) as caught:
        load_scene(write_scene(tmp_path, scene_text(SKY, *meshes, *pictures)), BANDS, {})
    assert "here.exr" not in str(caught.value)


@pytest.mark.parametrize("kind", one_in(2, ["bdpt", "depth", "ptracer", "aov"]))
def test_integrator_replaces_whatever_the_scene_has_and_says_so(
    tmp_path: Path, kind: str
) -> None:
    ready()
    inside = '<integer name="max_depth" value="2"/><integrator type="direct"/>'
    scene = scene_text(SKY, BALL.format(bsdf=""), '<integrator type="{}">{}</integrator>')
    path = write_scene(tmp_path, scene.format(kind, inside))
    found = load_scene(parse(path, {"integrator": "path"}), BANDS, {})
    plain = write_scene(tmp_path, scene.format("path", '<integer name="max_depth" value="2"/>'))
    images = [one.render(1, 16, (0, 8)) for one in (found, load_scene(plain, BANDS, {}))]
    np.testing.assert_array_equal(*images)
    assert any(f"integrator '{kind}' is replaced by 'path'" in note for note in found.notes)


@pytest.mark.parametrize(
    ("kind", "share"), [("polarizer", 0.5), ("circular", 0.5), ("retarder", 1.0)]
)
def test_polarising_elements_act_on_unpolarised_light_where_that_is_asked_for(
    tmp_path: Path, kind: str, share: float
) -> None:
    """An ideal linear or circular polarizer lets half of it through, a retarder all; a note says what is wrong then."""
    ready()
    pose = '<transform name="to_world"><scale value="9"/><translate z="2"/></transform>'
    pane = f'<shape type="rectangle"><bsdf type="{kind}"/>{pose}</shape>'
    path = write_scene(tmp_path, scene_text(FLAT, pane))
    scene = load_scene(parse(path, {"ignore_polarization": True}), BANDS, {})
    light = scene.render(1, 64, (0, 8)) / BANDS.bandwidths_nm
    np.testing.assert_allclose(light.mean(), share, rtol=0.01)
    assert any("unpolarised light" in note for note in scene.notes)


def test_path_elements_work_beside_nested_includes_defaults_and_instances(
    tmp_path: Path,
) -> None:
    """<path value="$folder"/> finds the mesh that an included file includes, and its instance is drawn."""
    ready()
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "m.obj").write_text(
        "v 0 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 2\n"
    )
    mesh = '<shape type="obj"><string name="filename" value="m.obj"/></shape>'
    group = f'<scene version="3.0.0"><shape type="shapegroup" id="group">{mesh}</shape></scene>'
    (tmp_path / "inner.xml").write_text(group)
    inner = '<scene version="3.0.0"><include filename="inner.xml"/></scene>'
    (tmp_path / "outer.xml").write_text(inner)
    paths = '<default name="folder" value="nowhere"/><path value="$folder"/><include filename="outer.xml"/>'
    pose = '<transform name="to_world"><translate z="4"/></transform>'
    text = scene_text(SKY, f'<shape type="instance"><ref id="group"/>{pose}</shape>')
    path = write_scene(tmp_path, text.replace('3.0.0">', f'3.0.0">{paths}', 1))
    light = load_scene(path, BANDS, {"folder": "meshes"}).render(1, 16, (0, 8))
    assert light[4, 6].mean() < 0.9 * light[0, 0].mean()


def test_what_a_compiled_variant_cannot_render_is_told_the_one_that_can(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """timed_sunsky of Mitsuba 3.9.1 works in scalar variants only, and its failure would spoil all later renders."""
    path = write_scene(
        tmp_path, scene_text('<emitter type="timed_sunsky"/>', BALL.format(bsdf=""))
    )
    done = cli("lint", path, "--variant", skip_unless_usable("llvm_ad_spectral"))
    assert done.exit_code == 2 and "--variant scalar_spectral" in " ".join(done.stderr.split())


# Size, parameters and the cost of a small render.


def test_parameters_reach_the_scene_and_its_fingerprint() -> None:
    ready()
    path = SCENES / "flat_field.xml"
    small, same, large = (load_scene(path, BANDS, {"width": w}) for w in (4, "4", 5))
    assert (small.view.size, large.view.size) == ((4, 256), (5, 256))
    assert small.sha256 == same.sha256 != large.sha256


def test_fewer_columns_are_the_same_view(tmp_path: Path) -> None:
    """A ball in the sky: half the columns show the mean of two by two pixels, rows and the crop in proportion; more
    columns than the film has are refused."""
    ready()
    path = write_scene(tmp_path, scene_text(SKY, BALL.format(bsdf='<bsdf type="diffuse"/>')))
    wide, narrow = (
        ms.render(path, CAMERA, EXPOSURE, spp=1024, wavelength_nm=550, width=columns).data[
            ..., 0
        ]
        for columns in (12, 6)
    )
    binned = wide.reshape(4, 2, 6, 2).mean(axis=(1, 3))
    assert narrow.shape == binned.shape and np.ptp(binned) > 0.2 * binned.max()
    np.testing.assert_allclose(narrow, binned, rtol=0.05)
    crop = {"crop_width": 6, "crop_height": 4, "crop_offset_x": 4, "crop_offset_y": 2}
    film = "".join(f'<integer name="{k}" value="{v}"/>' for k, v in crop.items())
    view = load_scene(scene_text(SKY, film=film), BANDS, {}, width=6).view
    assert (view.size, view.crop_size, view.crop_offset) == ((12, 8), (6, 4), (4, 2))
    with pytest.raises(ms.InputError, match="from 1 to the film's own 12"):
        ms.render(path, CAMERA, EXPOSURE, width=13)


@pytest.mark.exhaustive
def test_a_small_render_imports_no_optimiser() -> None:
    """scipy.optimize takes half a second, a sixth of a small render in a fresh process."""
    call = "ms.render('cornell_box', width=8, spp=1, denoise=False, variant='scalar_spectral', progress=False)"
    code = f"import sys, mitsuba_sensor as ms; {call}; print('scipy.optimize' in sys.modules)"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
