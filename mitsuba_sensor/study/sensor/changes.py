"""How far one setting's moments are from another's, level by level, with standard errors from device to device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

QUANTITIES = ("mean", "temporal σ", "fixed σ")

FALSE_ALARM = 1e-3
"""Chance that some measured change of one setting passes its limit although the true one does not."""


@dataclass(frozen=True, eq=False)
class Change:
    """Of mean, temporal σ and fixed σ at every light level, (3, levels) [DN], with its standard errors.

    devices : how many independent values the standard errors come from.
    """

    value_dn: Array
    error_dn: Array
    devices: int

    @property
    def worst(self) -> tuple[float, float, str]:
        """The largest change, its standard error, and what it is of."""
        row, level = np.unravel_index(np.argmax(np.abs(self.value_dn)), self.value_dn.shape)
        words = f"{QUANTITIES[row]} of level {level + 1}"
        return float(abs(self.value_dn[row, level])), float(self.error_dn[row, level]), words

    @property
    def limit(self) -> float:
        """Standard errors that no change exceeds by chance, but in one of a thousand studies (Student, Bonferroni)."""
        from scipy.special import stdtrit

        return float(stdtrit(self.devices - 1, 1 - FALSE_ALARM / (2 * self.value_dn.size)))

    def within(self, tolerance_dn: float) -> bool:
        """Whether every change is at most the tolerance, as far as the devices can tell."""
        return bool((np.abs(self.value_dn) <= tolerance_dn + self.limit * self.error_dn).all())


def change(found: Mapping[str, Any], other: Mapping[str, Any], spatial_dn2: tuple[Any, Any]) -> Change:
    """found − other, of frames with equal words: values by device and level, as ``frames.measured`` gives them.

    spatial_dn2 : the theoretical fixed variances of both by level, which the frames know less well.
    """
    mean, temporal, fixed = (
        np.asarray(found[name]) - np.asarray(other[name]) for name in ("mean_dn", "temporal_dn2", "spatial_dn2")
    )
    temporal_dn2 = [np.mean(one["temporal_dn2"], axis=0) for one in (found, other)]
    parts = (_summary(mean), _of_roots(temporal, temporal_dn2), _of_roots(fixed, spatial_dn2))
    value, error = (np.array([part[i] for part in parts]) for i in (0, 1))
    return Change(value, error, len(mean))


def from_theory(found: Mapping[str, Any], theory: Mapping[str, Any]) -> Change:
    """Frames against moments: the same with a second side that has no error."""
    exact = {name: np.broadcast_to(theory[name], np.shape(found[name])) for name in found}
    return change(found, exact, (theory["spatial_dn2"], theory["spatial_dn2"]))


def between(theory: Mapping[str, Any], other: Mapping[str, Any]) -> Array:
    """The change that theory predicts, (3, levels) [DN]."""
    roots = (np.sqrt(theory[name]) - np.sqrt(other[name]) for name in ("temporal_dn2", "spatial_dn2"))
    return np.array([np.subtract(theory["mean_dn"], other["mean_dn"]), *roots])


def _summary(by_device: Array) -> tuple[Array, Array]:
    """Mean over the devices and its standard error."""
    return by_device.mean(axis=0), by_device.std(axis=0, ddof=1) / np.sqrt(len(by_device))


def _of_roots(by_device: Array, variances: Any) -> tuple[Array, Array]:
    """The same for √a − √b = (a − b)/(√a + √b), from the differences of variances; √a + √b ≥ √|a − b| keeps it finite.

    Where a variance is not resolved, neither is its root: the sum of the roots is at least that of the standard error.
    """
    value, error = _summary(by_device)
    sums = np.sum(np.sqrt(np.maximum(variances, 0.0)), axis=0)
    least = np.sqrt(np.maximum(np.maximum(np.abs(value), error), np.finfo(float).tiny))
    sums = np.maximum(sums, least)
    return value / sums, error / sums
