"""Quotients of quantities: the value is inside the interval, and the interval holds the true quotient."""

from __future__ import annotations

import numpy as np
import pytest

from mitsuba_sensor.lab.quantity import Quantity, normal_interval, quotient
from mitsuba_sensor.pages.page import Section, study_of


@pytest.mark.parametrize("true", [-3.0, -0.5, 0.0, 0.5, 3.0])
def test_quotients_of_any_sign_hold_the_true_one(true: float) -> None:
    """4000 quotients with errors of 1 and of 10 %: 95 % ± 1.4 % (four standard errors)."""
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(4000):
        above = Quantity("a", "", *normal_interval(true + rng.normal(), 1.0), "", "")
        below = Quantity("b", "", *normal_interval(1 + 0.1 * rng.normal(), 0.1), "", "")
        covered += above.divided(below, "").covers(true)
    assert covered / 4000 == pytest.approx(0.95, abs=0.017)


def test_a_variance_in_electrons_has_the_interval_of_k_squared() -> None:
    variance = Quantity("v", "", 100.0, 99.999, 100.001, "DN²/s", "")
    gain = Quantity("K", "", 2.0, 1.9, 2.1, "DN/e-", "")
    measured, exact = variance.in_electrons(gain), variance.in_electrons(2.0)
    ends = measured.low, measured.value, measured.high
    assert ends == pytest.approx((100 / 2.1**2, 25, 100 / 1.9**2), rel=1e-3)
    assert exact.value == 25 and exact.unit == measured.unit == "e-/s"


def test_a_sentence_that_two_quantities_share_stands_once_in_the_note_of_their_quotient() -> (
    None
):
    limit = "the variance does not fall: a lower limit"
    above = Quantity(
        "µ_e.sat", "", 3e4, 2.9e4, 3.1e4, "e-", "", f"{limit}; points may be curved"
    )
    below = Quantity("σ_d", "", 7.0, 6.9, 7.1, "e-", "", "points may be curved")
    like = Quantity("DR", "", 1.0, 1.0, 1.0, "1", "", limit)
    assert quotient(above, below, like).note == f"{limit}; points may be curved"


def test_a_headline_says_what_failed_and_what_was_not_measured() -> None:
    right = Section((), True, ())
    short = Section((), True, (), missing=("dark current", "RTS pixels"))
    wrong = Section((), False, (), failed=("photon transfer (-7 σ at 2000 DN)",))
    assert study_of("", "", [right]).verdict == "all checks passed"
    assert study_of("", "", [right, short]).verdict == "not measured: dark current, RTS pixels"
    everything = study_of("", "", [wrong, short]).to_dict()["verdict"]
    assert everything.startswith("some checks failed: photon transfer (-7 σ at 2000 DN); not")
