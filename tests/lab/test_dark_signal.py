"""Distributions of dark signal: that of the samples has the smallest BIC; the histogram has whole steps."""

from __future__ import annotations

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
    with pytest.raises(ms.InputError, match="at least 16 pixels"):
        measured(np.arange(5.0))
