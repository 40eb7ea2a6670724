"""Lamps that flicker: every row of a frame gets the light of the time at which it is open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.optics.waveform import Waveform
from mitsuba_sensor.render.light.light_sum import sum_of_groups

ROW_TIME_US = 25.0
GLOBAL = ms.load_camera("konnik_table1")
ROLLING = GLOBAL.replace(
    **{"sensor.shutter": "rolling", "sensor.row_time_us": ROW_TIME_US, "sensor.rows": 2000}
)
EXPOSURE = ms.Exposure(0.0031)
ROWS = 400
PWM = ms.pwm(100, 0.4, 0.15)


@dataclass(frozen=True)
class Statistics:
    """What photons and frames take of the statistics of a render."""

    intrinsics: None = None
    camera_to_world: None = None
    brightness: None = None
    notes: tuple[str, ...] = ()


@pytest.fixture(scope="module")
def field() -> ms.Irradiance:
    """A flat field of two light groups, as a render writes it: lamp has 3 times the light of sky."""

    def flat(level: float) -> Any:
        data = np.full((ROWS, 8, 1), level, np.float32)
        errors = 0.01 * data, np.full((ROWS, 8), 0.01, np.float32)
        statistics = Statistics()
        return ms.Irradiance(data, np.array([550.0]), np.array([1.0]), *errors, statistics)  # type: ignore[arg-type]

    return sum_of_groups({"lamp": flat(3e-3), "sky": flat(1e-3)})


def profile(light: ms.Irradiance, camera: ms.Camera, **options: Any) -> np.ndarray:
    """Photons of each row."""
    return ms.collect(light, camera, EXPOSURE, **options).total.mean(axis=1)


@pytest.mark.parametrize("waveform", [PWM, ms.sine(120, 0.8, 0.3), ms.mains(50)])
def test_the_rows_of_a_flat_field_are_the_integral_of_the_waveform(
    waveform: Waveform, field: ms.Irradiance
) -> None:
    """Within 0.1 %, against a sum over 20 000 instants of the exposure of each row."""
    rows = profile(field.with_lights(lamp=waveform), ROLLING, start_s=0.0123)[::4]
    starts = 0.0123 + np.arange(0, ROWS, 4) * ROW_TIME_US * 1e-6
    instants = starts[:, None] + (np.arange(20_000) + 0.5) * EXPOSURE.time_s / 20_000
    weights = waveform.mean_over(instants, 0.0).mean(axis=1)
    lamp, sky = (
        ms.collect(field.groups[name], ROLLING, EXPOSURE).total[0, 0]
        for name in ("lamp", "sky")
    )
    np.testing.assert_allclose(rows, lamp * weights + sky, rtol=1e-3)
    assert np.ptp(rows) > 0.2 * rows.mean()


def test_bands_move_by_the_time_between_two_frames(field: ms.Irradiance) -> None:
    """At 100 Hz a frame that begins 32.5 ms later is a quarter of a period on: its bands are 100 rows higher."""
    lit = field.with_lights(lamp=PWM)
    first, later = (profile(lit, ROLLING, start_s=start) for start in (0.0, 0.0325))
    np.testing.assert_allclose(later[:-100], first[100:], rtol=1e-5)


def test_an_exposure_of_whole_periods_has_no_bands(field: ms.Irradiance) -> None:
    """Means of 400 rows of a frame vary as those of steady light do: χ² per row below its 99.99 % quantile."""
    from scipy.stats import chi2

    exposure = ms.Exposure(0.02)
    lit = field.with_lights(lamp="10 pwm(100, 0.4)", sky=10)
    frames = ms.expose(lit, ROLLING, exposure, seed=3)
    steady = ms.expose(replace(lit, waveforms={}), ROLLING, exposure, seed=4)
    change = frames.digital[0].mean(axis=1) - steady.digital[0].mean(axis=1)
    variance = 2 * frames.temporal_variance.mean() / frames.digital.shape[2]
    assert (change**2 / variance).sum() < chi2.ppf(0.9999, ROWS)
    assert abs(change.mean()) < 3 * np.sqrt(variance / ROWS)
    banded = ms.expose(lit, ROLLING, ms.Exposure(0.015), seed=3).digital[0].mean(axis=1)
    assert np.ptp(banded) > 10 * np.sqrt(variance)


def test_the_light_itself_is_the_mean_and_so_is_what_is_metered(field: ms.Irradiance) -> None:
    flickering = field.with_lights(lamp="0.5 pwm(100, 0.1)")
    steady = field.with_lights(lamp=0.5)
    np.testing.assert_array_equal(flickering.data, steady.data)
    assert "lamp 0.5 pwm(100, 0.1, 0)" in repr(flickering)
    times = [
        ms.expose(one, ROLLING, "auto").first.exposure.time_s for one in (flickering, steady)
    ]
    assert times[0] == times[1]


def test_error_bars_follow_the_rows(field: ms.Irradiance) -> None:
    """σ² = Σ w²·σ_g², and a lamp that is off while a row is open adds no error to it."""
    photons = ms.collect(field.with_lights(lamp=ms.pwm(50, 0.1)), ROLLING, ms.Exposure(1e-4))
    relative = photons.source.light.relative_error[:, 0]  # type: ignore[union-attr]
    weights = ms.pwm(50, 0.1).mean_over(np.arange(ROWS) * ROW_TIME_US * 1e-6, 1e-4)
    expected = np.hypot(0.03 * weights, 0.01) / (3 * weights + 1)
    np.testing.assert_allclose(relative, expected, rtol=1e-4)
    assert relative[-1] == pytest.approx(0.01)


def test_infinite_light_of_a_lamp_that_is_off_is_none(field: ms.Irradiance) -> None:
    lamp = field.groups["lamp"]
    data = lamp.data.copy()
    data[-1, 0] = np.inf
    lit = sum_of_groups({**field.groups, "lamp": replace(lamp, data=data)})
    rows = ms.collect(lit.with_lights(lamp=ms.pwm(50, 0.1)), ROLLING, ms.Exposure(1e-4)).total
    assert rows[-1, 0] == pytest.approx(rows[-1, 1])


def test_lag_of_a_lamp_that_flickers_is_that_of_the_frame_before(field: ms.Irradiance) -> None:
    """Frame k shows f of the light of frame k − 1, and is the same alone, also in ms.stream; frame 0 sees itself."""
    lit, times = field.with_lights(lamp="10 pwm(7, 0.5)"), {"fps": 10.0, "seed": 3}
    lagging = GLOBAL.replace(**{"quantum_efficiency.image_lag": 0.2})
    plain = [
        ms.expose(lit, GLOBAL, EXPOSURE, first_frame=k, **times).theory.light.mean_e
        for k in range(3)
    ]
    series = ms.expose(lit, lagging, EXPOSURE, frames=3, **times).digital
    streamed = list(ms.stream(lit, lagging, EXPOSURE, frames=3, **times))
    np.testing.assert_array_equal(series, streamed)
    assert abs(plain[1].mean() - plain[0].mean()) > 0.3 * plain[0].mean()
    for k in range(3):
        alone = ms.expose(lit, lagging, EXPOSURE, first_frame=k, **times)
        shown = 0.8 * plain[k] + 0.2 * plain[max(k - 1, 0)]
        np.testing.assert_allclose(alone.theory.light.mean_e, shown, rtol=1e-5)
        np.testing.assert_array_equal(alone.digital[0], series[k])
