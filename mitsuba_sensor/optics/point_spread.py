"""Point spread of a lens that only diffraction limits, and of the pixel's aperture: closed forms and tables.

The image of a point through a circular pupil, of which a circle of ε times its diameter may be obstructed in the
middle, has at the radius r, with x = π·r/(λN) and the working f-number N (Born & Wolf 1999, 8.5.2 and 8.6.2),

    p(x) = [2J₁(x)/x − ε²·2J₁(εx)/(εx)]² / (4π(1 − ε²)),    ∫p·2πx dx = 1.

A renderer draws a radius from it by the inverse of the encircled energy. From x = TAIL_FROM/(1 − ε) on both have the
mean over the rings: 1 − E falls with 1/x. The modulation transfer function of that is off by 6e-4 at most, and the
densities of different wavelengths far out are nearly alike: less noise in narrow bands.
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
SHARES = 2**15 + 1  # nodes of the inverse of the encircled energy
NODES = 2**12 + 1  # of the density
FINER = 8  # times as many steps where the energy is integrated
AIRY_ZERO = 3.8317059702075123  # of J₁


def point_spread(x: ArrayLike, obstruction: float = 0.0) -> Float64Array:
    """p at x: energy per area of the plane of x."""
    amplitude = _amplitude(np.asarray(x, dtype=float), obstruction)
    return np.asarray(amplitude**2 / (4 * math.pi * (1 - obstruction**2)))


def _amplitude(x: Float64Array, obstruction: float) -> Float64Array:
    """2J₁(x)/x − ε²·2J₁(εx)/(εx)."""
    return _jinc(x) - obstruction**2 * _jinc(obstruction * x)


def _jinc(x: Float64Array) -> Float64Array:
    """2J₁(x)/x, which is 1 at 0."""
    safe = np.maximum(x, 1e-9)
    return np.where(x < 1e-9, 1.0, 2 * scipy.special.j1(safe) / safe)


def encircled_energy(x: ArrayLike, obstruction: float = 0.0) -> Float64Array:
    """Share of the energy inside x: 1 − J₀² − J₁² of a clear pupil, else integrated from 0 to each x.

    x : any for a clear pupil; increasing, from 0 on, and close to each other, with an obstruction.
    """
    at = np.asarray(x, dtype=float)
    if obstruction == 0:
        return np.asarray(1 - scipy.special.j0(at) ** 2 - scipy.special.j1(at) ** 2)
    per_radius = 2 * math.pi * at * point_spread(at, obstruction)
    return np.asarray(scipy.integrate.cumulative_simpson(per_radius, x=at, initial=0.0))


@lru_cache(maxsize=32)
def first_zero(obstruction: float = 0.0) -> float:
    """x of the first dark ring, 3.83 without an obstruction; r = 1.22·λN."""
    if obstruction == 0:
        return AIRY_ZERO  # without scipy.optimize, which takes a second to import
    return root(lambda x: float(_amplitude(np.asarray(x), obstruction)), 1.5, AIRY_ZERO)


def airy_diameter_um(wavelength_nm: float, f_number: float, obstruction: float = 0.0) -> float:
    """Diameter of the first dark ring on the sensor [µm].  f_number : the working one."""
    return 2 * first_zero(obstruction) / math.pi * wavelength_nm * 1e-3 * f_number


def diffraction_mtf(frequency: ArrayLike, obstruction: float = 0.0) -> Float64Array:
    """Modulation transfer function at ν·λ·N, the frequency over the highest that the pupil passes.

    The overlap of the pupil with itself, over its area: (2/π)·(acos s − s√(1 − s²)) without an obstruction.
    """
    s, ring = np.abs(np.asarray(frequency, dtype=float)), obstruction
    both, inner = _overlap(1.0, 1.0, 2 * s), _overlap(ring, ring, 2 * s)
    return np.asarray(
        (both - 2 * _overlap(1.0, ring, 2 * s) + inner) / (math.pi * (1 - ring**2))
    )


def _overlap(large: float, small: float, distance: Float64Array) -> Float64Array:
    """Area that two circles of these radii have in common, at these distances of their centres."""
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
    """Modulation transfer function of a pixel of this width along one direction: |sinc| where all of it counts alike.

    frequency times width : in cycles.  cells : sensitivity of equal parts of the width, if it is measured; the modulus
    of the transform of these steps.
    """
    cycles = np.asarray(frequency, dtype=float)[..., None] * width
    count, shares = len(cells), np.array(cells) / np.sum(cells)
    waves = np.exp(-2j * math.pi * cycles * (np.arange(count) + 0.5) / count)
    return np.asarray(np.abs(np.sinc(cycles[..., 0] / count) * (waves @ shares)))


@dataclass(frozen=True, eq=False)
class PointSpreadTables:
    """What a renderer needs to draw radii x and to compare their densities.

    radii : (SHARES,) x at equidistant shares of the energy from 0 to ``inside``, which is what is inside ``edge``.
    densities : (NODES,) p at equidistant x from 0 to ``edge``.
    Farther out 1 − E is (1 − inside)·edge/x, and p is ``tail``/x³.
    """

    radii: Float64Array
    densities: Float64Array
    inside: float
    edge: float

    @property
    def tail(self) -> float:
        """p·x³ beyond ``edge``."""
        return (1 - self.inside) * self.edge / (2 * math.pi)


@lru_cache(maxsize=8)
def point_spread_tables(obstruction: float = 0.0) -> PointSpreadTables:
    """The tables of a pupil."""
    edge = TAIL_FROM / (1 - obstruction)
    x = np.linspace(0.0, edge, FINER * (NODES - 1) + 1)
    energy = np.maximum.accumulate(encircled_energy(x, obstruction))
    inside = float(energy[-1])
    radii = np.interp(np.linspace(0.0, inside, SHARES), energy, x)
    return PointSpreadTables(radii, point_spread(x[::FINER], obstruction), inside, edge)
