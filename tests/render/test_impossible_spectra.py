"""Spectra that end too early and values that cannot be: each is told, and what Mitsuba makes of it is as it is told."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import BALL, scalar_first, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.files.ply_colours import largest_colour
from mitsuba_sensor.render.lint.finding import Finding
from mitsuba_sensor.render.scene.scene import inspect_scene
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

VISIBLE = ms.load_camera("konnik_table1")  # 400 to 700 nm
INFRARED = ms.load_camera("rgbir_2mp")  # 390 to 1000 nm
SKY = '<emitter type="constant"><spectrum name="radiance" value="0.01"/></emitter>'
EXPOSURE = ms.Exposure(0.05)


@pytest.fixture(autouse=True)
def variant() -> str:
    return use(choose_variant(skip_unless_usable("scalar_spectral"))).variant()


def serious(folder: Path, *elements: str, camera: ms.Camera = VISIBLE) -> list[Finding]:
    """Findings but notes and facts, and those of metals, of a scene of these elements."""
    found = inspect_scene(write_scene(folder, scene_text(*elements)), camera, {}, None)
    return [x for x in found if x.level not in ("note", "fact") or "table" in x.what]


def ball(reflectance: str, kind: str = "diffuse") -> str:
    return BALL.format(bsdf=f'<bsdf type="{kind}">{reflectance}</bsdf>')


def grey(value: str, name: str = "reflectance") -> str:
    return f'<spectrum name="{name}" value="{value}"/>'


def texture(kind: str, inside: str, name: str = "reflectance") -> str:
    return f'<texture type="{kind}" name="{name}">{inside}</texture>'


def picture(folder: Path, name: str, value: float, channels: int) -> str:
    mitsuba().Bitmap(np.full((2, 2, channels), value, np.float32)).write(str(folder / name))
    return texture("bitmap", f'<string name="filename" value="{name}"/>')


def render(
    text: str, camera: ms.Camera = INFRARED, width: int = 8, variant: str = "scalar_spectral"
) -> ms.Irradiance:
    return ms.render(text, camera, EXPOSURE, width=width, spp=8, variant=variant, denoise=False)


D65_BY_DEFAULT = {
    "constant": "{}",
    "point": "{}",
    "spot": "{}",
    "directional": "{}",
    "projector": "{}",
    "area": '<shape type="sphere">{}</shape>',
}


@pytest.mark.parametrize("kind", D65_BY_DEFAULT)
def test_mitsuba_gives_a_light_without_a_spectrum_that_of_d65(kind: str) -> None:
    mi = mitsuba()
    shape = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 2], [0, 0, 0], [0, 1, 0]),
    }
    lamp = {**shape, "emitter": {"type": kind}} if kind == "area" else {"type": kind}
    if kind in ("spot", "projector"):
        lamp["to_world"] = shape["to_world"]
    if kind == "directional":
        lamp["direction"] = [0, 0, -1]
    if kind == "point":
        lamp["position"] = [0, 0, 2]
    point = mi.SurfaceInteraction3f()
    point.wavelengths, point.n = [355.0, 450.0, 650.0, 835.0], [0, 0, 1]
    scene = mi.load_dict(
        {"type": "scene", "lamp": lamp, "bead": {"type": "sphere", "radius": 0.1}}
    )
    weight = np.array(scene.emitters()[0].sample_direction(point, [0.5, 0.5])[1])
    assert weight[0] == weight[3] == 0.0
    assert weight[1] / weight[2] == pytest.approx(117.008 / 80.0268, rel=1e-3)  # CIE D65


TOO_LARGE = [
    (grey("1.3"), "1.3", "from 0 to 1"),
    (grey("300:40, 1100:40"), "40", "percent"),
    (grey("300:0.2, 450:200, 1100:0.2"), "200", "0 to 255"),
    ('<float name="reflectance" value="1.3"/>', "1.3", "from 0 to 1"),
    (texture("uniform", '<float name="value" value="1.5"/>'), "1.5", "from 0 to 1"),
    (texture("checkerboard", '<spectrum name="color0" value="3"/>'), "3", "percent"),
    (
        texture(
            "irregular",
            '<string name="wavelengths" value="300 800"/><string name="values" value="7 7"/>',
        ),
        "7",
        "percent",
    ),
    (
        texture(
            "regular",
            '<float name="wavelength_min" value="300"/><float name="wavelength_max" value="800"/>'
            '<string name="values" value="0.1, 9"/>',
        ),
        "7.22",  # at 700 nm, where the camera ends
        "percent",
    ),
]


@pytest.mark.parametrize(("reflectance", "largest", "remedy"), TOO_LARGE)
def test_a_reflectance_above_one_is_wrong(
    tmp_path: Path, reflectance: str, largest: str, remedy: str
) -> None:
    (finding,) = serious(tmp_path, SKY, ball(reflectance))
    assert (
        finding.level == "wrong"
        and f"'reflectance' in 1 place is as large as {largest}" in finding.what
    )
    assert remedy in finding.remedy


def test_negative_light_is_wrong_and_counted(tmp_path: Path) -> None:
    """A constant, a colour and a sky of 2 × 2 pixels; tables with negative values are refused by Mitsuba."""
    lamp = '<emitter type="constant">{}</emitter>'
    sky = picture(tmp_path, "sky.exr", -0.5, 3).replace('name="reflectance"', "")
    sky = sky.replace("<texture", "<emitter").replace("</texture", "</emitter")
    scenes = {
        1: [
            (SKY, ball(grey("-0.5"))),
            (lamp.format('<spectrum name="radiance" value="-0.5"/>'),),
            (lamp.format('<rgb name="radiance" value="-0.5, 1, 2"/>'),),
        ],
        12: [(sky.replace('type="bitmap"', 'type="envmap"'),)],
    }
    for count, elements in ((n, one) for n, several in scenes.items() for one in several):
        (finding,) = serious(tmp_path, *elements)
        assert finding.level == "wrong"
        assert f"has {count} value(s) below 0, as small as -0.5" in finding.what


def test_a_table_in_micrometres_is_told(tmp_path: Path) -> None:
    """Mitsuba reads nm, and finds no light there."""
    found = serious(tmp_path, SKY, ball(grey("0.3:0.5, 1.1:0.5")))
    assert any("in µm, multiply them by 1000" in finding.remedy for finding in found)


@pytest.mark.parametrize(
    ("channels", "effect"), [(1, "more light is sent out"), (3, "Mitsuba takes 1 instead")]
)
def test_pictures_above_one_are_wrong(tmp_path: Path, channels: int, effect: str) -> None:
    (finding,) = serious(tmp_path, SKY, ball(picture(tmp_path, "p.exr", 3.0, channels)))
    assert (
        finding.level == "wrong" and "as large as 3" in finding.what and effect in finding.what
    )


@pytest.mark.parametrize("channels", [1, 3])
def test_a_picture_above_one_is_clamped_as_a_lamp(tmp_path: Path, channels: int) -> None:
    """Told of colours, whose light Mitsuba cuts at 1; grey 5 shines with 5."""
    lamp = picture(tmp_path, "bright.exr", 5, channels).replace("reflectance", "radiance")
    place = '<transform name="to_world"><rotate y="1" angle="180"/><scale value="9"/><translate z="4"/></transform>'
    emitter = f'<shape type="rectangle">{place}<emitter type="area">{lamp}</emitter></shape>'
    path = write_scene(tmp_path, scene_text(emitter))
    options = {"spp": 1, "variant": "scalar_spectral", "denoise": False, "wavelength_nm": 550}
    flat = scene_text(emitter.replace(lamp, grey("1", "radiance")))
    light, one = (ms.render(x, VISIBLE, EXPOSURE, width=8, **options) for x in (path, flat))
    assert light.data.mean() / one.data.mean() == pytest.approx(5 if channels == 1 else 1)
    said = [note for note in light.notes if "as large as 5: Mitsuba takes 1 instead" in note]
    assert len(said) == (channels == 3)


VOLPATH = '<integrator type="volpath"/>'


def in_cube(medium: str) -> str:
    place = '<transform name="to_world"><translate z="4"/></transform>'
    return f'<shape type="cube"><bsdf type="null"/>{place}{medium}</shape>'


def test_a_medium_that_returns_more_light_than_it_gets_is_wrong(tmp_path: Path) -> None:
    medium = '<medium name="interior" type="homogeneous"><spectrum name="albedo" value="1.5"/></medium>'
    (finding,) = serious(tmp_path, SKY, in_cube(medium), VOLPATH)
    assert "'albedo' in 1 place is as large as 1.5" in finding.what


@pytest.mark.parametrize("channels", [1, 3])
def test_a_volume_that_returns_more_light_than_it_gets_is_wrong(
    tmp_path: Path, channels: int
) -> None:
    mitsuba().VolumeGrid(np.full((2, 2, 2, channels), 3, np.float32)).write(
        str(tmp_path / "v.vol")
    )
    grid = '<volume name="albedo" type="gridvolume"><string name="filename" value="v.vol"/></volume>'
    medium = f'<medium name="interior" type="heterogeneous">{grid}</medium>'
    (finding,) = serious(tmp_path, SKY, in_cube(medium), VOLPATH)
    assert "'albedo' in 1 place is as large as 3" in finding.what


PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
{properties}element face 2
property list uchar int vertex_indices
end_header
-1 -1 4 {colour}
1 -1 4 {colour}
1 1 4 {colour}
-1 1 4 {colour}
3 0 1 2
3 0 2 3
"""


def mesh(
    folder: Path,
    attribute: str,
    colour: str,
    kind: str = "float",
    names: str = "red green blue",
) -> str:
    """A square whose vertices have a colour, and whose material takes an attribute."""
    properties = "".join(f"property {kind} {name}\n" for name in names.split())
    (folder / "square.ply").write_text(
        PLY.format(properties=properties, colour=colour), encoding="utf-8"
    )
    inside = texture("mesh_attribute", f'<string name="name" value="{attribute}"/>')
    bsdf = f'<bsdf type="twosided"><bsdf type="diffuse">{inside}</bsdf></bsdf>'
    return f'<shape type="ply"><string name="filename" value="square.ply"/>{bsdf}</shape>'


@scalar_first
def test_an_attribute_that_the_mesh_does_not_have_is_refused(
    tmp_path: Path, variant: str
) -> None:
    use(choose_variant(skip_unless_usable(variant)))
    with pytest.raises(
        ms.InputError, match=r"no attribute 'vertex_albedo'.*it has vertex_color"
    ):
        serious(tmp_path, SKY, mesh(tmp_path, "vertex_albedo", "0.8 0.2 0.1"))
    assert serious(tmp_path, SKY, mesh(tmp_path, "vertex_color", "0.8 0.2 0.1")) == []


@pytest.mark.parametrize(("kind", "names"), [("uchar", "red green blue"), ("float", "r g b")])
def test_colours_of_vertices_from_0_to_255_are_wrong(
    tmp_path: Path, kind: str, names: str
) -> None:
    (finding,) = serious(
        tmp_path, SKY, mesh(tmp_path, "vertex_color", "100 200 50", kind, names)
    )
    assert finding.level == "wrong" and "'square.ply' are as large as 200" in finding.what
    read = loaded_colours(tmp_path)
    mesh(tmp_path, "vertex_color", "1 1 1")
    np.testing.assert_array_equal(read, loaded_colours(tmp_path))


BYTES = b"""ply
format binary_big_endian 1.0
element vertex 2
property double x
property uchar red
property ushort green
property float blue
end_header
"""


def test_colours_of_vertices_are_read_from_bytes_and_a_damaged_file_has_none(
    tmp_path: Path,
) -> None:
    """Two vertices as struct writes them; then the file cut after each of its bytes."""
    content = BYTES + struct.pack(">dBHfdBHf", 1e9, 3, 300, 0.5, 1e9, 255, 2, 4.0)
    path = tmp_path / "mesh.ply"
    path.write_bytes(content)
    assert largest_colour(path) == 300
    for length in range(len(content)):
        path.write_bytes(content[:length])
        assert largest_colour(path) is None
    path.write_bytes(content.replace(b"vertex 2", b"vertex 99999999999999999999"))
    assert largest_colour(path) is None


def loaded_colours(folder: Path) -> Any:
    """What Mitsuba makes of the colours of the square."""
    mi = mitsuba()
    square = mi.load_dict({"type": "ply", "filename": str(folder / "square.ply")})
    return np.array(mi.traverse(square)["vertex_color"])


WALL = """<shape type="rectangle"><transform name="to_world"><scale value="9"/><rotate y="1" angle="180"/>
<translate z="4"/></transform><bsdf type="conductor">{}</bsdf></shape>"""
HEAD_ON = '<sensor type="orthographic"><film type="hdrfilm"><integer name="width" value="8"/>{film}</film></sensor>'
SQUARE = '<integer name="height" value="8"/>'
NAMED = '<string name="material" value="Cr"/>'


def test_a_metal_reflects_beyond_its_table_what_its_last_indices_do() -> None:
    """Head-on a sky of 0.01 comes back times ((n − 1)² + k²)/((n + 1)² + k²), the law of Fresnel, at 950 nm too; plain
    Mitsuba has NaN there. n and k are those of the file Cr.eta.spd and Cr.k.spd at 885.57 nm."""
    perfect = '<spectrum name="eta" value="0.01"/><spectrum name="k" value="1000"/>'

    def mean(inside: str) -> float:
        text = scene_text(SKY, WALL.format(inside), film=SQUARE, sensor=HEAD_ON)
        options = {
            "width": 8,
            "spp": 8,
            "variant": "scalar_spectral",
            "denoise": False,
            "wavelength_nm": 950,
        }
        return float(ms.render(text, INFRARED, EXPOSURE, **options).data.mean())

    n, k = 4.38, 4.31
    fresnel = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    assert mean(NAMED) / mean(perfect) == pytest.approx(fresnel, rel=1e-3)


def test_a_metal_within_its_table_stays_as_it_is(tmp_path: Path) -> None:
    assert serious(tmp_path, SKY, ball(NAMED, "conductor")) == []
    (finding,) = serious(
        tmp_path,
        SKY,
        ball('<string name="material" value="Cu_palik"/>', "roughconductor"),
        camera=INFRARED,
    )
    assert finding.level == "note" and "309.95 to 826.53 nm" in finding.what


@scalar_first
def test_spectra_of_a_loaded_scene_are_looked_at(tmp_path: Path, variant: str) -> None:
    """By its parameters: a metal that is not continued, a lamp of D65, a reflectance of 1.3; and none of them where
    the camera sees nothing of it."""
    mi = use(choose_variant(skip_unless_usable(variant)))
    shapes = ball(NAMED, "conductor"), ball(grey("1.3")), ball(grey("300:0.2, 850:0.5"))
    text = scene_text(*shapes, '<emitter type="constant"/>')
    scene = mi.load_string(text)

    def found(camera: ms.Camera) -> list[tuple[str, str]]:
        findings = inspect_scene(scene, camera, {}, None)
        return [
            (finding.level, finding.what.split(" in ")[0].split(":")[0])
            for finding in findings
            if finding.level not in ("note", "fact")
        ]

    black = [("black", "'reflectance'"), ("black", "'radiance'")]
    wrong = [
        ("wrong", "'eta'"),
        ("wrong", "'k'"),
        ("wrong", "'reflectance' is as large as 1.3"),
    ]
    assert sorted(found(INFRARED)) == sorted([*black, *wrong])
    assert found(VISIBLE) == wrong[2:]


def test_the_share_of_the_photoelectrons_that_rests_on_a_table_is_told() -> None:
    """A flat light, seen by a flat sensor from 400 to 1000 nm and a metal that fills the picture: with E ∝ R(λ) the
    electrons of the bands beyond 885.57 nm, of all, weighed by λ."""
    flat = VISIBLE.replace(
        **{
            "quantum_efficiency.curves": {"mono": (0.5, 0.5)},
            "quantum_efficiency.wavelengths_nm": (400, 1000),
        }
    )
    light = render(scene_text(SKY, ball(NAMED, "conductor")), flat)
    (note,) = (note for note in light.statistics.notes if "where data of the scene end" in note)
    nm = light.wavelengths_nm
    electrons = light.data.mean(axis=(0, 1), dtype=float) * nm
    share = (
        electrons[nm > 880].sum() / electrons.sum()
    )  # the band from 880 to 890 nm reaches beyond
    assert note.startswith(f"up to {share:.1%} of the photoelectrons of the mono pixels")


def test_lint_says_what_share_of_a_flat_spectrum_is_beyond(tmp_path: Path) -> None:
    """∫λ dλ from 830 to 1000 nm over that from 400 to 1000 nm: 37.0 % for a flat quantum efficiency."""
    flat = VISIBLE.replace(
        **{
            "quantum_efficiency.curves": {"mono": (0.5, 0.5)},
            "quantum_efficiency.wavelengths_nm": (400, 1000),
        }
    )
    share = (1000**2 - 830**2) / (1000**2 - 400**2)
    (finding,) = serious(tmp_path, '<emitter type="constant"/>', camera=flat)
    assert f"the mono pixels detect {share:.1%} of a flat spectrum beyond" in finding.what


@scalar_first
def test_nan_in_an_environment_map_makes_a_render_unreliable(
    tmp_path: Path, variant: str
) -> None:
    mi = use(choose_variant(skip_unless_usable(variant)))
    sky = np.ones((4, 8, 3), np.float32)
    sky[1, 2] = np.nan
    mi.Bitmap(sky).write(str(tmp_path / "sky.exr"))
    lamp = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    path = write_scene(tmp_path, scene_text(ball(grey("0.5")), lamp))
    options = {"width": 8, "spp": 64, "variant": variant, "denoise": False}
    light = ms.render(path, VISIBLE, EXPOSURE, **options)
    assert light.statistics.non_finite > 0 and not light.statistics.reliable
    assert any("were NaN and count as 0" in note for note in light.statistics.notes)
    assert any("the environment map has" in note for note in light.statistics.notes)
    mi.Bitmap(np.ones((4, 8, 3), np.float32)).write(str(tmp_path / "sky.exr"))
    assert ms.render(path, VISIBLE, EXPOSURE, **options).statistics.reliable


def test_a_picture_of_nan_alone_is_not_said_to_lack_an_emitter() -> None:
    own = grey("300:1, 386:1", "eta") + grey("300:3, 386:3", "k")
    with pytest.raises(
        ms.InputError,
        match=r"values of its light were NaN.*perhaps because 'eta' in 1 place is 0",
    ) as error:
        render(scene_text(SKY, WALL.format(own), film=SQUARE, sensor=HEAD_ON))
    assert "emitter" not in str(error.value)
