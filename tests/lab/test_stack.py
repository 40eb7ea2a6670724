"""A stack's statistics against NumPy's two-pass figures; filters apart; what is no stack is refused."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames import stack
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.quantity import (
    Quantity,
    normal_interval,
    student_interval,
    variance_interval,
)

RNG = np.random.default_rng(16)
BAYER = (("R", "G"), ("G", "B"))


def test_mean_and_variance_are_those_of_numpy_whatever_the_strips(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames = RNG.integers(60_000, 65_536, (5, 7, 11), dtype=np.uint16)
    monkeypatch.setattr(stack, "STRIP_VALUES", 2 * 5 * 11)
    measured = Stack(frames, 0.1)
    np.testing.assert_allclose(measured.mean, frames.astype(float).mean(axis=0), rtol=1e-15)
    np.testing.assert_allclose(
        measured.variance, frames.astype(float).var(axis=0, ddof=1), rtol=1e-12
    )
    np.testing.assert_allclose(
        measured.frame_means, frames.astype(float).mean(axis=(1, 2)), rtol=1e-15
    )


def test_one_frame_has_no_variance_and_no_number_that_looks_like_one() -> None:
    assert np.isnan(Stack(np.zeros((1, 2, 2), np.uint8), 0).variance).all()


def test_each_place_of_a_mosaic_is_a_stack_of_its_own_pixels() -> None:
    frames = np.zeros((2, 4, 6), np.uint16)
    (
        frames[:, 0::2, 0::2],
        frames[:, 0::2, 1::2],
        frames[:, 1::2, 0::2],
        frames[:, 1::2, 1::2],
    ) = 1, 2, 3, 4
    parts = Stack(frames, 0.1, photons=np.arange(24.0).reshape(4, 6), tile=BAYER).of_filters()
    assert {name: set(part.frames.ravel()) for name, part in parts.items()} == {
        "R": {1},
        "G": {2},
        "G (2)": {3},
        "B": {4},
    }
    assert parts["B"].photons.tolist() == [[7, 9, 11], [19, 21, 23]]  # type: ignore[union-attr]
    assert all(
        np.shares_memory(part.frames, frames) and not part.tile for part in parts.values()
    )


@pytest.mark.parametrize(
    ("frames", "exposure_s", "said"),
    [
        (np.zeros((3, 4)), 0.1, "frames are float64 of shape (3, 4); pass numbers of shape"),
        (np.zeros((0, 4, 4)), 0.1, "shape (0, 4, 4)"),
        (np.zeros((2, 2, 2), bool), 0.1, "frames are bool"),
        (np.full((1, 1, 2), np.nan), 0.1, "frames is NaN or infinite in 2 place"),
        (np.zeros((1, 1, 1)), -1, "exposure_s is -1; it must be from 0 to"),
        (np.zeros((1, 1, 1)), np.nan, "exposure_s is nan"),
        ([[[1]]], 0.1, "frames are list"),
    ],
)
def test_what_is_no_stack_is_refused_with_the_value(
    frames: np.ndarray, exposure_s: float, said: str
) -> None:
    with pytest.raises(ms.InputError) as error:
        Stack(frames, exposure_s, source="dark.tiff")
    assert said in str(error.value) and str(error.value).startswith("dark.tiff: ")


def test_a_quantity_reads_as_a_sentence_and_scales_with_its_interval() -> None:
    gain = Quantity(
        "K", "overall system gain", 0.1241, 0.1239, 0.1243, "DN/e-", "EMVA 1288 R4 6.6"
    )
    assert str(gain) == "K = 0.1241 DN/e- (0.1239 to 0.1243; EMVA 1288 R4 6.6)"
    assert gain.covers(0.124) and not gain.covers(0.1244)
    assert gain.scaled(10, "%").low == pytest.approx(1.239) and "8 bit" in str(
        gain.noted("8 bit")
    )
    with pytest.raises(ms.InputError, match="outside of its interval"):
        Quantity("K", "", 1, 2, 3, "", "")


def test_intervals_contain_the_true_value_in_95_of_100_samples() -> None:
    """20 000 samples of 6 normal values: shares within ±0.6 %, which chance leaves once in 10 000 runs."""
    samples = RNG.normal(3, 2, (20_000, 6))
    means, variances = samples.mean(axis=1), samples.var(axis=1, ddof=1)
    for known, spread in (
        (student_interval, np.sqrt(variances / 6)),
        (normal_interval, np.full(20_000, 2 / 6**0.5)),
    ):
        freedom = (5,) if known is student_interval else ()
        ends = [
            known(mean, error, *freedom)[1:] for mean, error in zip(means, spread, strict=True)
        ]
        assert np.mean([low <= 3 <= high for low, high in ends]) == pytest.approx(
            0.95, abs=0.006
        )
    ends = [variance_interval(variance, 5)[1:] for variance in variances]
    assert np.mean([low <= 4 <= high for low, high in ends]) == pytest.approx(0.95, abs=0.006)
