"""frame.html shows the codes, expected values and σ of frames that the package made."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from helpers.marks import exhaustive
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.output.frame_page import STOPS, block_means

SHAPE = 24, 30
LIGHT = np.random.default_rng(1).uniform(10, 40_000, SHAPE)


def page_data(page: str) -> dict:
    return json.loads(re.search(r"const DATA = (\{.*?\}), at = ", page).group(1))


def unpacked(text: str) -> NDArray[np.int64]:
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
    return (planes.reshape(4, -1).astype(np.int64) << np.array([[0], [8], [16], [24]])).sum(
        axis=0
    )


def page_of(frames: ms.Frames, folder: Path) -> str:
    frames.save_page(folder / "frame.html")
    return (folder / "frame.html").read_text()


@pytest.mark.parametrize(
    "camera", ["bayer_2mp", *map(exhaustive, ("konnik_table1", "sony_imx490"))]
)
def test_every_frame_of_the_slider_is_what_expose_delivers(camera: str, tmp_path: Path) -> None:
    taken = ms.expose(ms.Photons(LIGHT, detected=True), camera, ms.Exposure(0.01), seed=5)
    data = page_data(page_of(taken, tmp_path))
    assert [one["own"] for one in data["frames"]] == [stops == 0 for stops in STOPS]
    for stops, shown in zip(STOPS, data["frames"], strict=True):
        light = ms.Photons(LIGHT * 2.0**stops, detected=True)
        frames = ms.expose(light, camera, ms.Exposure(0.01 * 2.0**stops), seed=5)
        np.testing.assert_array_equal(unpacked(shown["codes"]), frames.digital.ravel())
        step = data["step"]
        expected, sigma = (unpacked(shown[name]) * step for name in ("expected", "sigma"))
        np.testing.assert_allclose(expected, frames.clean.ravel(), atol=0.51 * step, rtol=1e-6)
        sigma_dn = np.sqrt(frames.temporal_variance).ravel()
        np.testing.assert_allclose(sigma, sigma_dn, atol=0.51 * step, rtol=1e-6)
        top = 2**frames.camera.code_bits - 1
        assert shown["full_scale"] == np.sum(frames.digital == top)
        assert shown["full_well"] == frames.counts["clipped_full_well"]


def test_a_render_is_exposed_again_as_its_irradiance_is(tmp_path: Path) -> None:
    light = ms.light_from_rgb(np.full((*SHAPE, 3), 200.0), "bayer_2mp", unit="cd_per_m2")
    frames = ms.expose(light, "bayer_2mp", ms.Exposure(0.01))
    brighter = page_data(page_of(frames, tmp_path))["frames"][-1]
    twice = ms.expose(light, "bayer_2mp", ms.Exposure(0.02))
    np.testing.assert_array_equal(unpacked(brighter["codes"]), twice.digital.ravel())


def test_a_large_frame_is_a_crop_with_an_overview_of_block_means(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crop_px = 64
    for name in ("CROP_PX", "OVERVIEW_PX"):
        monkeypatch.setattr(f"mitsuba_sensor.output.frame_page.{name}", crop_px)
    side = crop_px + 50
    frames = ms.expose(np.full((side, side), 500.0), "bayer_2mp", ms.Exposure(0.0))
    page, [top, left] = page_of(frames, tmp_path), (24, 24)
    data = page_data(page)
    assert data["first"] == [top, left] and data["rows"] == data["columns"] == crop_px
    crop = frames.digital[0][top : top + crop_px, left : left + crop_px]
    np.testing.assert_array_equal(unpacked(data["frames"][0]["codes"]), crop.ravel())
    assert "mean of 2 × 2 pixels" in page
    assert len(data["frames"]) == 1  # no time is 2 times as long as none


def test_block_means() -> None:
    picture = np.arange(2 * 5 * 3, dtype=np.uint8).reshape(2, 5, 3)
    means = [[picture[:2, a : a + 2, k].mean().round() for k in range(3)] for a in (0, 2)]
    np.testing.assert_array_equal(block_means(picture, 2)[0], means)


def test_names_of_cameras_and_notes_are_text(tmp_path: Path) -> None:
    camera = ms.load_camera("konnik_table1").replace(name="<script>alert(1)</script>")
    assert "<script>alert" not in page_of(ms.expose(LIGHT, camera, ms.Exposure(0.01)), tmp_path)


@pytest.mark.exhaustive
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_a_browser_shows_the_value_and_sigma_of_a_pixel(tmp_path: Path) -> None:
    frames = ms.expose(LIGHT, "konnik_table1", ms.Exposure(0.01))
    frames.save_page(tmp_path / "frame.html")
    row, column = 7, 19
    command = [
        "chromium",
        "--headless",
        "--no-sandbox",
        "--virtual-time-budget=5000",
        "--dump-dom",
    ]
    url = f"file://{tmp_path}/frame.html#{row},{column}"
    shown = subprocess.run([*command, url], capture_output=True, text=True, timeout=60).stdout
    assert 'data-ready="1"' in shown
    code, mean = frames.digital[0, row, column], frames.clean[row, column]
    sigma = frames.temporal_variance[row, column] ** 0.5
    assert (
        f"Row {row}, column {column}: {code} DN; expected {mean:.2f} ± {sigma:.2f} DN" in shown
    )
