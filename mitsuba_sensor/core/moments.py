"""What a signal must be on average: the theory that every stage writes below its sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import special

from .rounding import rounded

if TYPE_CHECKING:
    from .frame import Frame


@dataclass(frozen=True, eq=False)
class Moments:
    """Mean, temporal and spatial variance of a signal, in the unit of its domain.

    mean : what enters the first stage (:class:`Photons`), then the mean signal, scalar or (H, W).
    temporal : variance from frame to frame at one pixel, averaged over cameras.
    spatial : variance from pixel to pixel (camera to camera) of the mean over frames.
    frame : the conditions: exposure, window; a stage's theory reads them and draws nothing.
    light : the light's part of this signal, from the stage on that adds the dark current.
    yield_mean, yield_variance, variance_e2 : as in :class:`Electrons`.
    """

    mean: Any
    temporal: Any
    spatial: Any
    frame: Frame
    light: Moments | None = None
    yield_mean: Any = 1.0
    yield_variance: Any = 0.0
    variance_e2: Any = None

    def add(self, *, mean: Any = 0.0, temporal: Any = 0.0, spatial: Any = 0.0) -> Moments:
        """An independent part is added: all three add."""
        return replace(self, mean=self.mean + mean, temporal=self.temporal + temporal, spatial=self.spatial + spatial)

    def scale(self, gain: Any) -> Moments:
        """The signal is multiplied by a constant."""
        return replace(self, mean=self.mean * gain, temporal=self.temporal * gain**2, spatial=self.spatial * gain**2)

    def through(self, value: Any, slope: Any, curvature: Any) -> Moments:
        """The signal goes through a smooth curve f: f, f′ and f″ at the mean; second order in the noise."""
        total = self.temporal + self.spatial
        bend = 0.5 * curvature**2
        return replace(
            self,
            mean=value + 0.5 * curvature * total,
            temporal=slope**2 * self.temporal + bend * (total**2 - self.spatial**2),
            spatial=slope**2 * self.spatial + bend * self.spatial**2,
        )

    def round(self) -> Moments:
        """The signal is rounded to whole numbers; exact for a normal signal whose temporal σ is 0.1 or more."""
        mean, temporal, spatial = rounded(self.mean, self.temporal, self.spatial)
        return replace(self, mean=mean, temporal=temporal, spatial=spatial)

    def clip(self, low: float, high: float) -> Moments:
        """The signal is cut to [low, high]; exact for a normal signal that reaches only one of the two edges.

        What is deep above ``high`` is taken for log-normal, so that no part of a wide dark pattern counts as negative.
        """
        upper = _cut_above(self, high)
        mirrored = _cut_above(replace(upper, mean=-upper.mean), -low)
        return replace(mirrored, mean=-mirrored.mean)

    @property
    def sigma(self) -> float:
        """Root of the total variance averaged over the window: what the residual of one frame must show."""
        return math.sqrt(float(np.mean(self.temporal)) + float(np.mean(self.spatial)))


SATURATED = 2.0
"""Times the edge from which a mean is deep above it. A normal law that wide would reach below zero."""


def rectified_normal(sigma: float) -> tuple[float, float]:
    """Mean and variance of max(0, 1 + σ·z)."""
    if sigma < 0.1:  # nothing is cut within 10σ, and 1 + σ² − 1 would lose σ below 1e-8
        return 1.0, sigma * sigma
    density = math.exp(-0.5 / sigma**2) / math.sqrt(2 * math.pi)
    above = float(special.ndtr(1 / sigma))
    mean = above + sigma * density
    return mean, (1 + sigma**2) * above + sigma * density - mean**2


def _cut_above(m: Moments, edge: float) -> Moments:
    """min(x, edge) for normal x; a fixed part stays fixed by Price's theorem.

    With c = (edge − mean)/s the covariance of two frames of one pixel, correlated by ρ = spatial/s², is
    s²·∫₀^ρ P(z₁ < c, z₂ < c; r) dr, and Φ₂(c, c; r) = Φ(c) − 2·OwenT(c, √((1−r)/(1+r))).
    """
    parts = (np.asarray(x, dtype=np.float64) for x in (m.mean, m.temporal, m.spatial))
    mean, temporal, spatial = np.broadcast_arrays(*parts)
    variance = temporal + spatial
    sigma = np.sqrt(variance)
    near = (variance > 0) & np.isfinite(variance) & (edge - mean < 8 * sigma)
    sure = ~((variance > 0) & np.isfinite(variance)) & (mean > edge)
    saturated = near & (mean > SATURATED * edge) & (edge > 0)
    near &= ~saturated
    mean, temporal, spatial = mean.copy(), temporal.copy(), spatial.copy()
    mean[sure], temporal[sure], spatial[sure] = edge, 0.0, 0.0
    share = spatial[saturated] / variance[saturated]
    mean[saturated], left = _saturated(mean[saturated], sigma[saturated], edge)
    temporal[saturated], spatial[saturated] = (1 - share) * left, share * left
    s, v = sigma[near], variance[near]
    c = np.maximum((edge - mean[near]) / s, -40.0)
    below, density = special.ndtr(c), np.exp(-0.5 * c * c) / math.sqrt(2 * math.pi)
    shortfall = s * (c * below + density)
    total = np.maximum(v * ((c * c + 1) * below + c * density) - shortfall**2, 0.0)
    kept_spatial = np.clip(v * _correlated(c, spatial[near] / v, below), 0.0, total)
    mean[near], spatial[near], temporal[near] = edge - shortfall, kept_spatial, total - kept_spatial
    return replace(m, mean=mean, temporal=temporal, spatial=spatial)


def _saturated(mean: Any, sigma: Any, edge: float) -> tuple[Any, Any]:
    """Mean and variance of min(x, edge) for log-normal x, from the moments of (edge − x)⁺."""
    spread = np.maximum((sigma / mean) ** 2, np.finfo(float).tiny)
    width = np.sqrt(np.log1p(spread))
    c = np.log(edge / mean) / width + width / 2
    below, light, square = (special.ndtr(c - k * width) for k in (0, 1, 2))
    shortfall = edge * below - mean * light
    squared = edge**2 * below - 2 * edge * (mean * light) + (mean * np.sqrt((1 + spread) * square)) ** 2
    return edge - shortfall, np.maximum(squared - shortfall**2, 0.0)


def _correlated(c: Any, rho: Any, below: Any) -> Any:
    """∫₀^ρ Φ₂(c, c; r) dr, by eight-point Gauss-Legendre quadrature in r = sin θ, which is smooth at ρ = 1."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    integral, end = np.zeros_like(c), np.arcsin(rho)
    for node, weight in zip(nodes, weights, strict=True):
        theta = 0.5 * end * (node + 1)
        integral += (
            0.5 * weight * end * np.cos(theta) * (below - 2 * special.owens_t(c, np.tan(math.pi / 4 - theta / 2)))
        )
    return integral
