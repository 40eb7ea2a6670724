"""Frames that follow each other: frame k begins at start_s + k/fps, and what moves is where it is at that time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import HEIGHT, WIDTH, wall_that_moves, write_scene
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.files.raw_files import read_raw
from mitsuba_sensor.render.passes.prepared import PreparedRender

CAMERA = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(1e-3)
SPEED_PX_PER_S = 37.0
SCENE, MOTION = wall_that_moves(1, SPEED_PX_PER_S)
QUICK: dict[str, Any] = {
    "progress": False,
    "wavelength_nm": 550.0,
    "spp": 32,
    "denoise": False,
    "variant": "scalar_spectral",
}


@pytest.fixture(scope="module")
def series() -> tuple[ms.Capture, list[float]]:
    """Three frames of the wall that moves, and the beginnings of the frames that were rendered."""
    with pytest.MonkeyPatch.context() as patch:
        begun = renders_counted(patch)
        options: dict[str, Any] = {"motion": MOTION, "fps": 10, "start_s": -0.2, "frames": 3}
        captured = ms.capture(SCENE, CAMERA, EXPOSURE, clean=True, dng=True, **options, **QUICK)
    return captured, begun


def renders_counted(patch: pytest.MonkeyPatch) -> list[float]:
    """Return the beginnings of the frames that are rendered from now on."""
    begun, render = list[float](), PreparedRender.render

    def counted(self: PreparedRender, *given: Any, **options: Any) -> ms.Irradiance:
        begun.append(self.begin_s)
        return render(self, *given, **options)

    patch.setattr(PreparedRender, "render", counted)
    return begun


def edge_px(digital: np.ndarray) -> float:
    """Columns that the bright side covers: up to the first that is darker than the one before, and its share."""
    profile = digital.mean(axis=0) - digital.mean(axis=0).min()
    profile = profile if profile[0] > profile[-1] else profile[::-1]
    column = int(np.argmax(profile[1:] < 0.95 * profile[:-1])) + 1
    return float(column + profile[column] / profile[column - 1])


def test_a_moving_edge_is_where_the_time_of_its_frame_says(
    series: tuple[ms.Capture, list[float]],
) -> None:
    """Within 0.25 px: 32 + 37·(start_s + k/fps), in the middle of the exposure."""
    captured, begun = series
    times = -0.2 + np.arange(3) / 10
    assert begun == pytest.approx(times)
    found = [edge_px(digital.astype(float)) for digital in captured.frames.digital]
    expected = WIDTH / 2 + SPEED_PX_PER_S * (times + EXPOSURE.time_s / 2)
    np.testing.assert_allclose(found, expected, atol=0.25)
    told = captured.metadata["series"]
    assert [one["start_s"] for one in told["frames"]] == pytest.approx(times)
    assert (told["fps"], told["period_s"]) == (10, 0.1)


def test_frames_of_a_still_scene_are_one_render_and_the_frames_without_a_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun = renders_counted(monkeypatch)
    timed = ms.capture(SCENE, CAMERA, EXPOSURE, fps=30, frames=20, keep=["electrons"], **QUICK)
    assert len(begun) == 1
    plain = ms.capture(SCENE, CAMERA, EXPOSURE, frames=20, keep=["electrons"], **QUICK)
    np.testing.assert_array_equal(timed.frames.digital, plain.frames.digital)
    last = timed.timed[19].frames
    np.testing.assert_array_equal(last.electrons, plain.frames.electrons[19:])  # type: ignore[index]
    assert plain.metadata["series"] is None and not plain.timed
    assert timed.metadata["series"]["frames"][19]["start_s"] == pytest.approx(19 / 30)


@pytest.mark.exhaustive
def test_light_groups_of_a_moving_scene_are_loaded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mitsuba_sensor.render.passes import prepared

    loads, load = list[object](), prepared.load_scene

    def counted(*given: Any, **options: Any) -> Any:
        loads.append(options.get("emitters"))
        return load(*given, **options)

    monkeypatch.setattr(prepared, "load_scene", counted)
    lamp = '<emitter type="point" id="bulb"><spectrum name="intensity" value="1e-3"/></emitter>'
    scene = write_scene(tmp_path, SCENE.replace("</scene>", f"{lamp}</scene>"))
    options = {**QUICK, "spp": 8, "light_groups": "auto", "lights": {"bulb": "pwm(50, 0.5)"}}
    captured = ms.capture(scene, CAMERA, EXPOSURE, motion=MOTION, fps=10, frames=3, **options)
    assert len(loads) == 3  # the whole, wall and bulb
    assert np.ptp([edge_px(one.astype(float)) for one in captured.frames.digital]) > 7


def test_the_camera_has_a_pose_in_every_frame(tmp_path: Path) -> None:
    motion = {"camera": {"velocity_m_per_s": [0, 0.5, 0]}}
    captured = ms.capture(
        write_scene(tmp_path, SCENE), CAMERA, EXPOSURE, motion=motion, fps=5, frames=2, **QUICK
    )
    heights = [one.camera_to_world[1][3] for one in captured.timed]  # type: ignore[index]
    assert heights == pytest.approx([0.0, 0.1])


def test_the_files_of_a_series(tmp_path: Path, series: tuple[ms.Capture, list[float]]) -> None:
    captured, out = series[0], tmp_path / "out"
    captured.save(out)
    np.testing.assert_array_equal(read_raw(out / "frame.tiff").frames, captured.frames.digital)
    with Image.open(out / "frames.webp") as video:
        assert (video.n_frames, video.size) == (3, (WIDTH, HEIGHT))  # type: ignore[attr-defined]
        video.seek(1)
        video.load()
        assert video.info["duration"] == 100
    assert len(json.loads((out / "frame.json").read_text("utf-8"))["series"]["frames"]) == 3
    for number, one in enumerate(captured.timed):
        np.testing.assert_array_equal(
            read_raw(out / f"frame_{number:04d}.dng").frames[0], one.frames.digital[0]
        )
    assert captured.frames.clean_of_each.shape == captured.frames.digital.shape
    ms.capture(SCENE, CAMERA, EXPOSURE, **QUICK).save(out)
    assert not (out / "frames.webp").exists()


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "both": ({"fps": 30, "frame_period_s": 0.1}, "set the same"),
    "too long": ({"fps": 2000}, "exceeds the frame period"),
    "no rate": ({"fps": 0}, "fps is 0"),
    "no time": ({"auto_exposure": "target 0.2"}, "give fps"),
    "renders": (
        {"fps": 30, "render_noise": "per-frame"},
        "fps is given",
    ),
    "no number": ({"fps": 30, "auto_exposure": "target x"}, "'x' is not a number"),
    "no name": ({"fps": 30, "auto_exposure": "tarket 1"}, "Did you mean 'target'"),
    "damping": ({"fps": 30, "auto_exposure": "damping 2"}, "damping is 2"),
    "delay": ({"fps": 30, "auto_exposure": "delay 0.5"}, "whole number of frames"),
    "limits": ({"fps": 30, "auto_exposure": "shortest_s 1"}, "shortest_s is 1"),
}


@pytest.mark.parametrize("case", BAD)
def test_times_that_cannot_be_are_refused_with_the_way_out(
    case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = renders_counted(monkeypatch)
    options, sentence = BAD[case]
    given = {**QUICK, **options}
    if case == "renders":
        del given["denoise"]
    with pytest.raises(ms.InputError, match=sentence):
        ms.capture(SCENE, CAMERA, EXPOSURE, **given)
    assert case == "limits" or not begun  # said before the first ray


@pytest.mark.parametrize("options", [{"fps": 0}, {"fps": "fast"}, {"frame_period_s": -1}])
def test_impossible_times_are_refused_by_expose_too(options: dict[str, Any]) -> None:
    with pytest.raises(ms.InputError, match=f"{next(iter(options))} is"):
        ms.expose(np.ones((4, 4)), "konnik_table1", ms.Exposure(0.01), frames=2, **options)


@pytest.mark.exhaustive
def test_a_ghost_behind_a_moving_edge_has_the_lag_of_the_frame_before(tmp_path: Path) -> None:
    """Columns that have become dark show f of the light that was there one frame ago, of its own render; frame 2 is
    the same alone, and frame 0 sees itself. The light is the same with lag and without."""
    scene, lag = write_scene(tmp_path, SCENE), {"quantum_efficiency.image_lag": 0.1}
    given: dict[str, Any] = {
        "motion": MOTION,
        "fps": 4,
        "frames": 3,
        "keep": ["photoelectrons"],
        **QUICK,
    }
    quiet = CAMERA.replace(**{"pixel.prnu": 0.0, "sensor.without": ["shot_noise"]})
    plain, lagging = (
        ms.capture(scene, camera, EXPOSURE, **given) for camera in (quiet, quiet.replace(**lag))
    )
    light, shown = plain.frames.photoelectrons, lagging.frames.photoelectrons
    assert light is not None and shown is not None
    np.testing.assert_array_equal(shown[0], light[0])
    np.testing.assert_allclose(shown[1:], 0.9 * light[1:] + 0.1 * light[:-1], rtol=1e-6)
    np.testing.assert_array_equal(plain.light.data, lagging.light.data)
    alone = ms.capture(
        scene, quiet.replace(**lag), EXPOSURE, **{**given, "first_frame": 2, "frames": 1}
    )
    np.testing.assert_array_equal(alone.frames.photoelectrons, shown[2:])
    np.testing.assert_array_equal(alone.frames.digital, lagging.frames.digital[2:])
