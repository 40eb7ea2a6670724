"""σ of rounded normal noise: unbiased from 0.1 to 1 DN whatever the pixels' means, only bounded where they hide it."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.marks import one_in

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_noise import dark_noise
from mitsuba_sensor.lab.quantity import Quantity
from mitsuba_sensor.lab.statistics.rounded_normal import rounded_normal

UNIT = Quantity("K", "overall system gain", 0.5, 0.49, 0.51, "DN/e-", "")


def codes(
    sigma: float, centre: float, spread: float, shape: tuple[int, int], seed: int = 0
) -> np.ndarray:
    """(N, pixels, 1): each pixel has its own mean, the range ends at 0."""
    rng = np.random.default_rng(seed)
    means = centre + spread * rng.standard_normal(shape[1])
    return np.maximum(np.floor(means + sigma * rng.standard_normal(shape) + 0.5), 0).astype(
        np.uint16
    )[:, :, None]


@pytest.mark.parametrize(
    ("sigma", "centre", "spread", "stacks"),
    one_in(
        3,
        [
            *[(0.1, 100, 5, 8), (0.25, 100, 5, 2), (0.5, 100, 5, 1), (1.0, 100, 5, 1)],
            *[
                (0.2, 100.1, 0.02, 2),
                (0.35, 100.5, 0.02, 2),
                (0.5, 100.3, 0.02, 1),
                (1.0, 100, 0.0, 1),
            ],
            *[(0.3, 100.2, 0.3, 2), (0.5, 0.2, 0.02, 2), (0.5, 0.0, 0.5, 2)],
        ],
        several=True,
    ),
)
def test_sigma_is_right_within_2_percent(
    sigma: float, centre: float, spread: float, stacks: int
) -> None:
    """64 frames of 2048 pixels: standard errors of 0.8 % at most, so that a right estimate fails once in 80."""
    found = [
        rounded_normal(codes(sigma, centre, spread, (64, 2048), seed)) for seed in range(stacks)
    ]
    assert np.mean([one.sigma_dn for one in found]) == pytest.approx(sigma, rel=0.02)
    assert all(one.identified for one in found)
    assert sum(one.low_dn <= sigma <= one.high_dn for one in found) >= stacks - 1


@pytest.mark.parametrize(
    ("sigma", "centre"),
    one_in(2, [(0.1, 100.0), (0.1, 100.5), (0.1, 100.3), (0.2, 100.5)], several=True),
)
def test_pixels_that_are_alike_and_show_two_codes_only_bound_sigma(
    sigma: float, centre: float
) -> None:
    found = rounded_normal(codes(sigma, centre, 0.02, (64, 1024)))
    assert not found.identified and found.low_dn == 0 and sigma < found.high_dn < 0.4


def test_intervals_hold_sigma() -> None:
    """30 stacks of 8 frames: at least 25 of them, which 95 % intervals miss once in 300."""
    found = [rounded_normal(codes(0.3, 50, 3, (8, 200), seed)) for seed in range(30)]
    assert sum(one.low_dn <= 0.3 <= one.high_dn for one in found) >= 25
    assert np.median([one.high_dn - one.low_dn for one in found]) < 0.1


def test_hot_pixels_and_bright_codes_do_not_move_sigma() -> None:
    frames = codes(0.4, 4094.2, 0.2, (64, 1024))
    frames[:, ::200] += 7
    frames[::2, 5] -= 400  # a pixel that jumps
    found = rounded_normal(np.minimum(frames, 4095), 4095)
    assert found.sigma_dn == pytest.approx(0.4, rel=0.05) and 0 < found.left_out < 0.002


def dark(sigma: float, centre: float = 100.3, spread: float = 5.0) -> Stack:
    return Stack(
        codes(sigma, centre, spread, (32, 1600)).reshape(32, 40, 40), 0.01, photons=0.0, bits=12
    )


def test_below_04_dn_the_most_likely_sigma_stands_with_a_note_and_above_without() -> None:
    coarse, fine = dark_noise([dark(0.25)], UNIT), dark_noise([dark(0.9)], UNIT)
    assert "below 0.4 DN, where rounding forbids" in coarse.electrons.note and coarse.coarse
    assert coarse.electrons.covers(0.5) and coarse.electrons.value == pytest.approx(
        0.5, rel=0.03
    )
    assert not fine.coarse and not fine.electrons.note and fine.electrons.covers(1.8)
    difference = (coarse.total.value**2 - 1 / 12) ** 0.5
    lost = np.exp(-4 * np.pi**2 * 0.0625) / (
        2 * np.pi**2
    )  # of 1/12, what lies between pixels: Widrow and Kollár 2008
    assert difference == pytest.approx((0.0625 - lost) ** 0.5, rel=0.02)
    alike = dark_noise([dark(0.25, 100.0, 0.0)], UNIT)
    assert (
        alike.analogue.covers(0.25) and alike.total.value**2 < 1 / 12
    )  # where no difference is left


@pytest.mark.parametrize(
    ("code", "said"),
    [(0, "hides the noise"), (4095, "hides the noise"), (64, "an upper limit")],
)
def test_dark_frames_of_one_code_have_no_value_or_a_limit(code: int, said: str) -> None:
    stack = Stack(np.full((4, 8, 8), code, np.uint16), 0.01, photons=0.0, bits=12)
    found = dark_noise([stack], UNIT)
    assert said in found.analogue.note
    assert found.electrons.covers(0.5) == (code == 64) and not found.electrons.value > 0


def test_the_variance_is_extrapolated_to_no_exposure() -> None:
    """Dark current adds 20 DN² in a second; σ 5 DN at 0 s within its interval, once in 20 not: the seed is fixed."""
    rng = np.random.default_rng(4)
    stacks = [
        Stack(np.round(rng.normal(90, (25 + 20 * t) ** 0.5, (8, 64, 64))), t, 0.0)
        for t in (0.1, 0.5, 1.0)
    ]
    found = dark_noise(stacks)
    assert found.analogue.covers(5) and found.total.covers((25 + 1 / 12) ** 0.5)
    assert np.isnan(found.electrons.value) and "K is not known" in found.electrons.note
