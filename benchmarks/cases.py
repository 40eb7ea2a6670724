"""Define the test cases of the benchmarks: three cameras, and photon maps of a given size, level and content."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

EXPOSURE = ms.Exposure(time_s=0.1)


def full_chain() -> ms.Camera:
    """Return Table 1 with all options: kTC noise, and non-linear sense node, source follower and ADC."""
    return ms.load_camera("konnik_table1").replace(
        **{
            "readout.reset": "hard",
            "readout.ve_nonlinearity": 0.05,
            "source_follower.vv_nonlinearity": 1.05,
            "adc.gamma": 1.04,
        }
    )


def shot_read_quantise() -> ms.Camera:
    """Return Table 1 with only photon shot noise, read noise and quantisation."""
    return ms.load_camera("konnik_table1").replace(
        **{"pixel.prnu": 0.0, "dark_current.fom_na_per_cm2": 0.0, "readout.dsnu_col": 0.0}
    )


def shape_of(mpx: float) -> tuple[int, int]:
    """Return rows and columns of about ``mpx`` million pixels, 3 : 4."""
    rows = max(round(math.sqrt(mpx * 1e6 * 3 / 4)), 1)
    return rows, max(round(mpx * 1e6 / rows), 1)


def reference_qe(camera: ms.Camera) -> float:
    """Return the quantum efficiency at the reference wavelength, for photons without a wavelength."""
    return float(camera.qe([camera.quantum_efficiency.reference_nm or 0.0])[0, 0])


CONTENTS: dict[str, Callable[[tuple[int, int]], NDArray[np.float64]]] = {
    "flat": np.ones,
    "ramp": lambda shape: np.tile(np.linspace(0.0, 2.0, shape[1]), (shape[0], 1)),
    "random": lambda shape: np.random.default_rng(1).uniform(0.0, 2.0, shape),
}
"""Relative light of mean 1: constant, a ramp from 0 to 2 from left to right, and uniform random from 0 to 2."""


def photon_map(
    camera: ms.Camera, electrons: float, content: str, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Return mean photons per pixel for ``electrons`` photoelectrons on average, shape (H, W)."""
    return CONTENTS[content](shape) * (electrons / reference_qe(camera))
