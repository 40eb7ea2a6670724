"""Photon and electron stages of the released MATLAB code of Konnik & Welsh 2014, on NumPy float64, and its FPN maps.

Written from the paper, from descriptions and from numbers measured on that code, not from its text (it has no
licence). The stages reproduce its *behaviour*, also where it differs from physics: ``docs/stages.md`` lists every
difference with its size.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
import scipy

from mitsuba_sensor.core import Array, Float64Array, Frame, InputError, Photons, SensorWindow
from mitsuba_sensor.core.backend import normals
from mitsuba_sensor.stages.dark_current_models import band_gap_ev
from mitsuba_sensor.stages.stage import Chain, Stage, sample

# CODATA 2006, as in that code; with the value of SI 2019 its dark signal would be 2.4e-5 lower.
BOLTZMANN_EV_PER_K = 8.617343e-5
# In place of (300 K)^−1.5·exp(E_g/2kT)/q: e-/s per nA at 1 K^1.5; 0.8 % too low (released code).
DARK_CONSTANT = 2.55e15
AR_MARGIN = 63  # columns of normals that the autoregressive map needs to the left of its own
PER_UNIT = 2048  # nodes of the Wald's quantile function
FpnName = Literal["gaussian", "lognormal", "wald", "ar"]


@dataclass(frozen=True)
class PublishedFpnDistribution:
    """Distribution of the maps X, by name, and its one parameter; the mean of some is not 0.

    gaussian : standard normal.  lognormal : exp(parameter·z), median 1.
    wald : inverse Gaussian of mean 1 and shape χ = parameter, plus a uniform on (0, 1). The uniform is in no text; the
        records show it: for χ = 2 mean 1.4996 and σ 0.7636 (1.5 and √(7/12) here).
    ar : x_j = z_j − parameter·x_{j−1} along a row: the recursive filter 1/[1, parameter], |parameter| ≤ 0.5. The
        records determine only its σ, 1/√(1 − c²); the sign is that of MATLAB's ``filter`` (48 : 1 in favour of it from
        the six sample means of the records).
    """

    name: FpnName
    parameter: float = 0.0

    def __call__(self, normals: Float64Array) -> Float64Array:
        """(H, W) standard normals → (H, W) values of X; ar takes AR_MARGIN columns of normals more, to the left."""
        x = normals
        if self.name == "lognormal":
            return np.exp(self.parameter * x)
        if self.name == "wald":  # through the quantile function of the sum
            points, hazard = _wald_and_uniform(self.parameter)
            return np.asarray(np.interp(-scipy.special.log_ndtr(-x), hazard, points))
        for step in (
            (1, 2, 4, 8, 16, 32) if self.name == "ar" else ()
        ):  # 64 terms, summed by doubling, exact in float64
            x = x[:, step:] + (-self.parameter) ** step * x[:, :-step]
        return x

    @property
    def mean(self) -> float:
        """Mean of X; 1.083 for the log-normal (0, 0.4)."""
        return {"lognormal": math.exp(self.parameter**2 / 2), "wald": 1.5}.get(self.name, 0.0)

    @property
    def variance(self) -> float:
        """Variance of X."""
        square = self.parameter**2
        if self.name == "lognormal":
            return math.exp(square) * math.expm1(square)
        if self.name == "wald":
            return 1 / self.parameter + 1 / 12
        if self.name == "ar":
            return 1 / (1 - square)
        return 1.0


def _wald_and_uniform(chi: float) -> tuple[Float64Array, Float64Array]:
    """x and −ln P(X > x); P is the mean of the survival function of the Wald distribution over [x − 1, x]."""
    x = np.arange(0, (3 + 60 / chi) * PER_UNIT + 1) / PER_UNIT
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # P(Wald > x): Φ(−√(χ/x)(x − 1)) − e^(2χ)·Φ(−√(χ/x)(x + 1))
        root = np.sqrt(chi / x)
        tail = scipy.special.ndtr(-root * (x - 1)) - np.exp(
            2 * chi + scipy.special.log_ndtr(-root * (x + 1))
        )
    survival = np.where(x > 0, tail, 1.0)
    steps = 0.5 * (survival[1:] + survival[:-1]) / PER_UNIT
    integral = np.concatenate([[0.0], np.cumsum(steps[::-1])])[::-1]
    before = np.concatenate([integral[0] + x[1 : PER_UNIT + 1][::-1], integral[:-PER_UNIT]])
    return x, -np.log(np.maximum(before - integral, 1e-300))


def fpn_map(
    window: SensorWindow, source: str, distribution: PublishedFpnDistribution
) -> Float64Array:
    """FPN map X of ``source``, the same in every frame of a camera: (H, W), or (1, W) for the columns."""

    def make() -> Float64Array:
        (rows, columns), (top, left) = window.shape, window.origin
        margin = 0
        if distribution.name == "ar":
            margin = AR_MARGIN
        wide = replace(
            window,
            shape=(rows, columns + margin),
            origin=(top, left - margin),
            given={},
            _maps={},
        )
        return distribution(
            wide.line_map(source, 0.0)
            if source == "dsnu_col"
            else wide.fixed_map(source, normals)
        )

    return window.cached((source, distribution), make)


@dataclass(frozen=True)
class PublishedFpn(Stage):
    """The *noisy* signal times 1 + factor·X, not clipped at 0.  factor : dimensionless.  distribution : of X."""

    factor: float
    distribution: PublishedFpnDistribution
    source: ClassVar[str]

    def sample(self, signal: Array, frame: Frame) -> Array:
        """The signal times the gain map of the camera, (H, W)."""
        return signal * (
            1 + self.factor * fpn_map(frame.window, self.source, self.distribution)
        )


@dataclass(frozen=True)
class PublishedPhotons(Stage):
    """Mean photons are rounded to integers: floor(Λ + ½) (paper eq. 12); Λ = 0.49 becomes 0."""

    domain = "photons"

    def sample(self, photons: Photons, frame: Frame) -> Array:
        """Mean photons at one wavelength, (H, W) or (H, W, 1) → rounded mean photons (H, W)."""
        bands = photons.mean.shape[2:]
        if photons.detected:
            raise InputError(
                "photons is detected already, and the published code detects photons itself; pass photons, or use the "
                "physical chain."
            )
        if bands not in ((), (1,)):
            raise InputError(
                f"photons has {bands[0]} bands and the published code has one wavelength; "
                f"pass (H, W) photons, or use the physical chain (ms.expose)."
            )
        return np.floor(photons.total + 0.5)


@dataclass(frozen=True)
class PublishedShot(Stage):
    """Poisson counts of a mean.  stream : of the random bits."""

    stream: ClassVar[str]

    def sample(self, mean: Array, frame: Frame) -> Array:
        """Mean → counts, (H, W)."""
        return frame.poisson(self.stream, mean)


class PublishedPhotonShot(PublishedShot):
    """Poisson(Λ) *photons* (paper eq. 13). After the QE the variance is QE times the mean; it should be the mean."""

    domain, stream = "photons", "photon_shot"


@dataclass(frozen=True)
class PublishedQuantumEfficiency(Stage):
    """Electrons = photons × QE, not rounded (paper eq. 14).  value : QE, 0 … 1 [e- per photon]."""

    value: float
    domain = "electrons"

    def sample(self, photons: Array, frame: Frame) -> Array:
        """Photons → photoelectrons (H, W)."""
        return photons * self.value


class PublishedPrnu(PublishedFpn):
    """The *noisy* count times 1 + factor·z, not clipped at 0 (paper eq. 15).  factor : PRNU, dimensionless."""

    domain, source = "electrons", "prnu"


@dataclass(frozen=True)
class PublishedDarkMean(Stage):
    """t·D_R(T), D_R = 2.55e15·P_A·D_FM·T^1.5·exp(−E_g/2kT) [e-] (paper eq. 1, 16); 172.742 e- for Table 1 at 0.1 s."""

    fom_na_per_cm2: float  # D_FM
    area_cm2: float  # P_A, the whole pixel
    domain = "electrons"

    def sample(self, dark: Array, frame: Frame) -> Array:
        """``dark`` plus the mean dark electrons of this exposure."""
        return dark + self.mean_e(frame)

    def mean_e(self, frame: Frame) -> float:
        """Mean dark electrons of a pixel; 0 at 0 K."""
        kelvin = frame.exposure.temperature_k
        boltzmann = 0.0
        if kelvin:
            boltzmann = math.exp(-band_gap_ev(kelvin) / kelvin / (2 * BOLTZMANN_EV_PER_K))
        rate: float = (
            DARK_CONSTANT * self.area_cm2 * self.fom_na_per_cm2 * kelvin**1.5 * boltzmann
        )
        return frame.exposure.time_s * rate


class PublishedDarkShot(PublishedShot):
    """Poisson(t·D_R) dark electrons, counted *before* the dark FPN (paper eq. 17)."""

    domain, stream = "electrons", "dark_shot"


class PublishedDarkFpn(PublishedFpn):
    """The noisy dark count times 1 + D_N·X, one X per pixel of a camera (paper eq. 18 with σ = D_N)."""

    domain, source = "electrons", "dark_fpn"


@dataclass(frozen=True)
class PublishedReadNoise(Stage):
    """Source-follower noise, added to the dark electrons and not rounded (paper eq. 23).  sigma_e : [e- rms]."""

    sigma_e: float
    domain = "electrons"

    def sample(self, dark: Array, frame: Frame) -> Array:
        """Dark electrons with signed noise, (H, W)."""
        return dark + self.sigma_e * frame.normal("source_follower")


@dataclass(frozen=True)
class PublishedFollowerSpectrum:
    """σ of the source follower, summed as in the released code: every 10 kHz from 1 Hz to the clock (paper eq. 19–22).

    Accurate for t_s = 1 µs (6.0945 e-; all frequencies: 6.1051), wrong when t_s is a multiple of 1/10 kHz, where every
    point of the sum is a zero of the CDS (100 µs: 0.218 e-; all frequencies: 5.193).
    All defaults are released parameters.
    """

    white_nv_per_rthz: float = 15.0
    corner_hz: float = 1e6
    sample_s: float = 1e-6
    dominant_s: float = 0.5e-6
    rtn_step: float = 1e-8  # ΔI, added to V² as if it were volts
    rtn_s: float = 0.05e-6
    clock_hz: float = 20e6  # Table 1; camera files have none: the closed forms of the physical chain need none
    grid_hz: float = 1e4

    def sigma_e(self, sense_gain_uv_per_e: float) -> float:
        """Noise at the sense node [e- rms]."""
        f = np.arange(1.0, self.clock_hz + 0.5, self.grid_hz)
        rtn = 2 * self.rtn_step**2 * self.rtn_s / (4 + (2 * math.pi * f * self.rtn_s) ** 2)
        density = (self.white_nv_per_rthz * 1e-9) ** 2 * (1 + self.corner_hz / f) + rtn
        cds = (2 - 2 * np.cos(2 * math.pi * f * self.sample_s)) / (
            1 + (2 * math.pi * f * self.dominant_s) ** 2
        )
        settled = -math.expm1(-self.sample_s / self.dominant_s)
        return math.sqrt(self.grid_hz * float(np.sum(density * cds))) / (
            sense_gain_uv_per_e * 1e-6 * settled
        )


@dataclass(frozen=True)
class PublishedDarkSignal(Stage):
    """Dark electrons and read noise, added to the photoelectrons (paper eq. 25).  steps : in their order."""

    steps: Chain
    domain = "electrons"

    def sample(self, electrons: Array, frame: Frame) -> Array:
        """Photoelectrons → photoelectrons and dark electrons together."""
        return electrons + sample(self.steps, 0.0, frame)


@dataclass(frozen=True)
class PublishedWell(Stage):
    """Clipped to 0 … full well [e-], *floored* (paper eq. 26 rounds): loses half an electron and all negative noise."""

    full_well_e: float
    domain = "electrons"

    def sample(self, electrons: Array, frame: Frame) -> Array:
        """Photoelectrons and dark electrons → a whole number."""
        return np.floor(np.clip(electrons, 0.0, self.full_well_e))

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Saturated pixels."""
        return {"clipped_full_well": signal >= self.full_well_e}
