"""Lint: each finding in a scene that has it and none in the same scene without it; and what it says is true."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive
from helpers.scenes import BALL, SCENES, SHIPPED, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.files.ply_colours import largest_colour
from mitsuba_sensor.render.lint.built_checks import VOLUMETRIC
from mitsuba_sensor.render.lint.finding import Finding
from mitsuba_sensor.render.load.scene import inspect_scene
from mitsuba_sensor.render.scene.mitsuba_errors import gradient_integrators
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

VISIBLE = ms.load_camera("konnik_table1")  # 400 to 700 nm
QE = {"quantum_efficiency.curves": {"mono": (0.5, 0.5)}}
INFRARED = VISIBLE.replace(**QE, **{"quantum_efficiency.wavelengths_nm": (400, 1000)})
ULTRAVIOLET = VISIBLE.replace(**QE, **{"quantum_efficiency.wavelengths_nm": (300, 650)})
EXPOSURE = ms.Exposure(0.05)
SENSOR = (
    '<sensor type="perspective"><float name="fov" value="60"/>{more}<film type="specfilm">'
    '<integer name="width" value="12"/><integer name="height" value="8"/><string name="component_format" '
    'value="float32"/><rfilter type="box"/><spectrum name="band" value="360:1, 830:1"/></film>'
    '<sampler type="multijitter"/></sensor>'
)
WHITE = '<emitter type="constant"><spectrum name="radiance" value="1e-4"/></emitter>'


def ball(reflectance: str, kind: str = "diffuse") -> str:
    return BALL.format(bsdf=f'<bsdf type="{kind}">{reflectance}</bsdf>')


def spectrum(value: str, name: str = "reflectance") -> str:
    return f'<spectrum name="{name}" value="{value}"/>'


def plugin(kind: str, inside: str = "", name: str = "reflectance", tag: str = "texture") -> str:
    return f'<{tag} type="{kind}" name="{name}">{inside}</{tag}>'


def string(name: str, value: str) -> str:
    return f'<string name="{name}" value="{value}"/>'


GREY = ball(spectrum("0.5"))
FILE = '<string name="filename" value="{}"/>'
POINT = f'<emitter type="point">{spectrum("1", "intensity")}</emitter>'
NAMED = '<string name="material" value="Cr"/>'


def sky(inside: str, kind: str = "constant") -> str:
    return f'<emitter type="{kind}">{inside}</emitter>'


def lamp(radiance: str) -> str:
    centre = '<point name="center" value="0, 0, 4"/>'
    return f'<shape type="sphere">{centre}<emitter type="area">{radiance}</emitter></shape>'


def scene(*elements: str, more: str = "", light: str = WHITE) -> str:
    """A scene with nothing to find, and these elements."""
    return scene_text(light, GREY, *elements, sensor=SENSOR.replace("{more}", more))


@pytest.fixture(autouse=True, params=["scalar_spectral", exhaustive("llvm_ad_spectral")])
def variant(request: pytest.FixtureRequest) -> str:
    """Every finding in both: the parser's colours and spectra are other types in JIT variants."""
    return use(choose_variant(skip_unless_usable(request.param))).variant()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pictures of 2 × 2 pixels and a volume, named after their value."""
    mi, place = use(choose_variant("scalar_spectral")), tmp_path_factory.mktemp("pictures")
    for name, value, channels in (
        ("grey", 0.5, 3),
        ("three", 3, 3),
        ("one", 3, 1),
        ("below", -0.5, 3),
    ):
        picture = np.full((2, 2, channels), value, np.float32)
        mi.Bitmap(picture).write(str(place / f"{name}.exr"))
    mi.VolumeGrid(np.full((2, 2, 2, 3), 3, np.float32)).write(str(place / "three.vol"))
    return place


def findings(
    folder: Path, text: str, camera: ms.Camera = VISIBLE, scene_unit: str | None = None
) -> list[Finding]:
    """But facts."""
    found = inspect_scene(write_scene(folder, text), camera, {}, scene_unit)
    return [one for one in found if one.level != "fact"]


LIMITED_LIGHTS = [
    (plugin("d65", name="radiance", tag="spectrum"), "360 to 830"),
    ('<rgb name="radiance" value="1, 1, 1"/>', "360 to 830"),
    (plugin("blackbody", '<float name="temperature" value="3000"/>', "radiance", "spectrum"), "360 to 830"),
    (spectrum("350:1, 900:1", "radiance"), "350 to 900"),
    (plugin("irregular", string("wavelengths", "300, 700") + string("values", "1, 1"), "radiance", "spectrum"),
     "300 to 700"),
    (plugin("regular", '<float name="wavelength_min" value="390"/><float name="wavelength_max" value="940"/>'
            + string("values", "1, 1"), "radiance", "spectrum"), "390 to 940"),
]  # fmt: skip
COLOURED_LAMPS = [
    plugin("srgb", '<rgb name="color" value="0.9, 0.5, 0.5"/>', "radiance"),
    plugin("checkerboard", '<rgb name="color0" value="0.9, 0.5, 0.5"/>', "radiance"),
    plugin("bitmap", FILE.format("grey.exr"), "radiance"),
]
BITMAP, MEDIUM = (
    plugin("bitmap", FILE.format("{}.exr")),
    '<medium name="interior" type="{}">{}</medium>',
)
BOX = (
    '<shape type="cube"><bsdf type="null"/><transform name="to_world"><translate z="4"/></transform>{}</shape>'
    '<integrator type="volpath"/>'
)
DOT = '<shape type="sphere"><float name="radius" value="0"/><point name="center" value="0, 0, 4"/></shape>'
GRID = plugin("gridvolume", FILE.format("three.vol"), "albedo", "volume")
MORE = "more light is sent out than comes in"
FOUND: list[tuple[str, ms.Camera, str]] = [
    *((scene(light=sky(value)), INFRARED, f"black light in 1 place is black outside {ends} nm")
      for value, ends in LIMITED_LIGHTS),
    (scene(light=sky(FILE.format("grey.exr"), "envmap")), INFRARED, "black outside 360 to 830 nm"),
    (scene(light=sky("", "sunsky")), INFRARED, "black outside 320 to 720 nm"),
    (scene(ball(spectrum("450:0.5, 650:0.5"))), VISIBLE, "black 'reflectance' in 1 place is black outside 450 to 650"),
    (scene(light=sky('<float name="radiance" value="1"/>')), VISIBLE, "wrong gives the spectrum of D65"),
    *((scene(ball(colour)), INFRARED, "note beyond 700 nm rgb in 1 place keeps its value at 700 nm")
      for colour in ('<rgb name="reflectance" value="0.8, 0.1, 0.1"/>', BITMAP.format("grey"))),
    (scene(ball(BITMAP.format("grey"))), ULTRAVIOLET, "wrong is extrapolated below 360 nm"),
    *((scene(lamp(radiance)), VISIBLE, "note is not multiplied by D65") for radiance in COLOURED_LAMPS),
    (scene(POINT), VISIBLE, "note the unit is unknown"),
    (scene(more='<float name="near_clip" value="3.5"/>'), VISIBLE, "black near_clip is 3.5 and the scene begins at 3"),
    (scene(more='<float name="near_clip" value="6"/>'), VISIBLE, "black near_clip is 6"),
    (scene(more='<float name="far_clip" value="4.5"/>'), VISIBLE, "black far_clip is 4.5 and the scene extends to 5"),
    (scene(DOT), VISIBLE, "note no size"),
    (scene(more='<float name="shutter_open" value="-1"/>'), VISIBLE, "wrong change nothing"),
    (scene('<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>'), VISIBLE,
     "wrong hide_emitters"),
    (scene('<integrator type="stokes"><integrator type="path"/></integrator>'), VISIBLE, "note 'stokes' adds channels"),
    (scene(ball(spectrum("1.3"))), VISIBLE, f"wrong 'reflectance' in 1 place is as large as 1.3: {MORE}"),
    (scene(ball(spectrum("300:40, 1100:40"))), VISIBLE, "wrong percent"),
    (scene(ball(spectrum("300:0.2, 450:200, 1100:0.2"))), VISIBLE, "wrong 0 to 255"),
    (scene(ball('<float name="reflectance" value="1.3"/>')), VISIBLE, "wrong as large as 1.3"),
    (scene(ball(plugin("uniform", '<float name="value" value="1.5"/>'))), VISIBLE, "wrong as large as 1.5"),
    (scene(ball(plugin("checkerboard", spectrum("3", "color0")))), VISIBLE, "wrong as large as 3"),
    (scene(ball(plugin("irregular", string("wavelengths", "300 800") + string("values", "7 7")))), VISIBLE,
     "wrong percent"),
    (scene(ball(plugin("regular", '<float name="wavelength_min" value="300"/><float name="wavelength_max" value="800"/>'
                       + string("values", "0.1, 9")))), VISIBLE, "wrong as large as 7.22"),  # at 700 nm
    (scene(ball(spectrum("-0.5"))), VISIBLE, "wrong has 1 value(s) below 0, as small as -0.5"),
    (scene(light=sky('<rgb name="radiance" value="-0.5, 1, 2"/>')), VISIBLE, "wrong has 1 value(s) below 0"),
    (scene(light=sky(FILE.format("below.exr"), "envmap")), VISIBLE, "wrong has 12 value(s) below 0"),
    (scene(ball(spectrum("0.3:0.5, 1.1:0.5"))), VISIBLE, "black in µm, multiply them by 1000"),
    (scene(ball(BITMAP.format("one"))), VISIBLE, f"wrong as large as 3: {MORE}"),
    (scene(ball(BITMAP.format("three"))), VISIBLE, "wrong as large as 3: Mitsuba takes 1 instead"),
    (scene(BOX.format(MEDIUM.format("homogeneous", spectrum("1.5", "albedo")))), VISIBLE, "wrong 'albedo' in 1 place"),
    (scene(BOX.format(MEDIUM.format("heterogeneous", GRID))),
     VISIBLE, "wrong 'albedo' in 1 place is as large as 3"),
    (scene(ball('<string name="material" value="Cu_palik"/>', "roughconductor")), INFRARED, "note 309.95 to 826.53 nm"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "camera", "said"),
    FOUND,
    ids=[f"{number} {said[:30]}" for number, (_, _, said) in enumerate(FOUND)],
)
def test_what_is_wrong_with_a_scene_is_the_one_finding(
    folder: Path, text: str, camera: ms.Camera, said: str
) -> None:
    """said : its level, and words of it."""
    (finding,), (level, _, words) = findings(folder, text, camera), said.partition(" ")
    assert finding.level == level and words in str(finding) and finding.where


@pytest.mark.parametrize(
    "text",
    [
        scene(),
        scene(more='<float name="near_clip" value="3"/><float name="far_clip" value="5"/>'),
        scene(ball(NAMED, "conductor")),
        *(scene(light=sky(value)) for value, _ in LIMITED_LIGHTS[:4]),
    ],
)
def test_a_right_scene_has_no_finding(folder: Path, text: str) -> None:
    """A ball of radius 1 stands 4 before the sensor: its box goes from 3 to 5."""
    assert findings(folder, text) == []


@pytest.mark.parametrize("name", (*SHIPPED, "one_file", "first_frame"))
def test_the_shipped_scenes_are_clean_from_360_to_830_nm(name: str) -> None:
    camera = VISIBLE.replace(**{"quantum_efficiency.wavelengths_nm": (360, 830)})
    size = {"width": 16, "height": 12}
    found = inspect_scene(SCENES / f"{name}.xml", camera, size, None)
    assert all("the brightest lamp has" in one.what and one.level == "fact" for one in found)


def test_places_are_counted_and_named_by_their_lines(folder: Path) -> None:
    short = "\n" + ball(spectrum("450:0.5, 650:0.5"))
    (found,) = findings(folder, scene(short, short))
    assert found.where == "lines 2, 3" and "in 2 places" in found.what


@pytest.mark.parametrize("kind", ["point", "spot", "projector"])
def test_the_factor_of_a_point_light_undoes_the_scene_unit(folder: Path, kind: str) -> None:
    """Wrong in millimetres, nothing in metres. The same lamp at 2 m is then 1e-6 as bright as 1/d² says."""
    name = "irradiance" if kind == "projector" else "intensity"
    text = scene(sky(spectrum("1", name), kind))
    (wrong,) = findings(folder, text, scene_unit="mm")
    assert wrong.level == "wrong" and wrong.remedy == "multiply its intensity by 1e+06"
    assert findings(folder, text, scene_unit="m") == []
    at_2000 = {
        "type": "point",
        "position": [0, 0, 2000],
        "intensity": {"type": "spectrum", "value": 1.0},
    }
    ((radiance, *_),) = seen_from_origin(at_2000, [550.0] * 4)
    assert radiance * 1e6 == pytest.approx(0.25, rel=1e-3)


def seen_from_origin(lamp: dict[str, Any], wavelengths_nm: list[float]) -> np.ndarray:
    """Plain Mitsuba: the light of a lamp at the origin, (1, 4)."""
    mi = use(choose_variant("scalar_spectral"))
    bead = {"type": "sphere", "radius": 0.1}
    built, point = (
        mi.load_dict({"type": "scene", "lamp": lamp, "bead": bead}),
        mi.SurfaceInteraction3f(),
    )
    point.wavelengths, point.n = wavelengths_nm, [0, 0, 1]
    return np.array(built.emitters()[0].sample_direction(point, [0.5, 0.5])[1]).reshape(1, 4)


D65_RATIO = 117.008 / 80.0268  # of 450 nm to 650 nm; CIE


def test_what_is_called_black_or_d65_is_so(tmp_path: Path) -> None:
    """Mitsuba itself: each limited light is zero at 950 nm, a float is D65, and a spectrum of one value is flat."""
    mi = use(choose_variant("scalar_spectral"))

    def radiance(value: str) -> np.ndarray:
        point = mi.SurfaceInteraction3f()
        point.wavelengths = [450.0, 650.0, 950.0, 950.0]
        text = scene(light=sky(value))
        return np.array(
            mi.load_file(str(write_scene(tmp_path, text))).environment().eval(point)
        )

    assert [radiance(value)[2] for value, _ in LIMITED_LIGHTS] == [0.0] * len(LIMITED_LIGHTS)
    flat, d65 = (
        radiance(spectrum("1", "radiance")),
        radiance('<float name="radiance" value="1"/>'),
    )
    np.testing.assert_allclose(flat, 1, rtol=1e-6)
    assert d65[0] / d65[1] == pytest.approx(D65_RATIO, rel=1e-3)


@pytest.mark.parametrize(("channels", "shines"), [("one", 3), ("three", 1)])
def test_a_picture_above_one_is_clamped_as_a_lamp(
    folder: Path, channels: str, shines: float
) -> None:
    """Told of colours, whose light Mitsuba cuts at 1; grey 3 shines with 3."""
    place = '<transform name="to_world"><rotate y="1" angle="180"/><scale value="9"/><translate z="4"/></transform>'
    wall = f'<shape type="rectangle">{place}<emitter type="area">{{}}</emitter></shape>'
    picture = plugin("bitmap", FILE.format(folder / f"{channels}.exr"), "radiance")
    options: Any = {
        "spp": 1,
        "variant": "scalar_spectral",
        "denoise": False,
        "wavelength_nm": 550,
        "width": 4,
    }
    light, one = (
        ms.render(scene_text(wall.format(inside)), VISIBLE, EXPOSURE, **options)
        for inside in (picture, spectrum("1", "radiance"))
    )
    assert light.data.mean() / one.data.mean() == pytest.approx(shines)
    assert any("Mitsuba takes 1 instead" in note for note in light.notes) == (shines == 1)


@pytest.mark.parametrize(
    ("element", "code"),
    [("", 0), (POINT, 0), (ball('<float name="reflectance" value="2"/>'), 1)],
)
def test_the_exit_code_and_json_tell_light_that_is_wrong_from_notes(
    tmp_path: Path, cli: Callable[..., Any], element: str, code: int
) -> None:
    path = write_scene(tmp_path, scene(element))
    done = cli("lint", path, "--variant", "scalar_spectral")
    assert done.exit_code == code, done.output
    assert ("findings: none" in done.stdout) == (not element)
    found = json.loads(cli("lint", path, "--variant", "scalar_spectral", "--json").stdout)
    assert [set(one) for one in found] == [{"level", "where", "what", "remedy"}] * bool(element)


def test_the_camera_decides_the_band(tmp_path: Path, cli: Callable[..., Any]) -> None:
    """The one asked for, else the one that the scene names, else the usual one."""
    daylight = scene_text(sky(LIMITED_LIGHTS[0][0]), film="{film}").replace("hdrfilm", "{kind}")
    own = '<string name="camera" value="rgbir_2mp"/>'
    for kind, film, flags, code in (
        ("photosensor", own, (), 1),
        ("hdrfilm", "", (), 0),
        ("hdrfilm", "", ("--camera", "rgbir_2mp"), 1),
        ("hdrfilm", "", ("--camera", "leica"), 2),
    ):
        path = write_scene(tmp_path, daylight.format(film=film, kind=kind))
        assert cli("lint", path, "--variant", "scalar_spectral", *flags).exit_code == code


def test_lint_says_what_share_of_a_flat_spectrum_is_beyond(folder: Path) -> None:
    """∫λ dλ from 830 to 1000 nm over that from 400 to 1000 nm, for a flat quantum efficiency."""
    share = (1000**2 - 830**2) / (1000**2 - 400**2)
    (finding,) = findings(folder, scene(light='<emitter type="constant"/>'), INFRARED)
    assert f"the mono pixels detect {100 * share:.1f} % of a flat spectrum" in finding.what


WALL = """<shape type="rectangle"><transform name="to_world"><scale value="9"/><rotate y="1" angle="180"/>
<translate z="4"/></transform><bsdf type="conductor">{}</bsdf></shape>"""
HEAD_ON = '<sensor type="orthographic"><film type="hdrfilm"><integer name="width" value="4"/>{film}</film></sensor>'


def head_on(inside: str, **options: Any) -> ms.Irradiance:
    """The light of a sky in a wall of metal."""
    text = scene_text(
        WHITE, WALL.format(inside), film='<integer name="height" value="4"/>', sensor=HEAD_ON
    )
    asked: Any = {"spp": 8, "variant": "scalar_spectral", "denoise": False, **options}
    return ms.render(text, INFRARED, EXPOSURE, **asked)


def test_a_metal_reflects_beyond_its_table_what_its_last_indices_do() -> None:
    """Head-on a sky comes back times ((n − 1)² + k²)/((n + 1)² + k²), the law of Fresnel, at 950 nm too; plain Mitsuba
    has NaN there. n and k are those of the file Cr.eta.spd and Cr.k.spd at 885.57 nm."""
    perfect = spectrum("0.01", "eta") + spectrum("1000", "k")
    named, all_light = (head_on(x, wavelength_nm=950).data.mean() for x in (NAMED, perfect))
    n, k = 4.38, 4.31
    fresnel = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    assert named / all_light == pytest.approx(fresnel, rel=1e-3)


def test_the_share_of_the_photoelectrons_that_rests_on_a_table_is_told() -> None:
    """Of a flat sensor: with E ∝ R(λ) the electrons of the bands beyond 885.57 nm, of all, weighed by λ."""
    light = head_on(NAMED)
    (note,) = (
        note for note in light.notes if "where Mitsuba's table of 'Cr' in 1 place ends" in note
    )
    nm = light.wavelengths_nm
    electrons = light.data.mean(axis=(0, 1), dtype=float) * nm
    share = electrons[nm > 880].sum() / electrons.sum()  # the band from 880 nm reaches beyond
    assert note.startswith(
        f"up to {100 * share:.1f} % of the photoelectrons of the mono pixels"
    )


def test_values_that_are_nan_make_a_render_unreliable_or_are_the_reason_of_darkness(
    tmp_path: Path, variant: str
) -> None:
    own = spectrum("300:1, 386:1", "eta") + spectrum("300:3, 386:3", "k")
    with pytest.raises(ms.InputError, match=r"were NaN.*perhaps because 'eta' in 1 place is 0"):
        head_on(own, wavelength_nm=950)
    pixels = np.ones((4, 8, 3), np.float32)
    for is_reliable in (True, False):
        mitsuba().Bitmap(pixels).write(str(tmp_path / "sky.exr"))
        path = write_scene(tmp_path, scene(light=sky(FILE.format("sky.exr"), "envmap")))
        light = ms.render(
            path, VISIBLE, EXPOSURE, width=8, spp=64, variant=variant, denoise=False
        )
        assert light.statistics.reliable == is_reliable == (light.statistics.non_finite == 0)
        assert any("not finite" in note for note in light.notes) == (not is_reliable)
        pixels[1, 2] = np.nan


def test_spectra_of_a_loaded_scene_are_looked_at(variant: str) -> None:
    """By its parameters: a metal that is not continued, a lamp of D65, a reflectance of 1.3."""
    shapes = ball(NAMED, "conductor"), ball(spectrum("1.3")), ball(spectrum("300:0.2, 850:0.5"))
    loaded = mitsuba().load_string(scene_text(*shapes, '<emitter type="constant"/>'))

    def found(camera: ms.Camera) -> list[tuple[str, str]]:
        serious = [x for x in inspect_scene(loaded, camera, {}, None) if x.is_serious]
        return sorted((x.level, x.what.split("'")[1]) for x in serious)

    black = [("black", "radiance"), ("black", "reflectance")]
    wrong = [("wrong", "eta"), ("wrong", "k"), ("wrong", "reflectance")]
    assert found(INFRARED) == [*black, *wrong] and found(VISIBLE) == wrong[2:]


# Meshes with colours.

PLY = (
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{properties}"
    "element face 2\nproperty list uchar int vertex_indices\nend_header\n-1 -1 4 {colour}\n1 -1 4 {colour}\n"
    "1 1 4 {colour}\n-1 1 4 {colour}\n3 0 1 2\n3 0 2 3\n"
)


def mesh(
    folder: Path, attribute: str, colour: str, kind: str = "float", names: str = "r g b"
) -> str:
    """A square whose vertices have a colour, and whose material takes an attribute."""
    properties = "".join(f"property {kind} {name}\n" for name in names.split())
    (folder / "square.ply").write_text(PLY.format(properties=properties, colour=colour))
    inside = plugin("mesh_attribute", string("name", attribute))
    bsdf = f'<bsdf type="twosided"><bsdf type="diffuse">{inside}</bsdf></bsdf>'
    return f'<shape type="ply">{FILE.format("square.ply")}{bsdf}</shape>'


def test_an_attribute_that_the_mesh_does_not_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ms.InputError, match=r"no attribute 'vertex_albedo'.*it has vertex_color"
    ):
        findings(tmp_path, scene(mesh(tmp_path, "vertex_albedo", "0.8 0.2 0.1")))
    assert findings(tmp_path, scene(mesh(tmp_path, "vertex_color", "0.8 0.2 0.1"))) == []


@pytest.mark.parametrize(("kind", "names"), [("uchar", "red green blue"), ("float", "r g b")])
def test_colours_of_vertices_from_0_to_255_are_wrong(
    tmp_path: Path, kind: str, names: str
) -> None:
    """Mitsuba reads them as 1."""
    (finding,) = findings(
        tmp_path, scene(mesh(tmp_path, "vertex_color", "100 200 50", kind, names))
    )
    assert finding.level == "wrong" and "'square.ply' are as large as 200" in finding.what
    read = []
    for colour in ("100 200 50", "1 1 1"):
        mesh(tmp_path, "vertex_color", colour, kind, names)
        square = mitsuba().load_dict({"type": "ply", "filename": str(tmp_path / "square.ply")})
        read.append(np.array(mitsuba().traverse(square)["vertex_color"]))
    np.testing.assert_array_equal(*read)


def test_colours_of_vertices_are_read_from_bytes_and_a_damaged_file_has_none(
    tmp_path: Path,
) -> None:
    """Two vertices as struct writes them; then the file cut after each of its bytes."""
    header = (
        b"ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty double x\nproperty uchar red\n"
        b"property ushort green\nproperty float blue\nend_header\n"
    )
    content = header + struct.pack(">dBHfdBHf", 1e9, 3, 300, 0.5, 1e9, 255, 2, 4.0)
    path = tmp_path / "mesh.ply"
    path.write_bytes(content)
    assert largest_colour(path) == 300
    for damaged in (
        *(content[:length] for length in range(len(content))),
        content.replace(b"vertex 2", b"vertex 99999999999999999999"),
    ):
        path.write_bytes(damaged)
        assert largest_colour(path) is None


# Lenses and distances.


@pytest.mark.parametrize(("radius", "is_told"), [(0.1, True), (1e-4, False)])
def test_an_aperture_that_no_lens_has_is_told(
    folder: Path, radius: float, is_told: bool
) -> None:
    """A radius in metres where the camera's f-number asks for a thousandth of it: f/0.005 is beyond f/0.5, the limit of
    a lens in air."""
    lens = f'<float name="aperture_radius" value="{radius}"/><float name="focus_distance" value="4"/>'
    found = findings(folder, scene(more=lens).replace("perspective", "thinlens"))
    assert ["aperture_radius blurs" in one.what for one in found] == [True] * is_told


@pytest.mark.filterwarnings("ignore:too far from the sensor")
@pytest.mark.parametrize(
    ("kind", "radius", "centre", "distances"),
    [
        exhaustive("sphere", 1.0, 100.0, (100_000, 1_000_000)),
        ("cylinder", 1.0, 0.0, (40, 100)),
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
        ends = {"p0": [centre, -3 * radius, 0], "p1": [centre, 3 * radius, 0]}
        shape = {"radius": radius, **ends}
    reflectance = {"type": "spectrum", "value": 0.5}
    bsdf = {"type": "twosided", "side": {"type": "diffuse", "reflectance": reflectance}}
    for distance in distances:
        origin = [centre + 0.3 * distance, 0.5 * distance, 0.66**0.5 * distance]
        pose = transform().look_at(origin=origin, target=[centre, 0, 0], up=[0, 1, 0])
        view = {"fov": math.degrees(0.6 * radius / distance), "far_clip": 10.0 * distance}
        empty = {
            "type": "scene",
            "integrator": {"type": "path"},
            "sensor": {"type": "perspective", "to_world": pose, **view},
            "sky": {"type": "constant", "radiance": {"type": "spectrum", "value": 1e-4}},
        }
        options: Any = {
            "wavelength_nm": 550,
            "denoise": False,
            "seed": 3,
            "spp": 64,
            "width": 12,
        }
        whole, half = (
            ms.render(one, VISIBLE, EXPOSURE, **options)
            for one in (empty, {**empty, "shape": {"type": kind, "bsdf": bsdf, **shape}})
        )
        wrong = abs(half.data.mean() / whole.data.mean() / 0.5 - 1) > 0.01
        far = distance == distances[1] and variant != "scalar_spectral" and kind != "rectangle"
        assert wrong == any("too far from the sensor" in note for note in half.notes) == far


# Media.

INTEGRATORS = {"path", "direct", "volpath", "volpathmis", *gradient_integrators()}
FOG = (
    '<medium type="homogeneous" id="fog"><float name="sigma_t" value="0.2"/>'
    '<float name="albedo" value="0"/></medium>'
)
VOLPATH = '<integrator type="volpath"/>'
INSIDE = '<ref name="medium" id="fog"/>'


def backdrop(z: float) -> str:
    place = f'<scale value="50"/><rotate y="1" angle="180"/><translate z="{z}"/>'
    emitter = f'<emitter type="area">{spectrum("1e-3", "radiance")}</emitter>'
    return f'<shape type="rectangle"><transform name="to_world">{place}</transform>{emitter}</shape>'


def cube(scale: float, z: float = 0.0, inside: str = '<ref name="interior" id="fog"/>') -> str:
    place = f'<scale value="{scale}"/><translate z="{z}"/>'
    return f'<shape type="cube"><bsdf type="null"/><transform name="to_world">{place}</transform>{inside}</shape>'


@pytest.mark.exhaustive
def test_the_integrators_called_volumetric_are_those_in_which_fog_absorbs() -> None:
    """Plain Mitsuba: 2 units of fog of 0.2 leave exp(−0.4), 1024 paths within 4 standard errors. The others leave all
    light, or none of it, where they end at the boundary."""
    mi = use(choose_variant(skip_unless_usable("llvm_ad_spectral")))
    band = '<film type="specfilm"><integer name="width" value="4"/><integer name="height" value="4"/>{film}</film>'
    narrow = f'<sensor type="perspective"><float name="fov" value="1"/>{band}</sensor>'
    only = '<spectrum name="band" value="400:1, 700:1"/>'
    room = FOG, backdrop(6), cube(1, 4)
    for kind in sorted(INTEGRATORS - {"volprim_rf_basic"}):  # which has no spectra
        integrator = mi.load_dict({"type": kind})
        built = mi.load_string(scene_text(*room, film=only, sensor=narrow))
        share = (
            float(np.mean(np.array(mi.render(built, integrator=integrator, spp=64, seed=1))))
            / 0.3
        )
        is_volumetric = bool(
            {type(integrator).__name__, integrator.class_name()} & {*VOLUMETRIC}
        )
        assert is_volumetric == (share == pytest.approx(math.exp(-0.4), abs=0.06)), kind
        assert is_volumetric or share in (pytest.approx(1, rel=1e-3), 0.0), kind


REFERENCES = [
    ((cube(9), backdrop(6)), INSIDE, ""),
    ((cube(9), backdrop(6)), "", "inside a medium without a reference"),
    ((cube(1, 3), backdrop(6)), "", ""),
    ((cube(1, 3), backdrop(6)), INSIDE, "refers to a medium and is outside of it"),
    ((cube(9, inside=""), backdrop(6)), INSIDE, ""),  # fog without an end
    ((cube(9, inside=""), backdrop(6)), "", "belongs to no shape"),
    (
        (cube(9), cube(2, inside='<ref name="exterior" id="fog"/>')),
        "",
        "",
    ),  # in a hollow of the fog
]


@pytest.mark.parametrize(("shapes", "reference", "words"), REFERENCES)
def test_a_sensor_refers_to_the_medium_that_it_is_in(
    folder: Path, shapes: tuple[str, ...], reference: str, words: str
) -> None:
    text = scene_text(FOG, *shapes, WHITE, VOLPATH, more=reference)
    found = [one.what for one in findings(folder, text) if "medi" in one.what]
    assert len(found) == bool(words) and all(words in what for what in found)


@pytest.mark.parametrize("kind", ["path", "direct", "aov", ""])
def test_an_integrator_that_renders_no_media_is_told(folder: Path, kind: str) -> None:
    element = f'<integrator type="{kind}"/>' if kind else ""
    found = findings(folder, scene_text(FOG, WHITE, backdrop(6), cube(1, 3), element))
    (finding,) = (one for one in found if "media" in one.what)
    assert finding.level == "wrong" and "volpath" in finding.remedy


@pytest.mark.exhaustive
def test_prbvolpath_begins_in_a_vacuum(folder: Path) -> None:
    """The finding is true: the fog between the sensor and the wall is not there."""
    use(choose_variant(skip_unless_usable("llvm_ad_spectral")))
    prb, volpath = (
        scene_text(FOG, backdrop(5), cube(9), integrator, more=INSIDE)
        for integrator in ('<integrator type="prbvolpath"/>', VOLPATH)
    )
    assert any("'prbvolpath' begins in a vacuum" in one.what for one in findings(folder, prb))
    options: Any = {"spp": 64, "wavelength_nm": 550, "denoise": False, "width": 4}
    absent, present = (ms.render(text, VISIBLE, EXPOSURE, **options) for text in (prb, volpath))
    assert absent.data.mean() > 2 * present.data.mean()
