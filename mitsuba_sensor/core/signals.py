"""Mean photons and electrons per pixel: what enters the sensor and what its well collects."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import DTypeLike

from .errors import InputError
from .notes import SourceOfLight
from .types import Array, Float64Array, NumpyArray

LAYERS = ("light", "dark", "yield_mean", "yield_variance", "left_share")
"""Of Electrons: one value per pixel, or one for all."""

VALUES_AT_ONCE = 2**18  # pixels × bands of a strip: 2 MiB in float64


class Illuminant(NamedTuple):
    """wavelengths_nm, power : (B,) middles of bands of equal width, and relative power per wavelength in them;
    light groups of one scene have the same unit.
    """

    wavelengths_nm: Float64Array
    power: Float64Array


@dataclass(frozen=True, eq=False, repr=False)
class Photons:
    """Mean photons per pixel in one exposure; mean values, not integers.

    ::

        ms.Photons(np.full((48, 64, 2), 500.0), wavelengths_nm=np.array([500.0, 600.0]))
        ms.Photons(np.full((48, 64), 300.0), detected=True)  # photoelectrons

    values : (H, W), or (H, W, B) with one layer per band; never negative, never NaN; +inf saturates the pixel.
    wavelengths_nm : (B,) centre of each band, or None when ``values`` are (H, W) at the camera's own wavelength.
    detected : whether they are photoelectrons, with the QE applied already: (H, W) of each pixel behind its own
        colour filter, or (H, W, F) with one layer per filter; ``wavelengths_nm`` are not needed then.
    origin : (row, column) of the first pixel on the sensor, used unless a function is given another.
    bandwidths_nm : (B,) of the bands, over which the QE is then averaged; None: the photons have ``wavelengths_nm``.
    in_band : (H, W), the photoelectrons over those of a spectrum that is flat within each band, of each pixel behind
        its own filter at ``origin``; None: 1.  in_band_of : fingerprint of the camera that it is for.
    polarizers : fingerprint of the polarisers of the sensor that the light was rendered for, each pixel with its own at
        ``origin``; None: the light is not polarised.
    illuminant : of the scene, for the colours of a preview; None where it is not known.
    intrinsics : how the picture is a projection of the world, as of :func:`optics.intrinsics.intrinsics`, for the lens
        corrections of a DNG; None where it is not known.
    source : what is known of the light that they were collected from, for the notes of frames; None: nothing.
    by_readout : photons of the exposures that follow the first one, by the name of the read-out that is exposed again,
        each in its own exposure time; None where the light does not change in time. Of dual pixels ``left`` is the part
        of this light that falls on the left photodiodes; None: half of it. Of a camera with image lag ``before`` is the
        light of the frame before; None: this light.
    factor : (B,), photons of a value of 1, for the float32 values of a render: ``mean`` is twice as large, and made
        when somebody asks, of as many rows as are asked for. Where it is 0, so is ``mean``. None: 1.
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
        """``<Photons: 64 × 64 × 3>``, or electrons where they are detected."""
        size = " × ".join(map(str, self.shape)) or "for every pixel"
        return f"<{type(self).__name__}: {size}{', as photoelectrons behind each filter' * self.detected}>"

    @cached_property
    def mean(self) -> NumpyArray:
        """Mean photons of each pixel, (H, W) or (H, W, B)."""
        return self._mean_of(self.values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of ``mean``."""
        return np.shape(self.values)

    @property
    def total(self) -> NumpyArray:
        """Photons per pixel over all bands, (H, W)."""
        if self.factor is None:
            return self.mean if self.mean.ndim == 2 else self.mean.sum(axis=-1)
        return np.concatenate([strip.mean.sum(axis=-1) for strip in self.strips()])

    def at(self, pixels: NumpyArray) -> NumpyArray:
        """Photons of some pixels by their numbers, row after row, (N, B)."""
        return self._mean_of(self.values.reshape(math.prod(self.shape[:2]), -1)[pixels])

    def strips(self) -> Iterator[Self]:
        """Parts of whole rows, none of which takes much memory beyond what is there already."""
        if self.factor is None:
            return iter((self,))
        step = max(VALUES_AT_ONCE // math.prod(self.shape[1:]), 1)
        return (
            self.crop_rows(slice(first, first + step))
            for first in range(0, self.shape[0], step)
        )

    def crop_rows(self, rows: slice) -> Self:
        """The photons of ``rows`` of the window."""
        in_band = None if self.in_band is None else self.in_band[rows]
        cropped = replace(self, values=self.values[rows], in_band=in_band)
        return cropped.with_readouts(lambda one: one.crop_rows(rows))

    def _mean_of(self, values: NumpyArray) -> NumpyArray:
        """Photons of some of the values; 0 where the factor is 0, also of infinite irradiance."""
        if self.factor is None:
            return values
        with np.errstate(invalid="ignore"):
            mean = np.multiply(values, self.factor, dtype=np.float64)
        if not self.factor.all():
            mean[..., self.factor == 0] = 0.0
        return mean

    def with_readouts(self, change: Callable[[Photons], Photons]) -> Self:
        """With the photons of other read-outs changed, of later exposures for example; itself where there are none."""
        if self.by_readout is None:
            return self
        return self.changed(
            by_readout={name: change(one) for name, one in self.by_readout.items()}
        )

    def changed(self, **fields: Any) -> Self:
        """With other values of some fields, or another ``mean``."""
        if "mean" in fields:
            fields |= {"values": fields.pop("mean"), "factor": None}
        return replace(self, **fields)

    def scaled(self, ratio: float) -> Self:
        """The photons of light that is ``ratio`` times as bright, or as long."""
        if self.factor is None:
            scaled = self.changed(mean=self.mean * ratio)
        else:
            scaled = self.changed(factor=self.factor * ratio)
        return scaled.with_readouts(lambda one: one.scaled(ratio))

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
    """Electrons per pixel, (H, W) or one for all: means before the shot noise, counts after.

    ::

        electrons = ms.stages.Electrons(light=np.full((2, 3), 100.0), dark=2.0)
        electrons.total  # 102 in every pixel
    """

    light: Array  # photoelectrons
    dark: Array = 0.0  # dark electrons
    yield_mean: Array = (
        1.0  # electrons per interacting photon, where that is not 1 (ultraviolet)
    )
    yield_variance: Array = 0.0
    left_share: Array = None  # of the light, on left photodiodes of dual pixels; None: half
    by_readout: Mapping[str, Electrons] | None = None  # before the count, as in Photons

    def mapped(self, change: Callable[[Array], Array]) -> Electrons:
        """With everything that differs from pixel to pixel changed, also that of later exposures."""
        layers = dict[str, Array]()
        for name in LAYERS:
            values = getattr(self, name)
            layers[name] = change(values) if np.ndim(values) else values
        others = self.by_readout
        if others is not None:
            others = {name: one.mapped(change) for name, one in others.items()}
        return Electrons(**layers, by_readout=others)

    @property
    def total(self) -> Array:
        """Photoelectrons and dark electrons together, (H, W)."""
        return self.light + self.dark

    def changed(
        self,
        total: Callable[[Array], Array],
        parts: Callable[[Array, Array], tuple[Array, Array]],
    ) -> Self:
        """Other electrons: ``parts(light, dark)``, whose sum is ``total(sum)``."""
        light, dark = parts(self.light, self.dark)
        return replace(self, light=light, dark=dark)


class CountedElectrons(Electrons):
    """Electrons of light and dark current that are counted as one; the two apart are drawn when somebody asks.

    ``dataclasses.replace(electrons, light=…)`` asks, and its result is the two and their sum.
    """

    _count: Array
    _split: Callable[[], tuple[Array, Array]]

    def __init__(
        self,
        count: Array = None,
        split: Callable[[], tuple[Array, Array]] | None = None,
        **known: Any,
    ) -> None:
        """count : of both; None if they are given.  split : returns photoelectrons and dark electrons."""
        super().__init__(**{"light": None, **known})
        object.__setattr__(self, "_count", count)
        object.__setattr__(self, "_split", split)
        if split is not None:
            del self.__dict__["light"], self.__dict__["dark"]  # drawn when somebody asks

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

    def changed(
        self,
        total: Callable[[Array], Array],
        parts: Callable[[Array, Array], tuple[Array, Array]],
    ) -> Self:
        """The same; the parts of the others are drawn when somebody asks, too."""
        if self._count is None:
            return super().changed(total, parts)
        return type(self)(total(self._count), lambda: parts(self.light, self.dark))
