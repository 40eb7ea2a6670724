"""Clean frame and temporal variance: expectation of each pixel of one sensor unit.

A straight chain has a closed form (stages/straight.py); any other chain uses the frames of a lattice (lattice.py).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..core import Electrons, Frame
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.run import row_strips_of
from ..sensor.threads import for_each
from ..stages.stage import Chain
from ..stages.straight import NotStraight, StraightChain, line_of, moments
from .lattice import FRAMES, lattice_moments

STRIP_PIXELS = 2**15
"""Pixels that are computed together, so that their arrays stay in the processor's cache."""


class PixelMoments(NamedTuple):
    """Mean [DN] and temporal variance [DN²] of each pixel's code, shape (H, W).  method : the method, for people."""

    mean: Float64Array
    temporal: Float64Array
    method: str


def pixel_moments(stages: Chain, light: Detected, frame: Frame) -> PixelMoments:
    """Return mean and temporal variance of the codes of a window, with the FPN maps of its serial number."""
    try:
        found, method = _straight(stages, light, frame), "closed form"
    except NotStraight as reason:
        found = lattice_moments(stages, light, frame)
        method = f"{FRAMES} frames of a lattice, because {reason}"
    missing = int((~np.isfinite(found[0]) | ~np.isfinite(found[1])).sum())
    if missing:
        raise ArithmeticError(f"the expected code of {missing} pixels is not a number")
    return PixelMoments(*found, method)


def is_straight(stages: Chain, light: Electrons, frame: Frame) -> bool:
    """Return True if the first pixel of a window has a closed form."""
    window = replace(frame.window.crop_rows(slice(0, 1)), shape=(1, 1))
    given = {name: x[:, :1] for name, x in window.given.items()}
    alone = replace(frame, window=replace(window, given=given, _maps={}), _blocks={})
    try:
        line_of(stages, light.mapped(lambda values: values[:1, :1]), alone)
    except NotStraight:
        return False
    return True


def _straight(
    stages: Chain, light: Detected, frame: Frame
) -> tuple[Float64Array, Float64Array]:
    """Return the closed form, computed strip by strip. Raises NotStraight."""
    StraightChain.of(stages)
    shape = frame.window.shape
    found = np.empty((2, *shape))

    def write(rows: slice) -> None:
        window = frame.window  # has its maps already, if it is one strip
        if rows != slice(0, shape[0]):
            window = window.crop_rows(rows)
        part = replace(frame, window=window, _blocks={})
        codes = moments(line_of(stages, light.crop_rows(rows).signal, part))
        found[:, rows] = np.reshape(codes, (2, *part.window.shape))

    for_each(write, row_strips_of(shape, STRIP_PIXELS))
    return found[0], found[1]
