"""Frames of plain NumPy with known standard deviations of rows, columns and pixels, for tests of the instruments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mitsuba_sensor.lab.frames.stack import Stack


class Sigmas(NamedTuple):
    """Standard deviations of rows, columns and pixels."""

    row: float
    column: float
    pixel: float

    @property
    def total(self) -> float:
        return float(np.hypot(np.hypot(self.row, self.column), self.pixel))


def noise(
    rng: np.random.Generator, shape: tuple[int, ...], sigmas: Sigmas
) -> NDArray[np.float64]:
    """Normal values that rows, columns and pixels have of their own: fixed for (H, W), temporal for (N, H, W)."""
    *frames, height, width = shape
    return (
        sigmas.row * rng.normal(size=(*frames, height, 1))
        + sigmas.column * rng.normal(size=(*frames, 1, width))
        + sigmas.pixel * rng.normal(size=shape)
    )


def frames(
    rng: np.random.Generator, mean: NDArray[np.float64], count: int, temporal: Sigmas
) -> NDArray[np.float64]:
    """So many frames about a mean image."""
    return mean + noise(rng, (count, *mean.shape), temporal)


def rounded(values: NDArray[np.float64], bits: int = 12) -> NDArray[np.uint16]:
    """As an ADC of so many bits gives them."""
    return np.clip(np.floor(values + 0.5), 0, 2**bits - 1).astype(np.uint16)


def stack(values: NDArray[np.float64], exposure_s: float = 0.1) -> Stack:
    """Of 12-bit frames."""
    return Stack(rounded(values), exposure_s, bits=12)
