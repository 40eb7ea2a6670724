"""What was lost on the way is counted: light beyond the QE curve, pixels that a fixed pattern made negative."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
"""Its QE curve runs from 400 to 700 nm."""

EXPOSURE = ms.Exposure(0.1)
pytestmark = pytest.mark.usefixtures("few_windows")


def outside_qe(photons: Any, wavelengths_nm: Any) -> dict[str, Any]:
    light = ms.Photons(np.asarray(photons, float), np.asarray(wavelengths_nm, float))
    return ms.expose(light, TABLE1, EXPOSURE).report["outside_qe"]


def test_bands_beyond_the_curve_are_named_with_their_share_of_the_photons() -> None:
    """Both ends; the ends themselves are inside. Pixels do not all have the same spectrum."""
    bands = [399.9, 400.0, 550.0, 700.0, 700.1]
    light = np.array([[[10.0, 1.0, 5.0, 1.0, 3.0], [0.0, 2.0, 0.0, 0.0, 7.0]]])
    assert outside_qe(light, bands) == {
        "wavelengths_nm": [399.9, 700.1],
        "share_of_photons": pytest.approx(20 / 29),
    }


def test_no_light_has_no_share_outside_and_infinite_light_is_not_counted() -> None:
    assert outside_qe(np.zeros((2, 2, 2)), [300.0, 500.0])["share_of_photons"] == 0
    light = np.array([[[np.inf, 1.0], [3.0, np.inf], [0.0, 2.0]]])
    assert outside_qe(light, [300.0, 500.0])["share_of_photons"] == pytest.approx(3 / 6)


S_LOGISTIC = math.sqrt(3) / math.pi
CUT: dict[str, tuple[dict[str, Any], str, float]] = {
    "gaussian prnu": ({"pixel.prnu": 1.0}, "prnu", ndtr(-1.0)),
    "logistic dark": (
        {"dark_current.cv": 1.0, "dark_current.distribution": "logistic"},
        "dark_fpn",
        1 / (1 + math.exp(1 / S_LOGISTIC)),
    ),
}


@pytest.mark.parametrize("case", CUT)
def test_pixels_that_a_law_made_negative_are_counted(case: str) -> None:
    """50 000 pixels, 5 binomial standard errors."""
    changes, name, share = CUT[case]
    report = ms.expose(np.full((200, 250), 100.0), TABLE1.replace(**changes), EXPOSURE).report
    number = report["counts"][f"cut_to_zero_{name}"]
    assert number == pytest.approx(
        50_000 * share, abs=5 * math.sqrt(50_000 * share * (1 - share))
    )
