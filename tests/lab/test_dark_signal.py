"""Distributions of dark signal: that of the samples has the smallest BIC; the histogram has whole steps."""

from __future__ import annotations

import matplotlib.figure
import numpy as np
import pytest
import scipy.stats
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_signal import DarkSignal, dark_signal


def measured(values: NDArray[np.float64], offset_dn: float = 0.0) -> DarkSignal:
    return dark_signal(Stack(values.reshape(1, 1, -1), 100.0), offset_dn)


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("normal", scipy.stats.norm(50, 8)),
        ("log-normal", scipy.stats.lognorm(0.3, scale=50)),
        ("gamma", scipy.stats.gamma(9, scale=5)),
        ("inverse Gaussian", scipy.stats.invgauss(0.2, scale=250)),
    ],
)
def test_the_distribution_of_the_samples_has_the_smallest_bic_and_its_moments(
    name: str, law: object
) -> None:
    """20 000 values; mean and σ within 4 standard errors, once in 10 000 seeds."""
    values = law.rvs(20_000, random_state=np.random.default_rng(1))  # type: ignore[attr-defined]
    found = measured(values + 100, 100)
    best = found.best.law
    assert found.best.name == name and found.best.ks < 0.012
    assert best.mean() == pytest.approx(law.mean(), rel=0.012)  # type: ignore[attr-defined]
    assert best.std() == pytest.approx(law.std(), rel=0.04)  # type: ignore[attr-defined]
    below = measured(values, 60)
    assert [fit.name for fit in below.fits] == ["normal"] and "not above" in below.note


def test_frames_without_a_distribution_are_marked() -> None:
    constant = dark_signal(Stack(np.zeros((3, 8, 8), np.uint16), 1.0))
    assert not constant.fits and not constant.plots and "every value is 0 DN" in constant.note
    coarse = dark_signal(Stack(np.random.default_rng(5).integers(99, 102, (1, 40, 40)), 1.0))
    assert "only 3 different values" in coarse.note
    with pytest.raises(ms.InputError, match="of 16 or more"):
        measured(np.arange(5.0))


def test_the_histogram_of_averaged_frames_has_whole_steps_of_their_mean_in_every_bin() -> None:
    """Means of 32 frames are multiples of 1/32 DN; bins of 5.8 of these would hold 5 or 6: 18 % too few or too many.

    With fixed seed; of about 40 bins one lies beyond 5 σ of its Poisson noise by chance in 40 000 seeds.
    """
    values = np.round(np.random.default_rng(8).normal(56, 1.85, 200_000) * 32) / 32
    axes, logarithmic = (matplotlib.figure.Figure().subplots() for _ in range(2))
    found = measured(values)
    found.plot(axes)
    found.plot(logarithmic, log_counts=True)
    assert logarithmic.get_yscale() == "log" and "[DN]" in axes.get_xlabel()
    x, density = axes.lines[0].get_data()
    step = float(np.diff(x).min())
    assert step * 32 == pytest.approx(round(step * 32), abs=1e-6)
    expected = scipy.stats.norm(56, 1.85).pdf(x) * step * values.size
    some = expected > 25
    off = (density * step * values.size - expected)[some] / np.sqrt(expected[some])
    assert some.sum() > 20 and np.abs(off).max() < 5
