"""Polariser mosaic: what each pixel's polariser transmits of unpolarised and of polarised light.

    I(θ) = ½(τ_max + τ_min)·S0 + ½(τ_max − τ_min)·(S1 cos 2θ + S2 sin 2θ)
         = ½(τ_max + τ_min)·(S0 + c·(S1 cos 2θ + S2 sin 2θ)),  c = (τ_max − τ_min)/(τ_max + τ_min)

The first factor is part of the quantum efficiency of the pixel. The second is part of the light that is rendered for
such a camera; for unpolarised light, as arrays of photons are assumed to be, it is S0.
"""

from __future__ import annotations

import numpy as np

from ..core.types import Float64Array
from .stage import Datasheet


def mean_transmittance(camera: Datasheet) -> Float64Array:
    """½(τ_max + τ_min) of the polarisers at the wavelengths of the quantum efficiency, (N,); 1 without polarisers."""
    sensor, points = camera.sensor, len(camera.quantum_efficiency.wavelengths_nm)
    if sensor.polarizers is None:
        return np.ones(points)
    passed = 1.0 if sensor.polarizer_transmission is None else sensor.polarizer_transmission
    ratio = np.array(sensor.extinction_ratio, dtype=float)
    return np.broadcast_to(0.5 * np.array(passed, dtype=float) * (1 + 1 / ratio), points)


def contrast(camera: Datasheet) -> Float64Array:
    """(τ_max − τ_min)/(τ_max + τ_min) of the polarisers at the wavelengths of the quantum efficiency, (N,)."""
    ratio = np.array(camera.sensor.extinction_ratio, dtype=float)
    points = len(camera.quantum_efficiency.wavelengths_nm)
    return np.broadcast_to((ratio - 1) / (ratio + 1), points)


def efficiencies(camera: Datasheet) -> dict[str, tuple[float, ...]]:
    """Quantum efficiency of each filter in unpolarised light, polarisers included, at its wavelengths."""
    curves: dict[str, tuple[float, ...]] = camera.quantum_efficiency.curves
    if camera.sensor.polarizers is None:
        return curves
    passed = mean_transmittance(camera)
    return {name: tuple((np.array(curve) * passed).tolist()) for name, curve in curves.items()}
