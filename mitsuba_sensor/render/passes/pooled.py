"""Error bars of few passes: a pixel's variance and that of its neighbours, weighted by what each is known to."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import Float64Array
from ..denoise.combine import SMALLEST, box

RADIUS_PX = 1  # of the neighbourhood
DARKEST = (
    1e-3  # of the mean of the picture: darker pixels are compared as if they were as bright
)
FEWEST = 3  # passes
MOST_RELATIVE = 1e6  # standard error over the light: of pixels in which there is none


def pooled(mean: Float64Array, variance: Float64Array, passes: int) -> Float64Array:
    """The variance of the mean of the passes, (d·v + d₀·v₀)/(d + d₀), all (H, W).

    d : degrees of freedom of v, the pixel's own.  v₀ : at the relative variance of 3 × 3 pixels.  d₀ : for how many
    degrees of freedom v₀ counts, from how far log v and log v₀ differ over the picture, beyond what d explains
    (Smyth 2004, doi 10.2202/1544-6115.1027).
    A pixel without any light keeps its own. With 7 degrees of freedom the pixel's own variance is off by half, so that
    its error bar holds for 88 % of the pixels at two standard errors, where a known one holds for 95 %.
    """
    if passes < FEWEST:
        return variance
    level = np.maximum(mean, DARKEST * mean.mean()) + SMALLEST
    own, freedom = variance / level**2, passes - 1
    near = np.maximum(
        box(own, RADIUS_PX), own / (2 * RADIUS_PX + 1) ** 2
    )  # a running sum rounds
    lit = (own > 0) & np.isfinite(near)
    apart = np.log(own[lit] / near[lit])
    beyond = (
        float(apart.var()) - float(scipy.special.polygamma(1, freedom / 2))
        if apart.size
        else np.inf
    )
    most = (2 * RADIUS_PX + 1) ** 2 * freedom
    prior = min(2 / beyond, most) if beyond > 2 / most else most
    found = (freedom * own + prior * near) / (freedom + prior) * level**2
    return np.where(mean > 0, found, variance)


def relative_errors(
    mean: Float64Array, variance: Float64Array, infinite: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Standard errors over the light, all (H, W); at most MOST_RELATIVE, and inf where the light is infinite."""
    found = np.sqrt(variance)
    least = found / MOST_RELATIVE + np.finfo(float).tiny
    found /= np.maximum(mean, least, out=least)
    found[infinite] = np.inf
    return found.astype(np.float32)
