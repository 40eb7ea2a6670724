"""The stages that electrons leave: detection, PRNU, dark current, shot noise, full well."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ..core import arrays
from ..core.errors import InputError
from ..core.frame import Frame
from ..core.moments import Moments
from ..core.sensor_window import SensorWindow
from ..core.signals import Electrons, Photons
from .compensation import compensable, counted
from .dark_components import DarkComponent, component_maps, mixture_moments, superimpose
from .fpn_distributions import FpnDistribution


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
    quantum_yield : electrons per interacting photon against wavelength, or None for one everywhere.
    """

    curves: tuple[QeCurve, ...]
    tile: tuple[tuple[int, ...], ...] = ((0,),)
    reference_nm: float | None = None
    quantum_yield: QeCurve | None = None
    domain: ClassVar[str] = "electrons"

    def __call__(self, photons: Photons, frame: Frame) -> Electrons:
        """Mean photons (H, W) or (H, W, B) → mean light electrons (H, W); with a yield, mean interactions."""
        weights = self._weights(photons)
        if len(self.curves) > 1:
            rows = frame.window.rows % len(self.tile)
            columns = frame.window.columns % len(self.tile[0])
            weights = arrays.pick(weights, arrays.pick(self.tile, (rows[:, None], columns[None, :])))
        layers = photons.mean if photons.mean.ndim == 3 else photons.mean[..., None]
        light, window = arrays.weigh(layers, weights), frame.window
        within_float32 = window.backend.from_numpy(light, window)
        if self.quantum_yield is None:
            noise = photons.variance_e2
            return Electrons(
                within_float32, variance_e2=None if noise is None else window.backend.from_numpy(noise, window)
            )
        per_photon = self.quantum_yield.at(self._wavelengths(photons))
        first = arrays.ratio(arrays.weigh(layers, weights * per_photon), light, 1.0)
        second = arrays.ratio(arrays.weigh(layers, weights * per_photon**2), light, 1.0)
        spread = arrays.maximum(second - first**2, 0.0)
        return Electrons(
            within_float32,
            yield_mean=window.backend.from_numpy(first, window),
            yield_variance=window.backend.from_numpy(spread, window),
        )

    def moments(self, m: Moments) -> Moments:
        """The mean itself; nothing is random yet."""
        electrons = self(m.mean, m.frame)
        return Moments(
            electrons.light, 0.0, 0.0, m.frame,
            yield_mean=electrons.yield_mean, yield_variance=electrons.yield_variance,
            variance_e2=electrons.variance_e2,
        )  # fmt: skip

    def _weights(self, photons: Photons) -> Any:
        """QE of every filter at the photons' wavelengths, (F, B); (B,) for one filter. A channel has it."""
        if photons.detected:
            return arrays.table([[float(i == j) for j in range(len(self.curves))] for i in range(len(self.curves))])
        rows = [curve.at(self._wavelengths(photons)) for curve in self.curves]
        return arrays.table(rows if len(rows) > 1 else rows[0])

    def _wavelengths(self, photons: Photons) -> Any:
        """(B,) [nm]; the camera's reference where the photons came without."""
        if photons.wavelengths_nm is not None:
            return photons.wavelengths_nm
        if self.reference_nm is None:
            raise InputError(
                "photons has no wavelengths_nm and this camera's quantum efficiency depends on wavelength; "
                "pass wavelengths_nm=[...], one per band, or set quantum_efficiency.reference_nm in the camera."
            )
        return (self.reference_nm,)


@dataclass(frozen=True)
class Prnu:
    """Every pixel has its own gain for light, and keeps it.

    mean' = mean · max(0, 1 + factor·z), one z per pixel per camera  (paper eq. 15, and other families).

    pattern : the family of the gain; its cv is the PRNU factor, 0.01–0.02 typical (Janesick 2001).
    """

    pattern: FpnDistribution
    domain: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → mean electrons with the camera's gain pattern."""
        if self.pattern.cv == 0 and "prnu" not in frame.window.given:
            return electrons
        gain, noise = self.maps(frame.window)["prnu"], electrons.variance_e2
        noise = None if noise is None else arrays.product(noise, gain * gain)
        return replace(electrons, light=arrays.product(electrons.light, gain), variance_e2=noise)

    def moments(self, m: Moments) -> Moments:
        """It stands before the dark current, so all of the mean is light."""
        mean, variance = m.frame.window.map_moments("prnu", self.pattern.mean, self.pattern.variance)
        noise = None if m.variance_e2 is None else m.variance_e2 * (mean**2 + variance)
        return replace(
            m, mean=m.mean * mean, spatial=m.spatial + arrays.product(m.mean**2, variance), variance_e2=noise
        )

    def maps(self, window: SensorWindow) -> dict[str, Any]:
        """``prnu``: gain of every pixel, 1 on average."""
        return {"prnu": window.given_or("prnu", lambda: self.pattern.map_of(window, "prnu"))}


@dataclass(frozen=True)
class DarkCurrent:
    """Electrons come without light: mean dark electrons = t·D_R(T)·X, X a fixed map of mean 1 (paper eq. 16, 18).

    law : D_R(T) in e-/s.  pattern : the family of X; its coefficient of variation is D_N, 0.1–0.4 typical.
    parts : shares of the pixels that follow a superimposed law instead, also where a map is given.
    """

    law: Any
    pattern: FpnDistribution
    parts: tuple[DarkComponent, ...] = ()
    domain: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Adds the mean dark electrons of this exposure."""
        mean = self.mean_e(frame)
        flat = self.pattern.cv == 0 and "dark_fpn" not in frame.window.given
        dark = frame.number(mean) if mean else 0.0
        if mean and not flat:
            dark = arrays.product(dark, self.maps(frame.window)["dark_fpn"])
        if self.parts:
            dark = superimpose(self.parts, dark, frame)
        return replace(electrons, dark=electrons.dark + dark)

    def moments(self, m: Moments) -> Moments:
        """The mixture of t·D_R·X with the parts: its mean, and its variance from pixel to pixel."""
        mean = self.mean_e(m.frame)
        factor, variance = m.frame.window.map_moments("dark_fpn", self.pattern.mean, self.pattern.variance)
        average, spread = mixture_moments(self.parts, mean * factor, mean**2 * variance, m.frame)
        return replace(m.add(mean=average, spatial=spread), light=m)

    def mean_e(self, frame: Frame) -> float:
        """Mean dark electrons of a pixel of the main part in this exposure."""
        return frame.exposure.time_s * self.law.rate_e_per_s(frame.exposure.temperature_k)

    def maps(self, window: SensorWindow) -> dict[str, Any]:
        """``dark_fpn``: dark current of every pixel over the average; and which pixel belongs to which part."""
        main = window.given_or("dark_fpn", lambda: self.pattern.map_of(window, "dark_fpn"))
        return {"dark_fpn": main} | (component_maps(self.parts, window) if self.parts else {})


@dataclass(frozen=True)
class RtsPixels:
    """A few pixels have a trap that switches their dark current on and off between frames (random telegraph signal).

    share : of the pixels, 0 … 1.  amplitude_e_per_s : the step [e-/s].
    switching : chance per frame that a trap is drawn anew; states of frames Δ apart correlate by (1 − switching)^Δ.
    duty : share of the time that it is on.
    """

    share: float
    amplitude_e_per_s: float
    switching: float
    duty: float
    domain: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Adds the electrons of the traps that are on."""
        step = self.amplitude_e_per_s * frame.exposure.time_s
        if self.share == 0 or step == 0:
            return electrons
        site = self.maps(frame.window)["rts_site"]
        on = frame.telegraph(site, self.switching, self.duty)
        return replace(electrons, dark=electrons.dark + frame.number(step) * on)

    def maps(self, window: SensorWindow) -> dict[str, Any]:
        """``rts_site``: 1 where a pixel has a trap, else 0."""
        make = lambda: window.fixed_map("rts_site", self._of_words)  # noqa: E731
        return {"rts_site": window.given_or("rts_site", make)}

    def _of_words(self, backend: Any, bits: Any) -> Any:
        return arrays.where(
            backend.uniform(bits) < backend.number(self.share), backend.number(1.0), backend.number(0.0)
        )

    def moments(self, m: Moments) -> Moments:
        """A pixel blinks with chance ``share``, and is on with chance ``duty``."""
        step = self.amplitude_e_per_s * m.frame.exposure.time_s
        mean = step * self.duty
        share, spread = m.frame.window.map_moments("rts_site", self.share, self.share * (1 - self.share))
        return m.add(mean=share * mean, temporal=share * step * mean * (1 - self.duty), spatial=spread * mean**2)


@dataclass(frozen=True)
class ShotNoise:
    """Electrons are counted: Poisson(light) + Poisson(dark), in *detected* electrons (paper eq. 13, 17 corrected).

    Thinning a Poisson stream of photons by QE leaves a Poisson stream, so var/mean = 1 here, not QE.

    Where the mean is that of a render with a known variance, one render per frame, the counts vary by that much less
    about it (compensation.py). Over frames with renders of their own var/mean is 1 again; it is less for one render.
    """

    domain: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → whole electrons."""
        if electrons.variance_e2 is not None:
            return self._spending(electrons, frame)
        light = frame.poisson("photon_shot", electrons.light)
        dark = frame.poisson("dark_shot", electrons.dark) if arrays.any_positive(electrons.dark) else 0.0
        return replace(electrons, light=light, dark=dark)

    def moments(self, m: Moments) -> Moments:
        """The temporal variance is the mean; that of one frame about its own render is less by what is spent."""
        if m.variance_e2 is None:
            return m.add(temporal=m.mean)
        light = (m.light or m).mean
        by_light, by_dark = compensable(light, m.mean - light, m.variance_e2)
        return replace(m.add(temporal=m.mean - by_light - by_dark), variance_e2=None)

    def _spending(self, electrons: Electrons, frame: Frame) -> Electrons:
        """The same where a part of the variance is in the mean already."""
        by_light, by_dark = compensable(electrons.light, electrons.dark, electrons.variance_e2)
        light = counted("photon_shot", electrons.light, by_light, frame)
        dark = 0.0
        if arrays.any_positive(electrons.dark):
            dark = counted("dark_shot", electrons.dark, by_dark, frame)
        return replace(electrons, light=light, dark=dark, variance_e2=None)


@dataclass(frozen=True)
class QuantumYield:
    """A photon of the ultraviolet frees several electrons: n interactions give n·η ± √(n·(F·η + var η)) electrons.

    fano : Fano factor F of the pair production, about 0.1 in silicon (Janesick 2001).
    """

    fano: float
    domain: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Interactions → electrons; whole numbers stay whole."""
        n, mean = electrons.light, electrons.yield_mean
        spread = arrays.sqrt(n * (frame.number(self.fano) * mean + electrons.yield_variance))
        smooth = n * mean + spread * frame.normal("quantum_yield")
        burst = arrays.along(lambda x, _: x, lambda x: arrays.floor(x + 0.5), smooth)
        light = arrays.where(mean == 1, n, arrays.maximum(burst, 0.0))
        return replace(electrons, light=light, yield_mean=1.0, yield_variance=0.0)

    def moments(self, m: Moments) -> Moments:
        """var = λ·(η² + F·η + var η) + 1/12 for λ interactions, where η is not 1."""
        light, mean = m.light or m, m.yield_mean
        noise = arrays.where(mean == 1, 0.0, self.fano * mean + m.yield_variance)
        return m.add(
            mean=light.mean * (mean - 1),
            temporal=light.mean * (mean**2 - 1 + noise) + arrays.where(mean == 1, 0.0, 1 / 12),
            spatial=light.spatial * (mean**2 - 1),
        )


@dataclass(frozen=True)
class FullWell:
    """A well holds so many electrons and no more: min(N, full well), before any read noise.

    full_well_e : saturation capacity [e-].
    """

    full_well_e: float
    domain: ClassVar[str] = "electrons"

    def __call__(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Clips the sum; what overflows is booked on the light."""
        capacity = frame.number(self.full_well_e)
        dark = arrays.minimum(electrons.dark, capacity)
        return replace(electrons, light=arrays.minimum(electrons.light, capacity - dark), dark=dark)

    def moments(self, m: Moments) -> Moments:
        """A clipped normal: shot noise near a full well is one."""
        return m.clip(-float("inf"), self.full_well_e)
