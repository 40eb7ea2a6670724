"""Medians and ratios of turns, and the limit of many comparisons."""

from __future__ import annotations

import numpy as np
import pytest

from mitsuba_sensor.lab.statistics.estimators import ratio, spread, standard_error, z_limit


def test_the_median_lies_between_its_quartiles() -> None:
    assert spread([4.0, 1.0, 3.0, 2.0, 5.0]) == (2.0, 3.0, 4.0)


def test_a_ratio_is_that_of_the_turns() -> None:
    assert ratio([2.0, 40.0, 6.0], [1.0, 10.0, 2.0]) == 3.0


def test_the_standard_error_of_four_values_is_half_their_standard_deviation() -> None:
    assert standard_error(np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(1.2910 / 2, abs=1e-4)


def test_the_limit_of_many_comparisons_is_that_of_sidak() -> None:
    """1 − 0.99^(1/45) = 2.233e-4 on both sides: 3.69 of a table of the normal distribution."""
    assert z_limit(1) == pytest.approx(2.5758, abs=1e-4)
    assert z_limit(45) == pytest.approx(3.69, abs=0.02)
