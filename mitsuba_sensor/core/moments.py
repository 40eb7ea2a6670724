"""Mean, temporal and spatial variance of a signal, and how they change: the theory that every stage provides."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from .types import Array

if TYPE_CHECKING:
    from .frame import Frame


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean, temporal and spatial variance of a signal, in the unit of its domain.

    ::

        def moments(self, m):  # a method of a Stage
            return m.add(temporal=self.sigma_v**2)

    mean : what enters the first stage (:class:`Photons`), then the mean signal, scalar or (H, W).
    temporal : variance from frame to frame at one pixel, averaged over cameras.
    spatial : variance from pixel to pixel (camera to camera) of the mean over frames.
    frame : the conditions, exposure and window; no random number is drawn from it.
    light : the part of the signal that is photoelectrons, from the stage on that adds the dark current.
    yield_mean, yield_variance, variance_e2 : as in :class:`signals.Electrons`.
    """

    mean: Array
    temporal: Array
    spatial: Array
    frame: Frame
    light: Moments | None = None
    yield_mean: Array = 1.0
    yield_variance: Array = 0.0
    variance_e2: Array = None

    def add(self, *, mean: Array = 0.0, temporal: Array = 0.0, spatial: Array = 0.0) -> Moments:
        """An independent signal is added: all three add."""
        return replace(
            self,
            mean=self.mean + mean,
            temporal=self.temporal + temporal,
            spatial=self.spatial + spatial,
        )

    def scale(self, gain: Array) -> Moments:
        """The signal is multiplied by a constant."""
        return replace(
            self,
            mean=self.mean * gain,
            temporal=self.temporal * gain**2,
            spatial=self.spatial * gain**2,
        )

    def through(self, value: Array, slope: Array, curvature: Array) -> Moments:
        """A smooth function of the signal, by value, slope and curvature at the mean; second order in the noise."""
        total = self.temporal + self.spatial
        bend = 0.5 * curvature**2
        return replace(
            self,
            mean=value + 0.5 * curvature * total,
            temporal=slope**2 * self.temporal + bend * (total**2 - self.spatial**2),
            spatial=slope**2 * self.spatial + bend * self.spatial**2,
        )

    def clip(self, low: float, high: float) -> Moments:
        """The signal is clipped to [low, high]; exact for a normal signal that reaches only one of the two limits.

        A mean far above ``high`` is taken as that of a log-normal signal, which has no negative values however wide.
        """
        upper = _clip_above(self, high)
        mirrored = _clip_above(replace(upper, mean=-upper.mean), -low)
        return replace(mirrored, mean=-mirrored.mean)

    @property
    def sigma(self) -> float:
        """Root of the total variance averaged over the window: σ of one frame minus its mean."""
        return math.sqrt(float(np.mean(self.temporal)) + float(np.mean(self.spatial)))


SATURATED = 2.0
"""Means above this times the limit are far above it: a normal signal that wide would have negative values."""


def rectified_normal(sigma: float) -> tuple[float, float]:
    """Mean and variance of max(0, 1 + σ·z)."""
    if sigma < 0.1:  # nothing is cut within 10σ, and 1 + σ² − 1 would lose σ below 1e-8
        return 1.0, sigma * sigma
    density = math.exp(-0.5 / sigma**2) / math.sqrt(2 * math.pi)
    above = float(scipy.special.ndtr(1 / sigma))
    mean = above + sigma * density
    return mean, (1 + sigma**2) * above + sigma * density - mean**2


def _clip_above(m: Moments, edge: float) -> Moments:
    """Moments of min(x, edge) for normal x; the spatial variance follows from Price's theorem.

    With c = (edge − mean)/s the covariance of two frames of one pixel, correlated by ρ = spatial/s², is
    s²·∫₀^ρ P(z₁ < c, z₂ < c; r) dr, and Φ₂(c, c; r) = Φ(c) − 2·OwenT(c, √((1−r)/(1+r))).
    """
    parts = (np.asarray(x, dtype=np.float64) for x in (m.mean, m.temporal, m.spatial))
    mean, temporal, spatial = np.broadcast_arrays(*parts)
    variance = temporal + spatial
    if not variance.any():
        return replace(m, mean=np.minimum(mean, edge), temporal=temporal, spatial=spatial)
    sigma = np.sqrt(variance)
    near = (variance > 0) & np.isfinite(variance) & (edge - mean < 8 * sigma)
    sure = ~((variance > 0) & np.isfinite(variance)) & (mean > edge)
    saturated = near & (mean > SATURATED * edge) & (edge > 0)
    near &= ~saturated
    mean, temporal, spatial = mean.copy(), temporal.copy(), spatial.copy()
    mean[sure], temporal[sure], spatial[sure] = edge, 0.0, 0.0
    if not (near | saturated).any():
        return replace(m, mean=mean, temporal=temporal, spatial=spatial)
    share = spatial[saturated] / variance[saturated]
    mean[saturated], left = _saturated(mean[saturated], sigma[saturated], edge)
    temporal[saturated], spatial[saturated] = (1 - share) * left, share * left
    s, v = sigma[near], variance[near]
    c = np.maximum((edge - mean[near]) / s, -40.0)
    below, density = scipy.special.ndtr(c), np.exp(-0.5 * c * c) / math.sqrt(2 * math.pi)
    shortfall = s * (c * below + density)
    total = np.maximum(v * ((c * c + 1) * below + c * density) - shortfall**2, 0.0)
    kept_spatial = np.clip(v * _correlated(c, spatial[near] / v, below), 0.0, total)
    mean[near], spatial[near], temporal[near] = (
        edge - shortfall,
        kept_spatial,
        total - kept_spatial,
    )
    return replace(m, mean=mean, temporal=temporal, spatial=spatial)


def _saturated(mean: Array, sigma: Array, edge: float) -> tuple[Array, Array]:
    """Mean and variance of min(x, edge) for log-normal x, from the moments of (edge − x)⁺."""
    spread = np.maximum((sigma / mean) ** 2, np.finfo(float).tiny)
    width = np.sqrt(np.log1p(spread))
    c = np.log(edge / mean) / width + width / 2
    below, light, square = (scipy.special.ndtr(c - k * width) for k in (0, 1, 2))
    shortfall = edge * below - mean * light
    squared = (
        edge**2 * below
        - 2 * edge * (mean * light)
        + (mean * np.sqrt((1 + spread) * square)) ** 2
    )
    return edge - shortfall, np.maximum(squared - shortfall**2, 0.0)


def _correlated(c: Array, rho: Array, below: Array) -> Array:
    """∫₀^ρ Φ₂(c, c; r) dr, by eight-point Gauss-Legendre quadrature in r = sin θ, which is smooth at ρ = 1."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    integral, end = np.zeros_like(c), np.arcsin(rho)
    for node, weight in zip(nodes, weights, strict=True):
        theta = 0.5 * end * (node + 1)
        integral += (
            0.5
            * weight
            * end
            * np.cos(theta)
            * (below - 2 * scipy.special.owens_t(c, np.tan(math.pi / 4 - theta / 2)))
        )
    return integral
