"""Frames of a chart and their black level: what every instrument of the sheet begins with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.frames.stack import Stack


def frames_and_black(stacks: Sequence[Stack], bench: Bench) -> tuple[Stack, Float64Array]:
    """The first of these stacks, and the mean of the dark frames of the bench (H, W).

    Raises InputError where either is missing, and where they differ in size.
    """
    if not stacks or not bench.darks:
        raise InputError(
            f"{len(stacks)} pictures of the chart and {len(bench.darks)} stacks of dark frames; take both, with names "
            "that begin with scene and dark."
        )
    frames, dark = stacks[0], bench.darks[0]
    if frames.shape != dark.shape:
        raise InputError(
            f"{frames.source} has {frames.shape[0]} × {frames.shape[1]} pixels and {dark.source} {dark.shape[0]} × "
            f"{dark.shape[1]}; take dark frames of the same size."
        )
    return frames, dark.mean


def without_black(stacks: Sequence[Stack], bench: Bench) -> Float64Array:
    """Mean of the first of these stacks less that of the dark frames."""
    frames, black = frames_and_black(stacks, bench)
    return np.asarray(frames.mean - black)
