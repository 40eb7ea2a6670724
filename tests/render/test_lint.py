"""Lint: each finding in a scene that has it, and none in the same scene without it; and what the command line says."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive
from helpers.scenes import (
    BALL,
    SCENES,
    SHIPPED,
    scene_text,
    skip_unless_usable,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor.render.lint.lint import Finding
from mitsuba_sensor.render.scene.scene import inspect_scene
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

VISIBLE = ms.load_camera("konnik_table1")
INFRARED = VISIBLE.replace(
    **{
        "quantum_efficiency.curves": {"mono": (0.6, 0.3)},
        "quantum_efficiency.wavelengths_nm": (400, 1000),
    }
)
NARROW: Any = {"wavelength_nm": 550, "denoise": False, "seed": 3}
OURS = '<sampler type="multijitter"/>'
FILM = """<film type="specfilm"><integer name="width" value="12"/><integer name="height" value="8"/>
<string name="component_format" value="float32"/><rfilter type="box"/>
<spectrum name="band" value="360:1, 830:1"/></film>"""
SENSOR = (
    '<sensor type="perspective"><float name="fov" value="60"/>{more}'
    + FILM
    + OURS
    + "</sensor>"
)
WHITE = '<emitter type="constant"><spectrum name="radiance" value="1e-4"/></emitter>'
GREY = BALL.format(
    bsdf='<bsdf type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf>'
)
RED = BALL.format(
    bsdf='<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.1, 0.1"/></bsdf>'
)
POINT = '<emitter type="point"><spectrum name="intensity" value="1"/></emitter>'
PROJECTOR = '<emitter type="projector"><spectrum name="irradiance" value="1"/></emitter>'


@pytest.fixture(
    autouse=True,
    params=["scalar_spectral", exhaustive("llvm_ad_spectral")],
)
def variant(request: pytest.FixtureRequest) -> str:
    """Every finding in both: the parser's colours and spectra are other types in JIT variants."""
    return use(choose_variant(skip_unless_usable(request.param))).variant()


def sensor(more: str = "") -> str:
    return SENSOR.replace("{more}", more)


def clean(*elements: str, more: str = "") -> str:
    """A scene with nothing to find, and these elements."""
    return scene_text(WHITE, GREY, *elements, sensor=sensor(more))


def findings(
    folder: Path, text: str, camera: ms.Camera = VISIBLE, scene_unit: str | None = None
) -> tuple[Finding, ...]:
    return inspect_scene(write_scene(folder, text), camera, {}, scene_unit)


def light(value: str) -> str:
    return scene_text(f'<emitter type="constant">{value}</emitter>', GREY, sensor=sensor())


@pytest.mark.parametrize("camera", [VISIBLE, INFRARED], ids=["visible", "infrared"])
def test_a_clean_scene_has_no_finding(tmp_path: Path, camera: ms.Camera) -> None:
    """A uniform light and a uniform grey reach everywhere."""
    assert findings(tmp_path, clean(), camera) == ()


@pytest.mark.parametrize("name", (*SHIPPED, "one_file", "first_frame"))
def test_the_shipped_scenes_are_clean_from_360_to_830_nm(name: str) -> None:
    camera = VISIBLE.replace(**{"quantum_efficiency.wavelengths_nm": (360, 830)})
    size = {"width": 16, "height": 12}
    found = inspect_scene(SCENES / f"{name}.xml", camera, size, None)
    assert all("the brightest lamp has" in one.what and one.level == "fact" for one in found)


DARK = [
    ('<spectrum type="d65" name="radiance"/>', "360 to 830"),
    ('<rgb name="radiance" value="1, 1, 1"/>', "360 to 830"),
    ('<spectrum type="blackbody" name="radiance"><float name="temperature" value="3000"/></spectrum>', "360 to 830"),
    ('<spectrum name="radiance" value="350:1, 900:1"/>', "350 to 900"),
    ('<spectrum type="irregular" name="radiance"><string name="wavelengths" value="300, 700"/>'
     '<string name="values" value="1, 1"/></spectrum>', "300 to 700"),
    ('<spectrum type="regular" name="radiance"><float name="wavelength_min" value="390"/>'
     '<float name="wavelength_max" value="940"/><string name="values" value="1, 1"/></spectrum>', "390 to 940"),
]  # fmt: skip


@pytest.mark.parametrize(("value", "ends"), DARK)
def test_a_light_that_ends_inside_the_band_is_black(
    tmp_path: Path, value: str, ends: str
) -> None:
    """Found for a camera that sees to 1000 nm, with the two ends; the flat light of the clean scene is not."""
    (found,) = findings(tmp_path, light(value), INFRARED)
    assert (
        found.level == "black" and f"light in 1 place is black outside {ends} nm" in found.what
    )
    assert "line" in found.where and "400 to 1000" in found.remedy


@pytest.mark.parametrize(
    "texture",
    [
        '<texture type="srgb" name="radiance"><rgb name="color" value="0.9, 0.5, 0.5"/></texture>',
        '<texture type="checkerboard" name="radiance"><rgb name="color0" value="0.9, 0.5, 0.5"/></texture>',
        '<texture type="bitmap" name="radiance"><string name="filename" value="grey.exr"/></texture>',
    ],
)
def test_a_coloured_texture_of_a_lamp_is_held_beyond_the_visible(
    tmp_path: Path, texture: str
) -> None:
    """Unlike an rgb lamp it is not multiplied by D65, which is told to every camera, and does not end: Mitsuba would
    extrapolate it."""
    mi = mitsuba()
    mi.Bitmap(np.full((2, 2, 3), 0.5, np.float32)).write(str(tmp_path / "grey.exr"))
    emitter = f'<emitter type="area">{texture}</emitter>'
    lamp = f'<shape type="sphere"><point name="center" value="0, 0, 4"/>{emitter}</shape>'
    held, flat, brightest = findings(tmp_path, clean(lamp), INFRARED)
    assert held.level == "note" and "keeps its value at 700 nm" in held.what
    assert flat.level == "note" and "is not multiplied by D65" in flat.what
    assert brightest.level == "fact"
    assert findings(tmp_path, clean(lamp)) == (flat, brightest)


@pytest.mark.parametrize(("kind", "ends"), [("envmap", "360 to 830"), ("sunsky", "320 to 720")])
def test_a_sky_is_black_beyond_its_data(tmp_path: Path, kind: str, ends: str) -> None:
    mi = mitsuba()
    mi.Bitmap(np.full((4, 8, 3), 0.5, np.float32)).write(str(tmp_path / "sky.exr"))
    file = '<string name="filename" value="sky.exr"/>' if kind == "envmap" else ""
    text = scene_text(f'<emitter type="{kind}">{file}</emitter>', GREY, sensor=sensor())
    (found,) = findings(tmp_path, text, INFRARED)
    assert found.level == "black" and f"outside {ends} nm" in found.what
    assert findings(tmp_path, text) == ()


def test_what_is_called_black_is_black(tmp_path: Path) -> None:
    """Mitsuba itself: each of these lights is zero at 950 nm, the flat one is not."""
    mi = use(choose_variant("scalar_spectral"))

    def radiance(value: str) -> float:
        path = write_scene(tmp_path, light(value))
        point = mi.SurfaceInteraction3f()
        point.wavelengths = [950.0] * 4
        return float(mi.load_file(str(path)).environment().eval(point)[0])

    assert [radiance(value) for value, _ in DARK] == [0.0] * len(DARK)
    assert radiance('<spectrum name="radiance" value="1"/>') == pytest.approx(1)


def test_a_reflectance_that_ends_is_black_in_all_its_places(tmp_path: Path) -> None:
    short = BALL.format(
        bsdf='\n<bsdf type="diffuse"><spectrum name="reflectance" value="450:0.5, 650:0.5"/></bsdf>'
    )
    (found,) = findings(tmp_path, clean(short, short))
    assert (found.level, found.where) == ("black", "lines 4, 5")
    assert "'reflectance' in 2 places is black outside 450 to 650 nm" in found.what


@pytest.mark.parametrize("bsdf", ["rgb", "bitmap"])
def test_colours_are_held_beyond_the_visible(tmp_path: Path, bsdf: str) -> None:
    """Told to an infrared camera only; below 360 nm they are Mitsuba's guess."""
    mi = mitsuba()
    mi.Bitmap(np.full((2, 2, 3), 0.5, np.float32)).write(str(tmp_path / "grey.exr"))
    picture = (
        '<bsdf type="diffuse"><texture type="bitmap" name="reflectance">{}</texture></bsdf>'
    )
    ball = (
        RED
        if bsdf == "rgb"
        else BALL.format(bsdf=picture.format('<string name="filename" value="grey.exr"/>'))
    )
    (found,) = findings(tmp_path, clean(ball), INFRARED)
    assert found.level == "note"
    assert "beyond 700 nm rgb in 1 place keeps its value at 700 nm" in found.what
    assert findings(tmp_path, clean(ball)) == ()
    ultraviolet = INFRARED.replace(**{"quantum_efficiency.wavelengths_nm": (300, 650)})
    (found,) = findings(tmp_path, clean(ball), ultraviolet)
    assert found.level == "wrong" and "is extrapolated below 360 nm" in found.what


def test_a_float_light_is_d65_and_is_told(tmp_path: Path) -> None:
    """Found, and true: Mitsuba's float light has the ratio of D65 between two wavelengths, its spectrum is flat."""
    (found,) = findings(tmp_path, light('<float name="radiance" value="1"/>'))
    assert (
        found.level == "wrong" and "a float in 1 place gives the spectrum of D65" in found.what
    )
    mi = use(choose_variant("scalar_spectral"))

    def ratio(value: str) -> float:
        emitter = mi.load_file(str(write_scene(tmp_path, light(value)))).environment()
        point = mi.SurfaceInteraction3f()
        point.wavelengths = [450.0, 650.0, 450.0, 650.0]
        radiance = np.array(emitter.eval(point))
        return float(radiance[0] / radiance[1])

    assert ratio('<float name="radiance" value="1"/>') == pytest.approx(
        117.008 / 80.0268, rel=1e-3
    )  # CIE D65
    assert ratio('<spectrum name="radiance" value="1"/>') == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize(
    "lamp",
    [POINT, POINT.replace("point", "spot"), PROJECTOR],
    ids=["point", "spot", "projector"],
)
def test_a_point_light_needs_the_scene_unit(tmp_path: Path, lamp: str) -> None:
    """A note where the unit is unknown; wrong, with the factor, in millimetres; nothing in metres."""
    text = clean(lamp)
    (unknown,) = findings(tmp_path, text)
    (wrong,) = findings(tmp_path, text, scene_unit="mm")
    assert unknown.level == "note" and "not known" in unknown.what
    assert wrong.level == "wrong" and wrong.remedy == "multiply its intensity by 1e+06"
    assert findings(tmp_path, text, scene_unit="m") == ()


def test_the_factor_of_the_point_light_is_right(tmp_path: Path) -> None:
    """The same lamp and wall in millimetres is 1e-6 as bright, which the named factor undoes."""
    mi = use(choose_variant("scalar_spectral"))

    def wall(unit: float) -> float:
        lamp = {
            "type": "point",
            "position": [0, 0, 2 / unit],
            "intensity": {"type": "spectrum", "value": 1.0},
        }
        scene = mi.load_dict({"type": "scene", "lamp": lamp})
        point = mi.SurfaceInteraction3f()
        point.wavelengths = [550.0] * 4
        return float(scene.emitters()[0].sample_direction(point, [0.5, 0.5])[1][0])

    assert (
        wall(1e-3) * 1e6 == pytest.approx(wall(1.0), rel=1e-5) == pytest.approx(0.25, rel=1e-3)
    )


CLIPPED = [
    ('<float name="near_clip" value="3.5"/>', "near_clip is 3.5 and the scene begins at 3"),
    ('<float name="near_clip" value="6"/>', "near_clip is 6"),
    ('<float name="far_clip" value="4.5"/>', "far_clip is 4.5 and the scene extends to 5"),
]


@pytest.mark.parametrize(("more", "sentence"), CLIPPED)
def test_clip_planes_that_cut_the_scene_are_told(
    tmp_path: Path, more: str, sentence: str
) -> None:
    """A ball of radius 1 stands 4 before the sensor: its box goes from 3 to 5."""
    (found,) = findings(tmp_path, clean(more=more))
    assert found.level == "black" and sentence in found.what


def test_clip_planes_that_cut_nothing_are_not_told(tmp_path: Path) -> None:
    more = '<float name="near_clip" value="3"/><float name="far_clip" value="5"/>'
    assert findings(tmp_path, clean(more=more)) == ()
    turned = '<transform name="to_world"><lookat origin="0, 0, 20" target="0, 0, 0" up="0, 1, 0"/></transform>'
    (found,) = findings(tmp_path, clean(more=turned + '<float name="far_clip" value="16"/>'))
    assert "extends to 17" in found.what, "depths are along the view, not along z"


@pytest.mark.parametrize("radius", [0, 1e-6])
def test_a_shape_without_size_is_told(tmp_path: Path, radius: float) -> None:
    point = f'<shape type="sphere" id="bead"><float name="radius" value="{radius}"/></shape>'
    told = [
        (one.level, one.where)
        for one in findings(tmp_path, clean(point))
        if "no size" in one.what
    ]
    assert told == ([] if radius else [("note", "shape 'bead'")])


@pytest.mark.parametrize(("name", "value"), [("shutter_open", -1), ("shutter_close", 1)])
def test_a_shutter_does_nothing(tmp_path: Path, name: str, value: int) -> None:
    (found,) = findings(tmp_path, clean(more=f'<float name="{name}" value="{value}"/>'))
    assert (
        found.level == "wrong" and "change nothing" in found.what and "exposure" in found.remedy
    )


INTEGRATORS = [
    (
        '<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>',
        "wrong",
        "hide_emitters",
    ),
    (
        '<integrator type="path"><integer name="max_depth" value="3"/></integrator>',
        "note",
        "after 3 segments",
    ),
    ('<integrator type="direct"/>', "note", "after 2 segments, which loses 0.25"),
    (
        '<integrator type="stokes"><integrator type="path"/></integrator>',
        "note",
        "'stokes' adds channels",
    ),
]


@pytest.mark.parametrize(("text", "level", "sentence"), INTEGRATORS)
def test_integrators_that_leave_out_light_are_told(
    tmp_path: Path, text: str, level: str, sentence: str
) -> None:
    (found,) = findings(tmp_path, clean(text))
    assert found.level == level and sentence in found.what


def test_short_paths_are_enough_for_a_flat_chart(tmp_path: Path) -> None:
    """What lies in one plane does not light itself."""
    chart = '<shape type="rectangle"><transform name="to_world"><translate z="4"/></transform></shape>'
    assert (
        findings(
            tmp_path, scene_text(WHITE, chart, '<integrator type="direct"/>', sensor=sensor())
        )
        == ()
    )


@pytest.mark.parametrize(
    ("text", "code"),
    [(clean(), 0), (clean(POINT), 0), (light('<float name="radiance" value="1"/>'), 1)],
)
def test_the_exit_code_tells_light_that_is_wrong_from_notes(
    tmp_path: Path, cli: Callable[..., Any], text: str, code: int
) -> None:
    done = cli("lint", write_scene(tmp_path, text), "--variant", "scalar_spectral")
    assert done.exit_code == code, done.output
    assert ("nothing to say" in done.stdout) == (text == clean())


def test_json_holds_every_finding(tmp_path: Path, cli: Callable[..., Any]) -> None:
    path = write_scene(tmp_path, clean(POINT, more='<float name="shutter_close" value="1"/>'))
    done = cli("lint", path, "--variant", "scalar_spectral", "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == 1 and [one["level"] for one in found] == ["wrong", "note"]
    assert all(set(one) == {"level", "where", "what", "remedy"} for one in found)
    assert (
        json.loads(
            cli(
                "lint", path, "--scene-unit", "m", "--variant", "scalar_spectral", "--json"
            ).stdout
        )
        == found[:1]
    )


def test_the_camera_decides_the_band(tmp_path: Path, cli: Callable[..., Any]) -> None:
    """The one asked for, else the one that the scene names, else the usual one."""
    film = '<film type="photosensor"><string name="camera" value="rgbir_2mp"/></film>'
    daylight = light('<spectrum type="d65" name="radiance"/>')
    path = write_scene(tmp_path, daylight.replace(FILM, film))
    assert cli("lint", path, "--variant", "scalar_spectral").exit_code == 1
    path = write_scene(tmp_path, daylight)
    assert cli("lint", path, "--variant", "scalar_spectral").exit_code == 0
    assert (
        cli("lint", path, "--variant", "scalar_spectral", "--camera", "rgbir_2mp").exit_code
        == 1
    )
    assert cli("lint", path, "--variant", "scalar_spectral", "--camera", "leica").exit_code == 2


@pytest.mark.filterwarnings("ignore:too far from the sensor")
@pytest.mark.parametrize(
    ("kind", "radius", "centre", "distances"),
    [
        exhaustive("sphere", 1.0, 0.0, (2500, 10_000)),
        exhaustive("sphere", 100.0, 0.0, (120_000, 1_000_000)),
        exhaustive("sphere", 1.0, 100.0, (100_000, 1_000_000)),
        ("cylinder", 1.0, 0.0, (40, 100)),
        exhaustive("cylinder", 0.01, 0.0, (3, 8)),
        exhaustive("cylinder", 100.0, 100.0, (3000, 10_000)),
        exhaustive("disk", 1.0, 0.0, (1200, 5000)),
        exhaustive("rectangle", 1.0, 0.0, (40, 1_000_000)),
    ],
)
def test_shapes_that_float32_renders_wrong_are_found(
    variant: str, kind: str, radius: float, centre: float, distances: tuple[float, float]
) -> None:
    """A convex body of reflectance 0.5 under a uniform sky has half its radiance, and a finding where it has not."""
    transform = mitsuba().ScalarTransform4f
    shape = {
        "to_world": transform().translate([centre, 0, 0]).rotate([1, 0, 0], 40).scale(radius)
    }
    if kind == "cylinder":
        shape = {
            "radius": radius,
            "p0": [centre, -3 * radius, 0],
            "p1": [centre, 3 * radius, 0],
        }
    reflectance = {"type": "spectrum", "value": 0.5}
    bsdf = {"type": "twosided", "side": {"type": "diffuse", "reflectance": reflectance}}
    for distance in distances:
        origin = [centre + 0.3 * distance, 0.5 * distance, 0.66**0.5 * distance]
        pose = transform().look_at(origin=origin, target=[centre, 0, 0], up=[0, 1, 0])
        view = {"fov": math.degrees(0.6 * radius / distance), "far_clip": 10.0 * distance}
        sky = {
            "type": "scene",
            "integrator": {"type": "path"},
            "sensor": {"type": "perspective", "to_world": pose, **view},
            "sky": {"type": "constant", "radiance": {"type": "spectrum", "value": 1e-4}},
        }
        whole, half = (
            ms.render(scene, VISIBLE, ms.Exposure(0.1), spp=64, width=12, **NARROW)
            for scene in (sky, {**sky, "shape": {"type": kind, "bsdf": bsdf, **shape}})
        )
        wrong = abs(half.data.mean() / whole.data.mean() / 0.5 - 1) > 0.01
        far = distance == distances[1] and variant != "scalar_spectral" and kind != "rectangle"
        assert wrong == any("too far from the sensor" in note for note in half.notes) == far


@pytest.mark.parametrize(("radius", "is_told"), [(0.1, True), (1e-4, False)])
def test_an_aperture_that_no_lens_has_is_told(
    tmp_path: Path, radius: float, is_told: bool
) -> None:
    """A radius in metres where the camera's f-number asks for a thousandth of it: f/0.005 is beyond f/0.5, the limit of
    a lens in air."""
    lens = f'<float name="aperture_radius" value="{radius}"/><float name="focus_distance" value="4"/>'
    thin = sensor(lens).replace("perspective", "thinlens")
    found = findings(tmp_path, scene_text(WHITE, GREY, sensor=thin))
    assert [one.level for one in found if "aperture_radius blurs" in one.what] == [
        "note"
    ] * is_told
