"""Read noise of the source follower after correlated double sampling (CDS): white, flicker and telegraph (RTN) noise.

The paper sums S_SF(f)·H_CDS(f) over every hertz up to 20 MHz; the integral over all frequencies has a closed form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from ...core import Array, Frame, Moments, SensorWindow
from ...core.special import EULER_GAMMA, integral, sinh_integrals, two_term_remainder
from ...core.types import Float64Array
from ..datasheet import FileTable, NotNegative, Positive
from ..fpn_distributions import LogNormal
from ..gains import sense_gain_v_per_e
from ..pixel_law import NoiseLaw, borders_of
from ..stage import Datasheet, PixelNoise, Stage
from ..usual_range import NS_TO_SECONDS, US_TO_SECONDS, VOLTS_TO_NV, Usual

NOTED = 0.01
"""A band that leaves out more than this of the noise is worth a note."""

GROUPS, FARTHEST = 9, 3.2
"""Kinds of pixels that differ in read noise, for the theory, and how far out they lie [σ]."""

CdsTime = Annotated[Positive, Usual.of(1e-9, 0.1, US_TO_SECONDS, NS_TO_SECONDS)]

READ_NOISE = "read_noise"
"""Name of the map of every pixel's σ."""


class SourceFollowerNoiseFields(FileTable):
    """Noise of the pixel's amplifier, from its densities (closed form) or as the datasheet's one number."""

    cmos_only: ClassVar[Mapping[str, float | str]] = {"rtn_uv": 0.0}
    read_noise_e: Annotated[NotNegative | None, Usual(0.05, 500)] = Field(
        None, description="read noise as a datasheet gives it, instead of white_nv_per_rthz [e- rms]", examples=[3]
    )
    read_noise_cv: NotNegative = Field(
        0.0,
        description="spread of the read noise over pixels: σ over mean of a log-normal law; their rms stays as given",
        examples=[0.3],
    )
    white_nv_per_rthz: Annotated[NotNegative | None, Usual.of(0.1, 1e3, VOLTS_TO_NV)] = Field(
        None, description="white noise density W_f, instead of read_noise_e [nV/√Hz]", examples=[15]
    )
    corner_hz: NotNegative = Field(0.0, description="flicker corner frequency f_c [Hz]", examples=[1e6])
    cds_sample_s: CdsTime = Field(1e-6, description="time between the two CDS samples t_s [s]", examples=[1e-6])
    cds_dominant_s: CdsTime = Field(0.5e-6, description="dominant time constant of the CDS τ_D [s]", examples=[0.5e-6])
    rtn_uv: NotNegative = Field(0.0, description="random telegraph step ΔV [µV]", examples=[0.0])
    rtn_s: Positive = Field(1e-6, description="random telegraph time constant [s]", examples=[1e-6])
    band_hz: tuple[NotNegative, Positive] | None = Field(
        None, description="finite noise band [Hz] instead of all frequencies", examples=[[1.0, 20e6]]
    )

    @model_validator(mode="after")
    def _one_read_noise(self) -> Self:
        if (self.read_noise_e is None) == (self.white_nv_per_rthz is None):
            raise ValueError("give either read_noise_e or white_nv_per_rthz (with corner_hz, …), and not both")
        if self.band_hz is not None and self.band_hz[1] <= self.band_hz[0]:
            raise ValueError(f"band_hz is {list(self.band_hz)}; its second frequency must be the higher one")
        return self


@dataclass(frozen=True)
class SourceFollowerNoise(Stage):
    """Adds σ_V·z, signed and not rounded (paper eq. 19–24, in closed form).

    sigma_v : at the sense node, after CDS, root mean square over the pixels [V rms].
    cv : coefficient of variation of a log-normal σ from pixel to pixel; 0 for pixels that are all alike.
    gain_v_per_e : one electron at this stage [V/e-].
    """

    sigma_v: float
    cv: float = 0.0
    gain_v_per_e: float = 1.0
    domain = "volts"
    table = "source_follower"
    fields = SourceFollowerNoiseFields
    paper = "eq. 19–24"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> SourceFollowerNoise:
        """From the read noise, or from the densities; a CCD has one amplifier and no telegraph noise."""
        follower, per_e = camera.source_follower, sense_gain_v_per_e(camera)
        if follower.read_noise_e is not None:
            return cls(follower.read_noise_e * per_e, follower.read_noise_cv, per_e)
        return cls(cds_noise(camera).sigma_v / follower.gain, follower.read_noise_cv, per_e)

    @classmethod
    def notes(cls, camera: Datasheet) -> tuple[str, ...]:
        """One where band_hz leaves out more than 1 % of the noise."""
        follower = camera.source_follower
        if follower.read_noise_e is not None or follower.band_hz is None:
            return ()
        inside, whole = cds_noise(camera).sigma_v, replace(cds_noise(camera), band_hz=None).sigma_v
        if inside >= (1 - NOTED) * whole:
            return ()
        left, of = (sigma / follower.gain / sense_gain_v_per_e(camera) for sigma in (inside, whole))
        return (
            f"source_follower.band_hz {list(follower.band_hz)} leaves {left:.3g} of {of:.3g} e- of read noise, "
            f"{100 * inside / whole:.3g} %; leave it out for the noise of all frequencies",
        )

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing with noise."""
        if self.sigma_v == 0 and READ_NOISE not in frame.window.given:
            return swing
        z = frame.normal("source_follower")
        if self.cv == 0:
            return swing + frame.number(self.sigma_v) * z
        return swing + frame.number(self.gain_v_per_e) * (self.fpn_maps(frame.window)[READ_NOISE] * z)

    def moments(self, m: Moments) -> Moments:
        """Adds the mean of σ² over the pixels to the temporal variance."""
        if READ_NOISE not in m.frame.window.given:
            return m.add(temporal=self.sigma_v**2)
        mean, variance = m.frame.window.map_moments(READ_NOISE, 0.0, 0.0)
        return m.add(temporal=self.gain_v_per_e**2 * (mean**2 + variance))

    def noise_law(self, frame: Frame) -> NoiseLaw | None:
        """Normals whose σ is a quantile of the law of the pixels, or the rms of a group of the measured map."""
        if READ_NOISE in frame.window.given:
            weights, squares = frame.window.cached(
                (READ_NOISE, GROUPS), lambda: _groups(frame.window.given[READ_NOISE])
            )
            squares = self.gain_v_per_e**2 * squares
        elif self.cv and self.sigma_v:
            z = np.linspace(-FARTHEST, FARTHEST, GROUPS)
            weights, squares = np.exp(-0.5 * z**2), np.exp(2 * math.sqrt(math.log1p(self.cv**2)) * z)
            squares *= self.sigma_v**2 * weights.sum() / (weights @ squares)
        else:
            return None
        return NoiseLaw(weights / weights.sum(), squares, np.zeros((weights.size, 1)), np.ones(1))

    def pixel_noise(self, frame: Frame) -> PixelNoise | None:
        """Normals of every pixel's σ."""
        if self.cv == 0:
            return None
        return PixelNoise((self.gain_v_per_e * np.asarray(self.fpn_maps(frame.window)[READ_NOISE], np.float64)) ** 2)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """``read_noise``: σ of every pixel [e- rms], where the pixels have noise of their own."""
        return {READ_NOISE: window.measured_or(READ_NOISE, lambda: self._sigma_e(window))} if self.cv else {}

    def _sigma_e(self, window: SensorWindow) -> Array:
        scale = self.sigma_v / self.gain_v_per_e / math.sqrt(1 + self.cv**2)
        return window.number(scale) * LogNormal(self.cv).map_of(window, READ_NOISE)


def _groups(sigma_e: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Numbers of pixels of a measured map and their mean σ²: of every value, or of groups where there are many.

    Borders of the groups are quantiles of a normal law, so that few noisy pixels keep their tail.
    """
    values, counts = np.unique(sigma_e, return_counts=True)
    few = values.size <= 3 * GROUPS
    borders = np.arange(values.size) if few else borders_of(values.size, 2 * FARTHEST / (2 * GROUPS))
    weights = np.add.reduceat(counts, borders).astype(np.float64)
    return weights, np.add.reduceat(counts * values**2, borders) / weights


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
        return density**2 * -math.expm1(-self.sample_s / self.dominant_s) / (2 * self.dominant_s)

    @property
    def flicker_v2(self) -> float:
        """2W²f_c·J(a) [V²]."""
        density = self.white_nv_per_rthz * 1e-9
        return 2 * density**2 * self.corner_hz * flicker_integral(self.sample_s / self.dominant_s)

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
        telegraph = 2 * (self.rtn_uv * 1e-6) ** 2 * self.rtn_s / (4 + (2 * math.pi * f * self.rtn_s) ** 2)
        passed = 4 * math.sin(math.pi * f * self.sample_s) ** 2 / (1 + (2 * math.pi * f * self.dominant_s) ** 2)
        return (density * (1 + self.corner_hz / f) + telegraph) * passed if f else 0.0

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
