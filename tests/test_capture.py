"""capture.py: capture() gives what render, collect and expose give one by one, and its files hold the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.scenes import SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.output.exr import read_aovs_exr, read_irradiance_exr
from mitsuba_sensor.render.load.scene import Scene
from mitsuba_sensor.render.motion.aovs import render_aovs
from mitsuba_sensor.render.passes.stop_criterion import RenderProgress

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.05)
RENDER = {"spp": 16, "wavelength_nm": 550.0, "variant": "scalar_spectral"}


@pytest.fixture(scope="module")
def captured(scene_file: Path) -> ms.Capture:
    return ms.capture(
        scene_file, CAMERA, EXPOSURE, seed=3, serial=4, frames=2, aovs=True, **RENDER
    )


def test_a_capture_is_render_collect_and_expose_in_one(
    captured: ms.Capture, scene_file: Path
) -> None:
    light = ms.render(scene_file, CAMERA, EXPOSURE, seed=3, **RENDER)
    frames = ms.expose(
        ms.collect(light, CAMERA, EXPOSURE), CAMERA, EXPOSURE, seed=3, serial=4, frames=2
    )
    np.testing.assert_array_equal(captured.light.data, light.data)
    np.testing.assert_array_equal(captured.frames.digital, frames.digital)
    assert captured.metadata["stages"] == frames.report["stages"]


def test_the_aovs_of_a_capture_are_those_of_a_pass_of_their_own(
    captured: ms.Capture, scene_file: Path
) -> None:
    alone = render_aovs(scene_file, CAMERA, exposure=EXPOSURE, variant="scalar_spectral")
    assert captured.aovs is not None
    for name in ("depth_m", "position_m", "normal", "albedo", "shape_index", "flow_px"):
        np.testing.assert_array_equal(
            getattr(captured.aovs, name), getattr(alone, name), err_msg=name
        )


def test_the_files_hold_what_the_capture_holds(captured: ms.Capture, tmp_path: Path) -> None:
    captured.save(tmp_path / "out")
    names = {"frame.tiff", "frame.png", "irradiance.exr", "aovs.exr", "frame.json"}
    names |= {"frame_brightened.png"}  # the scene is dark
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    np.testing.assert_array_equal(
        tifffile.imread(tmp_path / "out" / "frame.tiff"), captured.frames.digital
    )
    np.testing.assert_array_equal(
        read_irradiance_exr(tmp_path / "out" / "irradiance.exr").data, captured.light.data
    )
    aovs = read_aovs_exr(tmp_path / "out" / "aovs.exr")
    np.testing.assert_array_equal(
        aovs.depth_m, captured.aovs.depth_m if captured.aovs else None
    )
    report = json.loads((tmp_path / "out" / "frame.json").read_text(encoding="utf-8"))
    assert report["seeds"] == {"seed": 3, "serial": 4, "first_frame": 0}


def test_irradiance_is_written_small_or_not_at_all(scene_file: Path, tmp_path: Path) -> None:
    """An older irradiance.exr does not stay beside the new frame; another one's frames do not leave it."""
    options = {"spp": 16, "variant": "scalar_spectral", "wavelength_nm": 550.0}
    shots = {
        name: ms.capture(scene_file, CAMERA, EXPOSURE, **options, **more)
        for name, more in (
            ("float", {}),
            ("half", {"half": True}),
            ("none", {"no_irradiance": True}),
        )
    }
    for name, shot in shots.items():
        shot.save(tmp_path / name)
        assert (shot.frames.digital == shots["float"].frames.digital).all()
    half = read_irradiance_exr(tmp_path / "half" / "irradiance.exr")
    np.testing.assert_allclose(half.data, shots["float"].light.data, rtol=2.0**-11)
    assert (half.data != shots["float"].light.data).any()
    assert (
        not (tmp_path / "none" / "irradiance.exr").exists()
        and (tmp_path / "none" / "frame.tiff").exists()
    )
    with pytest.raises(ms.InputError, match="half is the precision"):
        ms.capture(scene_file, CAMERA, EXPOSURE, half=True, no_irradiance=True)
    shots["none"].save(tmp_path / "float")
    assert not (tmp_path / "float" / "irradiance.exr").exists()
    ms.capture(tmp_path / "half" / "irradiance.exr").save(tmp_path / "half")
    assert (tmp_path / "half" / "irradiance.exr").exists()


def test_light_that_is_there_already_gives_the_same_frames(
    captured: ms.Capture, tmp_path: Path
) -> None:
    """From the file, and from the object; and no irradiance.exr is written again."""
    captured.save(tmp_path)
    for source in (tmp_path / "irradiance.exr", captured.light):
        again = ms.capture(source, CAMERA, EXPOSURE, seed=3, serial=4, frames=2)
        np.testing.assert_array_equal(again.frames.digital, captured.frames.digital)
    again.save(tmp_path / "again")
    assert {path.name for path in (tmp_path / "again").iterdir()} == {
        "frame.tiff",
        "frame.png",
        "frame_brightened.png",
        "frame.json",
    }


def test_frames_with_a_render_each_are_those_of_render_frames(scene_file: Path) -> None:
    asked = {"frames": 2, **RENDER}
    found = ms.capture(scene_file, CAMERA, EXPOSURE, render_noise="per-frame", **asked)
    each = list(ms.render_frames(scene_file, CAMERA, EXPOSURE, **asked))
    np.testing.assert_array_equal(
        found.frames.digital, np.concatenate([one.frames.digital for one in each])
    )
    np.testing.assert_array_equal(found.light.data, each[0].light.data)


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"spq": 3}, "'spq' is not an option"),
    ({"serial": 1.5}, "serial is 1.5"),
    ({"frames": 2, "first_frame": 2**32 - 1}, "frames is 2 from 4294967295"),
    ({"maps": {"prnv": np.ones((12, 16))}}, "Did you mean 'prnu'"),
    ({"maps": {"prnu": np.ones((12, 15))}}, r"maps\['prnu'\] has shape \(12, 15\)"),
    ({"maps": {"prnu": np.full((12, 16), np.nan)}}, "NaN"),
    ({"engine": "numpi"}, "Did you mean 'numpy'"),
    ({"engine": "drjit", "precision": "float64"}, "compiled engines are float32"),
    ({"render_noise": "each"}, "render_noise is 'each'; it must be one of"),
    ({"subframes": 4}, "nothing moves"),
    ({"width": 17}, "width is 17"),
    ({"scene_unit": [1]}, "scene_unit is .*; it must be"),
]


@pytest.mark.parametrize(("options", "said"), REFUSED)
def test_what_cannot_be_made_is_refused_before_the_first_ray(
    options: dict[str, Any], said: str, scene_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Scene, "render", lambda *_: pytest.fail("it was rendered first"))
    with pytest.raises(ms.InputError, match=said):
        ms.capture(scene_file, CAMERA, EXPOSURE, **{**RENDER, **options})


@pytest.mark.parametrize(
    "option", [{"spp": 4}, {"render_noise": "per-frame"}, {"aovs": True}, {"scene_unit": [1]}]
)
def test_options_of_a_render_are_refused_for_light_that_is_rendered_already(
    light: Any, option: dict[str, Any]
) -> None:
    with pytest.raises(ms.InputError, match="rendered already"):
        ms.capture(light, CAMERA, EXPOSURE, **option)


def test_frames_of_light_that_is_there_are_told_one_by_one(light: Any) -> None:
    steps: list[RenderProgress] = []
    exposure, frames = ms.Exposure(0.1), {"frames": 3, "first_frame": 7}
    told = ms.capture(
        light, ms.load_camera("konnik_table1"), exposure, progress=steps.append, **frames
    )  # type: ignore[arg-type]
    assert [(step.done, step.most, step.doing) for step in steps] == [
        (k, 3, "exposing") for k in range(4)
    ]
    assert [step.seconds for step in steps] == sorted(step.seconds for step in steps)
    silent = ms.capture(light, ms.load_camera("konnik_table1"), exposure, **frames)  # type: ignore[arg-type]
    np.testing.assert_array_equal(told.frames.digital, silent.frames.digital)


@pytest.mark.parametrize(
    ("shape", "origin", "said"),
    [
        ((2, 1901), (0, 0), ["sensor.columns=1901"]),
        ((2, 8), (1299, 0), ["sensor.rows=1301"]),
        ((2, 8), (1298, 1892), []),
    ],
)
def test_an_array_that_extends_beyond_the_sensor_is_noted(
    shape: tuple[int, int], origin: tuple[int, int], said: list[str]
) -> None:
    """Any list of pixels is allowed as an array; only the last of the three is on the sensor of 1900 × 1300."""
    frames = ms.expose(np.full(shape, 1e4), CAMERA, EXPOSURE, origin=origin)
    notes = [note for note in frames.notes if "1900 × 1300" in note]
    assert len(notes) == len(said)
    assert all(text in note for text, note in zip(said, notes, strict=True))


def test_a_scene_without_a_camera_has_the_default_one_and_says_so(tmp_path: Path) -> None:
    """As the command `render`; the fields that the scene sets are those of the camera."""
    text = scene_text(SKY, film='<string name="adc.bits" value="10"/>')
    scene = write_scene(tmp_path, text.replace("hdrfilm", "photosensor"))
    options: dict[str, Any] = {"spp": 4, "width": 8, "progress": False}
    taken = ms.capture(scene, exposure=EXPOSURE, **options)
    named = ms.capture(scene, taken.frames.camera, EXPOSURE, **options)
    default = ms.load_camera("konnik_table1").replace(**{"adc.bits": 10})
    assert taken.frames.camera.adc == default.adc
    np.testing.assert_array_equal(taken.frames.digital, named.frames.digital)
    said = "rendered for konnik_table1, because no camera was given"
    for notes in (taken.frames.notes, taken.light.notes):
        assert any(said in note for note in notes)
    assert not any(said in note for note in named.frames.notes)


def test_light_needs_a_camera(light: Any) -> None:
    with pytest.raises(ms.InputError, match="no camera is given"):
        ms.capture(light, None, EXPOSURE)


@pytest.mark.parametrize("render_noise", ["shared", "per-frame"])
def test_signals_that_are_kept_belong_to_every_frame(
    scene_file: Path, render_noise: Any
) -> None:
    """Without dark current too, where dark electrons are one 0 for all pixels."""
    keep = ("photons", "photoelectrons", "dark_electrons", "electrons", "volts")
    options: Any = {"frames": 2, "first_frame": 5, "render_noise": render_noise, **RENDER}
    found = ms.capture(scene_file, CAMERA, ms.Exposure(0.05, 0.0), keep=keep, **options).frames
    for name in keep:
        assert getattr(found, name).shape == found.digital.shape
