"""Denoising that nobody has decided: left out where samples are better in the same time. No clock decides."""

from __future__ import annotations

import gc
import time
import weakref
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.render.denoise.network import is_undecided
from mitsuba_sensor.render.options import RenderOptions
from mitsuba_sensor.render.passes import denoise_choice
from mitsuba_sensor.render.passes.denoise_choice import DenoiseChoice, DenoiseForecast
from mitsuba_sensor.render.passes.prepared import prepare
from mitsuba_sensor.render.passes.stop_criterion import (
    DEFAULT_PASS_SPP,
    FIRST_LOOK,
    stop_criterion_of,
)

pytest.importorskip("pyoidn", reason="Open Image Denoise has no wheel for this machine")

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.05)
BOX = SCENES / "cornell_box.xml"  # noise in every pixel
FAST: dict[str, Any] = {
    "wavelength_nm": 550,
    "variant": "scalar_spectral",
    "parameters": {"width": 32, "height": 64},
    "progress": False,
}
UNTOLD = {name: value for name, value in FAST.items() if name != "progress"}


def render(**options: Any) -> ms.Irradiance:
    return ms.render(BOX, CAMERA, EXPOSURE, **{**FAST, **options})


@pytest.fixture
def denoiser_samples(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sets the samples that take as long as denoising a pixel, and tries some rows of a small picture."""

    def chosen(samples: float) -> None:
        monkeypatch.setattr(denoise_choice, "LEAST_TRIED_PIXELS", 1)
        monkeypatch.setattr(
            denoise_choice, "_denoiser_samples", lambda pixels, rays: samples * pixels
        )

    return chosen


@pytest.mark.parametrize(
    ("gain", "denoiser_samples", "denoises"),
    [(3.0, 190.0, True), (3.0, 210.0, False), (0.9, 0.0, False), (None, 0.0, False)],
)
def test_denoising_must_gain_what_samples_gain_in_its_time(
    gain: float | None, denoiser_samples: float, denoises: bool
) -> None:
    """In the time of 100 samples and of a denoiser worth 200 there are 300 samples, a third of the variance."""
    forecast = DenoiseForecast(gain, 5.0, denoiser_samples, samples=100.0)
    assert forecast.denoises == denoises
    assert forecast.needed == pytest.approx(1 + denoiser_samples / 100)


@pytest.mark.parametrize("asked", one_in(2, [{"spp": 16}, {"noise_ratio": 20.0}, {}]))
@pytest.mark.parametrize("beside", [0.99, 1.01])
def test_a_slow_clock_and_a_fast_one_choose_the_same_bytes_at_the_boundary(
    asked: dict[str, Any],
    beside: float,
    denoiser_samples: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A denoiser that takes 1 % less or more than it may: left out on neither, or on both, of two clocks."""
    denoiser_samples(0.0)
    first = render(**asked).statistics.denoise_forecast
    assert first is not None and first["gain"] is not None and first["samples"] is not None
    denoiser_samples(beside * (first["gain"] - 1) * first["samples"])
    clocks = {name: getattr(time, name) for name in ("monotonic", "perf_counter", "time")}
    lights = []
    for speed in (1e-4, 1e4):
        for name, clock in clocks.items():
            monkeypatch.setattr(time, name, lambda clock=clock, speed=speed: clock() * speed)
        lights.append(render(**asked))
    slow, fast = lights
    assert (slow.statistics.denoised is None) == (beside > 1)
    assert slow.data.tobytes() == fast.data.tobytes()
    assert slow.standard_error.tobytes() == fast.standard_error.tobytes()
    assert slow.statistics.denoise_forecast == fast.statistics.denoise_forecast


def test_a_slow_denoiser_is_left_out_and_the_light_is_that_without_it(
    denoiser_samples: Any,
) -> None:
    denoiser_samples(1e9)
    light, plain = render(spp=16), render(spp=16, denoise=False)
    assert light.data.tobytes() == plain.data.tobytes()
    assert light.standard_error.tobytes() == plain.standard_error.tobytes()
    statistics = light.statistics
    assert statistics.denoised is None and statistics.denoise_forecast is not None
    assert statistics.denoise_forecast["gain_of_samples"] > 1e6
    assert any("not denoised: samples are better here" in note for note in statistics.notes)


def test_a_quick_denoiser_is_used_and_its_light_is_that_of_who_asks_for_it(
    denoiser_samples: Any,
) -> None:
    denoiser_samples(0.0)
    light, asked = render(spp=16), render(spp=16, denoise=True)
    assert light.statistics.denoised is not None
    assert light.data.tobytes() == asked.data.tobytes()
    forecast = light.statistics.denoise_forecast
    assert forecast is not None and asked.statistics.denoise_forecast is None
    assert forecast["gain"] is not None and forecast["gain"] > 1.5
    assert not any("not denoised" in note for note in light.statistics.notes)


def test_the_gain_of_some_rows_is_about_that_of_the_picture(denoiser_samples: Any) -> None:
    """A quarter of the rows: within a factor of two of the median noise ratio of all of them."""
    denoiser_samples(0.0)
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
        samples = choice._prepared.renderer.samples
        return DenoiseForecast(1.0, 9.0, 5.0 * samples, 32.0 * samples)

    monkeypatch.setattr(DenoiseChoice, "_make_forecast", five_passes)
    bright = ms.Exposure(0.15)  # whose noise 320 samples do not reach
    small = {**FAST, "parameters": {"width": 14, "height": 13}}
    found = ms.render(BOX, CAMERA, bright, **small).statistics
    assert found.samples_per_pixel == (32 + FIRST_LOOK) * DEFAULT_PASS_SPP
    assert found.ended_by == "spp" and found.denoised is None


def test_a_goal_that_a_render_without_denoising_works_towards_is_reached(
    denoiser_samples: Any,
) -> None:
    denoiser_samples(1e9)
    found = render(noise_ratio=20.0).statistics
    assert found.denoised is None and found.ended_by == "noise_ratio"
    assert found.noise_ratio_median <= 20.0


def test_where_repeatable_or_both_lights_are_asked_for_no_forecast_decides() -> None:
    decided = {"denoise": True}, {"denoise": False}, {"repeatable": True}, {"raw_light": True}
    assert is_undecided(complete(RenderOptions, {}))
    assert not any(is_undecided(complete(RenderOptions, options)) for options in decided)


def test_each_light_group_decides_for_itself(denoiser_samples: Any) -> None:
    denoiser_samples(1e9)
    light = render(spp=32, light_groups="auto")
    assert light.statistics.denoised is None
    assert any("not denoised: samples are better" in note for note in light.statistics.notes)


def test_a_calm_render_is_not_even_tried(
    denoiser_samples: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With so calm a limit no render is noisy enough for a trial that takes longer than its samples."""
    denoiser_samples(1e9)
    monkeypatch.setattr(denoise_choice, "CALM", np.inf)
    found = render(spp=16).statistics
    assert found.denoised is None and found.denoise_forecast is not None
    assert found.denoise_forecast["gain"] is None
    assert any("× the sensor's on average; --denoise" in note for note in found.notes)


def test_a_scene_is_unloaded_with_its_render_also_where_a_forecast_was_made() -> None:
    """Without a search for cycles: what is loaded beside it would change the kernels of the next scene."""
    prepared = prepare(BOX, CAMERA, EXPOSURE, denoise=True, undecided=True, **UNTOLD)
    loaded = weakref.ref(prepared.scene)
    gc.disable()
    try:
        light = prepared.render(1, stop_criterion_of({"spp": 16}))
        del prepared
        assert light.statistics.denoise_forecast is not None and loaded() is None
    finally:
        gc.enable()
