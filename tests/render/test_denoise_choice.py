"""Denoising that nobody has decided: left out where samples are better in the same time. No test reads the clock."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.scenes import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.render.denoise.network import is_undecided
from mitsuba_sensor.render.options import RenderOptions
from mitsuba_sensor.render.passes import denoise_choice
from mitsuba_sensor.render.passes.denoise_choice import DenoiseChoice, DenoiseForecast
from mitsuba_sensor.render.passes.stop_criterion import DEFAULT_PASS_SPP, FIRST_LOOK

pytest.importorskip("pyoidn", reason="Open Image Denoise has no wheel for this machine")

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.05)
BOX = SCENES / "cornell_box.xml"  # noise in every pixel
FAST: dict[str, Any] = {
    "wavelength_nm": 550,
    "variant": "scalar_spectral",
    "parameters": {"width": 32, "height": 64},
    "progress": False,
}


def render(**options: Any) -> ms.Irradiance:
    return ms.render(BOX, CAMERA, EXPOSURE, **{**FAST, **options})


@pytest.fixture
def denoiser_s(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sets the seconds of the denoiser, and makes a trial of some rows of a small picture."""

    def chosen(seconds: float) -> None:
        monkeypatch.setattr(denoise_choice, "LEAST_TRIED_PIXELS", 1)
        monkeypatch.setattr(denoise_choice, "_for_picture", lambda tried_s, times: seconds)

    return chosen


@pytest.mark.parametrize(
    ("gain", "denoiser_s", "denoises"),
    [(3.0, 1.9, True), (3.0, 2.1, False), (0.9, 0.0, False), (None, 0.0, False)],
)
def test_denoising_must_gain_what_samples_gain_in_its_time(
    gain: float | None, denoiser_s: float, denoises: bool
) -> None:
    """In 1 s of samples and 2 s of the denoiser there are three times the samples, a third of the variance."""
    forecast = DenoiseForecast(gain, noise=5.0, denoiser_s=denoiser_s, samples_s=1.0)
    assert forecast.denoises == denoises
    assert forecast.needed == pytest.approx(1 + denoiser_s)


def test_a_slow_denoiser_is_left_out_and_the_light_is_that_without_it(denoiser_s: Any) -> None:
    denoiser_s(1e9)
    light, plain = render(spp=16), render(spp=16, denoise=False)
    assert light.data.tobytes() == plain.data.tobytes()
    assert light.standard_error.tobytes() == plain.standard_error.tobytes()
    statistics = light.statistics
    assert statistics.denoised is None and statistics.denoise_forecast is not None
    assert statistics.denoise_forecast["gain_of_samples"] > 1e6
    assert any("not denoised: samples are better here" in note for note in statistics.notes)


def test_a_quick_denoiser_is_used_and_its_light_is_that_of_who_asks_for_it(
    denoiser_s: Any,
) -> None:
    denoiser_s(0.0)
    light, asked = render(spp=16), render(spp=16, denoise=True)
    assert light.statistics.denoised is not None
    assert light.data.tobytes() == asked.data.tobytes()
    forecast = light.statistics.denoise_forecast
    assert forecast is not None and asked.statistics.denoise_forecast is None
    assert forecast["gain"] is not None and forecast["gain"] > 1.5
    assert not any("not denoised" in note for note in light.statistics.notes)


def test_the_gain_of_some_rows_is_about_that_of_the_picture(denoiser_s: Any) -> None:
    """A quarter of the rows: within a factor of two of the median noise ratio of all of them."""
    denoiser_s(0.0)
    statistics = render(spp=16, parameters={"width": 48, "height": 64}).statistics
    assert statistics.denoised is not None and statistics.denoise_forecast is not None
    whole = statistics.denoised["raw_noise_ratio_median"] / statistics.noise_ratio_median
    gain = statistics.denoise_forecast["gain"]
    assert gain is not None and 0.5 < gain / whole < 2


def test_the_time_of_a_denoiser_that_is_left_out_goes_into_passes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the default, which no number of samples binds: whole looks, here one more than the 32 passes."""

    def five_passes(choice: DenoiseChoice) -> DenoiseForecast:
        renderer = choice._prepared.renderer
        renderer.seconds_per_sample = 1.0
        return DenoiseForecast(1.0, 9.0, 5.0 * renderer.samples, 32.0 * renderer.samples)

    monkeypatch.setattr(DenoiseChoice, "_make_forecast", five_passes)
    bright = ms.Exposure(0.15)  # whose noise 320 samples do not reach
    small = {**FAST, "parameters": {"width": 14, "height": 13}}
    found = ms.render(BOX, CAMERA, bright, **small).statistics
    assert found.samples_per_pixel == (32 + FIRST_LOOK) * DEFAULT_PASS_SPP
    assert found.ended_by == "spp" and found.denoised is None


def test_a_goal_that_a_render_without_denoising_works_towards_is_reached(
    denoiser_s: Any,
) -> None:
    denoiser_s(1e9)
    found = render(noise_ratio=20.0).statistics
    assert found.denoised is None and found.ended_by == "noise_ratio"
    assert found.noise_ratio_median <= 20.0


def test_where_the_same_bits_or_both_lights_are_asked_for_no_clock_decides() -> None:
    decided = {"denoise": True}, {"denoise": False}, {"repeatable": True}, {"raw_light": True}
    assert is_undecided(complete(RenderOptions, {}))
    assert not any(is_undecided(complete(RenderOptions, options)) for options in decided)


def test_each_light_group_decides_for_itself(denoiser_s: Any) -> None:
    denoiser_s(1e9)
    light = render(spp=32, light_groups="auto")
    assert light.statistics.denoised is None
    assert any("not denoised: samples are better" in note for note in light.statistics.notes)


def test_a_calm_render_is_not_even_tried(
    denoiser_s: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a thousandth of the exposure the sensor's noise is far above the render's; a second trial would fail."""
    denoiser_s(0.0)
    monkeypatch.setattr(denoise_choice, "CALM", np.inf)
    monkeypatch.setattr(denoise_choice, "START_S", 1e9)
    found = render(spp=16).statistics
    assert found.denoised is None and found.denoise_forecast is not None
    assert found.denoise_forecast["gain"] is None
    assert any("× the sensor's on average; --denoise" in note for note in found.notes)
