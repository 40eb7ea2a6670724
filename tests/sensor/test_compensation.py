"""Compensated render noise: shot noise is drawn with less variance, and the total is that of Poisson's law."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers import KEEP
from helpers.marks import exhaustive
from numpy.typing import NDArray
from scipy import stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.dark_current import DarkCurrent
from mitsuba_sensor.stages.effects.shot_noise import (
    LIMIT,
    ShotNoise,
    compensable,
    largest_e2,
    reserved,
)

BACKENDS = (exhaustive("float64"), "numpy", exhaustive("drjit"))
EXPOSURE = ms.Exposure(0.1)
TABLE1 = ms.load_camera("konnik_table1")
QE = float(TABLE1.qe([TABLE1.quantum_efficiency.reference_nm])[0, 0])
"""Electrons per photon."""

BARE = TABLE1.replace(**{"pixel.prnu": 0.0, "dark_current.fom_na_per_cm2": 0.0})
"""Nothing before the well but light and its shot noise."""

SHAPE = (53, 47)
LIGHT_E = np.geomspace(0.05, 40_000.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
NOISE_E2 = LIGHT_E * np.random.default_rng(3).uniform(0.0, 0.6, SHAPE)
"""From nothing to more than can be compensated."""


def rendered(light_e: Any, noise_e2: Any = None) -> ms.Photons:
    """Photons that free so many electrons on average."""
    return ms.Photons(np.asarray(light_e) / QE, variance_e2=noise_e2)


def frame_of(
    shape: tuple[int, int], backend: Backend = NUMPY_FLOAT64, seed: int = 5
) -> ms.Frame:
    return ms.Frame(EXPOSURE, SensorWindow(7, shape, backend=backend), seed)


class Parts:
    """A frame that draws nothing and keeps the chance that it is asked for."""

    def bernoulli(self, _: str, chance: Any) -> float:
        self.chance = float(chance)
        return 0.0


def law_of(mean: float, variance: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Every count and its probability, from the parts that are drawn: a Poisson law, shifted and mixed."""
    compensated, _ = compensable(np.float64(mean), 0.0, np.float64(variance))
    parts: Any = Parts()
    whole, rest = map(float, reserved(np.float64(mean), compensated, parts))
    reach = 12 * np.sqrt(rest) + 40
    n = np.arange(np.floor(max(rest - reach, 0)), rest + reach)
    poisson = stats.poisson.pmf(n, rest)
    moved = np.concatenate([[0.0], poisson])
    law = (1 - parts.chance) * np.concatenate([poisson, [0.0]]) + parts.chance * moved
    return whole + np.append(n, n[-1] + 1), law


MEANS = (1e-3, 0.03, 0.3, 0.5, 1.0, 1.7, 2.0, 3.0, 9.99, 10.5, 31.4, 100.0, 1234.5, 1e4, 1e6)
SHARES = (0.0, 1e-9, 0.05, 0.16, 0.3, 1 / 3)


@pytest.mark.parametrize("mean", MEANS)
@pytest.mark.parametrize("share", SHARES)
def test_the_law_has_exactly_the_mean_and_what_the_render_leaves_of_the_variance(
    mean: float, share: float
) -> None:
    """All counts added up: to 1e-10, from a thousandth of an electron to a million. (SciPy's law is as good at 1e6.)"""
    variance = min(share * mean, float(largest_e2(np.float64(mean))))
    n, law = law_of(mean, variance)
    tolerance = 1e-10 if mean < 1e5 else 1e-8
    assert law.sum() == pytest.approx(1, abs=tolerance) and n[0] >= 0
    found = np.sum(law * (n - mean))
    assert found == pytest.approx(0, abs=tolerance * mean)
    assert np.sum(law * (n - mean) ** 2) == pytest.approx(mean - variance, rel=tolerance)
    np.testing.assert_array_equal(n, np.floor(n))


@pytest.mark.parametrize("mean", [1e-6, 0.02, 0.2, 0.7, 1.0, 1.5, 2.9, 3.0, 1e3 + 0.25])
def test_a_mean_compensates_as_much_as_its_distribution_can_lose(mean: float) -> None:
    """Its Poisson part is used up there: one more would be negative. Below 1 e- that is the bound of every whole law:
    0 or 1 with mean μ has variance μ − μ², and no law has less."""
    most = float(largest_e2(np.float64(mean)))
    parts: Any = Parts()
    _, rest = reserved(np.float64(mean), np.float64(most), parts)
    assert rest == pytest.approx(0, abs=1e-7)
    if mean < 1:
        assert most == pytest.approx(mean**2)


# Samples


CASES_E = (
    (0.3, 0.09),
    (1.0, 0.2),
    (2.5, 0.7),
    (9.0, 2.25),
    (12.0, 3.999),
    (100.0, 16.0),
    (1e4, 3e3),
)
"""Mean light [e-] and the variance of its render [e-²]; all of it can be compensated."""

DRAWS = 2**19


@pytest.mark.parametrize("backend", BACKENDS, indirect=True)
@pytest.mark.parametrize(
    ("draws", "dark_e"), [(2**17, 5.0), exhaustive(DRAWS, 0.0), exhaustive(DRAWS, 5.0)]
)
def test_every_engine_draws_whole_electrons_of_that_mean_and_variance(
    backend: Backend, draws: int, dark_e: float
) -> None:
    """Of 2^19 draws 5 standard errors of the variance are 1.0 % (1.3 % at 0.3 e-), of the mean 0.7 % of σ; of 2^17
    twice as much.

    28 comparisons each at P(|z| > 5) = 6e-7: one other seed in 60 000 would fail (the backends share their bits).
    """
    mean, noise = (
        np.repeat(np.array(x)[:, None], draws, axis=1) for x in zip(*CASES_E, strict=True)
    )
    frame = frame_of(mean.shape, backend)
    light, variance = (backend.from_numpy(x, frame.window) for x in (mean, noise))
    dark = frame.number(dark_e) if dark_e else 0.0
    after = ShotNoise().sample(ms.Electrons(light, dark, variance_e2=variance), frame)
    for drawn, about, compensated in (
        (after.light, mean, noise),
        (after.dark, np.full_like(mean, dark_e), 0 * noise),
    ):
        n = np.asarray(backend.to_numpy(drawn, frame.window), dtype=np.float64)
        assert (n >= 0).all() and (n == np.floor(n)).all()
        expected, sigma = (
            (about - compensated)[:, 0],
            np.sqrt(np.maximum((about - compensated)[:, 0], 1e-30)),
        )
        away = n - about
        assert (
            np.abs(away.mean(axis=1)) <= 5 * sigma / np.sqrt(draws) + 1e-6 * about[:, 0]
        ).all()
        error = 5 * np.sqrt(np.maximum((away**4).mean(axis=1) - expected**2, 0) / draws)
        assert (np.abs((away**2).mean(axis=1) - expected) <= error + 1e-6 * expected).all()
    assert after.variance_e2 is None


RENDERS = 240


@pytest.mark.parametrize(
    ("camera", "mean", "ratio"),
    [
        (BARE, 3.0, 0.16),
        exhaustive(BARE, 200.0, 0.16),
        exhaustive(TABLE1, 40.0, 0.3),
    ],
)
def test_frames_with_renders_of_their_own_have_the_mean_and_variance_of_shot_noise(
    camera: ms.Camera, mean: float, ratio: float
) -> None:
    """240 frames of 64 × 64 pixels, render noise N(μ, ratio·μ) cut at 0, through the whole chain to the well.

    5 standard errors of var/mean of 983 040 counts are 0.84 % (√(2 + κ)/√n, excess κ < 0.8); the cut at 0 and the limit
    leave less than 0.1 % beside it. Neighbours and next frames: |ρ| < 5/√n. Five comparisons at 6e-7 each.
    Not compensated, a render leaves 16 % too much (with Table 1's dark current 12 in 214: 5.6 %).
    """
    draw = np.random.default_rng(11)
    shape = (64, 64)
    flat = camera.replace(**{"pixel.prnu": 0.0, "dark_current.cv": 0.0})
    noise = np.full(shape, ratio * mean)
    frames = []
    for index in range(RENDERS):
        render = np.maximum(draw.normal(mean, np.sqrt(noise)), 0.0)
        frames.append(
            ms.expose(
                rendered(render, noise), flat, EXPOSURE, first_frame=index, keep="electrons"
            ).electrons
        )
    n = np.concatenate(frames)
    dark = next(stage for stage in chain(flat) if isinstance(stage, DarkCurrent))
    expected = mean + dark.mean_e(frame_of(shape))
    size = n.size**0.5
    assert n.mean() == pytest.approx(expected, abs=5 * expected**0.5 / size + 1e-4 * mean)
    assert n.var() / n.mean() == pytest.approx(1, abs=5 * 2.8**0.5 / size + 1e-3)
    away = n - n.mean()
    for a, b in (
        (away[:, 1:], away[:, :-1]),
        (away[:, :, 1:], away[:, :, :-1]),
        (away[1:], away[:-1]),
    ):
        assert abs(np.mean(a * b)) / away.var() < 5 / size


# What cannot be compensated


def test_a_limit_is_kept_and_what_is_left_is_counted_and_reported() -> None:
    """Four pixels: all compensated; above the limit; above the square of a small mean; nothing to compensate."""
    light_e = np.array([[100.0, 100.0, 0.2, 50.0]])
    noise = np.array([[20.0, 90.0, 0.06, 0.0]])
    report = ms.expose(rendered(light_e, noise), BARE, EXPOSURE, precision="float64").report
    compensated = np.array([20.0, 100 / 3, 0.04, 0.0])
    assert report["counts"]["compensated_short"] == 2
    found = report["compensation"]
    assert found["limit"] == LIMIT
    assert found["variance_e2"] == pytest.approx(noise.mean())
    assert found["compensated_e2"] == pytest.approx(compensated.mean())
    assert found["left_e2"] == pytest.approx((noise - compensated).mean())
    assert found["left_over_shot"] == pytest.approx((noise - compensated).sum() / 200.2)
    line = next(line for line in report["stages"] if line["name"] == "shot noise")
    expected = math.sqrt((light_e - compensated).mean())
    error = 4 * line["sigma_temporal_error"]
    assert line["sigma_temporal_expected"] == pytest.approx(expected, abs=error)


def test_light_of_an_exact_mean_reports_nothing_of_it() -> None:
    report = ms.expose(rendered(LIGHT_E), TABLE1, EXPOSURE).report
    assert "compensation" not in report and "compensated_short" not in report["counts"]


def test_dark_current_compensates_what_the_light_cannot() -> None:
    """2 e- of light that vary by 3 e-², and 30 e- of dark current: both keep their mean, the sum varies by 29 e-²."""
    by_light, by_dark = compensable(
        np.array([[2.0, 9.0]]), np.array([[30.0, 30.0]]), np.array([[3.0, 3.0]])
    )
    np.testing.assert_array_equal(by_light, [[0.0, 3.0]])
    np.testing.assert_array_equal(by_dark, [[3.0, 0.0]])
    shape = (1, 2**19)
    after = ShotNoise().sample(
        ms.Electrons(np.full(shape, 2.0), 30.0, variance_e2=np.full(shape, 3.0)),
        frame_of(shape),
    )
    size = shape[1] ** 0.5
    for n, mean, variance in ((after.light, 2, 2), (after.dark, 30, 27), (after.total, 32, 29)):
        assert n.mean() == pytest.approx(mean, abs=5 * variance**0.5 / size)
        assert n.var() == pytest.approx(variance, rel=5 * 2.5**0.5 / size)


# Nothing else moves


@pytest.mark.parametrize("camera", [TABLE1, BARE], ids=["dark current", "no dark current"])
def test_no_variance_to_compensate_is_the_plain_frame_bit_for_bit(
    backend: Backend, camera: ms.Camera
) -> None:
    engine = "drjit" if backend.compiled else "numpy"
    plain, compensated = (
        ms.expose(
            light,
            camera,
            EXPOSURE,
            engine=engine,
            precision=backend.precision,
            keep=KEEP,
        )  # type: ignore[arg-type]
        for light in (rendered(LIGHT_E), rendered(LIGHT_E, np.zeros(SHAPE)))
    )
    for name in (*KEEP, "digital"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(compensated, name))


# What is refused


@pytest.mark.parametrize(
    ("variance", "sentence"),
    [
        ("much", "variance_e2 is not numeric; pass one variance per pixel"),
        (1.0, r"has shape \(\); it must be \(53, 47\), one variance per pixel"),
        (np.zeros((47, 53)), r"has shape \(47, 53\)"),
        (
            np.where(LIGHT_E > 1e4, -1.0, 0.0),
            r"is -1 in the first of \d+ bad place\(s\), \(\d+, \d+\)",
        ),
        (np.full(SHAPE, np.nan), "a render of one pass has none, so pass None"),
        (np.full(SHAPE, np.inf), "is inf in the first of 2491"),
    ],
)
def test_a_variance_that_is_none_is_one_sentence(variance: Any, sentence: str) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        ms.expose(rendered(LIGHT_E, variance), TABLE1, EXPOSURE)


@pytest.mark.parametrize(
    ("how", "changes", "sentence"),
    [
        ({"frames": 2}, {}, "frames is 2 and photons has variance_e2, .* one frame at a time"),
        (
            {},
            {"quantum_efficiency.quantum_yield": [2.0, 1.0]},
            "quantum_yield .* leave one of them out",
        ),
    ],
)
def test_compensation_is_refused_where_it_would_be_wrong(
    how: dict[str, Any], changes: Any, sentence: str
) -> None:
    """Frames that share a render would be too quiet from one to the next."""
    camera, light = TABLE1.replace(**changes), rendered(LIGHT_E, NOISE_E2)
    for ask in (ms.expose, ms.stream):
        with pytest.raises(ms.InputError, match=sentence):
            ask(light, camera, EXPOSURE, **how)
