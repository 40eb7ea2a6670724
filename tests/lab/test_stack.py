"""A stack's statistics against NumPy's two-pass figures; filters apart; what is no stack is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames import stack
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.quantity import (
    Quantity,
    normal_interval,
    student_interval,
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


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"frames": np.zeros((3, 4))}, "float64 of shape"),
        ({"frames": np.zeros((0, 4, 4))}, "shape"),
        ({"frames": np.zeros((2, 2, 2), bool)}, "frames are bool"),
        ({"frames": np.full((1, 1, 2), np.nan)}, "NaN or infinite in 2 place"),
        ({"frames": [[[1]]]}, "frames are list"),
        ({"exposure_s": -1}, "exposure_s is -1"),
        ({"exposure_s": math.nan}, "exposure_s is nan"),
        ({"photons": math.nan}, "photons is NaN or infinite"),
        ({"photons": -1.0}, "values from -1"),
        ({"photons": np.ones(3)}, "photons has shape"),
        ({"photons": "many"}, "photons is not numeric"),
        ({"bits": 12.5}, "bits is 12.5"),
        ({"bits": 10**5000}, "bits is a whole number of"),
    ],
)
def test_facts_of_a_stack_that_are_none_are_refused(facts: dict[str, Any], said: str) -> None:
    given: dict[str, Any] = {"frames": np.ones((2, 4, 4)), "exposure_s": 0.01, **facts}
    with pytest.raises(ms.InputError, match=f"^dark.tiff: .*{said}"):
        Stack(**given, source="dark.tiff")


@pytest.mark.parametrize("mode", ["r", "r+", "c"])
def test_frames_on_disk_are_let_go_and_changes_to_them_are_not(
    tmp_path: Path, mode: Any
) -> None:
    frames = RNG.integers(0, 4000, (3, 64, 64), dtype=np.uint16)
    np.save(tmp_path / "a.npy", frames)
    mapped = np.load(tmp_path / "a.npy", mmap_mode=mode)
    if mode != "r":
        mapped[:, 5] = frames[:, 5] = 4095
    measured = Stack(mapped, 0.1).window(slice(0, 40), slice(None))
    assert measured.clipping.largest == measured.frames.max()
    assert measured.changes.mean == pytest.approx(frames[:, :40].mean())
    np.testing.assert_array_equal(mapped, frames)
