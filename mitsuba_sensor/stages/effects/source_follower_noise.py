"""Read noise of the source follower: normal, or with measured tails."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...core import Array, Frame, SensorWindow
from ...core.noise_distributions import NoiseDistribution, StudentT, TukeyLambda
from ...core.special import EULER_GAMMA, integral, sinh_integrals, two_term_remainder
from ..datasheet import Chance, FileTable, NotNegative, Positive, optional
from ..fpn_distributions import LogNormal, Sites
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, ElectronMaps
from ..usual_range import NS_TO_SECONDS, US_TO_SECONDS, VOLTS_TO_NV, Usual

NOTED = 0.01
"""A band that excludes more than this fraction of the noise gives a note."""

CV_MAX = 5.0
"""Up to this spread of the read noise the rms of the drawn pixels is right within 0.1 %."""

DISTRIBUTIONS: dict[str, tuple[type[NoiseDistribution], float, float]] = {
    "tukey_lambda": (TukeyLambda, -0.45, 0.2),
    "student": (StudentT, 2.5, 1000.0),
}
"""Distributions of the read noise and the range of their shape: the variance is finite above −0.5 and 2; beyond the
other end tails are lighter than any camera's, or normal."""

CdsTime = Annotated[Positive, Usual.of(1e-9, 0.1, US_TO_SECONDS, NS_TO_SECONDS)]

READ_NOISE = "read_noise"
"""Map of every pixel's σ."""

NOISY_SITE = "noisy_site"
"""Random stream that selects the noisy pixels."""


class SourceFollowerNoiseFields(FileTable):
    """Noise of the pixel's amplifier, one number or noise densities."""

    cmos_only = ("rtn_uv",)
    read_noise_e: Annotated[NotNegative | None, Usual(0.05, 500)] = optional(
        "read noise of the datasheet, instead of white_nv_per_rthz [e- rms]", 3
    )
    read_noise_cv: Annotated[NotNegative, Field(le=CV_MAX)] = optional(
        "spread of the read noise over the pixels: σ over mean, log-normal; the rms stays",
        0.3,
        0.0,
    )
    noisy_pixel_fraction: Chance = optional(
        "fraction of the pixels that are noisier by noisy_pixel_factor; the rms over all "
        "pixels stays",
        0.02,
        0.0,
        title="noisy pixels, high-RTS pixels",
    )
    noisy_pixel_factor: Annotated[float, Field(ge=1, le=1000, strict=True)] = optional(
        "read noise of the noisy pixels over that of other pixels", 3.0, 1.0
    )
    read_noise_distribution: Literal["normal", "tukey_lambda", "student"] = optional(
        "distribution of the read noise; its σ stays as given",
        "tukey_lambda",
        "normal",
        title="heavy tails, Tukey-lambda distribution λ, Student's t distribution ν",
    )
    read_noise_shape: float | None = Field(
        None,
        strict=True,
        description="λ of tukey_lambda, -0.45 to 0.2 (0.14 is nearly normal), or degrees of freedom of "
        "student, 2.5 to 1000",
        examples=[-0.1],
    )
    white_nv_per_rthz: Annotated[NotNegative | None, Usual.of(0.1, 1e3, VOLTS_TO_NV)] = (
        optional(
            "white noise density W_f, instead of read_noise_e [nV/√Hz]",
            15,
            title="white noise density W(f)",
        )
    )
    corner_hz: NotNegative = optional(
        "flicker corner frequency f_c [Hz]", 1e6, 0.0, title="1/f noise, flicker noise, f_c"
    )
    cds_sample_s: CdsTime = optional(
        "time between the two CDS samples t_s [s]",
        1e-6,
        1e-6,
        title="correlated double sampling CDS, t_s",
    )
    cds_dominant_s: CdsTime = optional(
        "dominant time constant of the CDS τ_D [s]",
        0.5e-6,
        0.5e-6,
        title="CDS time constant τ_D",
    )
    rtn_uv: NotNegative = optional(
        "random telegraph step ΔV [µV]",
        0.0,
        0.0,
        title="random telegraph noise RTN of the source follower, ΔV",
    )
    rtn_s: Positive = optional("random telegraph time constant [s]", 1e-6, 1e-6)
    band_hz: tuple[NotNegative, Positive] | None = optional(
        "finite noise band [Hz] instead of all frequencies", [1.0, 20e6]
    )

    @model_validator(mode="after")
    def _one_read_noise(self) -> Self:
        if self.read_noise_e is not None and self.white_nv_per_rthz is not None:
            raise ValueError(
                "give either read_noise_e or white_nv_per_rthz (with corner_hz, …), not both"
            )
        if self.read_noise_e is None and self.white_nv_per_rthz is None:
            raise ValueError(
                "the read noise is missing; give read_noise_e, EMVA's temporal dark noise [e- rms], or "
                "white_nv_per_rthz [nV/√Hz] with corner_hz, …"
            )
        if self.band_hz is not None and self.band_hz[1] <= self.band_hz[0]:
            raise ValueError(
                f"band_hz is {list(self.band_hz)}; the second frequency must be higher than the first"
            )
        return self

    @model_validator(mode="after")
    def _shape_of_its_distribution(self) -> Self:
        check_shape(self.read_noise_distribution, self.read_noise_shape)
        return self

    @classmethod
    def notes_of(cls, camera: Datasheet) -> tuple[str, ...]:
        """A note if band_hz excludes more than 1 % of the noise."""
        follower = camera.source_follower
        if follower.read_noise_e is not None or follower.band_hz is None:
            return ()
        inside, whole = (
            cds_noise(camera).sigma_v,
            replace(cds_noise(camera), band_hz=None).sigma_v,
        )
        if inside >= (1 - NOTED) * whole:
            return ()
        left, of = (
            sigma / follower.gain / sense_gain_v_per_e(camera) for sigma in (inside, whole)
        )
        return (
            f"source_follower.band_hz {list(follower.band_hz)} leaves {left:.3g} of {of:.3g} e- of read noise, "
            f"{100 * inside / whole:.3g} %; omit it for the noise of all frequencies",
        )


def check_shape(distribution: str, shape: float | None) -> None:
    """Raise ValueError if this distribution of the read noise does not allow the shape."""
    if distribution == "normal":
        if shape is None:
            return
        raise ValueError(
            f"read_noise_shape is {shape:g}, but normal read noise has no shape; omit it, or set "
            'read_noise_distribution to "tukey_lambda" or "student"'
        )
    _, low, high = DISTRIBUTIONS[distribution]
    if shape is None or not low <= shape <= high:
        if shape is None:
            said = "is missing"
        else:
            said = f"is {shape:g}"
        raise ValueError(
            f"read_noise_shape {said}; for {distribution} it must be from {low:g} to {high:g}"
        )


@dataclass(frozen=True)
class SourceFollowerNoise(ElectronMaps):
    """Adds σ_V·z, signed and not rounded (paper eq. 19–24, in closed form).

    sigma_v : at the sense node, after CDS, root mean square over the pixels [V rms].
    cv : coefficient of variation of the log-normal σ of the pixels.
    gain_v_per_e : one electron at this stage [V/e-].
    distribution : of z; None for a normal one.
    noisy_fraction, noisy_factor : fraction of noisy pixels, and their noise over that of the others.
    """

    sigma_v: float
    cv: float = 0.0
    gain_v_per_e: float = 1.0
    distribution: NoiseDistribution | None = None
    noisy_fraction: float = 0.0
    noisy_factor: float = 1.0
    domain = "volts"
    table = "source_follower"
    fields = SourceFollowerNoiseFields
    terms = "read noise σ_R (J), σ_d (E)"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> SourceFollowerNoise:
        """Return the stage for the read noise or the densities of the datasheet; a CCD has no telegraph noise."""
        follower, per_e = camera.source_follower, sense_gain_v_per_e(camera)
        kind = DISTRIBUTIONS.get(follower.read_noise_distribution)
        return cls(
            read_noise_v(camera),
            follower.read_noise_cv,
            per_e,
            kind and kind[0](follower.read_noise_shape),
            follower.noisy_pixel_fraction,
            follower.noisy_pixel_factor,
        )

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing with noise."""
        if self.sigma_v == 0 and READ_NOISE not in frame.window.given:
            return swing
        z = frame.distributed("source_follower", self.distribution)
        if not self._differs:
            return swing + frame.number(self.sigma_v) * z
        return swing + frame.number(self.gain_v_per_e) * (
            self.fpn_maps(frame.window)[READ_NOISE] * z
        )

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return ``read_noise``, σ of every pixel [e- rms], if pixels differ."""
        if self._differs:
            return {READ_NOISE: window.measured_or(READ_NOISE, lambda: self._sigma_e(window))}
        return {}

    def gains_of_maps(self) -> dict[str, float]:
        """Return A_SN [V/e-]."""
        if self._differs:
            return {READ_NOISE: self.gain_v_per_e}
        return {}

    @property
    def _differs(self) -> bool:
        """Whether the noise of pixels differs."""
        return self.cv > 0 or (self.noisy_fraction > 0 and self.noisy_factor > 1)

    def _sigma_e(self, window: SensorWindow) -> Array:
        mean_square = 1 + self.noisy_fraction * (self.noisy_factor**2 - 1)
        mean_square *= 1 + self.cv**2
        scale = window.number(self.sigma_v / self.gain_v_per_e / math.sqrt(mean_square))
        if self.noisy_fraction:
            factors = Sites(self.noisy_fraction, self.noisy_factor, 1.0)
            scale = scale * window.fixed_map(NOISY_SITE, factors)
        if self.cv:
            return scale * LogNormal(self.cv).map_of(window, READ_NOISE)
        return scale


def read_noise_v(camera: Datasheet) -> float:
    """Return the read noise at the sense node, as given or from its densities [V rms]."""
    follower = camera.source_follower
    if follower.read_noise_e is None:
        return float(cds_noise(camera).sigma_v / follower.gain)
    return float(follower.read_noise_e * sense_gain_v_per_e(camera))


def cds_noise(camera: Datasheet) -> CdsNoise:
    """Return the noise of a camera with noise densities."""
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
    """White, flicker and random telegraph noise of a source follower after CDS.

    white_nv_per_rthz : white noise density W [nV/√Hz].  corner_hz : flicker corner f_c [Hz].
    sample_s : time between the two samples t_s [s].  dominant_s : time constant τ_D of the CDS, usually t_s/2 [s].
    rtn_uv, rtn_s : step ΔV [µV] and time constant τ_RTN [s] of the telegraph noise.
    band_hz : lowest and highest frequency of the noise [Hz]; None for all frequencies, in closed form.
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
        """Return the band divided at the first 4000 zeros of the CDS, so that each piece has one maximum."""
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
