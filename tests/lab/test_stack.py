"""Statistics of a stack against NumPy, filters apart, rejected stacks, intervals of quantities and quotients."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames import stack
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.quantity import Quantity, normal_interval, quotient, student_interval

RNG = np.random.default_rng(16)


def test_mean_and_variance_are_those_of_numpy_whatever_the_strips(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames = RNG.integers(60_000, 65_536, (5, 7, 11), dtype=np.uint16)
    monkeypatch.setattr(stack, "STRIP_VALUES", 2 * 5 * 11)
    measured, exact = Stack(frames, 0.1), frames.astype(float)
    np.testing.assert_allclose(measured.mean, exact.mean(axis=0), rtol=1e-15)
    np.testing.assert_allclose(measured.variance, exact.var(axis=0, ddof=1), rtol=1e-12)
    np.testing.assert_allclose(measured.frame_means, exact.mean(axis=(1, 2)), rtol=1e-15)


def test_each_place_of_a_mosaic_is_a_stack_of_its_own_pixels() -> None:
    frames = np.tile(np.array([[1, 2], [3, 4]], np.uint16), (2, 2, 3))
    light, tile = np.arange(24.0).reshape(4, 6), (("R", "G"), ("G", "B"))
    parts = Stack(frames, 0.1, light, tile=tile).of_filters()
    found = {name: set(part.frames.ravel()) for name, part in parts.items()}
    assert found == {"R": {1}, "G": {2}, "G (2)": {3}, "B": {4}}
    assert parts["B"].photons.tolist() == [[7, 9, 11], [19, 21, 23]]  # type: ignore[union-attr]
    assert all(
        np.shares_memory(part.frames, frames) and not part.tile for part in parts.values()
    )


@pytest.mark.parametrize(
    ("symbol", "ends", "text"),
    [
        ("K", (0.1241, 0.1239, 0.1243), "K = 0.1241 DN/e- (0.1239 to 0.1243; R4 6.6)"),
        ("σ_d", (math.nan, 0.0, 3.2), "σ_d < 3.2 DN/e- (R4 6.6)"),
        ("µ_e.sat", (900.0, 900.0, math.inf), "µ_e.sat ≥ 900 DN/e- (R4 6.6)"),
        ("K", (math.nan,) * 3, "K not measurable (R4 6.6)"),
    ],
)
def test_a_quantity_or_a_bound_reads_as_a_sentence(
    symbol: str, ends: tuple[float, float, float], text: str
) -> None:
    quantity = Quantity(symbol, "", *ends, "DN/e-", "R4 6.6")
    assert str(quantity) == text
    assert (quantity.is_bound, quantity.is_lower_bound) == ("<" in text, "≥" in text)


def test_a_ratio_of_bounds_is_a_bound_with_decibels() -> None:
    """A full well of at least 1000 e- over a threshold below 10 e-: at least 100, 40 dB."""
    like = Quantity("DR", "", math.nan, math.nan, math.nan, "", "")
    below = Quantity("µ_e.min", "", math.nan, 0.0, 10.0, "e-", "")
    for high in (1010.0, math.inf):
        full = Quantity("µ_e.sat", "", 1000.0, 1000.0, high, "e-", "")
        for least in (0.0, 1.0):
            ratio = quotient(full, replace(below, low=least), like)
            assert str(ratio).startswith("DR ≥ 100 = 40.0 dB")
    assert quotient(below, below, like).shown == "not measurable"


def test_intervals_contain_the_true_value_in_95_of_100_samples() -> None:
    """20 000 samples of 6 normal values: shares within ±0.6 %, which chance leaves once in 10 000 runs."""
    samples = RNG.normal(3, 2, (20_000, 6))
    means, errors = samples.mean(axis=1), samples.std(axis=1, ddof=1) / 6**0.5
    known = [normal_interval(mean, 2 / 6**0.5) for mean in means]
    measured = [student_interval(*pair, 5) for pair in zip(means, errors, strict=True)]
    for ends in (known, measured):
        assert np.mean([low <= 3 <= high for _, low, high in ends]) == pytest.approx(
            0.95, abs=0.006
        )


@pytest.mark.parametrize("true", [-3.0, 0.0, 0.5])
def test_quotients_of_any_sign_hold_the_true_one(true: float) -> None:
    """2000 quotients with errors of 1 and of 10 %: 95 % ± 2 % (four standard errors)."""
    rng, covered = np.random.default_rng(1), 0
    for _ in range(2000):
        above = Quantity("a", "", *normal_interval(true + rng.normal(), 1.0), "", "")
        below = Quantity("b", "", *normal_interval(1 + 0.1 * rng.normal(), 0.1), "", "")
        covered += above.divided(below, "").covers(true)
    assert covered / 2000 == pytest.approx(0.95, abs=0.024)


def test_a_variance_in_electrons_has_the_interval_of_k_squared() -> None:
    variance = Quantity("v", "", 100.0, 99.999, 100.001, "DN²/s", "")
    measured = variance.in_electrons(Quantity("K", "", 2.0, 1.9, 2.1, "DN/e-", ""))
    ends = measured.low, measured.value, measured.high
    assert ends == pytest.approx((100 / 2.1**2, 25, 100 / 1.9**2), rel=1e-3)
    assert variance.in_electrons(2.0).value == 25 and measured.unit == "e-/s"


@pytest.mark.parametrize(
    ("facts", "named"),
    [
        ({"frames": np.zeros((3, 4))}, "shape"),
        ({"frames": np.zeros((2, 2, 2), bool)}, "frames are bool"),
        ({"frames": np.full((1, 1, 2), np.nan)}, "2 value.s. that are NaN or infinite"),
        ({"exposure_s": math.nan}, "exposure_s is nan"),
        ({"photons": -1.0}, "from -1"),
        ({"photons": np.ones(3)}, "photons has shape"),
        ({"bits": 12.5}, "bits is 12.5"),
    ],
)
def test_impossible_facts_of_a_stack_are_refused(facts: dict[str, Any], named: str) -> None:
    given: dict[str, Any] = {"frames": np.ones((2, 4, 4)), "exposure_s": 0.01, **facts}
    with pytest.raises(ms.InputError, match=f"^dark.tiff: .*{named}"):
        Stack(**given, source="dark.tiff")


@pytest.mark.parametrize("mode", ["r", "r+", "c"])
def test_frames_on_disk_are_released_and_changes_to_them_are_not(
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
