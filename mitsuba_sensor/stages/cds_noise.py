"""Noise of a source follower after correlated double sampling (CDS): white, flicker and telegraph (RTN) noise.

The paper sums S_SF(f)·H_CDS(f) over every hertz up to 20 MHz; the integral over all frequencies has a closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..core.special import EULER_GAMMA, integral, sinh_integrals, two_term_remainder
from .stage import Datasheet


def cds_noise(camera: Datasheet) -> CdsNoise:
    """The noise of a camera that gives densities."""
    follower = camera.source_follower
    return CdsNoise(
        white_nv_per_rthz=follower.white_nv_per_rthz or 0.0,
        corner_hz=follower.corner_hz,
        sample_s=follower.cds_sample_s,
        dominant_s=follower.cds_dominant_s,
        rtn_uv=0.0 if camera.sensor.technology == "ccd" else follower.rtn_uv,
        rtn_s=follower.rtn_s,
        band_hz=follower.band_hz,
    )


@dataclass(frozen=True)
class CdsNoise:
    """White, flicker and random telegraph noise of a source follower, seen through a CDS of sample time t_s.

    white_nv_per_rthz : white noise density W [nV/√Hz].  corner_hz : flicker corner f_c [Hz].
    sample_s : time between the two samples t_s [s].  dominant_s : time constant τ_D of the CDS, usually t_s/2 [s].
    rtn_uv, rtn_s : step ΔV [µV] and time constant τ_RTN [s] of the telegraph noise.
    band_hz : from and to which frequency noise counts [Hz]; all of them, in closed form, when None.
    """

    white_nv_per_rthz: float
    corner_hz: float
    sample_s: float
    dominant_s: float
    rtn_uv: float = 0.0
    rtn_s: float = 1e-6
    band_hz: tuple[float, float] | None = None

    @property
    def sigma_v(self) -> float:
        """Noise at the sense node before the source follower's gain [V rms]: √(∫ S·H df)/(1 − e^(−t_s/τ_D))."""
        if self.band_hz is not None:
            total = integral(self._seen_v2_per_hz, self._edges_hz())
        else:
            total = self.white_v2 + self.flicker_v2 + self.rtn_v2
        return math.sqrt(total) / -math.expm1(-self.sample_s / self.dominant_s)

    @property
    def white_v2(self) -> float:
        """W²(1 − e^(−a))/(2τ_D), a = t_s/τ_D [V²]."""
        density = self.white_nv_per_rthz * 1e-9
        return (
            density**2 * -math.expm1(-self.sample_s / self.dominant_s) / (2 * self.dominant_s)
        )

    @property
    def flicker_v2(self) -> float:
        """2W²f_c·J(a) [V²]."""
        density = self.white_nv_per_rthz * 1e-9
        return (
            2 * density**2 * self.corner_hz * flicker_integral(self.sample_s / self.dominant_s)
        )

    @property
    def rtn_v2(self) -> float:
        """(ΔV²·r/2)·[g(r) − g(τ_D)]/(r² − τ_D²), r = τ_RTN/2, g(τ) = −τ·expm1(−t_s/τ) [V²]."""
        r, tau = self.rtn_s / 2, self.dominant_s
        if abs(r - tau) < 1e-4 * tau:
            middle = 0.5 * (r + tau)
            slope = two_term_remainder(self.sample_s / middle) / (2 * middle)
        else:
            slope = (self._decay(r) - self._decay(tau)) / ((r - tau) * (r + tau))
        return (self.rtn_uv * 1e-6) ** 2 * r / 2 * slope

    def _seen_v2_per_hz(self, f: float) -> float:
        """S_SF(f)·H_CDS(f) [V²/Hz] (paper eq. 20–22)."""
        density = (self.white_nv_per_rthz * 1e-9) ** 2
        telegraph = (
            2
            * (self.rtn_uv * 1e-6) ** 2
            * self.rtn_s
            / (4 + (2 * math.pi * f * self.rtn_s) ** 2)
        )
        passed = (
            4
            * math.sin(math.pi * f * self.sample_s) ** 2
            / (1 + (2 * math.pi * f * self.dominant_s) ** 2)
        )
        if f:
            return (density * (1 + self.corner_hz / f) + telegraph) * passed
        return 0.0

    def _edges_hz(self) -> list[float]:
        """The band cut at the zeros of the CDS, so that no piece holds more than one hump; at most 4000 of them."""
        low, high = self.band_hz  # type: ignore[misc]
        first, last = math.floor(low * self.sample_s) + 1, math.ceil(high * self.sample_s)
        return [low, *(k / self.sample_s for k in range(first, min(last, first + 4000))), high]

    def _decay(self, tau: float) -> float:
        return -tau * math.expm1(-self.sample_s / tau)


def flicker_integral(a: float) -> float:
    """J(a) = γ_E + ln a − ½[e^(−a)Ei(a) − e^(a)E₁(a)]; J(2) = 1.115785799."""
    if a < 1e-4:
        return a * a / 2 * (1.5 - EULER_GAMMA - math.log(a))
    return EULER_GAMMA + math.log(a) - sinh_integrals(a)
