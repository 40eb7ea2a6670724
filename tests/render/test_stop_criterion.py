"""When a render ends: a number of samples, a noise ratio, a time; and what it tells on its way."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from helpers.scenes import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor.render.load.scene import Scene
from mitsuba_sensor.render.passes import prepared as prepared_module
from mitsuba_sensor.render.passes.stop_criterion import (
    DEFAULT_DENOISED_SPP,
    DEFAULT_SPP,
    SURE_PASSES_MIN,
)

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.02)
BOX = SCENES / "cornell_box.xml"  # noise in every pixel
FAST = {
    "wavelength_nm": 550,
    "variant": "scalar_spectral",
    "parameters": {"width": 12, "height": 8},
}
RAW = {**FAST, "denoise": False}


def test_a_noise_ratio_is_reached_and_is_true() -> None:
    """Two renders of one ratio differ by what they say: the variance of their difference is the sum of theirs.

    Rationale: a render that stops when its ratio happens to be low would look better than it is. Medians over 1536
    pixels of squares: a standard deviation of 4 %, the bound is 15 %.
    """
    options = {**RAW, "parameters": {"width": 48, "height": 32}, "noise_ratio": 4.0}
    one, two = (ms.render(BOX, CAMERA, EXPOSURE, seed=s, **options) for s in (1, 2))
    claimed = one.standard_error.astype(float) ** 2 + two.standard_error.astype(float) ** 2
    z = (one.data - two.data).astype(float) ** 2 / claimed
    # F of 1 and about 50 degrees of freedom
    assert np.median(z) / 0.47 == pytest.approx(1.0, abs=0.15)
    found = one.statistics
    assert (found.ended_by, found.noise_ratio_asked) == ("noise_ratio", 4.0)
    assert found.noise_ratio_median <= 4.0 and found.passes >= SURE_PASSES_MIN


def test_a_render_ends_at_its_most_samples_and_says_that_the_ratio_was_missed() -> None:
    light = ms.render(BOX, CAMERA, EXPOSURE, noise_ratio=1e-6, max_spp=512, **FAST)
    assert light.statistics.ended_by == "max_spp"
    assert light.statistics.samples_per_pixel <= 512
    assert light.statistics.noise_ratio_median > 1e-6


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The render's clock, which goes on by a second for each sample of each row; ``now_s`` is what it shows."""
    shown, rendered = SimpleNamespace(now_s=0.0), Scene.render

    def timed(self: Scene, seed: int, samples: int, rows: tuple[int, int]) -> np.ndarray:
        shown.now_s += samples * (rows[1] - rows[0])
        return rendered(self, seed, samples, rows)

    monkeypatch.setattr(Scene, "render", timed)
    still = SimpleNamespace(monotonic=lambda: shown.now_s)
    monkeypatch.setattr(prepared_module, "time", still)
    return shown


@pytest.mark.parametrize("options", [{}, {"noise_ratio": 1e-6}, exhaustive({"spp": 10**6})])
def test_a_render_ends_when_its_time_is_up(
    options: dict[str, Any], clock: SimpleNamespace
) -> None:
    """No pass begins that would end later; two passes are always made."""
    light = ms.render(BOX, CAMERA, EXPOSURE, max_seconds=2000, **options, **FAST)
    assert light.statistics.ended_by == "max_seconds"
    assert light.statistics.passes >= 2
    pass_s = light.statistics.samples_per_pixel / light.statistics.passes * len(light.data)
    assert clock.now_s <= max(2000, 2.1 * pass_s) and clock.now_s + pass_s > 2000


def test_no_time_at_all_still_gives_two_passes_and_no_trust() -> None:
    light = ms.render(BOX, CAMERA, EXPOSURE, max_seconds=0.0, **FAST)
    assert light.statistics.passes == 2 and not light.statistics.reliable
    assert any("error bars are guesses" in note for note in light.statistics.notes)


def test_progress_tells_the_falling_ratio_and_no_end_where_it_is_not_known() -> None:
    steps: list[Any] = []
    ms.render(BOX, CAMERA, EXPOSURE, noise_ratio=0.02, progress=steps.append, **RAW)
    assert steps[0].done == 0 and math.isnan(steps[0].noise_ratio)
    assert not any(step.most for step in steps) and math.isnan(steps[-1].share)
    assert steps[-1].noise_ratio <= 0.02 < steps[3].noise_ratio


@pytest.mark.parametrize("options", [{"spp": 64}, {"spp": 64, "max_seconds": 1e4}, {}])
def test_progress_of_a_number_of_passes_goes_from_none_to_all(options: dict[str, Any]) -> None:
    steps: list[Any] = []
    ms.render(BOX, CAMERA, EXPOSURE, progress=steps.append, **options, **FAST)
    shares = [step.share for step in steps if step.doing == "rendering"]
    assert shares[0] == 0 and shares[-1] == 1 and shares == sorted(shares)


@pytest.mark.parametrize("time_s", one_in(2, [0.0005, 0.01, 0.05, 0.5]))
def test_a_render_stops_where_the_sensor_is_noisier_than_the_render(time_s: float) -> None:
    """95 % of the lit pixels; the same bytes as of so many samples that were asked for. Much light has little shot
    noise beside it, so that all samples are taken."""
    light = ms.render(BOX, CAMERA, ms.Exposure(time_s), **RAW)
    found = light.statistics
    stopped = found.samples_per_pixel < DEFAULT_SPP
    assert (found.ended_by == "sensor_noise") == (found.noise_ratio_p95 <= 1)
    assert stopped <= (found.ended_by == "sensor_noise")
    assert stopped == (time_s < 0.1)


@pytest.mark.parametrize(
    ("time_s", "options", "denoised"),
    [
        (1e-5, {}, False),
        (0.05, {}, True),
        (0.05, {"spp": 64}, True),
        (0.05, {"denoise": False}, False),
        (1e-5, {"denoise": True}, True),
    ],
)
def test_light_is_denoised_where_the_render_ends_above_the_sensor_s_noise(
    time_s: float, options: dict[str, Any], denoised: bool
) -> None:
    """Unless told otherwise; what a denoiser cleans gets few samples."""
    pytest.importorskip("pyoidn", reason="Open Image Denoise has no wheel for this machine")
    large = {**FAST, "parameters": {"width": 16, "height": 12}}
    found = ms.render(BOX, CAMERA, ms.Exposure(time_s), **large, **options).statistics
    assert (found.denoised is not None) == denoised
    before = found.denoised["raw_noise_ratio_p95"] if found.denoised else found.noise_ratio_p95
    if not options:
        assert denoised == (before > 1) and found.samples_per_pixel <= DEFAULT_DENOISED_SPP


def test_a_metered_render_stops_by_the_noise_of_the_exposure_that_is_found() -> None:
    light = ms.render(BOX, CAMERA.replace(**{"pixel.full_well_e": 400}), "auto", **RAW)
    assert light.statistics.ended_by == "sensor_noise"
    assert light.statistics.noise_ratio_p95 <= 1


def test_a_fixed_number_of_samples_is_the_same_render_with_or_without_time_to_spare() -> None:
    one, other = (
        ms.render(BOX, CAMERA, EXPOSURE, spp=32, **more, **FAST).data.tobytes()
        for more in ({}, {"max_seconds": 1e6})
    )
    assert one == other
