"""Quantum efficiency (QE, η): mean photoelectrons = Σ_k QE_k·Λ_k for each pixel's colour filter.

QE_k is the QE at a wavelength, or its mean over a band, weighted by photons.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import Field, ValidationInfo, model_validator

from ...core import (
    Array,
    Doubt,
    Electrons,
    Frame,
    InputError,
    Photons,
    SensorWindow,
    arrays,
)
from ...core.signals import Filters
from ...core.types import NumpyArray
from ..crosstalk import Crosstalk, CrosstalkFields
from ..datasheet import Chance, FileTable, Nanometres, Positive, optional
from ..diffusion import Diffusion, SpectralCurve
from ..image_lag import BEFORE, ImageLag, ImageLagFields
from ..polarizers import efficiencies
from ..qe_file import read_curves
from ..stage import Datasheet, Detector, OtherPhotodiode
from ..usual_range import PERCENT, Usual
from .quantum_yield import bursts

if TYPE_CHECKING:
    from ..combined_readouts import ReadoutChain

PEAK_MIN = 0.01
"""A QE curve with a lower maximum was probably divided by 100 twice."""

Fractions = tuple[Annotated[float, Field(ge=0, le=1, strict=True)], ...]


class CurveFields(FileTable):
    """Electrons per photon, a curve for each colour filter, and the tile of filters."""

    value: Annotated[Chance | None, Usual.of(0.001, 1, PERCENT)] = optional(
        "one QE for all of wavelengths_nm, a fraction, instead of curves", 0.6
    )
    file: str | None = optional(
        "CSV file of the curves, instead of wavelengths_nm and curves", "qe.csv"
    )
    wavelengths_nm: Annotated[tuple[Positive, ...], Field(min_length=2), Nanometres] = Field(
        description="wavelengths of the curves, increasing [nm]", examples=[[400, 700]]
    )
    curves: Annotated[dict[str, Fractions], Field(min_length=1), Usual.of(0, 1, PERCENT)] = (
        Field(
            description="filter name → QE at each of wavelengths_nm, a fraction",
            examples=[{"mono": [0.6, 0.6]}],
        )
    )
    tile: Annotated[tuple[tuple[str, ...], ...], Field(min_length=1)] | None = optional(
        "rows of filter names that repeat over the sensor",
        [["R", "G"], ["G", "B"]],
        title="colour filter array CFA, Bayer pattern",
    )
    reference_nm: Annotated[Positive | None, Nanometres] = optional(
        "wavelength assumed for photons without one [nm]", 550
    )

    @model_validator(mode="before")
    @classmethod
    def _from_value_or_file(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict):
            return data
        if not _plausible(data.get("value")) or not isinstance(data.get("file"), str | None):
            # any curve will do: the field's own check reports the error
            return data | {"curves": {"mono": [0.0, 1.0]}, "wavelengths_nm": [1.0, 2.0]}
        ways = [name for name in ("value", "file", "curves") if data.get(name) is not None]
        if len(ways) > 1:
            raise ValueError(f"give either {ways[0]} or {ways[1]}, not both")
        if ways == ["file"]:
            return (
                data
                | {"file": None}
                | read_curves(data["file"], (info.context or {}).get("folder", "."))
            )
        if ways != ["value"]:
            return data
        points = data.get("wavelengths_nm")
        if not isinstance(points, list | tuple) or not points:
            raise ValueError("value needs wavelengths_nm, its range, e.g. [400, 700]")
        return data | {
            "value": None,
            "curves": {"mono": [data["value"]] * len(points)},
            "tile": None,
        }

    @model_validator(mode="after")
    def _curves_fit(self) -> Self:
        points = self.wavelengths_nm
        if any(b <= a for a, b in pairwise(points)):
            raise ValueError("wavelengths_nm must increase from each point to the next")
        for name, curve in self.curves.items():
            if len(curve) != len(points):
                raise ValueError(
                    f"curves.{name} has {len(curve)} values for {len(points)} wavelengths_nm"
                )
        if self.tile is None and len(self.curves) > 1:
            raise ValueError(
                'several curves need a tile of their names, e.g. [["R", "G"], ["G", "B"]]'
            )
        for row in self.tile or ():
            if not row or len(row) != len(self.tile[0]):  # type: ignore[index]
                raise ValueError("tile must be a rectangle: rows of equal length, none empty")
            for name in row:
                if name not in self.curves:
                    raise ValueError(
                        f"tile names {name!r}, which has no curve; the curves are {sorted(self.curves)}"
                    )
        return self

    @property
    def filter_tile(self) -> tuple[tuple[int, ...], ...]:
        """The tile with the numbers of the curves."""
        names = tuple(self.curves)
        return tuple(
            tuple(names.index(name) for name in row) for row in self.tile or (names[:1],)
        )


class QuantumEfficiencyFields(ImageLagFields, CrosstalkFields, CurveFields):
    """Quantum efficiency, filters, crosstalk and lag; pydantic lists the fields of the last base first."""

    @classmethod
    def notes_of(cls, camera: Datasheet) -> tuple[str, ...]:
        """Notes on curves that were probably divided by 100."""
        peaks = {name: max(curve) for name, curve in camera.quantum_efficiency.curves.items()}
        return tuple(
            Doubt(
                f"quantum_efficiency.curves.{name} has a maximum of {peak:.4g}; {PEAK_MIN:g} to 1 is usual: if it was "
                f"a fraction given as percent, write {100 * peak:.4g}"
            )
            for name, peak in peaks.items()
            if 0 < peak < PEAK_MIN
        )


def _plausible(value: Any) -> bool:
    """Return whether a QE is absent or a fraction."""
    return value is None or (
        isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 1
    )


@dataclass(frozen=True)
class QuantumEfficiency(Detector):
    """Mean photoelectrons of each pixel, Σ_k QE(λ_k)·Λ_k (paper eq. 14), not rounded; nothing is random.

    curves : one QE curve per colour filter, for unpolarised light, with the polarisers, if any.
    tile : rows of filter numbers that repeat over the sensor.
    reference_nm : wavelength assumed for photons without one [nm]; None to require one.
    quantum_yield : electrons per interacting photon by wavelength; None for one everywhere.
    crosstalk : None if each pixel keeps its electrons. The light beyond the edge of the window is its mirror image,
        with the filters that are there.
    diffusion : crosstalk by wavelength, instead.
    lag : of the previous frame, if its light is given, or None.
    photodiodes : of split pixels, with crosstalk or diffusion of their own; each detects the photoelectrons that
        the first one would with these.
    """

    curves: tuple[SpectralCurve, ...]
    tile: tuple[tuple[int, ...], ...] = ((0,),)
    reference_nm: float | None = None
    quantum_yield: SpectralCurve | None = None
    crosstalk: Crosstalk | None = None
    diffusion: Diffusion | None = None
    lag: ImageLag | None = None
    photodiodes: tuple[OtherPhotodiode, ...] = ()
    domain = "electrons"
    table = "quantum_efficiency"
    fields = QuantumEfficiencyFields
    terms = "quantum efficiency η (E), QE, QE_I (J)"
    no_noise = "set quantum_efficiency.value to 1 to detect every photon"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> QuantumEfficiency:
        """Return the stage with the camera's curves, and its quantum yield if that is not one."""
        section = camera.quantum_efficiency
        curves = tuple(
            SpectralCurve(section.wavelengths_nm, curve)
            for curve in efficiencies(camera).values()
        )
        if bursts(section.quantum_yield):
            burst = SpectralCurve(section.wavelengths_nm, section.quantum_yield)
        else:
            burst = None
        crosstalk = Crosstalk.of(
            section.shares_given, tuple(section.curves), section.filter_tile
        )
        diffusion, lag = Diffusion.from_camera(camera), ImageLag.from_camera(camera)
        tile = section.filter_tile
        return cls(curves, tile, section.reference_nm, burst, crosstalk, diffusion, lag)

    def with_photodiodes(self, readouts: Iterable[ReadoutChain]) -> QuantumEfficiency:
        """Add the photodiodes of these readouts whose crosstalk or diffusion differs from the first one's."""
        others = list[OtherPhotodiode]()
        for readout in readouts:
            own = readout.stages[0]
            assert isinstance(own, QuantumEfficiency)
            same = (own.crosstalk, own.diffusion) == (self.crosstalk, self.diffusion)
            if readout.begins_photodiode and not same:
                detection = replace(self, crosstalk=own.crosstalk, diffusion=own.diffusion)
                others.append(OtherPhotodiode(readout.name, readout.exposure_ratio, detection))
        return replace(self, photodiodes=tuple(others))

    @property
    def other_photodiodes(self) -> tuple[OtherPhotodiode, ...]:
        """Further photodiodes of split pixels."""
        return self.photodiodes

    @property
    def light_reach_px(self) -> int:
        """Reach of crosstalk or diffusion."""
        spread = self.crosstalk or self.diffusion
        if spread is None:
            return 0
        return spread.reach_px

    def sample(self, photons: Photons, frame: Frame) -> Electrons:
        """Return mean photoelectrons (H, W), with a quantum yield mean interactions."""
        window = frame.window
        collected = self._of_exposure(photons, window)
        if self.lag is not None and photons.by_readout is not None:
            before = self._of_exposure(photons.by_readout[BEFORE], window)
            collected = self.lag.shown(collected, before)
        return collected.mapped(lambda values: window.backend.from_numpy(values, window))

    def _of_exposure(self, photons: Photons, window: SensorWindow) -> Electrons:
        """Return the mean photoelectrons (interactions) that each pixel collects of this light, (H, W) on NumPy."""
        if self.light_reach_px == 0:
            return self._freed(photons, window)
        wider, around = _mirrored(photons, window, self.light_reach_px)
        if self.crosstalk is not None:
            return self.crosstalk.mixed(self._freed(wider, around), around.origin)
        return self._diffused(wider, around)

    def _freed(self, photons: Photons, window: SensorWindow) -> Electrons:
        """Return the mean photoelectrons (interactions) that the light frees in each pixel, (H, W) on NumPy."""
        weights = self._weights(photons)
        layers = photons.mean if photons.mean.ndim == 3 else photons.mean[..., None]
        known = 1.0 if photons.in_band is None else photons.in_band
        flat = self._collected(layers, weights, window)
        light = flat * known
        if self.quantum_yield is None:
            return Electrons(light)
        once, twice = (self._weights(photons, power) for power in (1, 2))
        first = arrays.ratio(self._collected(layers, once, window), flat, 1.0)
        second = arrays.ratio(self._collected(layers, twice, window), flat, 1.0)
        spread = arrays.maximum(second - first**2, 0.0)
        return Electrons(light, yield_mean=first, yield_variance=spread)

    def _diffused(self, photons: Photons, window: SensorWindow) -> Electrons:
        """Return what pixels collect from a window that is wider by the reach of the diffusion."""
        assert self.diffusion is not None
        if photons.detected:
            raise InputError(
                "photons are detected, so their wavelengths are unknown, but quantum_efficiency.diffusion_um needs "
                "them; pass photons by wavelength, or give crosstalk instead."
            )
        weights = self._weights(photons)
        layers = photons.mean if photons.mean.ndim == 3 else photons.mean[..., None]
        known = 1.0 if photons.in_band is None else photons.in_band

        def freed_with(shares: Array) -> Array:
            return known * self._collected(layers, weights * shares, window)

        nm = self._wavelengths(photons)
        return Electrons(self.diffusion.collected(freed_with, nm))

    def filters(self, photons: Photons) -> Filters | None:
        """Return None for sums over bands, quantum yield and crosstalk, which are faster on the host."""
        one_layer = photons.detected or len(photons.shape) == 2 or photons.shape[2] == 1
        spread = self.crosstalk or self.diffusion
        maps = (self.quantum_yield, spread, photons.in_band)
        if not one_layer or self.photodiodes or any(one is not None for one in maps):
            return None
        weights = self._weights(photons)
        layers = range(len(weights)) if photons.detected else [0] * len(weights)
        return Filters(tuple(layers), tuple(float(line.max()) for line in weights), self.tile)

    def _collected(self, layers: Array, weights: Array, window: SensorWindow) -> Array:
        """Return Σ over the bands (H, W, B), each pixel with the weights of its filter, (F, B)."""
        if len(self.curves) == 1:
            return arrays.weighted_sum(layers, weights[0])
        found, size = np.empty(window.shape), (len(self.tile), len(self.tile[0]))
        for y, x in np.ndindex(size):
            rows, columns = (
                slice((k - o) % n, None, n)
                for k, o, n in zip((y, x), window.origin, size, strict=True)
            )
            place = (rows, columns)
            found[place] = arrays.weighted_sum(layers[place], weights[self.tile[y][x]])
        return found

    def _weights(self, photons: Photons, power: int = 0) -> Array:
        """Return QE times a power of the quantum yield for filters and bands, (F, B); 1 for detected photons."""
        if photons.detected:
            return np.eye(len(self.curves))
        nm, burst = self._wavelengths(photons), self.quantum_yield if power else None
        return np.array([curve.of(photons, nm, burst, power) for curve in self.curves])

    def _wavelengths(self, photons: Photons) -> Array:
        """Return the wavelengths of the bands (B,) [nm], or the camera's reference_nm."""
        if photons.wavelengths_nm is not None:
            return photons.wavelengths_nm
        if self.reference_nm is None:
            raise InputError(
                "photons have no wavelengths_nm, but this camera's quantum efficiency depends on wavelength; pass "
                "wavelengths_nm=[...], one per band, or set quantum_efficiency.reference_nm in the camera."
            )
        return (self.reference_nm,)


def _mirrored(
    photons: Photons, window: SensorWindow, by_px: int
) -> tuple[Photons, SensorWindow]:
    """Return the light on a window wider by so many pixels on each side, mirrored at the outermost pixels."""

    def wider(values: NumpyArray | None) -> NumpyArray | None:
        if values is None:
            return None
        sides = [(by_px, by_px)] * 2 + [(0, 0)] * (values.ndim - 2)
        return np.pad(values, sides, mode="reflect")

    (height, width), (row, column) = window.shape, window.origin
    around = SensorWindow(
        window.serial, (height + 2 * by_px, width + 2 * by_px), (row - by_px, column - by_px)
    )
    mean = wider(photons.mean)
    assert mean is not None
    return photons.changed(mean=mean, in_band=wider(photons.in_band)), around
