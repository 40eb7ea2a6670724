"""Photon and electron stages of the released MATLAB code of Konnik & Welsh 2014, on NumPy float64.

Written from the paper, from descriptions and from numbers measured on that code, not from its text (it has no
licence). The stages reproduce its *behaviour*, also where it differs from physics: ``docs/konnik2014.md`` lists every
difference with its size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...core import Array, Frame, InputError, Moments, Photons
from ..dark_current_models import band_gap_ev
from ..stage import Chain, Stage, propagate, sample
from .fpn_distributions import PublishedFpn

BOLTZMANN_EV_PER_K = 8.617343e-5
"""CODATA 2006, as in that code; with the value of SI 2019 its dark signal would be 2.4e-5 lower."""

DARK_CONSTANT = 2.55e15
"""In place of (300 K)^−1.5·exp(E_g/2kT)/q: e-/s per nA at 1 K^1.5; 0.8 % too low (released code)."""


@dataclass(frozen=True)
class PublishedPhotons(Stage):
    """Mean photons are rounded to integers: floor(Λ + ½) (paper eq. 12); Λ = 0.49 becomes 0."""

    domain = "photons"

    def sample(self, photons: Photons, frame: Frame) -> Array:
        """Mean photons at one wavelength, (H, W) or (H, W, 1) → rounded mean photons (H, W)."""
        if photons.mean.ndim == 3 and photons.mean.shape[2] > 1:
            raise InputError(
                f"photons has {photons.mean.shape[2]} bands and the published code has one wavelength; "
                f"pass (H, W) photons, or use the physical chain."
            )
        return np.floor(photons.total + 0.5)

    def moments(self, m: Moments) -> Moments:
        """The rounded mean; nothing is random yet."""
        return Moments(self.sample(m.mean, m.frame), 0.0, 0.0, m.frame)


@dataclass(frozen=True)
class PublishedShot(Stage):
    """Poisson counts of a mean.  stream : of the random bits."""

    stream: ClassVar[str]

    def sample(self, mean: Array, frame: Frame) -> Array:
        """Mean → counts, (H, W)."""
        return frame.poisson(self.stream, mean)

    def moments(self, m: Moments) -> Moments:
        """The temporal variance is the mean."""
        return m.add(temporal=m.mean)


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

    def moments(self, m: Moments) -> Moments:
        """Scaled by QE."""
        return m.scale(self.value)


class PublishedPrnu(PublishedFpn):
    """The *noisy* count times 1 + factor·z, not clipped at 0 (paper eq. 15).  factor : PRNU, dimensionless."""

    domain, source = "electrons", "prnu"


@dataclass(frozen=True)
class PublishedDarkMean(Stage):
    """t·D_R(T), D_R = 2.55e15·P_A·D_FM·T^1.5·exp(−E_g/2kT) [e-] (paper eq. 1, 16); 172.742 e- for Table 1 at 0.1 s.

    fom_na_per_cm2 : D_FM [nA/cm²].  area_cm2 : P_A, the whole pixel [cm²].
    """

    fom_na_per_cm2: float
    area_cm2: float
    domain = "electrons"

    def sample(self, dark: Array, frame: Frame) -> Array:
        """``dark`` plus the mean dark electrons of this exposure."""
        return dark + self.mean_e(frame)

    def moments(self, m: Moments) -> Moments:
        """Adds to the mean."""
        return m.add(mean=self.mean_e(m.frame))

    def mean_e(self, frame: Frame) -> float:
        """Mean dark electrons of a pixel; 0 at 0 K."""
        kelvin = frame.exposure.temperature_k
        if kelvin == 0:
            return 0.0
        boltzmann = math.exp(-band_gap_ev(kelvin) / kelvin / (2 * BOLTZMANN_EV_PER_K))
        rate: float = DARK_CONSTANT * self.area_cm2 * self.fom_na_per_cm2 * kelvin**1.5 * boltzmann
        return frame.exposure.time_s * rate


class PublishedDarkShot(PublishedShot):
    """Poisson(t·D_R) dark electrons, counted *before* the dark FPN (paper eq. 17)."""

    domain, stream = "electrons", "dark_shot"


class PublishedDarkFpn(PublishedFpn):
    """The noisy dark count times 1 + factor·X, one X per pixel of a camera (paper eq. 18 with σ = D_N).

    factor : D_N, dimensionless.  distribution : of X; its mean may differ from 0 (log-normal (0, 0.4): 1.083).
    """

    domain, source = "electrons", "dark_fpn"


@dataclass(frozen=True)
class PublishedReadNoise(Stage):
    """Source-follower noise, added to the dark electrons and not rounded (paper eq. 23).  sigma_e : [e- rms]."""

    sigma_e: float
    domain = "electrons"

    def sample(self, dark: Array, frame: Frame) -> Array:
        """Dark electrons with signed noise, (H, W)."""
        return dark + self.sigma_e * frame.normal("source_follower")

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the temporal variance."""
        return m.add(temporal=self.sigma_e**2)


@dataclass(frozen=True)
class PublishedFollowerSpectrum:
    """σ of the source follower, summed as in the released code: every 10 kHz from 1 Hz to the clock (paper eq. 19–22).

    Accurate for t_s = 1 µs (6.0945 e-; all frequencies: 6.1051), wrong when t_s is a multiple of 1/10 kHz, where every
    point of the sum is a zero of the CDS (100 µs: 0.218 e-; all frequencies: 5.193).

    rtn_step : ΔI, added to V² as if it were volts.  All defaults: released parameters.
    """

    white_nv_per_rthz: float = 15.0
    corner_hz: float = 1e6
    sample_s: float = 1e-6
    dominant_s: float = 0.5e-6
    rtn_step: float = 1e-8
    rtn_s: float = 0.05e-6
    clock_hz: float = 20e6  # Table 1; camera files have none: the closed forms of the physical chain need none
    grid_hz: float = 1e4

    def sigma_e(self, sense_gain_uv_per_e: float) -> float:
        """Noise at the sense node [e- rms]."""
        f = np.arange(1.0, self.clock_hz + 0.5, self.grid_hz)
        rtn = 2 * self.rtn_step**2 * self.rtn_s / (4 + (2 * math.pi * f * self.rtn_s) ** 2)
        density = (self.white_nv_per_rthz * 1e-9) ** 2 * (1 + self.corner_hz / f) + rtn
        cds = (2 - 2 * np.cos(2 * math.pi * f * self.sample_s)) / (1 + (2 * math.pi * f * self.dominant_s) ** 2)
        settled = -math.expm1(-self.sample_s / self.dominant_s)
        return math.sqrt(self.grid_hz * float(np.sum(density * cds))) / (sense_gain_uv_per_e * 1e-6 * settled)


@dataclass(frozen=True)
class PublishedDarkSignal(Stage):
    """Dark electrons and read noise, added to the photoelectrons (paper eq. 25).  steps : in their order."""

    steps: Chain
    domain = "electrons"

    def sample(self, electrons: Array, frame: Frame) -> Array:
        """Photoelectrons → photoelectrons and dark electrons together."""
        return electrons + sample(self.steps, 0.0, frame)

    def moments(self, m: Moments) -> Moments:
        """Sum of two independent signals."""
        dark = propagate(self.steps, Moments(0.0, 0.0, 0.0, m.frame))
        return m.add(mean=dark.mean, temporal=dark.temporal, spatial=dark.spatial)


@dataclass(frozen=True)
class PublishedWell(Stage):
    """Clipped to 0 … full well, then *floored* (paper eq. 26 rounds): loses half an electron and all negative noise.

    full_well_e : saturation capacity [e-].
    """

    full_well_e: float
    domain = "electrons"

    def sample(self, electrons: Array, frame: Frame) -> Array:
        """Photoelectrons and dark electrons → a whole number."""
        return np.floor(np.clip(electrons, 0.0, self.full_well_e))

    def moments(self, m: Moments) -> Moments:
        """floor and clip commute; a signal that is continuous and wider than 1 e- loses ½ and gains 1/12."""
        return m.add(mean=-0.5, temporal=1 / 12).clip(0.0, math.floor(self.full_well_e))

    def marked(self, signal: Array, maps: dict[str, Array]) -> dict[str, Array]:
        """Saturated pixels."""
        return {"clipped_full_well": signal >= self.full_well_e}
