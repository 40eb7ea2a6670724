"""Parameters of a scene by their names in mi.traverse, another pose of the camera, and renders that repeat."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import (
    PERSPECTIVE,
    SCENES,
    SKY,
    scalar_first,
    scene_text,
    skip_unless_usable,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.render.motion.aovs import render_aovs
from mitsuba_sensor.render.passes.prepared import METERING_SPP
from mitsuba_sensor.render.samples import PASSES_MIN, pass_plan, whole_grid

TABLE1, BAYER, EXPOSURE = (
    ms.load_camera("konnik_table1"),
    ms.load_camera("bayer_2mp"),
    ms.Exposure(0.02),
)
LAMP = """<emitter type="constant" id="lamp"><spectrum name="radiance" type="uniform"><float name="value" value="{}"/>
</spectrum></emitter>"""
VALUE = "lamp.radiance.value"
WALL = """<shape type="rectangle" id="wall"><transform name="to_world"><rotate y="1" angle="180"/><scale value="9"/>
<translate z="4"/></transform></shape>"""
ONE_BAND: dict[str, Any] = {"spp": 16, "wavelength_nm": 550, "denoise": False}
Cli = Callable[..., Any]


@scalar_first
def test_a_parameter_that_is_set_is_the_one_that_the_file_could_have(
    tmp_path: Path, variant: str
) -> None:
    """Radiance 2 by its name in the scene of radiance 1, and in the file: the same bits, another digest than 1."""
    options = {**ONE_BAND, "variant": skip_unless_usable(variant)}
    one = write_scene(tmp_path, scene_text(LAMP.format(1), WALL))
    (tmp_path / "two").mkdir()
    two = write_scene(tmp_path / "two", scene_text(LAMP.format(2), WALL))
    found = ms.render(one, TABLE1, EXPOSURE, traverse={VALUE: 2}, **options)
    np.testing.assert_array_equal(found.data, ms.render(two, TABLE1, EXPOSURE, **options).data)
    plain = ms.render(one, TABLE1, EXPOSURE, **options)
    np.testing.assert_allclose(found.data, 2 * plain.data, rtol=1e-5)
    digests = [
        ms.render(one, TABLE1, EXPOSURE, traverse=x, **options).statistics.scene_sha256
        for x in ({}, {VALUE: 3})
    ]
    assert digests[0] == plain.statistics.scene_sha256
    assert len({*digests, found.statistics.scene_sha256}) == 3


@scalar_first
def test_transforms_and_points_are_set_by_their_numbers(tmp_path: Path, variant: str) -> None:
    """A wall 4 m away is moved to 6 m, given as 16 numbers or as four rows of four."""
    spot = '<emitter type="point" id="bulb"><point name="position" value="0, 0, 1"/></emitter>'
    scene, matrix = (
        write_scene(tmp_path, scene_text(SKY, WALL, spot)),
        np.diag([-9.0, 9, -9, 1]),
    )
    matrix[2, 3] = 6
    options = {"variant": skip_unless_usable(variant)}
    for value in (matrix.ravel().tolist(), matrix):
        found = render_aovs(scene, TABLE1, traverse={"wall.to_world": value}, **options)
        np.testing.assert_allclose(found.depth_m, 6, rtol=1e-5)
    moved = render_aovs(scene, TABLE1, traverse={"bulb.position": [0, 1, 0]}, **options)
    np.testing.assert_allclose(moved.depth_m, 4, rtol=1e-5)


def test_light_that_only_a_parameter_brings_into_the_bands_is_light(tmp_path: Path) -> None:
    """An emitter from 200 to 300 nm is black for this camera, until its wavelengths are others."""
    lamp = """<emitter type="constant" id="lamp"><spectrum name="radiance" type="regular">
    <float name="wavelength_min" value="200"/><float name="wavelength_max" value="300"/>
    <string name="values" value="1, 1"/></spectrum></emitter>"""
    scene, options = (
        write_scene(tmp_path, scene_text(lamp)),
        {**ONE_BAND, "variant": "scalar_spectral"},
    )
    with pytest.raises(ms.InputError, match="no light in the bands"):
        ms.render(scene, TABLE1, EXPOSURE, **options)
    assert (
        ms.render(
            scene, TABLE1, EXPOSURE, traverse={"lamp.radiance.range": [300, 1000]}, **options
        ).data.min()
        > 0
    )


@pytest.mark.parametrize(
    ("traverse", "said"),
    [
        ({"lamp.radiance.valve": 1}, "does not have.*Did you mean 'lamp.radiance.value'"),
        ({"x": 1}, "does not have: it has .*lamp.radiance.value, .*directly in <scene>"),
        ({VALUE: [1, 2]}, "the number of values must be 1"),
        ({VALUE: float("nan")}, "must be a finite number"),
        ({VALUE: 1e39}, "must be a finite number"),
        ({VALUE: "bright"}, "must be a finite number"),
        ({VALUE: True}, "must be a finite number"),
        ({VALUE: []}, "has 0 numbers"),
        ({VALUE: [1] * 17}, "has 17 numbers"),
        ({"wall.to_world": 1}, "the number of values must be 16"),
        ({"wall.to_world": [0] * 16}, "is not a transform"),
        ({"eye.film.size": [4, 4]}, "film or sampler"),
        ({"object_140487374245648.x_fov": 3}, "give an id to the shape"),
        ({"mesh.faces": 0}, "is not a number"),
        ({"mesh.vertex_positions": 0}, "more than 16"),
        (VALUE, "pass names and numbers"),
    ],
)
def test_parameters_that_cannot_be_set_are_refused(
    traverse: Any, said: str, tmp_path: Path
) -> None:
    sensor = PERSPECTIVE.replace("<sensor", '<sensor id="eye"')
    cube = '<shape type="cube" id="mesh"/>'
    scene = write_scene(tmp_path, scene_text(LAMP.format(1), WALL, cube, sensor=sensor))
    with pytest.raises(ms.InputError, match=said) as caught:
        ms.render(
            scene, TABLE1, EXPOSURE, traverse=traverse, variant="scalar_spectral", **ONE_BAND
        )
    assert "\n" not in str(caught.value)


def test_a_nested_element_is_found_by_the_name_that_begins_with_its_shape() -> None:
    glow = '<emitter type="area" id="glow"><spectrum name="radiance" value="1"/></emitter>'
    place = '<point name="center" value="0, 0, 3"/>'
    text = scene_text(f'<shape type="sphere" id="shade">{place}{glow}</shape>', WALL)
    said = "Did you mean 'shade.emitter.radiance.value'"
    options: dict[str, Any] = {"variant": "scalar_spectral", **ONE_BAND}
    with pytest.raises(ms.InputError, match=said):
        ms.render(text, TABLE1, EXPOSURE, traverse={"glow.radiance.value": 1}, **options)
    ms.render(text, TABLE1, EXPOSURE, traverse={"shade.emitter.radiance.value": 1}, **options)


@scalar_first
def test_the_pose_is_that_of_lookat_in_the_file_in_metres(tmp_path: Path, variant: str) -> None:
    """AOVs of the same pose in the file and as an option; a scene in centimetres."""
    lookat = '<transform name="to_world"><lookat origin="{}" target="{}" up="{}"/></transform>'
    (tmp_path / "moved").mkdir()
    rest = write_scene(
        tmp_path, scene_text(SKY, WALL, more=lookat.format("0, 0, 0", "0, 0, 1", "0, 1, 0"))
    )
    posed = lookat.format("100, 20, -300", "0, 0, 4", "1, 1, 0")
    moved = write_scene(tmp_path / "moved", scene_text(SKY, WALL, more=posed))
    look_at = {"origin_m": [1, 0.2, -3], "target_m": (0, 0, 0.04), "up": [1, 1, 0]}
    options: dict[str, Any] = {"scene_unit": "cm", "variant": skip_unless_usable(variant)}
    expected = render_aovs(moved, TABLE1, **options)
    for given in (look_at, "1,0.2,-3 0,0,0.04 1,1,0"):
        found = render_aovs(rest, TABLE1, look_at=given, **options)
        for name in ("depth_m", "position_m", "normal"):
            np.testing.assert_allclose(
                getattr(found, name), getattr(expected, name), rtol=1e-4, atol=1e-5
            )
        assert found.scene_sha256 != render_aovs(rest, TABLE1, **options).scene_sha256
    motion = {"camera": {"velocity_m_per_s": [0.0, 0.0, 1.0]}}
    for one in (
        render_aovs(rest, TABLE1, exposure=EXPOSURE, motion=motion, look_at=look_at, **options),
        expected,
    ):
        np.testing.assert_allclose(one.depth_m, expected.depth_m, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    ("look_at", "said"),
    [
        ("0,0,0", "pass origin, target"),
        ("0,0,0 0,1", "target_m"),
        ("0,0,a 0,1,0", "pass origin, target"),
        ("0,0,nan 0,1,0", "finite number"),
        ("0,0,0 0,0,0", "target_m is at origin_m"),
        ("0,0,0 0,1,0", "up is along the view"),
        ({"target_m": [0, 0, 1], "origin": [0, 0, 0]}, "pass origin, target"),
        ({"origin_m": [1, 0, 0], "target_m": [0, 0, 1], "upp": [0, 1, 0]}, "upp"),
        ({"origin_m": [0, 0], "target_m": [0, 0, 1]}, "origin_m"),
        (3, "look_at is 3; pass"),
    ],
)
def test_a_pose_that_is_none_is_refused(look_at: Any, said: str) -> None:
    with pytest.raises(ms.InputError, match=said) as caught:
        ms.render(SCENES / "flat_field.xml", TABLE1, EXPOSURE, look_at=look_at)
    assert "\n" not in str(caught.value)


def test_the_command_line_takes_names_and_a_pose(tmp_path: Path, cli: Cli) -> None:
    scene = write_scene(tmp_path, scene_text(LAMP.format(1), WALL))
    small = (
        "--spp",
        "8",
        "--variant",
        "scalar_spectral",
        "--exposure-s",
        "0.01",
        "--wavelength-nm",
        "550",
    )
    named = (
        "--traverse",
        f"{VALUE}=2",
        "--traverse",
        "wall.to_world=-9,0,0,0,0,9,0,0,0,0,-9,6,0,0,0,1",
    )
    done = cli(
        "render",
        scene,
        "-o",
        tmp_path / "out",
        *small,
        *named,
        "--look-at",
        "0,0,1 0,0,2",
        "--repeatable",
    )
    assert done.exit_code == 0, done.stderr
    wrong = cli("render", scene, "-o", tmp_path / "other", *small, "--traverse", f"{VALUE}=2;3")
    assert wrong.exit_code == 2 and "finite number" in " ".join(wrong.stderr.split())


@pytest.mark.parametrize("spp", [1, 2, 5, 8, 9, 16, 31, 32, 64, 100, 500, 1000, 4096])
def test_a_repeatable_plan_has_passes_of_a_power_of_two_up_to_8(spp: int) -> None:
    passes, samples = pass_plan(spp, repeatable=True)
    assert samples in (1, 2, 4, 8) and samples == whole_grid(samples)
    assert passes >= min(max(spp, 2), PASSES_MIN) and abs(passes * samples - spp) <= max(
        0.07 * spp, 1
    )
    assert pass_plan(METERING_SPP) == pass_plan(METERING_SPP, repeatable=True)


def bits(light: ms.Irradiance) -> str:
    arrays = [light.data, light.standard_error, light.relative_error, light.in_band]
    return hashlib.sha256(
        b"".join(array.tobytes() for array in arrays if array is not None)
    ).hexdigest()


def rendered_by_threads(variant: str, threads: tuple[int, ...], **options: Any) -> set[str]:
    """Digests of the Cornell box, one render for each number of threads."""
    dr, found = drjit(), set()
    before = dr.thread_count()
    try:
        for count in threads:
            dr.set_thread_count(count)
            made = ms.render(
                SCENES / "cornell_box.xml",
                BAYER,
                EXPOSURE,
                repeatable=True,
                variant=variant,
                **options,
            )
            found.add(bits(made))
    finally:
        dr.set_thread_count(before)
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "options",
    [
        {"spp": 100, "width": 33, "spectral": "channels", "denoise": False},
        {"spp": 100, "width": 21, "bandwidth_nm": 80, "denoise": True},
        {"spp": 100, "width": 27, "spectral": "cube", "bandwidth_nm": 80, "denoise": False},
        {
            "noise_ratio": 20,
            "max_spp": 400,
            "width": 25,
            "bandwidth_nm": 80,
            "denoise": False,
        },
    ],
)
def test_a_repeatable_render_has_the_same_bits_with_any_number_of_threads(
    options: dict[str, Any],
) -> None:
    """Without ``repeatable`` the same renders differ in the last bits of some pixels."""
    assert (
        len(rendered_by_threads(skip_unless_usable("llvm_ad_spectral"), (1, 3), **options)) == 1
    )


def test_a_repeatable_render_repeats_in_scalar_variants_too() -> None:
    """Mitsuba's blocks are 32 pixels wide, and 16 here with seven threads."""
    options: dict[str, Any] = {
        "spp": 2,
        "width": 33,
        "wavelength_nm": 550,
        "parameters": {"max_depth": 3},
    }
    assert len(rendered_by_threads("scalar_spectral", (1, 7), denoise=False, **options)) == 1


@pytest.mark.exhaustive
def test_frames_of_their_own_repeat(tmp_path: Path) -> None:
    """The first frame determines the passes of the others: still a power of two."""
    options: dict[str, Any] = {
        "variant": "scalar_spectral",
        "frames": 2,
        "repeatable": True,
        "max_spp": 2000,
    }
    scene = write_scene(tmp_path, scene_text(LAMP.format(1e-4), WALL))
    frames = list(ms.render_frames(scene, TABLE1, ms.Exposure(1e-3), **options))
    found = [frame.light.statistics for frame in frames]
    assert all(one.samples_per_pixel / one.passes in (1, 2, 4, 8) for one in found)
