"""A slanted edge: its spatial frequency response after ISO 12233, and the picture that a transfer function makes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PER_PIXEL = 4  # bins of the edge spread function
WINDOW_PX = 24  # on either side of the edge
FREQUENCIES = np.linspace(0.05, 0.5, 10)
"""Cycles per pixel, up to Nyquist's."""


def frequency_response(picture: Array) -> Array:
    """Modulation at FREQUENCIES of a picture with an edge that is nearly upright, (rows, columns)."""
    rows, columns = picture.shape
    step = np.diff(picture, axis=1)  # signed, so that noise far from the edge cancels
    place = (step * (np.arange(columns - 1) + 1.0)).sum(axis=1) / step.sum(axis=1)
    slope, at_first = np.polyfit(np.arange(rows) + 0.5, place, 1)
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    distance = (x - (slope * y + at_first)) * math.cos(math.atan(slope))
    number = np.floor(distance * PER_PIXEL).astype(int) + WINDOW_PX * PER_PIXEL
    bins = 2 * WINDOW_PX * PER_PIXEL
    inside = (number >= 0) & (number < bins)
    counts = np.bincount(number[inside], minlength=bins)
    spread = np.bincount(number[inside], picture[inside], minlength=bins) / counts
    line = np.diff(spread) * np.hamming(bins - 1)
    at = np.arange(bins - 1) / PER_PIXEL
    waves = np.exp(-2j * math.pi * np.outer(FREQUENCIES, at))
    bin_box = np.sinc(FREQUENCIES / PER_PIXEL) ** 2  # of the bins, and of the difference
    return np.asarray(np.abs(waves @ line) / np.abs(line.sum()) / bin_box)


def edge_picture(
    mtf: Callable[[Array], Array], shape: tuple[int, int], angle_deg: float
) -> Array:
    """Light right of an edge through the middle that is turned by an angle, of 1 far away, behind a system with this
    transfer function of the frequency across the edge [cycles per pixel]: ½ + ∫ M(ν)·sin(2πνx)/(πν) dν."""
    rows, columns = shape
    x, y = np.meshgrid(np.arange(columns) + 0.5 - columns / 2, np.arange(rows) + 0.5 - rows / 2)
    angle = math.radians(angle_deg)
    distance = x * math.cos(angle) + y * math.sin(angle)
    step = 1e-3
    frequency = (np.arange(8_000) + 0.5) * step
    grid = np.linspace(distance.min() - 0.1, distance.max() + 0.1, 4001)
    waves = mtf(frequency) / (math.pi * frequency) * step
    spread = np.array([np.dot(waves, np.sin(2 * math.pi * frequency * at)) for at in grid])
    return np.asarray(0.5 + np.interp(distance, grid, spread))
