"""Law of the electrons that leave a multiplication register: a sum of gamma laws, one for each count that enters.

Where an end of the converter or of the register cuts such a law, a normal of the same mean and variance is far off: of
48 electrons at a gain of 5000 few are left in its lower tail. So it is cut into narrow cells there.
"""

from __future__ import annotations

import numpy as np
import scipy

from ..core.types import Float64Array
from .pixel_counts import ABOUT_END
from .swing import FARTHEST, Normals, cells_between

EVEN: Float64Array = np.linspace(-FARTHEST, FARTHEST, 41)[:, None]
"""Edges of the cells of the law, 0.35 of its σ apart."""


def cells_of_gamma_laws(laws: Normals, ends_e: Float64Array, noise_e: float) -> Normals:
    """The same law as a sum of narrow normals, one for each cell of the electrons.

    laws : chances, means and variances of gamma laws; one without mean or variance is certain.
    ends_e : where the law is cut; cells about these are as narrow as the noise behind the register.
    noise_e : its σ, in electrons that leave the register.
    """
    chances, means, variances = np.broadcast_arrays(*laws)
    edges = _edges(Normals(chances, means, variances), ends_e, noise_e)
    mass, first, second = (np.zeros(edges.shape) for _ in range(3))
    for chance, mean, variance in zip(chances, means, variances, strict=True):
        below, once, twice = _partial_moments(edges, mean, variance)
        mass += chance * below
        first += chance * once
        second += chance * twice
    return cells_between(np.maximum(edges, 0.0), mass, first, second)


def _edges(laws: Normals, ends_e: Float64Array, noise_e: float) -> Float64Array:
    """Edges of the cells, (K + 1, P): evenly spaced, narrow about the ends, and one cell for no electrons at all."""
    chances, means, variances = laws
    centre = np.sum(chances * means, axis=0)
    spread = np.sqrt(np.sum(chances * (variances + (means - centre) ** 2), axis=0))
    about = (ends_e[:, None] + noise_e * ABOUT_END.T).ravel()
    pixels = np.ones(centre.shape)
    inner = np.concatenate(
        [centre + EVEN * spread, about[:, None] * pixels, 0.0 * pixels[None]]
    )
    inner = np.sort(np.maximum(inner, 0.0), axis=0)
    return np.concatenate([-pixels[None], inner, np.inf * pixels[None]])


def _partial_moments(
    edges: Float64Array, mean: Float64Array, variance: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Moments 0, 1 and 2 of the part of a gamma law that lies at or below each edge, (K, P)."""
    spread = (mean > 0) & (variance > 0)
    rate = np.where(spread, mean, 1.0) / np.where(spread, variance, 1.0)
    shape, ends = np.where(spread, mean, 1.0) * rate, np.maximum(edges, 0.0) * rate
    certain = (edges >= mean).astype(np.float64)
    below, once, twice = (
        np.where(spread, scipy.special.gammainc(shape + order, ends), certain)
        for order in range(3)
    )
    return below, mean * once, (mean**2 + variance) * twice
