"""Slopes with intervals that cover as often as they say, and fronts that nothing beats."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mitsuba_sensor.lab.statistics.estimators import as_normal, pareto, slope_of_runs, z_limit


@pytest.mark.parametrize("power", [-1.0, -0.5, 0.0, 2.0])
def test_a_power_law_has_its_power_as_slope(power: float) -> None:
    x = [0.5, 1.0, 2.0, 8.0]
    assert slope_of_runs([(x, [3 * v**power for v in x])] * 2).value == pytest.approx(
        power, abs=1e-12
    )


def test_equal_runs_have_an_interval_of_no_width() -> None:
    run = [1.0, 2.0, 4.0], [1.0, 0.5, 0.25]
    slope = slope_of_runs([run, run, run])
    assert slope.value == pytest.approx(-1, abs=1e-12) and slope.half_width == pytest.approx(
        0, abs=1e-12
    )


def test_two_runs_have_the_interval_of_students_t_with_one_degree_of_freedom() -> None:
    """Half width t·|a − b|/2 with t = 12.706 of every table of Student's t, of the slopes 1 and 3."""
    x = [1.0, 2.0, 4.0]
    value, half_width = slope_of_runs([(x, x), (x, [v**3 for v in x])])
    assert value == pytest.approx(2) and half_width == pytest.approx(12.7062 * 1.0, rel=1e-5)


def test_the_interval_covers_the_true_slope_as_often_as_it_says() -> None:
    """2000 times four runs whose rungs share a common error, as those of one render do; 95 % ± 0.5 %, four of them."""
    rng = np.random.default_rng(1)
    passes = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    covered = 0
    for _ in range(2000):
        steps = 0.05 * rng.normal(size=(4, passes.size))
        errors = passes**-0.5 * np.exp(np.cumsum(steps, axis=1))
        slope = slope_of_runs([(passes, row) for row in errors])
        covered += abs(slope.value + 0.5) <= slope.half_width
    assert covered / 2000 == pytest.approx(0.95, abs=0.02)


def test_a_point_that_is_beaten_in_both_is_not_on_the_front() -> None:
    assert pareto([(1, 4), (2, 2), (3, 3), (4, 1)]) == (0, 1, 3)


def test_as_quick_but_worse_and_as_good_but_slower_are_beaten() -> None:
    assert pareto([(1, 2), (1, 3), (2, 2)]) == (0,)


def test_equal_points_are_on_the_front_together_and_nan_never() -> None:
    assert pareto([(math.nan, 0), (1, 1), (1, 1), (0.5, math.nan), (2, 0.5)]) == (1, 2, 4)


def test_no_points_have_no_front() -> None:
    assert pareto([]) == ()


def test_the_front_is_what_a_comparison_of_all_pairs_leaves() -> None:
    rng = np.random.default_rng(2)
    points = [tuple(pair) for pair in rng.integers(0, 12, size=(60, 2)).tolist()]

    def beaten(one: tuple[int, int]) -> bool:
        return any(
            other[0] <= one[0] and other[1] <= one[1] and other != one for other in points
        )

    assert set(pareto(points)) == {i for i, point in enumerate(points) if not beaten(point)}


def test_students_t_counts_as_the_normal_that_is_as_unlikely() -> None:
    """Tables: |t| > 3.460 has a chance of 0.1 % at 63 − 2 = 61 degrees of freedom; that of a normal law is 3.2905."""
    assert as_normal(-3.457, 63) == pytest.approx(-3.29, abs=0.02) and as_normal(0.0, 63) == 0
    assert z_limit(1) == pytest.approx(2.5758, abs=1e-4) and z_limit(45) == pytest.approx(
        3.69, abs=0.02
    )
