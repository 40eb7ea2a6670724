"""Mean photons and electrons per pixel: what enters the sensor and what its well collects."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import DTypeLike

from .illuminant import Illuminant
from .types import Array, Float64Array, NumpyArray


@dataclass(frozen=True, eq=False)
class Photons:
    """Mean photons per pixel in one exposure; mean values, not integers.

    mean : (H, W), or (H, W, B) with one layer per band; never negative, never NaN; +inf saturates the pixel.
    wavelengths_nm : (B,) centre of each band, or None when ``mean`` is (H, W) at the camera's own wavelength.
    detected : whether ``mean`` is in photoelectrons, one layer per colour filter, with the QE applied already.
    origin : (row, column) of the first pixel on the sensor, used unless a function is given another.
    bandwidths_nm : (B,) of the bands, over which the QE is then averaged; None: the photons have ``wavelengths_nm``.
    in_band : (H, W), the photoelectrons over those of a spectrum that is flat within each band, of each pixel behind
        its own filter at ``origin``; None: 1.  in_band_of : fingerprint of the camera that it is for.
    variance_e2 : (H, W), variance of the mean photoelectrons over renders [e-²], for a frame that has a render of its
        own, whose render noise replaces a part of the shot noise; None: the mean is exact.
    illuminant : of the scene, for the colours of a preview; None where it is not known.
    """

    mean: NumpyArray
    wavelengths_nm: Float64Array | None = None
    variance_e2: NumpyArray | None = None
    detected: bool = False
    origin: tuple[int, int] = (0, 0)
    bandwidths_nm: Float64Array | None = None
    in_band: NumpyArray | None = None
    in_band_of: str | None = None
    illuminant: Illuminant | None = None

    @property
    def total(self) -> NumpyArray:
        """Photons per pixel over all bands, (H, W)."""
        return self.mean if self.mean.ndim == 2 else self.mean.sum(axis=-1)

    def crop_rows(self, rows: slice) -> Self:
        """The photons of ``rows`` of the window."""
        variance_e2, in_band = (None if x is None else x[rows] for x in (self.variance_e2, self.in_band))
        return replace(self, mean=self.mean[rows], variance_e2=variance_e2, in_band=in_band)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NumpyArray:
        return np.array(self.mean, dtype=dtype, copy=copy)


class Filters(NamedTuple):
    """Colour filters of a mosaic, each of which passes a share of one layer of the photons.

    layers, shares : of each filter.  tile : rows of filter numbers that repeat over the sensor.
    """

    layers: tuple[int, ...]
    shares: tuple[float, ...]
    tile: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Electrons:
    """Electrons per pixel, (H, W) or one for all: means before the shot noise, counts after."""

    light: Array  # photoelectrons
    dark: Array = 0.0  # dark electrons
    yield_mean: Array = 1.0  # electrons per interacting photon, where that is not 1 (ultraviolet)
    yield_variance: Array = 0.0
    variance_e2: Array = None  # as in Photons

    @property
    def total(self) -> Array:
        """Photoelectrons and dark electrons together, (H, W)."""
        return self.light + self.dark

    def changed(self, total: Callable[[Array], Array], parts: Callable[[Array, Array], tuple[Array, Array]]) -> Self:
        """Other electrons: ``parts(light, dark)``, whose sum is ``total(sum)``."""
        light, dark = parts(self.light, self.dark)
        return replace(self, light=light, dark=dark)


class CountedElectrons(Electrons):
    """Electrons of light and dark current that are counted as one; the two apart are drawn when somebody asks.

    ``dataclasses.replace(electrons, light=…)`` asks, and its result is the two and their sum.
    """

    _count: Array = None
    _split: Callable[[], tuple[Array, Array]]

    @classmethod
    def of(cls, count: Array, split: Callable[[], tuple[Array, Array]]) -> Self:
        """count : of both.  split : returns photoelectrons and dark electrons."""
        electrons = cls.__new__(cls)
        vars(electrons).update(_count=count, _split=split)
        return electrons

    @property
    def total(self) -> Array:
        """Photoelectrons and dark electrons together, (H, W)."""
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

    def changed(self, total: Callable[[Array], Array], parts: Callable[[Array, Array], tuple[Array, Array]]) -> Self:
        """The same; the parts of the others are drawn when somebody asks, too."""
        if self._count is None:
            return super().changed(total, parts)
        return self.of(total(self._count), lambda: parts(self.light, self.dark))
