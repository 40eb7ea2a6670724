"""The picture of a slanted edge that a transfer function makes, and what the laboratory measures in one."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mitsuba_sensor.lab.measure.image_quality.slanted_edge import slanted_edge

Array = NDArray[np.float64]
FREQUENCIES = np.linspace(0.05, 0.5, 10)
"""Cycles per pixel, up to Nyquist's."""


def frequency_response(picture: Array) -> Array:
    """Modulation at FREQUENCIES of a picture with an edge, as the laboratory measures it."""
    modulation = slanted_edge(picture).modulation
    return np.asarray(np.interp(FREQUENCIES, modulation.frequency, modulation.value))


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
    grid = np.linspace(0, np.abs(distance).max() + 0.1, 2001)
    waves = mtf(frequency) / (math.pi * frequency) * step
    spread = np.array([np.dot(waves, np.sin(2 * math.pi * frequency * at)) for at in grid])
    return np.asarray(0.5 + np.sign(distance) * np.interp(np.abs(distance), grid, spread))
