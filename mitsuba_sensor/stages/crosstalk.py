"""Crosstalk: photoelectrons that neighbouring pixels collect, optically or by diffusion, under the colour filters.

Each electron moves independently before it is counted. A Poisson stream divided at random gives independent Poisson
streams, so only the means are mixed: the shot noise of a pixel is that of the light it collects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ..core import Electrons, arrays
from ..core.backend import FLOAT32_LIMIT
from ..core.types import Array, Float64Array
from .datasheet import Chance, FileTable, NotNegative, optional
from .effects.quantum_yield import bursts

Kernel = tuple[tuple[Chance, ...], ...]
Tile: TypeAlias = tuple[tuple[int, ...], ...]
SIDES = (3, 5)
ROUNDING = 1e-9
"""A sum of fractions that were rounded in a file may exceed 1 by this."""

KEEPS_ALL: Kernel = ((1.0,),)
GIVES_NOTHING: Kernel = ((0.0,),)
EXAMPLE = [[0.0, 0.02, 0.0], [0.02, 0.92, 0.02], [0.0, 0.02, 0.0]]
OWN_EXAMPLE = [[0.0, 0.0, 0.0], [0.0, 0.92, 0.0], [0.0, 0.0, 0.0]]
PAIR_EXAMPLE = [[0.0, 0.02, 0.0], [0.02, 0.0, 0.02], [0.0, 0.02, 0.0]]


def of_reach(kernel: Kernel, reach_px: int) -> Kernel:
    """Return the same fractions, padded with zeros to this reach."""
    padded = np.pad(np.array(kernel), reach_px - len(kernel) // 2)
    return tuple(tuple(row) for row in padded.tolist())


def check_kernel(name: str, kernel: Kernel) -> None:
    """Raise ValueError for a wrong shape or impossible fractions."""
    _check_shape(name, kernel)
    _check_shares(name, np.array(kernel))


def check_pairs(
    source: str, of_receivers: Mapping[str, Kernel], names: tuple[str, ...], tile: Tile
) -> None:
    """Raise ValueError for impossible fractions from the pixels of one filter to the pixels of each filter.

    source : name of the filter.  of_receivers : filter name → kernel.  names : of all filters.
    """
    where = f"crosstalk_pairs.{source}"
    for receiver, kernel in of_receivers.items():
        if receiver not in names:
            raise ValueError(
                f"{where} names {receiver!r}, which has no curve; the curves are {sorted(names)}"
            )
        _check_shape(f"{where}.{receiver}", kernel)
    if source not in of_receivers:
        raise ValueError(
            f"{where} has no {source!r}, so its pixels would keep no electrons; add what they keep, e.g. "
            f"{source} = {OWN_EXAMPLE}"
        )
    reach_px = max(len(kernel) // 2 for kernel in of_receivers.values())
    given = [of_receivers.get(name, GIVES_NOTHING) for name in names]
    kernels = np.array([of_reach(kernel, reach_px) for kernel in given])
    numbers, lies = np.arange(len(names))[:, None, None], np.zeros(kernels.shape, bool)
    for place in np.argwhere(np.array(tile) == names.index(source)):
        here = numbers == filters_of(tile, (place - reach_px).tolist(), kernels.shape[1:])
        lies |= here
        shares = np.sum(np.where(here, kernels, 0.0), axis=0)
        _check_shares(f"{where} of the pixel at {place.tolist()} of the tile", shares)
    _check_receivers(where, names, (kernels > 0) & ~lies)


def filters_of(tile: Tile, origin: Sequence[int], shape: Sequence[int]) -> NDArray[np.intp]:
    """Return the filter numbers of the pixels of a window, (H, W)."""
    numbers = np.array(tile)
    rows, columns = (
        (np.arange(length) + first) % period
        for length, first, period in zip(shape, origin, numbers.shape, strict=True)
    )
    return np.asarray(numbers[np.ix_(rows, columns)])


def _check_receivers(where: str, names: tuple[str, ...], nowhere: NDArray[np.bool_]) -> None:
    """Raise ValueError for fractions that no pixel would collect.  nowhere : which, (F, rows, columns)."""
    for number, row, column in np.argwhere(nowhere):
        raise ValueError(
            f"{where}.{names[number]} has a fraction in row {row - nowhere.shape[1] // 2:+d} and column "
            f"{column - nowhere.shape[2] // 2:+d} from the pixel, where this tile has no pixel with {names[number]}; "
            "set it to 0, and give that fraction to the filter that is there"
        )


def _check_shape(name: str, kernel: Kernel) -> None:
    """Raise ValueError unless the shape is 3 × 3 or 5 × 5."""
    side = len(kernel)
    if side not in SIDES or any(len(row) != side for row in kernel):
        raise ValueError(
            f"{name} has rows of {', '.join(str(len(row)) for row in kernel)} fractions; it must be 3 rows of 3 or "
            f"5 rows of 5, e.g. {EXAMPLE}"
        )


def _check_shares(name: str, shares: Float64Array) -> None:
    """Raise ValueError for a sum above 1, or if a neighbour collects more than the pixel itself."""
    if shares.sum() > 1 + ROUNDING:
        raise ValueError(
            f"{name} adds up to {shares.sum():.6g}, more electrons than the light frees; scale the fractions so that "
            "they add up to 1, or less if some electrons are lost"
        )
    middle = shares[len(shares) // 2, len(shares) // 2]
    if middle < max(shares.max(), ROUNDING):
        raise ValueError(
            f"{name} gives {middle:g} to the pixel itself and {shares.max():g} to another; the middle must be the "
            "largest"
        )


class CrosstalkFields(FileTable):
    """Which pixels collect the photoelectrons of a pixel."""

    crosstalk: Kernel | None = optional(
        "fractions of a pixel's photoelectrons that it and its neighbours collect, 3 × 3 or 5 × 5",
        EXAMPLE,
        title="crosstalk, pixel response kernel",
    )
    crosstalk_from: Annotated[dict[str, Kernel], Field(min_length=1)] | None = optional(
        "filter name → a kernel for its pixels, instead of crosstalk; other pixels keep all "
        "electrons",
        {"R": EXAMPLE},
        title="crosstalk of a colour",
    )
    crosstalk_pairs: (
        Annotated[
            dict[str, Annotated[dict[str, Kernel], Field(min_length=1)]], Field(min_length=1)
        ]
        | None
    ) = optional(
        "filter name → filter name → kernel from pixels of the first to pixels of the second,"
        " instead of crosstalk",
        {"R": {"R": OWN_EXAMPLE, "G": PAIR_EXAMPLE}},
        title="crosstalk between two colours",
    )
    diffusion_um: tuple[NotNegative, ...] | None = optional(
        "σ of the lateral diffusion of electrons at each of wavelengths_nm, instead of "
        "crosstalk [µm]",
        [1.5, 3.0],
        title="charge diffusion, diffusion length",
    )

    @model_validator(mode="after")
    def _one_way_of_giving_it(self) -> Self:
        ways = ("crosstalk", "crosstalk_from", "crosstalk_pairs", "diffusion_um")
        given = [name for name in ways if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"give either {given[0]} or {given[1]}, not both")
        points = getattr(self, "wavelengths_nm", ())
        if self.diffusion_um is not None and len(self.diffusion_um) != len(points):
            raise ValueError(
                f"diffusion_um has {len(self.diffusion_um)} values for {len(points)} wavelengths_nm; give one for each"
            )
        if self.diffusion_um is not None and bursts(getattr(self, "quantum_yield", None)):
            raise ValueError(
                "give either diffusion_um or quantum_yield, not both: electrons of one photon diffuse together"
            )
        return self

    @model_validator(mode="after")
    def _shares_are_possible(self) -> Self:
        if self.crosstalk is not None:
            check_kernel("crosstalk", self.crosstalk)
        known = getattr(self, "curves", {})
        for way in ("crosstalk_from", "crosstalk_pairs"):
            for name in getattr(self, way) or ():
                if name not in known:
                    raise ValueError(
                        f"{way} names {name!r}, which has no curve; the curves are {sorted(known)}"
                    )
        for name, kernel in (self.crosstalk_from or {}).items():
            check_kernel(f"crosstalk_from.{name}", kernel)
        for name, of_receivers in (self.crosstalk_pairs or {}).items():
            check_pairs(name, of_receivers, tuple(known), getattr(self, "filter_tile", ((0,),)))
        return self

    @property
    def shares_given(self) -> dict[str, dict[str, Kernel]]:
        """Filter name → filter name → kernel, for filters whose pixels lose electrons to others."""
        names = tuple(getattr(self, "curves", {}))
        by_filter = self.crosstalk_from or {}
        if self.crosstalk is not None:
            by_filter = dict.fromkeys(names, self.crosstalk)
        to_all = {name: dict.fromkeys(names, kernel) for name, kernel in by_filter.items()}
        return to_all | (self.crosstalk_pairs or {})


@dataclass(frozen=True)
class Crosstalk:
    """Fractions of the photoelectrons of a pixel that its neighbours collect.

    kernels : from the pixels of each filter to the pixels of each filter, (2·reach_px + 1)².
    tile : rows of filter numbers that repeat.
    """

    kernels: tuple[tuple[Kernel, ...], ...]
    tile: Tile

    @classmethod
    def of(
        cls, given: Mapping[str, Mapping[str, Kernel]], names: tuple[str, ...], tile: Tile
    ) -> Crosstalk | None:
        """Return None if each pixel keeps its electrons.  given : kernels of filters whose pixels lose some."""
        sizes = [
            len(kernel) for of_receivers in given.values() for kernel in of_receivers.values()
        ]
        reach_px = max(sizes, default=1) // 2
        alone, nothing = of_reach(KEEPS_ALL, reach_px), of_reach(GIVES_NOTHING, reach_px)
        kernels = []
        for source in names:
            of_source = given.get(source, {source: KEEPS_ALL})
            shares = (of_source.get(name, GIVES_NOTHING) for name in names)
            kernels.append(tuple(of_reach(kernel, reach_px) for kernel in shares))
        if all(kernel in (alone, nothing) for of_source in kernels for kernel in of_source):
            return None
        return cls(tuple(kernels), tile)

    @property
    def reach_px(self) -> int:
        """Distance of the furthest pixel that collects electrons."""
        return len(self.kernels[0][0]) // 2

    def mixed(self, wider: Electrons, origin: tuple[int, int]) -> Electrons:
        """Return what the pixels of a window collect.

        wider : mean photoelectrons of the window and ``reach_px`` pixels around it, on NumPy.
        origin : sensor row and column of the first of these pixels.
        """
        freed = np.minimum(wider.light, FLOAT32_LIMIT)
        light = self._collected(freed, origin)
        if np.ndim(wider.yield_mean) == 0:
            return replace(wider, light=light)
        square = wider.yield_variance + wider.yield_mean**2
        once = self._collected(freed * wider.yield_mean, origin)
        twice = self._collected(freed * square, origin)
        mean = arrays.ratio(once, light, 1.0)
        spread = arrays.ratio(twice, light, 1.0) - mean**2
        return replace(
            wider, light=light, yield_mean=mean, yield_variance=np.maximum(spread, 0.0)
        )

    def _collected(self, values: Array, origin: tuple[int, int]) -> Float64Array:
        """Return for each pixel the sum of its neighbours' values times their fractions."""
        side, (height, width) = 2 * self.reach_px + 1, values.shape
        rows, columns = height - side + 1, width - side + 1
        receiving = origin[0] + self.reach_px, origin[1] + self.reach_px
        found = np.zeros((rows, columns))
        for row, column in product(range(side), repeat=2):
            top, left = side - 1 - row, side - 1 - column
            of_pairs = ((kernel[row][column] for kernel in one) for one in self.kernels)
            shares = np.array([list(of_source) for of_source in of_pairs])
            if shares.any():
                start = origin[0] + top, origin[1] + left
                giving = values[top : top + rows, left : left + columns]
                found += self._of_filters(shares, start, receiving, giving.shape) * giving
        return found

    def _of_filters(
        self,
        shares: Float64Array,
        giving: tuple[int, int],
        receiving: tuple[int, int],
        shape: tuple[int, ...],
    ) -> Array:
        """Return the fraction for each pair of pixels by their filters, (H, W), or one for all.

        giving, receiving : sensor row and column of the first pixel of each.
        """
        if np.ptp(shares) == 0:
            return shares[0, 0]
        return shares[
            filters_of(self.tile, giving, shape), filters_of(self.tile, receiving, shape)
        ]
