"""Each kind of material, light, shape, texture and medium of Mitsuba 3.9.1 once, against plain Mitsuba.

12 × 8 pixels through the same three bands, 64 samples: the mean radiance of a band is known within 2 % or so, and the
bound of 15 % is far outside that. Polarising materials are compared with what they do to unpolarised light.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.load.scene import load_scene
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.scene.parsed_scene import POLARISING
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA = ms.load_camera("konnik_table1")
BANDS = box_bands(CAMERA, np.array([400.0, 500.0, 600.0, 700.0]))
FILM = """<film type="specfilm"><integer name="width" value="12"/><integer name="height" value="8"/>
<rfilter type="box"/><string name="component_format" value="float32"/><spectrum name="b1" value="400:1, 500:1"/>
<spectrum name="b2" value="500:1, 600:1"/><spectrum name="b3" value="600:1, 700:1"/></film>"""
SENSOR = f'<sensor type="perspective"><float name="fov" value="60"/>{FILM}</sensor>'
SKY = '<emitter type="constant"><spectrum name="radiance" value="360:1, 830:1"/></emitter>'
AT = '<point name="center" value="0, 0, 4"/>'
BEHIND = """<shape type="rectangle"><bsdf type="diffuse"/><transform name="to_world"><scale value="9"/>
<rotate y="1" angle="180"/><translate z="6"/></transform></shape>"""
POSE = '<transform name="to_world"><rotate x="1" angle="30"/><translate z="4"/></transform>'
GREY = '<spectrum name="{}" value="0.3"/>'
DIFFUSE = '<bsdf type="diffuse"/>'
MEDIUM = '<medium name="interior" type="{}"><float name="albedo" value="0.8"/>{}</medium>'
CUBE = '<shape type="cube"><bsdf type="null"/>{}' + POSE + "</shape>"


def ball(inside: str) -> str:
    return f'<shape type="sphere">{AT}{inside}</shape>'


def bsdf(kind: str, inside: str = "") -> str:
    return ball(f'<bsdf type="{kind}">{inside}</bsdf>') + SKY


def texture(kind: str, inside: str = "") -> str:
    return bsdf("diffuse", f'<texture type="{kind}" name="reflectance">{inside}</texture>')


def medium(kind: str, inside: str, phase: str = "") -> str:
    return (
        CUBE.format(MEDIUM.format(kind, inside + phase)) + SKY + '<integrator type="volpath"/>'
    )


def phase(kind: str, inside: str = "") -> str:
    return medium(
        "homogeneous",
        '<float name="sigma_t" value="1"/>',
        f'<phase type="{kind}">{inside}</phase>',
    )


def curve(kind: str) -> str:
    return (
        f'<shape type="{kind}"><string name="filename" value="hair.txt"/>{DIFFUSE}{POSE}</shape>'
        + SKY
    )


def light(kind: str, inside: str) -> str:
    return BEHIND + f'<emitter type="{kind}">{inside}</emitter>'


def shape(kind: str, inside: str = "") -> str:
    return f'<shape type="{kind}">{inside}{DIFFUSE}{POSE}</shape>' + SKY


def file(name: str) -> str:
    return f'<string name="filename" value="{name}"/>'


def raw(name: str, use: str) -> str:
    return f'<texture type="bitmap" name="{use}">{file(name)}<boolean name="raw" value="true"/></texture>'


def lamp(kind: str, inside: str) -> str:
    return ball(
        f'<emitter type="area"><spectrum name="radiance" type="{kind}">{inside}</spectrum></emitter>'
    )


TABLE = """<float name="wavelength_min" value="400"/><float name="wavelength_max" value="700"/>
<string name="values" value="0.1, 0.5, 0.2"/>"""
LOOK = '<transform name="to_world"><lookat origin="0, 1, 0" target="0, 0, 6" up="0, 1, 0"/></transform>'
VOLUME = '<volume name="sigma_t" type="{}">{}</volume>'
ATTRIBUTE = '<texture type="mesh_attribute" name="reflectance"><string name="name" value="vertex_color"/></texture>'
GROUP = '<shape type="shapegroup" id="group"><shape type="sphere"><bsdf type="diffuse"/></shape></shape>'

SCENES = {
    "diffuse": bsdf("diffuse", '<rgb name="reflectance" value="0.8, 0.3, 0.1"/>'),
    "conductor": bsdf("conductor", '<string name="material" value="Au"/>'),
    "roughconductor": bsdf("roughconductor", '<string name="material" value="Cu"/>'),
    "dielectric": bsdf("dielectric"),
    "roughdielectric": bsdf("roughdielectric"),
    "thindielectric": bsdf("thindielectric"),
    "plastic": bsdf("plastic"),
    "roughplastic": bsdf("roughplastic"),
    "pplastic": bsdf("pplastic"),
    "principled": bsdf("principled", '<float name="metallic" value="0.5"/>'),
    "principledthin": bsdf("principledthin"),
    "twosided": bsdf("twosided", DIFFUSE),
    "mask": bsdf("mask", DIFFUSE + '<float name="opacity" value="0.4"/>'),
    "blendbsdf": bsdf("blendbsdf", DIFFUSE + '<bsdf type="plastic"/><float name="weight" value="0.4"/>'),
    "bumpmap": bsdf("bumpmap", DIFFUSE + raw("a.exr", "bumps")),
    "normalmap": bsdf("normalmap", DIFFUSE + raw("n.exr", "normalmap")),
    "null": bsdf("null"),
    "hair bsdf": f'<shape type="bsplinecurve">{file("hair.txt")}<bsdf type="hair"/>{POSE}</shape>' + SKY,
    "area": ball('<emitter type="area"><rgb name="radiance" value="2, 1, 1"/></emitter>') + BEHIND,
    "directionalarea": SKY + ball('<emitter type="directionalarea"><spectrum name="radiance" value="1"/></emitter>'),
    "point": light("point", '<rgb name="intensity" value="9, 5, 1"/>'),
    "spot": light("spot", '<float name="cutoff_angle" value="60"/>' + LOOK),
    "directional": light("directional", '<vector name="direction" value="0, -1, 2"/>'),
    "projector": light("projector", f'<texture name="irradiance" type="bitmap">{file("a.exr")}</texture>' + LOOK),
    "rgb environment map": light("envmap", file("a.exr")),
    "sunsky": '<emitter type="sunsky"><vector name="sun_direction" value="1, 0, 1"/></emitter>',
    "timed_sunsky": '<emitter type="timed_sunsky"/>',
    "sphere": shape("sphere"), "disk": shape("disk"), "rectangle": shape("rectangle"), "cube": shape("cube"),
    "cylinder": shape("cylinder"),
    "ply": shape("ply", file("m.ply")), "obj": shape("obj", file("m.obj")),
    "linearcurve": curve("linearcurve"), "bsplinecurve": curve("bsplinecurve"),
    "sdfgrid": shape("sdfgrid", file("sdf.vol")),
    "instance": GROUP + f'<shape type="instance"><ref id="group"/>{POSE}</shape>' + SKY,
    "mesh attribute": f'<shape type="ply">{file("m.ply")}<bsdf type="diffuse">{ATTRIBUTE}</bsdf>{POSE}</shape>' + SKY,
    "merge": f'<shape type="merge"><shape type="cube">{DIFFUSE}{POSE}</shape></shape>' + SKY,
    "bitmap": texture("bitmap", file("a.exr")), "checkerboard": texture("checkerboard"),
    "volume texture": texture("volume", f'<volume name="volume" type="constvolume">{GREY.format("value")}</volume>'),
    "homogeneous": medium("homogeneous", '<rgb name="sigma_t" value="1, 0.5, 0.2"/>'),
    "heterogeneous": medium("heterogeneous", VOLUME.format("gridvolume", file("v.vol"))),
    "constvolume": medium("heterogeneous", VOLUME.format("constvolume", '<float name="value" value="0.5"/>')),
    "hg": phase("hg", '<float name="g" value="0.5"/>'), "rayleigh": phase("rayleigh"), "isotropic": phase("isotropic"),
    "blendphase": phase("blendphase", '<phase type="isotropic"/><phase type="hg"/><float name="weight" value="0.5"/>'),
    "tabphase": phase("tabphase", '<string name="values" value="0.5, 1, 1.5"/>'),
    "d65": lamp("d65", ""),
    "blackbody": lamp("blackbody", '<float name="temperature" value="4000"/>'),
    "regular": lamp("regular", TABLE),
    "volpathmis": medium("homogeneous", '<float name="sigma_t" value="1"/>').replace("volpath", "volpathmis"),
    "direct": ball(DIFFUSE) + SKY + '<integrator type="direct"/>',
    "polarizer": bsdf("polarizer"), "circular": bsdf("circular"), "retarder": bsdf("retarder"),
}  # fmt: skip


def write_files(folder: Path, mi: Any) -> None:
    """What the scenes name: pictures, meshes, curves, volumes."""
    picture = np.linspace(0.1, 0.9, 48, dtype=np.float32).reshape(4, 4, 3)
    mi.Bitmap(picture).write(str(folder / "a.exr"))
    normals = np.tile(np.array([0.5, 0.5, 1.0], np.float32), (4, 4, 1))
    mi.Bitmap(normals).write(str(folder / "n.exr"))
    (folder / "m.obj").write_text(
        "v 0 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 2\n", encoding="utf-8"
    )
    (folder / "hair.txt").write_text(
        "\n".join(f"0 {y} 0 0.4" for y in (-2, -1, 0, 1, 2)), encoding="utf-8"
    )
    names = ["x", "y", "z"], ["r", "g", "b"]
    head = [
        "ply",
        "format ascii 1.0",
        "element vertex 3",
        *(f"property float {n}" for part in names for n in part),
    ]
    head += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    rows = [
        "0 -1 0 0.8 0.1 0.1",
        "1 1 0 0.8 0.1 0.1",
        "-1 1 0 0.8 0.1 0.1",
        "3 0 1 2",
        "3 0 2 1",
    ]
    (folder / "m.ply").write_text("\n".join([*head, *rows, ""]), encoding="utf-8")
    axis = np.linspace(0, 1, 8, dtype=np.float32) - 0.5
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    mi.VolumeGrid((np.sqrt(x**2 + y**2 + z**2) - 0.4).astype(np.float32)[..., None]).write(
        str(folder / "sdf.vol")
    )
    mi.VolumeGrid(np.full((4, 4, 4, 1), 0.5, np.float32)).write(str(folder / "v.vol"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenes")
    write_files(path, use(choose_variant(skip_unless_usable("scalar_spectral"))))
    return path


@pytest.mark.parametrize("name", one_in(2, SCENES))
def test_every_plugin_renders_as_in_plain_mitsuba(folder: Path, name: str) -> None:
    mi = use(choose_variant("scalar_spectral"))
    path = write_scene(folder, f'<scene version="3.0.0">{SENSOR}{SCENES[name]}</scene>')
    scene = mi.load_file(str(path))
    integrator = scene.integrator() or mi.load_dict({"type": "path"})
    plain = np.array(mi.render(scene, integrator=integrator, spp=64, seed=3)).mean(axis=(0, 1))
    parsed = parse(path, {"ignore_polarization": name in POLARISING})
    ours = load_scene(parsed, BANDS, {}).render(1, 64, (0, 8)).mean(axis=(0, 1))
    assert plain.min() > 0
    np.testing.assert_allclose(ours, plain, rtol=0.15)
