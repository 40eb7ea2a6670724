"""Denoises the light behind a polariser mosaic: the pixels of each polariser make a picture of their own.

Neighbours behind other polarisers see other light, which a network would take for texture or noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Float64Array
from .combine import Image
from .denoise import LEAST_PIXELS, Denoised, Halves, denoise
from .guides import Guides

Phase = tuple[slice, slice]


def tile_of(camera: Camera) -> NDArray[np.intp]:
    """Filter numbers in a tile after which filters and polarisers repeat, (rows, columns)."""
    tile, periods = np.array(camera.tile), camera.sensor.polarizer_periods
    times = [math.lcm(own, n) // own for own, n in zip(tile.shape, periods, strict=True)]
    return np.tile(tile, times)


def least_pixels(periods: tuple[int, int]) -> int:
    """Pixels of the smallest picture that can be denoised behind polarisers that repeat so."""
    return LEAST_PIXELS * math.prod(periods)


def phases(periods: tuple[int, int]) -> Iterator[Phase]:
    """Rows and columns of the pixels of each place in a tile that repeats after so many rows and columns."""
    for row, column in np.ndindex(periods):
        yield slice(row, None, periods[0]), slice(column, None, periods[1])


def denoise_each(halves: Halves, guides: Guides | None, periods: tuple[int, int]) -> Denoised:
    """:func:`denoise` of the pixels of each polariser.  periods : rows and columns after which they repeat."""
    if periods == (1, 1):
        return denoise(halves, guides)
    parts = []
    for phase in phases(periods):
        guides_here = None
        if guides is not None:
            guides_here = replace(guides, values=guides.values[phase])
        parts.append(denoise(_of_phase(halves, phase), guides_here))
    shape = (*halves.variance(0).shape, parts[0].mean.shape[2])
    images = {}
    for name in ("mean", "variance", "even", "odd"):
        images[name] = np.empty(shape, np.float32)
        for part, phase in zip(parts, phases(periods), strict=True):
            images[name][phase] = getattr(part, name)
    records: list[dict[str, Any]] = [dict(part.record) for part in parts]
    record = {
        **records[0],
        "raw_weight": float(np.mean([one["raw_weight"] for one in records])),
        "sum_corrected_by": max(one["sum_corrected_by"] for one in records),
    }
    return Denoised(**images, record=record)


def _of_phase(halves: Halves, phase: Phase) -> Halves:
    """The halves of some pixels."""

    def image(of_all: Callable[[], Image]) -> Image:
        return np.ascontiguousarray(of_all()[phase])

    def variance(number: int) -> Float64Array:
        return np.ascontiguousarray(halves.variance(number)[phase])

    even, odd = partial(image, halves.even), partial(image, halves.odd)
    return Halves(even, odd, variance, halves.share)
