"""Benches that would be measured wrongly without an error: copies, mosaics without a tile, saturated dark frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core import InputError
from .bench import Bench
from .selection import darks_of
from .stack import Stack, centre

COMPARED = 16
"""Every so many rows of two frames are compared first."""
FEWEST_CODES = 12
"""Of a frame: without noise, offsets of so many codes would put some pixels between two of them."""
LEAST_DIFFERENCE = 0.05
"""Relative difference of the signals at the places of 2 × 2 tiles, from which on they are colour filters; channels of
a sensor differ by less."""
SEEN, SEEN_FRAMES = 256, 16
"""Rows and columns of the centre, and frames, that tell whether a dark stack is saturated."""


def sound(bench: Bench) -> tuple[Bench, str]:
    """The bench without saturated dark stacks, and a note about these, or nothing.

    Raises InputError for frames that are copies, and for flat fields of a mosaic without a tile.
    """
    for stack in bench.stacks:
        refuse_copies(stack)
    _refuse_mosaic(bench)
    return _without_saturated_darks(bench)


def refuse_copies(stack: Stack) -> None:
    """Raises InputError where a frame is a copy of another one; frames of few codes may be equal by chance."""
    first_frame: dict[bytes, int] = {}
    for number, frame in enumerate(stack.frames):
        some = np.ascontiguousarray(frame[::COMPARED]).tobytes()
        first = first_frame.setdefault(some, number)
        if first == number or len(np.unique(frame[::COMPARED])) < FEWEST_CODES:
            continue
        if np.array_equal(frame, stack.frames[first]):
            raise InputError(
                f"{stack.source}: frames {first + 1} and {number + 1} are identical; copies show no temporal "
                "noise, leave them out."
            )


def _refuse_mosaic(bench: Bench) -> None:
    """Raises InputError where the four places of 2 × 2 tiles have other signals, as behind colour filters."""
    flats = [flat for flat in bench.flats if not flat.tile and flat.clipping.usable]
    if not flats or bench.stacks[0].tile or min(flats[0].shape) < 8 or not darks_of(bench):
        return
    flat, dark = max(flats, key=lambda stack: float(stack.frame_means[0])), darks_of(bench)[0]
    if dark.shape != flat.shape:
        return
    signal = flat.frames[0].astype(np.float64) - dark.frames[0]
    height, width = (size // 2 * 2 for size in flat.shape)
    tiles = signal[:height, :width].reshape(height // 2, 2, width // 2, 2).swapaxes(1, 2)
    tiles = tiles.reshape(-1, 4)
    means = np.median(tiles, axis=0)
    error = 1.25 * float(tiles.std(axis=0).mean()) / len(tiles) ** 0.5
    difference = float(np.ptp(means))
    if difference > max(LEAST_DIFFERENCE * abs(means.mean()), 10 * error):
        shown = ", ".join(f"{mean:.4g}" for mean in means)
        raise InputError(
            f"{flat.source}: the four places of 2 × 2 tiles have signals of {shown} DN, as behind colour filters; give "
            'the tile, e.g. tile = [["R", "G"], ["G", "B"]] in the manifest.'
        )


def _without_saturated_darks(bench: Bench) -> tuple[Bench, str]:
    """The bench without dark stacks at the end of the range, whose noise is less than half of that of darker stacks."""
    points = [_mean_and_variance(stack) for stack in bench.stacks if len(stack) > 1]
    shortest_s = min((dark.exposure_s for dark in darks_of(bench)), default=0.0)
    full: list[Stack] = []
    for dark in darks_of(bench):
        if len(dark) < 2 or dark.exposure_s == shortest_s:
            continue
        mean, variance = _mean_and_variance(dark)
        if any(other < mean and more > max(2 * variance, 1.0) for other, more in points):
            full.append(dark)
    if not full:
        return bench, ""

    def keep(stacks: Sequence[Stack]) -> list[Stack]:
        return [stack for stack in stacks if not any(stack is other for other in full)]

    times = ", ".join(f"{stack.exposure_s:g} s" for stack in full)
    return bench.change(keep), f"dark frames of {times} are saturated, and left out"


def _mean_and_variance(stack: Stack) -> tuple[float, float]:
    """Mean [DN] and temporal variance within rows [DN²] at the centre: light that flickers is no noise."""
    frames = centre(stack, SEEN).frames[:SEEN_FRAMES].astype(np.float64)
    mean = float(frames.mean())
    frames -= frames.mean(axis=2, keepdims=True)
    return mean, float(frames.var(axis=0, ddof=1).mean())
