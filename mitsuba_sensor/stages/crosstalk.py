"""Crosstalk: photoelectrons that neighbouring pixels collect, optically or by diffusion, behind the colour filters.

It moves single electrons before they are counted. Streams of Poisson electrons that are shared out are Poisson streams
and independent, so that only the means are mixed: the shot noise of a pixel is that of the light it collects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ..core import Electrons, arrays
from ..core.backend import FLOAT32_LIMIT
from ..core.types import Array, Float64Array
from .crosstalk_kernels import (
    EXAMPLE,
    GIVES_NOTHING,
    KEEPS_ALL,
    OWN_EXAMPLE,
    PAIR_EXAMPLE,
    Kernel,
    Tile,
    check_kernel,
    check_pairs,
    of_reach,
)
from .datasheet import FileTable, NotNegative
from .effects.quantum_yield import bursts


class CrosstalkFields(FileTable):
    """Where the photoelectrons of a pixel go."""

    crosstalk: Kernel | None = Field(
        None,
        title="crosstalk, pixel response kernel",
        description="shares of a pixel's photoelectrons that it and its neighbours collect, rows of 3 × 3 or 5 × 5",
        examples=[EXAMPLE],
    )
    crosstalk_from: Annotated[dict[str, Kernel], Field(min_length=1)] | None = Field(
        None,
        title="crosstalk of a colour",
        description="filter name → these shares for pixels behind it, instead of crosstalk; others keep all",
        examples=[{"R": EXAMPLE}],
    )
    crosstalk_pairs: (
        Annotated[
            dict[str, Annotated[dict[str, Kernel], Field(min_length=1)]], Field(min_length=1)
        ]
        | None
    ) = Field(
        None,
        title="crosstalk between two colours",
        description="filter name → filter name → shares that pixels behind the first give to pixels behind the second, "
        "instead of crosstalk; others keep all",
        examples=[{"R": {"R": OWN_EXAMPLE, "G": PAIR_EXAMPLE}}],
    )
    diffusion_um: tuple[NotNegative, ...] | None = Field(
        None,
        title="charge diffusion, diffusion length",
        description="standard deviation of the way that electrons go sideways before they are collected, at each of "
        "wavelengths_nm, instead of crosstalk [µm]",
        examples=[[1.5, 3.0]],
    )

    @model_validator(mode="after")
    def _one_way_of_giving_it(self) -> Self:
        ways = ("crosstalk", "crosstalk_from", "crosstalk_pairs", "diffusion_um")
        given = [name for name in ways if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"give either {given[0]} or {given[1]}, and not both")
        points = getattr(self, "wavelengths_nm", ())
        if self.diffusion_um is not None and len(self.diffusion_um) != len(points):
            raise ValueError(
                f"diffusion_um has {len(self.diffusion_um)} values for {len(points)} wavelengths_nm"
            )
        if self.diffusion_um is not None and bursts(getattr(self, "quantum_yield", None)):
            raise ValueError(
                "give either diffusion_um or quantum_yield, and not both: electrons of one photon diffuse together"
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
                        f"{way} names {name!r}, which has no curve; there are {sorted(known)}"
                    )
        for name, kernel in (self.crosstalk_from or {}).items():
            check_kernel(f"crosstalk_from.{name}", kernel)
        for name, of_receivers in (self.crosstalk_pairs or {}).items():
            check_pairs(name, of_receivers, tuple(known), getattr(self, "filter_tile", ((0,),)))
        return self

    @property
    def shares_given(self) -> dict[str, dict[str, Kernel]]:
        """Filter name → filter name → kernel, of the filters whose pixels give electrons away."""
        names = tuple(getattr(self, "curves", {}))
        by_filter = self.crosstalk_from or {}
        if self.crosstalk is not None:
            by_filter = dict.fromkeys(names, self.crosstalk)
        to_all = {name: dict.fromkeys(names, kernel) for name, kernel in by_filter.items()}
        return to_all | (self.crosstalk_pairs or {})


@dataclass(frozen=True)
class Crosstalk:
    """Shares of the photoelectrons of a pixel that the pixels about it collect.

    kernels : of pixels behind each filter for those behind each filter, (2·reach_px + 1)².
    tile : rows of filter numbers that repeat.
    """

    kernels: tuple[tuple[Kernel, ...], ...]
    tile: Tile

    @classmethod
    def of(
        cls, given: Mapping[str, Mapping[str, Kernel]], names: tuple[str, ...], tile: Tile
    ) -> Crosstalk | None:
        """None where each pixel keeps its electrons.  given : shares of the filters whose pixels do not."""
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
        """How far away a pixel is that gets electrons."""
        return len(self.kernels[0][0]) // 2

    def mixed(self, wider: Electrons, origin: tuple[int, int]) -> Electrons:
        """What the pixels of a window collect.

        wider : mean photoelectrons of the window and ``reach_px`` pixels about it, on NumPy.
        origin : row and column of the first of these on the sensor.
        """
        freed = np.minimum(wider.light, FLOAT32_LIMIT)
        light = self._collected(freed, origin)
        if wider.variance_e2 is not None:
            variance = self._collected(wider.variance_e2, origin, power=2)
            return replace(wider, light=light, variance_e2=variance)
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

    def _collected(
        self, values: Array, origin: tuple[int, int], power: int = 1
    ) -> Float64Array:
        """Σ over the pixels about each one of their values times their shares, or a power of these."""
        side, (height, width) = 2 * self.reach_px + 1, values.shape
        rows, columns = height - side + 1, width - side + 1
        receiving = origin[0] + self.reach_px, origin[1] + self.reach_px
        found = np.zeros((rows, columns))
        for row, column in product(range(side), repeat=2):
            # what goes so many rows down comes from as many rows above
            top, left = side - 1 - row, side - 1 - column
            of_pairs = ((kernel[row][column] for kernel in one) for one in self.kernels)
            shares = np.array([list(of_source) for of_source in of_pairs]) ** power
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
        """The share of every pair of pixels by their filters, (H, W), or one for all.

        giving, receiving : row and column of the first of them on the sensor.
        """
        if np.ptp(shares) == 0:
            return shares[0, 0]
        return shares[self._filters(giving, shape), self._filters(receiving, shape)]

    def _filters(self, origin: tuple[int, int], shape: tuple[int, ...]) -> NDArray[np.intp]:
        """Filter numbers of the pixels of a window, (H, W)."""
        tile = np.array(self.tile)
        rows, columns = (
            (np.arange(length) + first) % period
            for length, first, period in zip(shape, origin, tile.shape, strict=True)
        )
        return np.asarray(tile[np.ix_(rows, columns)])
