"""Distributions of dark signal recover the published parameters from their own samples, with honest intervals."""

from __future__ import annotations

import math

import matplotlib.figure
import numpy as np
import pytest
import scipy.stats
from helpers.marks import one_in
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_signal import DarkSignal, Fit, dark_signal
from mitsuba_sensor.lab.statistics.families import FAMILIES
from mitsuba_sensor.lab.statistics.mixture import Mixture

PIXELS = 512 * 512


def measured(values: NDArray[np.float64], **options: object) -> DarkSignal:
    return dark_signal(Stack(values.reshape(1, 1, -1), 100.0), **options)  # type: ignore[arg-type]


def fit_of(found: DarkSignal, name: str) -> Fit:
    return next(one for one in found.fits if one.name == name)


def test_the_papers_log_normals_and_gamma_come_back_from_their_own_samples() -> None:
    """512 × 512 values; 3.5 standard errors: ±2.5 for a, 6.5e-5 and 4.6e-5 for µ and σ."""
    rng = np.random.default_rng(1)
    for mu, sigma in ((4.0241, 0.033), (4.0246, 0.035)):
        found = fit_of(
            measured(rng.lognormal(mu, sigma, PIXELS), families=("log-normal", "normal")),
            "log-normal",
        )
        assert found.parameters[0].value == pytest.approx(mu, abs=3.5 * 6.8e-5)
        assert found.parameters[1].value == pytest.approx(sigma, abs=3.5 * 4.8e-5)
        assert found.ks_probability > 1e-3
    found = measured(rng.gamma(914.6579, 0.0611, PIXELS))
    shape, scale = found.best.parameters
    assert found.best.name == "gamma" and shape.value == pytest.approx(914.66, abs=3.5 * 2.53)
    assert (shape.high - shape.low) / 2 == pytest.approx(1.96 * 2.53, rel=0.02)
    assert shape.value * scale.value == pytest.approx(914.6579 * 0.0611, abs=3.5 * 0.0036)


def test_the_superimposed_distribution_comes_back_with_its_weights() -> None:
    """gamma(627.200, 0.0893) + 1 % of U[50, 460] + 2 % of N(18, 4), 10⁵ values: every parameter within 2 of its
    intervals' halves; the lower edge lies below the gamma, which hides it, so that its interval is 15 DN wide."""
    rng = np.random.default_rng(2)
    count, part = 100_000, rng.random(100_000)
    uniform, normal = rng.uniform(50, 460, count), rng.normal(18, 4, count)
    values = np.where(
        part < 0.01, uniform, np.where(part < 0.03, normal, rng.gamma(627.2, 0.0893, count))
    )
    found = measured(
        np.abs(values),
        families=("gamma", "normal"),
        superimposed=(("gamma", "uniform", "normal"),),
    )
    assert found.best.name == "gamma + uniform + normal" and found.best.ks_probability > 1e-3
    known = {"a": 627.2, "b": 0.0893, "w_uniform": 0.01, "from": 50, "to": 460}
    known |= {"w_normal": 0.02, "µ_normal": 18, "σ_normal": 4}
    for one in found.best.parameters:
        middle, half = 0.5 * (one.high + one.low), 0.5 * (one.high - one.low)
        assert abs(known[one.symbol] - middle) < 2 * half, one
    edge = found.best.parameters[3]
    assert 5 < edge.high - edge.low < 30 and edge.unit == "DN"


@pytest.mark.parametrize(
    ("name", "sample"),
    [
        ("normal", lambda rng: rng.normal(50, 3, 400)),
        ("log-normal", lambda rng: rng.lognormal(1.0, 0.5, 400)),
        ("gamma", lambda rng: rng.gamma(3.0, 2.0, 400)),
        ("inverse Gaussian", lambda rng: rng.wald(5.0, 12.0, 400)),
    ],
)
def test_intervals_cover_the_parameters_95_times_in_100(name: str, sample: object) -> None:
    """400 samples of 400: shares within 4.2 %, beyond once in 8000 runs each."""
    rng = np.random.default_rng(3)
    known = {
        "normal": (50, 3),
        "log-normal": (1.0, 0.5),
        "gamma": (3.0, 2.0),
        "inverse Gaussian": (5.0, 12.0),
    }[name]
    found = [measured(sample(rng), families=(name,)).best.parameters for _ in range(400)]  # type: ignore[operator]
    for measured_ones, value in zip(zip(*found, strict=True), known, strict=True):
        assert np.mean([one.covers(value) for one in measured_ones]) == pytest.approx(
            0.95, abs=0.042
        )


@pytest.mark.parametrize(
    ("name", "p", "law"),
    [
        ("normal", (50.0, 3.0), scipy.stats.norm(50, 3)),
        ("log-normal", (1.0, 0.5), scipy.stats.lognorm(0.5, scale=math.e)),
        ("gamma", (914.6579, 0.0611), scipy.stats.gamma(914.6579, scale=0.0611)),
        ("inverse Gaussian", (5.0, 12.0), scipy.stats.invgauss(5 / 12, scale=12)),
    ],
)
def test_densities_and_distribution_functions_are_scipys(
    name: str, p: tuple[float, ...], law: object
) -> None:
    x = law.ppf(np.linspace(0.001, 0.999, 50))  # type: ignore[attr-defined]
    np.testing.assert_allclose(FAMILIES[name].log_density(x, p), law.logpdf(x), rtol=1e-9)  # type: ignore[attr-defined]
    np.testing.assert_allclose(FAMILIES[name].below(x, p), law.cdf(x), rtol=1e-9)  # type: ignore[attr-defined]


def test_a_mixture_is_the_weighted_sum_of_its_parts() -> None:
    mixture = Mixture(FAMILIES["gamma"], (9.0, 2.0), (0.2, 5.0, 25.0), (0.1, 40.0, 3.0))
    x = np.linspace(0.5, 60, 40)
    laws = (
        (0.7, scipy.stats.gamma(9, scale=2)),
        (0.2, scipy.stats.uniform(5, 20)),
        (0.1, scipy.stats.norm(40, 3)),
    )
    np.testing.assert_allclose(
        mixture.density(x), sum(w * law.pdf(x) for w, law in laws), rtol=1e-9
    )
    np.testing.assert_allclose(
        mixture.below(x), sum(w * law.cdf(x) for w, law in laws), rtol=1e-9
    )
    assert mixture.with_values(mixture.values) == mixture


def test_the_offset_is_subtracted_and_what_lies_below_it_is_said() -> None:
    rng = np.random.default_rng(4)
    values = 100 + rng.gamma(20.0, 1.0, 5000)
    found = measured(values, offset_dn=100.0)
    assert found.best.name == "gamma" and found.best.parameters[0].covers(20)
    below = measured(values, offset_dn=110.0)
    assert [one.name for one in below.fits] == [
        "normal"
    ] and "gamma is not fitted" in below.note


def test_frames_without_a_distribution_are_marked() -> None:
    constant = dark_signal(Stack(np.zeros((3, 8, 8), np.uint16), 1.0))
    assert not constant.fits and "every value is 0 DN" in constant.note
    coarse = dark_signal(Stack(np.random.default_rng(5).integers(99, 102, (1, 40, 40)), 1.0))
    assert "only 3 different values" in coarse.note
    for options in (
        {"families": ("gama",)},
        {"superimposed": (("gamma", "gamma"),)},
        {"families": ()},
    ):
        with pytest.raises(ms.InputError, match="is no distribution"):
            measured(np.arange(50.0), **options)
    with pytest.raises(ms.InputError, match="it must be finite, of 16 or more"):
        measured(np.arange(5.0))


@pytest.mark.parametrize("scale", one_in(3, [1e-12, 1.0, 1e9]))
def test_superimposed_parts_that_are_not_there_have_hardly_any_weight(scale: float) -> None:
    """Few pixels, any unit: no part becomes a spike on a few values."""
    rng = np.random.default_rng(7)
    for values in (
        rng.normal(100, 2, 168),
        rng.normal(100, 2, 4000),
        np.round(rng.normal(100, 20, 4000)),
    ):
        found = measured(
            values * scale, families=(), superimposed=(("normal", "uniform", "normal"),)
        )
        assert len(found.fits) == 1 and np.isfinite(found.best.log_likelihood)
        assert found.best.ks_probability > 1e-3
        low, high = (one.value for one in found.best.parameters[3:5])
        assert high - low > 0.005 * np.ptp(values) * scale
    few = measured(
        np.round(rng.normal(100, 1, 400)) * scale,
        families=("normal",),
        superimposed=(("gamma", "uniform"),),
    )
    assert [one.name for one in few.fits] == [
        "normal"
    ] and "gamma + uniform is not fitted" in few.note


def test_the_plot_has_linear_or_logarithmic_counts() -> None:
    found = measured(np.random.default_rng(6).gamma(20.0, 1.0, 5000))
    for log_counts, scale in ((False, "linear"), (True, "log")):
        axes = matplotlib.figure.Figure().subplots()
        found.plot(axes, log_counts)
        assert axes.get_yscale() == scale and len(axes.lines) == 5
        assert "[DN]" in axes.get_xlabel() and "[1/DN]" in axes.get_ylabel() and not axes.texts


def test_the_histogram_of_averaged_frames_has_whole_steps_of_their_mean_in_every_bin() -> None:
    """Means of 32 frames are multiples of 1/32 DN; bins of 5.8 of these would hold 5 or 6: 18 % too few or too many.

    With fixed seed; of about 40 bins one lies beyond 5 σ of its Poisson noise by chance in 40 000 seeds.
    """
    values = np.round(np.random.default_rng(8).normal(56, 1.85, 200_000) * 32) / 32
    axes = matplotlib.figure.Figure().subplots()
    dark_signal(Stack(values.reshape(1, 400, 500), 0.001), families=("normal",)).plot(axes)
    x, density = axes.lines[0].get_data()
    step = float(np.diff(x).min())
    assert step * 32 == pytest.approx(round(step * 32), abs=1e-6)
    expected = scipy.stats.norm(56, 1.85).pdf(x) * step * values.size
    some = expected > 25
    off = (density * step * values.size - expected)[some] / np.sqrt(expected[some])
    assert some.sum() > 20 and np.abs(off).max() < 5
