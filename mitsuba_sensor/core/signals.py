"""Mean photons and electrons per pixel: the input of the sensor and the charge in its wells."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import DTypeLike

from .errors import InputError
from .near_names import checks_names
from .notes import SourceOfLight
from .types import Array, Float64Array, NumpyArray

LAYERS = ("light", "dark", "yield_mean", "yield_variance", "left_share")
"""Fields of Electrons with one value per pixel, or one for all."""

VALUES_AT_ONCE = 2**18  # pixels × bands of a strip: 2 MiB in float64


class Illuminant(NamedTuple):
    """Spectrum of a light source.

    wavelengths_nm : (B,) centres of bands of equal width.  power : (B,) relative power per wavelength; the light groups
    of a scene share the unit.
    """

    wavelengths_nm: Float64Array
    power: Float64Array


@checks_names
@dataclass(frozen=True, eq=False, repr=False)
class Photons:
    """Mean photons per pixel in one exposure, unrounded.

    ::

        ms.Photons(np.full((48, 64, 2), 500.0), wavelengths_nm=np.array([500.0, 600.0]))
        ms.Photons(np.full((48, 64), 300.0), detected=True)  # photoelectrons

    values : (H, W), or (H, W, B) with one layer per band; neither negative nor NaN; +inf saturates the pixel.
    wavelengths_nm : (B,) centre of each band; None if ``values`` are (H, W) at the camera's reference wavelength.
    detected : the values are photoelectrons: (H, W) after each pixel's filter, or (H, W, F) with one layer per filter.
        They need no ``wavelengths_nm``.
    origin : (row, column) of the first pixel on the sensor, unless a function is given another origin.
    bandwidths_nm : (B,) widths of the bands for averaging the QE; None: the photons have ``wavelengths_nm``.
    in_band : (H, W), photoelectrons relative to a flat spectrum within each band, after each pixel's filter at
        ``origin``; None: 1.  in_band_of : fingerprint of the camera that it is for.
    polarizers : fingerprint of the sensor's polarisers that the light was rendered for, at ``origin``; None:
        unpolarised light.
    illuminant : of the scene, for the colours of a preview; None if unknown.
    intrinsics : projection of the world onto the image, from :func:`optics.intrinsics.intrinsics`, for the lens
        corrections of a DNG; None if unknown.
    source : describes the light for the notes of frames; None: no description.
    by_readout : readout name → photons of its later exposure; None if the light is constant. With dual pixels,
        ``left`` is the light on the left photodiodes; None: half. With image lag, ``before`` is the light of the
        previous frame; None: this light.
    factor : (B,), photons per unit of the float32 values of a render. ``mean`` is float64, so it is computed on demand,
        for the requested rows. A factor of 0 gives a mean of 0. None: 1.
    """

    values: NumpyArray
    wavelengths_nm: Float64Array | None = None
    detected: bool = False
    origin: tuple[int, int] = (0, 0)
    bandwidths_nm: Float64Array | None = None
    in_band: NumpyArray | None = None
    in_band_of: str | None = None
    polarizers: str | None = None
    illuminant: Illuminant | None = None
    intrinsics: Mapping[str, Any] | None = None
    source: SourceOfLight | None = None
    by_readout: Mapping[str, Photons] | None = None
    factor: Float64Array | None = None

    def __post_init__(self) -> None:
        if self.factor is not None and np.shape(self.factor) != self.shape[-1:]:
            raise InputError(
                f"factor has shape {np.shape(self.factor)}; pass one number per band, {self.shape[-1:]}."
            )

    def __repr__(self) -> str:
        """Return ``<Photons: 64 × 64 × 3>``."""
        size = " × ".join(map(str, self.shape)) or "for every pixel"
        return f"<{type(self).__name__}: {size}{', as photoelectrons after each filter' * self.detected}>"

    @cached_property
    def mean(self) -> NumpyArray:
        """Mean photons of each pixel, shape (H, W) or (H, W, B)."""
        return self._mean_of(self.values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of ``mean``."""
        return np.shape(self.values)

    @property
    def total(self) -> NumpyArray:
        """Photons per pixel over all bands, shape (H, W)."""
        if self.factor is None:
            return self.mean if self.mean.ndim == 2 else self.mean.sum(axis=-1)
        return np.concatenate([strip.mean.sum(axis=-1) for strip in self.strips()])

    def at(self, pixels: NumpyArray) -> NumpyArray:
        """Return the photons of pixels by their numbers in row order, shape (N, B)."""
        return self._mean_of(self.values.reshape(math.prod(self.shape[:2]), -1)[pixels])

    def strips(self) -> Iterator[Self]:
        """Return strips of whole rows that need little extra memory."""
        if self.factor is None:
            return iter((self,))
        step = max(VALUES_AT_ONCE // math.prod(self.shape[1:]), 1)
        return (
            self.crop_rows(slice(first, first + step))
            for first in range(0, self.shape[0], step)
        )

    def crop_rows(self, rows: slice) -> Self:
        """Return the photons of these rows of the window."""
        in_band = None if self.in_band is None else self.in_band[rows]
        cropped = replace(self, values=self.values[rows], in_band=in_band)
        return cropped.with_readouts(lambda photons: photons.crop_rows(rows))

    def _mean_of(self, values: NumpyArray) -> NumpyArray:
        """Return the photons of these values; 0 for a factor of 0, even with infinite irradiance."""
        if self.factor is None:
            return values
        with np.errstate(invalid="ignore"):
            mean = np.multiply(values, self.factor, dtype=np.float64)
        if not self.factor.all():
            mean[..., self.factor == 0] = 0.0
        return mean

    def with_readouts(self, change: Callable[[Photons], Photons]) -> Self:
        """Return a copy with changed photons of the other readouts, or itself without other readouts."""
        if self.by_readout is None:
            return self
        return self.changed(by_readout={name: change(x) for name, x in self.by_readout.items()})

    def changed(self, **fields: Any) -> Self:
        """Return a copy with other values of some fields, or another ``mean``."""
        if "mean" in fields:
            fields |= {"values": fields.pop("mean"), "factor": None}
        return replace(self, **fields)

    def scaled(self, ratio: float) -> Self:
        """Return the photons of light that is ``ratio`` times as bright, or as long."""
        if self.factor is None:
            scaled = self.changed(mean=self.mean * ratio)
        else:
            scaled = self.changed(factor=self.factor * ratio)
        return scaled.with_readouts(lambda photons: photons.scaled(ratio))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NumpyArray:
        return np.array(self.mean, dtype=dtype, copy=copy)


class Filters(NamedTuple):
    """Colour filters of a mosaic; each passes a fraction of one layer of the photons.

    layers, shares : number of the layer and fraction, for each filter.  tile : filter numbers, by rows.
    """

    layers: tuple[int, ...]
    shares: tuple[float, ...]
    tile: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Electrons:
    """Electrons per pixel, shape (H, W) or one value for all: means before shot noise, counts after.

    ::

        electrons = ms.stages.Electrons(light=np.full((2, 3), 100.0), dark=2.0)
        electrons.total  # 102 in every pixel
    """

    light: Array  # photoelectrons
    dark: Array = 0.0  # dark electrons
    yield_mean: Array = 1.0  # electrons per interacting photon (above 1 in the ultraviolet)
    yield_variance: Array = 0.0
    # Fraction of the light on left photodiodes of dual pixels; None: half.
    left_share: Array = None
    by_readout: Mapping[str, Electrons] | None = None  # before the count, as in Photons

    def mapped(self, change: Callable[[Array], Array]) -> Electrons:
        """Return a copy with all per-pixel values changed, also of later exposures."""
        values = {name: getattr(self, name) for name in LAYERS}
        layers = {name: change(x) if np.ndim(x) else x for name, x in values.items()}
        others = self.by_readout
        if others is not None:
            others = {name: electrons.mapped(change) for name, electrons in others.items()}
        return Electrons(**layers, by_readout=others)

    @property
    def total(self) -> Array:
        """Sum of photoelectrons and dark electrons, shape (H, W)."""
        return self.light + self.dark

    def changed(
        self,
        total: Callable[[Array], Array],
        parts: Callable[[Array, Array], tuple[Array, Array]],
    ) -> Self:
        """Return the electrons ``parts(light, dark)``; their sum is ``total(sum)``."""
        light, dark = parts(self.light, self.dark)
        return replace(self, light=light, dark=dark)


class CountedElectrons(Electrons):
    """Joint count of photoelectrons and dark electrons, which are separated on demand.

    ``dataclasses.replace(electrons, light=…)`` separates them.
    """

    _count: Array
    _split: Callable[[], tuple[Array, Array]]

    def __init__(
        self,
        count: Array = None,
        split: Callable[[], tuple[Array, Array]] | None = None,
        **known: Any,
    ) -> None:
        """count : joint count; None if both are given.  split : returns photoelectrons and dark electrons."""
        super().__init__(**{"light": None, **known})
        object.__setattr__(self, "_count", count)
        object.__setattr__(self, "_split", split)
        if split is not None:
            del self.__dict__["light"], self.__dict__["dark"]  # drawn on demand

    @property
    def total(self) -> Array:
        """Sum of photoelectrons and dark electrons, shape (H, W)."""
        return super().total if self._count is None else self._count

    @cached_property
    def _parts(self) -> tuple[Array, Array]:
        return self._split()

    @cached_property
    def light(self) -> Array:
        """Photoelectrons."""
        return self._parts[0]

    @cached_property
    def dark(self) -> Array:
        """Dark electrons."""
        return self._parts[1]

    def changed(
        self,
        total: Callable[[Array], Array],
        parts: Callable[[Array, Array], tuple[Array, Array]],
    ) -> Self:
        """Return the changed electrons, which are also separated on demand."""
        if self._count is None:
            return super().changed(total, parts)
        return type(self)(total(self._count), lambda: parts(self.light, self.dark))
