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
from pydantic import Field, model_validator

from ..core import Electrons, arrays
from ..core.backend import FLOAT32_LIMIT
from ..core.types import Array, Float64Array
from .datasheet import Chance, FileTable, NotNegative
from .effects.quantum_yield import bursts

Kernel = tuple[tuple[Chance, ...], ...]
SIDES = (3, 5)
ROUNDING = 1e-9
"""By which a sum of shares that were rounded in a file may pass 1."""

EXAMPLE = [[0.0, 0.02, 0.0], [0.02, 0.92, 0.02], [0.0, 0.02, 0.0]]


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

    diffusion_um: tuple[NotNegative, ...] | None = Field(
        None,
        title="charge diffusion, diffusion length",
        description="standard deviation of the way that electrons go sideways before they are collected, at each of "
        "wavelengths_nm, instead of crosstalk [µm]",
        examples=[[1.5, 3.0]],
    )

    @model_validator(mode="after")
    def _one_way_of_giving_it(self) -> Self:
        ways = ("crosstalk", "crosstalk_from", "diffusion_um")
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
            _check_kernel("crosstalk", self.crosstalk)
        known = getattr(self, "curves", {})
        for name, kernel in (self.crosstalk_from or {}).items():
            if name not in known:
                raise ValueError(
                    f"crosstalk_from names {name!r}, which has no curve; there are {sorted(known)}"
                )
            _check_kernel(f"crosstalk_from.{name}", kernel)
        return self


def _check_kernel(name: str, kernel: Kernel) -> None:
    """Raise ValueError for another shape, for more electrons than there were, and for a pixel that keeps too few."""
    side = len(kernel)
    if side not in SIDES or any(len(row) != side for row in kernel):
        raise ValueError(
            f"{name} has rows of {', '.join(str(len(row)) for row in kernel)} shares; it must be 3 rows of 3 or "
            f"5 rows of 5, e.g. {EXAMPLE}"
        )
    shares = np.array(kernel)
    if shares.sum() > 1 + ROUNDING:
        raise ValueError(
            f"{name} adds up to {shares.sum():.6g}, and there are no more electrons than the light has freed; "
            "let the shares add up to 1, or less where some are lost"
        )
    if shares[side // 2, side // 2] < max(shares.max(), ROUNDING):
        raise ValueError(
            f"{name} gives {shares[side // 2, side // 2]:g} to the pixel itself and {shares.max():g} to another; the "
            "share in the middle must be the largest"
        )


@dataclass(frozen=True)
class Crosstalk:
    """Shares of the photoelectrons of a pixel that the pixels about it collect.

    kernels : of pixels behind each filter, (2·reach_px + 1)² each.  tile : rows of filter numbers that repeat.
    """

    kernels: tuple[Kernel, ...]
    tile: tuple[tuple[int, ...], ...]

    @classmethod
    def of(
        cls,
        every: Kernel | None,
        by_filter: Mapping[str, Kernel] | None,
        names: tuple[str, ...],
        tile: tuple[tuple[int, ...], ...],
    ) -> Crosstalk | None:
        """None where each pixel keeps its electrons.  every, by_filter : as in the camera file."""
        given = dict.fromkeys(names, every) if every is not None else dict(by_filter or {})
        if not given:
            return None
        reach_px = max(len(kernel) // 2 for kernel in given.values())
        kernels = tuple(_of_reach(given.get(name, ((1.0,),)), reach_px) for name in names)
        if all(kernel == _of_reach(((1.0,),), reach_px) for kernel in kernels):
            return None
        return cls(kernels, tile)

    @property
    def reach_px(self) -> int:
        """How far away a pixel is that gets electrons."""
        return len(self.kernels[0]) // 2

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
        found = np.zeros((rows, columns))
        for row, column in product(range(side), repeat=2):
            # what goes so many rows down comes from as many rows above
            top, left = side - 1 - row, side - 1 - column
            shares = [kernel[row][column] ** power for kernel in self.kernels]
            if any(shares):
                start = origin[0] + top, origin[1] + left
                giving = values[top : top + rows, left : left + columns]
                found += self._of_filters(shares, start, giving.shape) * giving
        return found

    def _of_filters(
        self, shares: list[float], origin: tuple[int, int], shape: tuple[int, ...]
    ) -> Array:
        """The share of every pixel by its filter, (H, W), or one for all."""
        if len(set(shares)) == 1:
            return shares[0]
        tile = np.array(self.tile)
        rows, columns = (
            (np.arange(length) + first) % period
            for length, first, period in zip(shape, origin, tile.shape, strict=True)
        )
        return np.array(shares)[tile[np.ix_(rows, columns)]]


def _of_reach(kernel: Kernel, reach_px: int) -> Kernel:
    """The same shares, with zeros about them."""
    padded = np.pad(np.array(kernel), reach_px - len(kernel) // 2)
    return tuple(tuple(row) for row in padded.tolist())
