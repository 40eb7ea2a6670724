"""When a render ends: a number of samples, a noise ratio, a time; and what it tells on its way."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor.render.passes import stop_criterion
from mitsuba_sensor.render.passes.passes import FEWEST, MOST_SPP, whole_grid
from mitsuba_sensor.render.passes.prepared import prepare
from mitsuba_sensor.render.passes.stop_criterion import (
    FIRST_LOOK,
    PASS_SPP,
    stop_criterion_of,
)
from mitsuba_sensor.render.scene.scene import Scene

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.02)
BOX = SCENES / "cornell_box.xml"  # noise in every pixel
SMALL = {"width": 16, "height": 12}  # large enough to be denoised
FAST = {
    "wavelength_nm": 550,
    "variant": "scalar_spectral",
    "parameters": {"width": 12, "height": 8},
}
LOOKED_AT = {**FAST, "parameters": SMALL, "denoise": True}


def test_a_noise_ratio_is_reached_and_the_statistics_say_so() -> None:
    light = ms.render(BOX, CAMERA, EXPOSURE, noise_ratio=3.0, **FAST)
    found = light.statistics
    assert (found.ended_by, found.noise_ratio_asked) == ("noise_ratio", 3.0)
    assert found.noise_ratio_median <= 3.0 and found.passes >= FEWEST


def test_the_ratio_that_is_reached_is_true() -> None:
    """Two renders of one ratio differ by what they say: the variance of their difference is the sum of theirs.

    Rationale: a render that stops when its ratio happens to be low would look better than it is. Medians over 1536
    pixels of squares: a standard deviation of 4 %, the bound is 15 %.
    """
    options = {**FAST, "parameters": {"width": 48, "height": 32}, "denoise": False}
    one, two = (
        ms.render(BOX, CAMERA, EXPOSURE, noise_ratio=2.0, seed=s, **options) for s in (1, 2)
    )
    claimed = one.standard_error.astype(float) ** 2 + two.standard_error.astype(float) ** 2
    z = (one.data - two.data).astype(float) ** 2 / claimed
    assert np.median(z) / 0.47 == pytest.approx(
        1.0, abs=0.15
    )  # F of 1 and about 50 degrees of freedom
    assert one.statistics.noise_ratio_median <= 2.0


def test_a_render_ends_at_its_most_samples_and_says_that_the_ratio_was_missed() -> None:
    light = ms.render(BOX, CAMERA, EXPOSURE, noise_ratio=1e-6, max_spp=512, **FAST)
    assert light.statistics.ended_by == "max_spp"
    assert light.statistics.samples_per_pixel <= 512
    assert light.statistics.noise_ratio_median > 1e-6


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The render's clock, which goes on by a second for each sample of each row; ``now_s`` is what it shows."""
    shown, rendered = SimpleNamespace(now_s=0.0), Scene.render

    def timed(
        self: Scene, seed: int, samples: int, rows: tuple[int, int], count: int = 1
    ) -> np.ndarray:
        shown.now_s += samples * (rows[1] - rows[0]) * count
        return rendered(self, seed, samples, rows, count)

    monkeypatch.setattr(Scene, "render", timed)
    monkeypatch.setattr(stop_criterion, "time", SimpleNamespace(monotonic=lambda: shown.now_s))
    return shown


@pytest.mark.parametrize("options", [{}, {"noise_ratio": 1e-6}, {"spp": 10**6}])
def test_a_render_ends_when_its_time_is_up(
    options: dict[str, Any], clock: SimpleNamespace
) -> None:
    """No pass is begun that would end later; two passes are always made, behind a trial of a few samples."""
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
    ms.render(BOX, CAMERA, EXPOSURE, noise_ratio=1.0, progress=steps.append, **FAST)
    assert steps.pop().doing == "denoising"
    assert steps[0].done == 0 and math.isnan(steps[0].noise_ratio)
    assert not any(step.most for step in steps) and math.isnan(steps[-1].share)
    late = [step.noise_ratio for step in steps if step.done >= FEWEST]
    assert late[-1] <= 1.0


@pytest.mark.parametrize("options", [{"spp": 64}, {"spp": 64, "max_seconds": 1e4}, {}])
def test_progress_of_a_number_of_passes_goes_from_none_to_all(options: dict[str, Any]) -> None:
    steps: list[Any] = []
    ms.render(BOX, CAMERA, EXPOSURE, progress=steps.append, **options, **FAST)
    shares = [step.share for step in steps if step.doing == "rendering"]
    assert shares[0] == 0 and shares[-1] == 1 and shares == sorted(shares)


def test_the_size_of_the_passes_follows_the_need_and_stays_on_the_sampler_s_grid() -> None:
    """About 32 passes for what one pass of 16 samples says is needed, at most 1024 samples each."""
    for ratio in (0.02, 1.0, 50.0, 1e5):
        sized = stop_criterion_of({"noise_ratio": 0.01}).sized_by(ratio, 1.0)
        assert sized.samples == whole_grid(sized.samples) <= MOST_SPP
        assert PASS_SPP <= sized.samples <= max(PASS_SPP, PASS_SPP * ratio / 0.01 / 32)


def test_a_render_without_a_number_of_samples_stops_where_the_sensor_is_noisier_than_the_render() -> (
    None
):
    """95 % of the lit pixels; the same bytes as of so many samples that were asked for. Much light has little shot
    noise beside it, so that all samples are taken."""
    dim = ms.render(BOX, CAMERA, ms.Exposure(0.0005), **FAST)
    assert dim.statistics.ended_by == "sensor_noise"
    assert dim.statistics.samples_per_pixel < stop_criterion.DEFAULT_SPP
    asked = ms.render(
        BOX, CAMERA, ms.Exposure(0.0005), spp=dim.statistics.samples_per_pixel, **FAST
    )
    assert asked.statistics.ended_by == "spp"
    assert asked.data.tobytes() == dim.data.tobytes()


@pytest.mark.parametrize("time_s", one_in(2, [0.0005, 0.005, 0.01, 0.02, 0.05]))
def test_a_render_that_stopped_at_the_sensor_s_noise_has_less(time_s: float) -> None:
    """Denoised error bars can be larger than those of the passes, and they count."""
    light = ms.render(BOX, CAMERA, ms.Exposure(time_s), **LOOKED_AT)
    stopped = light.statistics.ended_by == "sensor_noise"
    assert stopped == (light.statistics.samples_per_pixel < stop_criterion.DEFAULT_SPP)
    assert not stopped or light.statistics.noise_ratio_p95 <= 1


def test_all_samples_are_taken_where_much_light_shows_the_render_s_noise() -> None:
    bright = ms.render(BOX, CAMERA, ms.Exposure(0.05), **LOOKED_AT)
    assert bright.statistics.ended_by == "spp"
    assert bright.statistics.samples_per_pixel == stop_criterion.DEFAULT_SPP


@pytest.mark.parametrize("denoise", [True, False])
def test_a_look_at_the_noise_leaves_the_rest_of_the_render_as_it_is(denoise: bool) -> None:
    """Compared with a render that is never looked at."""
    prepared = prepare(
        BOX, CAMERA, ms.Exposure(0.05), **{**FAST, "parameters": SMALL}, denoise=denoise
    )
    looked_at = stop_criterion_of({})
    light = prepared.render(1, looked_at)
    assert light.statistics.passes > FIRST_LOOK
    plain = prepared.render(
        1, replace(looked_at, passes=light.statistics.passes, to_sensor_noise=False)
    )
    assert plain.data.tobytes() == light.data.tobytes()
    assert plain.relative_error.tobytes() == light.relative_error.tobytes()
    raw_ratio = "raw_noise_ratio_p95"
    if denoise:
        assert light.statistics.denoised is not None and plain.statistics.denoised is not None
        assert light.statistics.denoised[raw_ratio] == plain.statistics.denoised[raw_ratio]


def test_a_metered_render_stops_by_the_noise_of_the_exposure_that_is_found() -> None:
    light = ms.render(BOX, CAMERA.replace(**{"pixel.full_well_e": 400}), "auto", **FAST)
    assert light.statistics.ended_by == "sensor_noise"
    assert light.statistics.noise_ratio_p95 <= 1


def test_the_next_look_comes_when_the_noise_should_be_low_enough() -> None:
    """Denoised, it falls as samples^-0.75: to the eighth with 16 times as many."""
    default = stop_criterion_of({})
    assert default.passes == 32
    assert default.next_look(FIRST_LOOK, 2**0.75) == 2 * FIRST_LOOK
    assert default.next_look(FIRST_LOOK, 1.01) == 2 * FIRST_LOOK
    assert default.next_look(FIRST_LOOK, 8.0) is None
    assert default.next_look(FIRST_LOOK, math.inf) is None
    assert stop_criterion_of({"spp": 256}).first_look() is None
    assert not stop_criterion_of({}, groups=8).to_sensor_noise  # bands for other cameras, too


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"noise_ratio": 0}, "noise_ratio is 0"),
        ({"noise_ratio": -0.1}, "noise_ratio is -0.1"),
        ({"noise_ratio": math.nan}, "noise_ratio is nan"),
        ({"noise_ratio": 0.01, "spp": 64}, "give one"),
        ({"spp": 64, "max_spp": 128}, "spp is exact"),
        ({"max_seconds": -1}, "max_seconds is -1"),
        ({"max_spp": 1}, "max_spp is 1"),
        ({"spectral": "colours"}, "spectral is 'colours'"),
        ({"spectral": "channels", "wavelength_nm": 550}, "a single band has no colour filters"),
    ],
)
def test_contradictory_budgets_are_refused_in_one_sentence(
    options: dict[str, Any], said: str
) -> None:
    with pytest.raises(ms.InputError) as caught:
        ms.render(
            SCENES / "flat_field.xml", CAMERA, EXPOSURE, variant="scalar_spectral", **options
        )
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_fixed_number_of_samples_is_the_same_render_with_or_without_time_to_spare() -> None:
    def bits(light: ms.Irradiance) -> bytes:
        return light.data.tobytes()

    assert bits(ms.render(BOX, CAMERA, EXPOSURE, spp=32, **FAST)) == bits(
        ms.render(BOX, CAMERA, EXPOSURE, spp=32, max_seconds=1e6, **FAST)
    )
