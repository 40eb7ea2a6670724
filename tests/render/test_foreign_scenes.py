"""Scenes of other people: what must render does, and what is broken is refused in one sentence with exit code 2."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import (
    BALL,
    SKY,
    scalar_first,
    scene_text,
    skip_unless_usable,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.scene.scene import load_scene
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA = ms.load_camera("konnik_table1")
BANDS = box_bands(CAMERA, np.array([400.0, 500.0, 600.0, 700.0]))
RGB_SKY = '<emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>'
WALL = """<shape type="rectangle">{bsdf}<transform name="to_world">
<scale value="9"/><rotate y="1" angle="180"/><translate z="4"/></transform></shape>"""
PICTURE = """<bsdf type="diffuse"><texture type="bitmap" name="reflectance">
<string name="filename" value="{name}"/>{more}</texture></bsdf>"""
FLAT = '<emitter type="constant"><spectrum name="radiance" value="360:1, 830:1"/></emitter>'


def ready(variant: str = "scalar_spectral") -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


def render_frames(folder: Path, text: str, spp: int = 64, **options: Any) -> np.ndarray:
    """Mean radiance in each band [W m⁻² sr⁻¹ nm⁻¹], (8, 12, 3)."""
    scene = load_scene(write_scene(folder, text), BANDS, {}, **options)
    return scene.render(1, spp, (0, 8)).astype(float) / BANDS.bandwidths_nm


@scalar_first
def test_an_even_environment_map_is_an_even_sky(tmp_path: Path, variant: str) -> None:
    """A picture of 0.5 everywhere shines as <rgb value="0.5"> does, in every band (both good to 1 %, 64 samples)."""
    mi = ready(variant)
    mi.Bitmap(np.full((4, 8, 3), 0.5, np.float32)).write(str(tmp_path / "sky.exr"))
    sky = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    mapped, even = (
        render_frames(tmp_path, scene_text(e), 256).mean(axis=(0, 1)) for e in (sky, RGB_SKY)
    )
    np.testing.assert_allclose(mapped, even, rtol=0.02)


@scalar_first
def test_textures_colour_the_wall(tmp_path: Path, variant: str) -> None:
    """A wall under a sky of radiance 1 is as bright as its reflectance: 0.2 in the left half, 0.6 in the right."""
    mi = ready(variant)
    picture = np.full((2, 2, 3), 0.2, np.float32)
    picture[:, 1] = 0.6
    mi.Bitmap(picture).write(str(tmp_path / "halves.exr"))
    nearest = '<string name="filter_type" value="nearest"/>'
    wall = WALL.format(bsdf=PICTURE.format(name="halves.exr", more=nearest))
    light = render_frames(tmp_path, scene_text(FLAT, wall), 256)
    halves = sorted((light[:, :6].mean(), light[:, 6:].mean()))
    np.testing.assert_allclose(halves, (0.2, 0.6), rtol=0.02)


def test_a_scene_without_a_sensor_is_told_one_that_works_when_pasted(tmp_path: Path) -> None:
    ready()
    with pytest.raises(ms.InputError, match="has no sensor; add one") as caught:
        load_scene(write_scene(tmp_path, scene_text(SKY, sensor="")), BANDS, {})
    element = re.search(r"<sensor.*</sensor>", str(caught.value))
    assert element
    pasted = scene_text(SKY, element[0], sensor="")
    assert load_scene(write_scene(tmp_path, pasted), BANDS, {}).view.half_width > 0


def test_an_old_scene_that_mitsuba_can_upgrade_renders(tmp_path: Path) -> None:
    """Format 0.6: toWorld, maxDepth and fovAxis are understood."""
    ready()
    old = '<integrator type="path"><integer name="maxDepth" value="8"/></integrator>'
    text = scene_text(SKY, old, more='<string name="fovAxis" value="y"/>').replace(
        "3.0.0", "0.6.0"
    )
    assert load_scene(write_scene(tmp_path, text), BANDS, {}).view.half_width == pytest.approx(
        1.5 * np.tan(np.pi / 6)
    )


BROKEN = [
    (scene_text(SKY, '<shape type="ply"><string name="filename" value="bunny.ply"/></shape>'), "bunny.ply"),
    (scene_text(SKY, '<shape type="obj"><string name="filename" value="bunny.obj"/></shape>'), "bunny.obj"),
    (scene_text(SKY, BALL.format(bsdf=PICTURE.format(name="wood.png", more=""))), "wood.png"),
    (scene_text('<emitter type="envmap"><string name="filename" value="sky.hdr"/></emitter>'), "sky.hdr"),
    (scene_text(SKY, '<shape type="spher"/>'), "Did you mean 'sphere'?"),
    (scene_text(SKY, BALL.format(bsdf='<bsdf type="rough_plastic"/>')), "Did you mean 'roughplastic'?"),
    (scene_text(SKY, '<integrator type="pathtracer"/>'), "Did you mean 'ptracer'?"),
    (scene_text(SKY, '<shape type="diffuse"/>'), "does not match the expected type"),
    (scene_text(SKY, '<integrator type="bdpt"/>'), "take 'path'"),
    (scene_text(SKY, '<shape type="ply"/>').replace("3.0.0", "2.0.0"), "format of Mitsuba 2.0.0"),
    (scene_text(SKY, "<shape").replace("3.0.0", "0.5.0"), "format of Mitsuba 0.5.0"),
    (scene_text(SKY, '<subsurface type="dipole"/>').replace("3.0.0", "0.6.0"), "format of Mitsuba 0.6.0"),
    (scene_text(SKY, BALL.format(bsdf='<bsdf type="ward"/>')).replace("3.0.0", "0.6.0"), "format of Mitsuba 0.6.0"),
    (scene_text(SKY, BALL.format(bsdf='<bsdf type="polarizer"/>')), "polarised light, which scalar_spectral does"),
    (scene_text(SKY, BALL.format(bsdf='<bsdf type="circular"/>')), "line 2: 'circular' acts on polarised light"),
    (scene_text(SKY, BALL.format(bsdf='<bsdf type="retarder"/>')), "acts on polarised light"),
    (scene_text(SKY, BALL.format(bsdf='<bsdf type="measured_polarized"/>')), "--ignore-polarization"),
    (scene_text(SKY, '<integrator type="ptracer"/>'), "take 'path'"),
    (scene_text(SKY, '<integrator type="depth"/>'), "take 'path'"),
    (scene_text(SKY, '<shape type="sphere"><float name="radius" value="$size"/></shape>'), "-D name=value"),
    (scene_text(SKY, sensor=""), '<sensor type="perspective">'),
    (scene_text(SKY, sensor='<sensor type="fisheye"/>'), "must be one of perspective"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "sentence"), one_in(3, BROKEN, several=True))
def test_a_broken_scene_is_one_sentence_and_exit_code_2(
    tmp_path: Path, cli: Callable[..., Any], text: str, sentence: str
) -> None:
    path = write_scene(tmp_path, text)
    done = cli("lint", path, "--variant", "scalar_spectral")
    said = " ".join(done.stderr.split())
    assert done.exit_code == 2 and sentence in said and said.startswith("error: "), done.output
    assert "Traceback" not in said and said.count(str(tmp_path)) == said.count(str(path)) == 1
    assert said.endswith((".", "?"))


def test_all_missing_files_are_named_at_once(tmp_path: Path) -> None:
    """Three of them, with their lines, in one sentence; a file that is there is not."""
    ready().Bitmap(np.ones((2, 2, 3), np.float32)).write(str(tmp_path / "here.exr"))
    mesh = '\n<shape type="ply"><string name="filename" value="{}"/></shape>'
    pictures = [
        WALL.format(bsdf=PICTURE.format(name=name, more=""))
        for name in ("here.exr", "wood.png")
    ]
    text = scene_text(SKY, mesh.format("a.ply"), mesh.format("b.ply"), *pictures)
    with pytest.raises(
        ms.InputError, match=r"lacks 3 files: a\.ply \(line 3\), b\.ply \(line 4\), wood\.png"
    ) as caught:
        load_scene(write_scene(tmp_path, text), BANDS, {})
    assert "here.exr" not in str(caught.value)


@pytest.mark.parametrize("kind", ["bdpt", "depth", "ptracer", "pathtracer", "aov"])
def test_integrator_replaces_whatever_the_scene_has_and_says_so(
    tmp_path: Path, kind: str
) -> None:
    ready()
    inside = '<integer name="max_depth" value="2"/><integrator type="direct"/>'
    scene = scene_text(SKY, BALL.format(bsdf=""), '<integrator type="{}">{}</integrator>')
    path = write_scene(tmp_path, scene.format(kind, inside))
    found = load_scene(parse(path, {"integrator": "path"}), BANDS, {})
    plain = write_scene(tmp_path, scene.format("path", '<integer name="max_depth" value="2"/>'))
    assert (
        found.render(1, 16, (0, 8)) == load_scene(plain, BANDS, {}).render(1, 16, (0, 8))
    ).all()
    assert any(f"integrator '{kind}' is replaced by 'path'" in note for note in found.notes)


def test_polarising_elements_act_on_unpolarised_light_where_that_is_asked_for(
    tmp_path: Path,
) -> None:
    """An ideal linear or circular polarizer lets half of it through, a retarder all; a note says what is wrong then."""
    ready()
    pane = '<shape type="rectangle"><bsdf type="{}"/><transform name="to_world"><scale value="9"/><translate z="2"/>'
    for kind, share in (("polarizer", 0.5), ("circular", 0.5), ("retarder", 1.0)):
        path = write_scene(
            tmp_path, scene_text(FLAT, pane.format(kind) + "</transform></shape>")
        )
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
        "v 0 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 2\n", encoding="utf-8"
    )
    group = """<scene version="3.0.0"><shape type="shapegroup" id="group"><shape type="obj">
    <string name="filename" value="m.obj"/></shape></shape></scene>"""
    (tmp_path / "inner.xml").write_text(group, encoding="utf-8")
    (tmp_path / "outer.xml").write_text(
        '<scene version="3.0.0"><include filename="inner.xml"/></scene>', encoding="utf-8"
    )
    paths = '<default name="folder" value="nowhere"/><path value="$folder"/><include filename="outer.xml"/>'
    pose = '<transform name="to_world"><translate z="4"/></transform>'
    text = scene_text(SKY, f'<shape type="instance"><ref id="group"/>{pose}</shape>')
    path = write_scene(tmp_path, text.replace('3.0.0">', f'3.0.0">{paths}', 1))
    found = load_scene(path, BANDS, {"folder": "meshes"}).render(1, 16, (0, 8))
    empty = load_scene(write_scene(tmp_path, scene_text(SKY)), BANDS, {}).render(1, 16, (0, 8))
    assert found.mean() < 0.99 * empty.mean()
    with pytest.raises(ms.InputError, match="nowhere"):
        load_scene(
            write_scene(tmp_path, text.replace('3.0.0">', f'3.0.0">{paths}', 1)), BANDS, {}
        )


def test_what_a_compiled_variant_cannot_render_is_told_the_one_that_can(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """timed_sunsky of Mitsuba 3.9.1 works in scalar variants only, and its failure would spoil all later renders."""
    path = write_scene(
        tmp_path, scene_text('<emitter type="timed_sunsky"/>', BALL.format(bsdf=""))
    )
    variant = skip_unless_usable("llvm_ad_spectral")
    done = cli("render", path, "-o", tmp_path / "out", "--spp", 16, "--variant", variant)
    said = " ".join(done.stderr.split())
    assert done.exit_code == 2 and "take `--variant scalar_spectral`" in said
