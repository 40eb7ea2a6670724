"""The stages that electrons leave: detection, PRNU, dark current, shot noise, full well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..engine import arrays, draws
from ..engine.errors import InputError
from ..engine.frame import Frame
from ..engine.moments import Moments, rectified_normal
from ..engine.quantities import Electrons, Photons
from .laws import Doubling, FigureOfMerit
from .patterns import GaussianMap, LogNormalMap


@dataclass(frozen=True)
class QeCurve:
    """Quantum efficiency against wavelength: linear between the points, 0 outside them.

    wavelengths_nm : increasing [nm].  values : electrons per photon, 0 … 1.
    """

    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]

    def at(self, wavelengths_nm: Any) -> Any:
        """QE at each wavelength, (B,)."""
        return arrays.interpolate(wavelengths_nm, self.wavelengths_nm, self.values)


@dataclass(frozen=True)
class Detection:
    """Photons free electrons: mean light electrons = Σ_k QE(λ_k)·Λ_k (paper eq. 14).

    curves : one QE curve per colour filter.  tile : rows of filter numbers that repeat over the sensor.
    reference_nm : the wavelength of photons that come without one [nm], or None when they must have one.
    """

    curves: tuple[QeCurve, ...]
    tile: tuple[tuple[int, ...], ...] = ((0,),)
    reference_nm: float | None = None
    room: ClassVar[str] = "electrons"

    def __call__(self, photons: Photons, frame: Frame) -> Electrons:
        """Mean photons (H, W) or (H, W, B) → mean light electrons (H, W)."""
        weights = self._weights(photons)
        if len(self.curves) > 1:
            rows = frame.device.rows % len(self.tile)
            columns = frame.device.columns % len(self.tile[0])
            weights = arrays.pick(weights, arrays.pick(self.tile, (rows[:, None], columns[None, :])))
        layers = photons.mean if photons.mean.ndim == 3 else photons.mean[..., None]
        return Electrons(light=arrays.weigh(layers, weights))

    def moments(self, m: Moments) -> Moments:
        """The mean itself; nothing is random yet."""
        return Moments(self(m.mean, m.frame).light, 0.0, 0.0, m.frame)

    def _weights(self, photons: Photons) -> Any:
        """QE of every filter at the photons' wavelengths, (F, B); (B,) for one filter."""
        wavelengths = photons.wavelengths_nm
        if wavelengths is None:
            if self.reference_nm is None:
                raise InputError(
                    "photons has no wavelengths_nm and this camera's quantum efficiency depends on wavelength; "
                    "pass wavelengths_nm=[...], one per band, or set quantum_efficiency.reference_nm in the camera."
                )
            wavelengths = (self.reference_nm,)  # type: ignore[assignment]
        rows = [curve.at(wavelengths) for curve in self.curves]
        return rows if len(rows) > 1 else rows[0]


@dataclass(frozen=True)
class Prnu:
    """Every pixel has its own gain for light, and keeps it.

    mean' = mean · max(0, 1 + factor·z), one z per pixel per camera  (paper eq. 15).

    factor : dimensionless, 0.01–0.02 typical (Janesick 2001).
    """

    factor: float
    room: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → mean electrons with the camera's gain pattern."""
        if self.factor == 0:
            return electrons
        gain = arrays.maximum(1 + self.factor * frame.device.pattern("prnu", draws.normal), 0.0)
        return Electrons(arrays.product(electrons.light, gain), electrons.dark)

    def moments(self, m: Moments) -> Moments:
        """Mean and variance of the rectified normal; it stands before the dark current, so all of the mean is light."""
        mean, variance = rectified_normal(self.factor)
        return Moments(m.mean * mean, m.temporal, m.fixed + m.mean**2 * variance, m.frame)


@dataclass(frozen=True)
class DarkCurrent:
    """Electrons come without light: mean dark electrons = t·D_R(T)·X, X a fixed map of mean 1 (paper eq. 16, 18).

    law : D_R(T) in e-/s.  pattern : the family of X; its coefficient of variation is D_N, 0.1–0.4 typical.
    """

    law: FigureOfMerit | Doubling
    pattern: GaussianMap | LogNormalMap
    room: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Adds the mean dark electrons of this exposure."""
        mean = self.mean_e(frame)
        if mean == 0:
            return electrons
        factor = frame.device.pattern("dark_pattern", self.pattern) if self.pattern.cv else 1.0
        return Electrons(electrons.light, mean * factor)

    def moments(self, m: Moments) -> Moments:
        """Adds t·D_R to the mean and (t·D_R)²·var X to the fixed variance."""
        mean = self.mean_e(m.frame)
        return m.add(mean=mean, fixed=mean * mean * self.pattern.variance)

    def mean_e(self, frame: Frame) -> float:
        """Mean dark electrons of a pixel in this exposure."""
        return frame.exposure.time_s * self.law.rate_e_per_s(frame.exposure.temperature_k)


@dataclass(frozen=True)
class ShotNoise:
    """Electrons are counted: Poisson(light) + Poisson(dark), in *detected* electrons (paper eq. 13, 17 corrected).

    Thinning a Poisson stream of photons by QE leaves a Poisson stream, so var/mean = 1 here, not QE.
    """

    room: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → whole electrons."""
        light = frame.poisson("light_shot", electrons.light)
        dark = frame.poisson("dark_shot", electrons.dark) if arrays.any_positive(electrons.dark) else 0.0
        return Electrons(light, dark)

    def moments(self, m: Moments) -> Moments:
        """The temporal variance is the mean."""
        return m.add(temporal=m.mean)


@dataclass(frozen=True)
class FullWell:
    """A well holds so many electrons and no more: min(N, full well), before any read noise.

    full_well_e : saturation capacity [e-].
    """

    full_well_e: float
    room: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Clips the sum; what overflows is booked on the light."""
        dark = arrays.minimum(electrons.dark, self.full_well_e)
        return Electrons(arrays.minimum(electrons.light, self.full_well_e - dark), dark)

    def moments(self, m: Moments) -> Moments:
        """A clipped normal: shot noise near a full well is one."""
        return m.clip(-float("inf"), self.full_well_e)
