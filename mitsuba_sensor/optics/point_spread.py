"""Point spread of a diffraction-limited lens and of the pixel aperture: closed forms and tables.

The image of a point through a circular pupil with a central obstruction of ε times its diameter is, at the radius r,
with x = π·r/(λN) and the working f-number N (Born & Wolf 1999, 8.5.2 and 8.6.2),

    p(x) = [2J₁(x)/x − ε²·2J₁(εx)/(εx)]² / (4π(1 − ε²)),    ∫p·2πx dx = 1.

The renderer draws a radius by inverting the encircled energy E. Above x = TAIL_FROM/(1 − ε), both are averaged over the
rings: 1 − E falls as 1/x. This changes the MTF by at most 6e-4, and makes the densities of different wavelengths almost
equal far out, which reduces the noise in narrow bands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core import Float64Array
from ..core.special import root

TAIL_FROM = 32.0
ENERGY_NODES = 2**15 + 1  # of the inverse of the encircled energy
DENSITY_NODES = 2**12 + 1
STEPS_PER_NODE = 8  # of the integral of the energy
AIRY_ZERO = 3.8317059702075123  # of J₁


def point_spread(x: ArrayLike, obstruction: float = 0.0) -> Float64Array:
    """Return p at x: energy per area of the plane of x."""
    amplitude = _amplitude(np.asarray(x, dtype=float), obstruction)
    return np.asarray(amplitude**2 / (4 * math.pi * (1 - obstruction**2)))


def _amplitude(x: Float64Array, obstruction: float) -> Float64Array:
    """Return 2J₁(x)/x − ε²·2J₁(εx)/(εx)."""
    return _jinc(x) - obstruction**2 * _jinc(obstruction * x)


def _jinc(x: Float64Array) -> Float64Array:
    """Return 2J₁(x)/x, which is 1 at 0."""
    safe = np.maximum(x, 1e-9)
    return np.where(x < 1e-9, 1.0, 2 * scipy.special.j1(safe) / safe)


def encircled_energy(x: ArrayLike, obstruction: float = 0.0) -> Float64Array:
    """Return the fraction of the energy inside x: 1 − J₀² − J₁² for a clear pupil, else the integral from 0 to x.

    x : with an obstruction, must start at 0 and increase in small steps.
    """
    at = np.asarray(x, dtype=float)
    if obstruction == 0:
        return np.asarray(1 - scipy.special.j0(at) ** 2 - scipy.special.j1(at) ** 2)
    per_radius = 2 * math.pi * at * point_spread(at, obstruction)
    return np.asarray(scipy.integrate.cumulative_simpson(per_radius, x=at, initial=0.0))


@lru_cache(maxsize=32)
def first_zero(obstruction: float = 0.0) -> float:
    """Return x of the first dark ring; 3.83 without obstruction, where r = 1.22·λN."""
    if obstruction == 0:
        return AIRY_ZERO  # without scipy.optimize, which takes a second to import
    return root(lambda x: float(_amplitude(np.asarray(x), obstruction)), 1.5, AIRY_ZERO)


def airy_diameter_um(wavelength_nm: float, f_number: float, obstruction: float = 0.0) -> float:
    """Return the diameter of the first dark ring on the sensor [µm].  f_number : working f-number."""
    return 2 * first_zero(obstruction) / math.pi * wavelength_nm * 1e-3 * f_number


def diffraction_mtf(frequency: ArrayLike, obstruction: float = 0.0) -> Float64Array:
    """Return the MTF at ν·λ·N, the frequency over the cut-off frequency of the pupil.

    It is the autocorrelation of the pupil over its area: (2/π)·(acos s − s√(1 − s²)) without obstruction.
    """
    s, ring = np.abs(np.asarray(frequency, dtype=float)), obstruction
    both, inner = _overlap(1.0, 1.0, 2 * s), _overlap(ring, ring, 2 * s)
    return np.asarray(
        (both - 2 * _overlap(1.0, ring, 2 * s) + inner) / (math.pi * (1 - ring**2))
    )


def _overlap(large: float, small: float, distance: Float64Array) -> Float64Array:
    """Return the intersection area of two circles with these radii and centre distances."""
    if small == 0:
        return np.zeros_like(distance)
    crossing = np.clip(distance, max(large - small, 1e-12), large + small)
    reach = (crossing**2 + large**2 - small**2) / (2 * crossing)  # of the chord from the centre
    rest = crossing - reach
    segments = large**2 * np.arccos(np.clip(reach / large, -1, 1))
    segments = segments + small**2 * np.arccos(np.clip(rest / small, -1, 1))
    segments = segments - crossing * np.sqrt(np.maximum(large**2 - reach**2, 0.0))
    return np.where(distance <= large - small, math.pi * small**2, segments)


def aperture_mtf(
    frequency: ArrayLike, width: float = 1.0, cells: Sequence[float] = (1.0,)
) -> Float64Array:
    """Return the MTF of a pixel of this width along one direction; |sinc| for uniform sensitivity.

    frequency times width : in cycles.  cells : measured sensitivity of equal parts of the width.
    """
    cycles = np.asarray(frequency, dtype=float)[..., None] * width
    count, shares = len(cells), np.array(cells) / np.sum(cells)
    waves = np.exp(-2j * math.pi * cycles * (np.arange(count) + 0.5) / count)
    return np.asarray(np.abs(np.sinc(cycles[..., 0] / count) * (waves @ shares)))


@dataclass(frozen=True, eq=False)
class PointSpreadTables:
    """Tables for drawing radii x and evaluating their densities.

    radii : (ENERGY_NODES,) x at equidistant energies from 0 to ``inside``, the energy inside ``edge``.
    densities : (DENSITY_NODES,) p at equidistant x from 0 to ``edge``.
    Farther out, 1 − E is (1 − inside)·edge/x, and p is ``tail``/x³.
    """

    radii: Float64Array
    densities: Float64Array
    inside: float
    edge: float

    @property
    def tail(self) -> float:
        """p·x³ outside ``edge``."""
        return (1 - self.inside) * self.edge / (2 * math.pi)


@lru_cache(maxsize=8)
def point_spread_tables(obstruction: float = 0.0) -> PointSpreadTables:
    """Return the tables of a pupil."""
    edge = TAIL_FROM / (1 - obstruction)
    x = np.linspace(0.0, edge, STEPS_PER_NODE * (DENSITY_NODES - 1) + 1)
    energy = np.maximum.accumulate(encircled_energy(x, obstruction))
    inside = float(energy[-1])
    radii = np.interp(np.linspace(0.0, inside, ENERGY_NODES), energy, x)
    densities = point_spread(x[::STEPS_PER_NODE], obstruction)
    return PointSpreadTables(radii, densities, inside, edge)
