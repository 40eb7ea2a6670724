"""Dark current against temperature: values worked out by hand, limits, and the dark-current FPN over time."""

from __future__ import annotations

import itertools
import math

import pytest

from mitsuba_sensor.stages.dark_current_models import Doubling, FigureOfMerit, band_gap_ev

TABLE1 = FigureOfMerit(fom_na_per_cm2=1.0, area_cm2=(5.7e-4) ** 2)


def test_the_band_gap_of_silicon_at_300_k() -> None:
    assert band_gap_ev(300.0) == pytest.approx(1.11082145, abs=5e-9)
    assert band_gap_ev(0.0) == 1.1557


@pytest.mark.parametrize(
    ("kelvin", "rate"),
    [(300.0, 2027.87), (298.15, 1741.58), (77.0, 1.1100e-26), (400.0, 1.031887e6)],
)
def test_the_dark_rate_of_table_1_at_four_temperatures(kelvin: float, rate: float) -> None:
    """The printed values were made with the Boltzmann constant of CODATA 2006, 1.1e-6 larger: 6e-6 at 400 K."""
    assert TABLE1.rate_e_per_s(kelvin) == pytest.approx(
        rate, rel=1e-4 if kelvin == 77 else 7e-6
    )


@pytest.mark.parametrize("kelvin", [0.0, 5e-324, 1e-300, 1e-3, 4.0])
def test_a_frozen_sensor_has_exactly_no_dark_current(kelvin: float) -> None:
    assert TABLE1.rate_e_per_s(kelvin) == 0.0


def test_dark_current_never_falls_when_it_gets_warmer() -> None:
    """1 K to 1600 K; silicon melts at 1687 K."""
    for law in (TABLE1, Doubling(5.0, 298.15, 7.0)):
        rates = [law.rate_e_per_s(float(kelvin)) for kelvin in range(1, 1600, 7)]
        assert all(b >= a for a, b in itertools.pairwise(rates)) and all(
            map(math.isfinite, rates)
        )
