"""Checks for benches that would be measured wrongly: copied frames, mosaics without a tile, saturated dark frames, dead
or stuck lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from .bench import Bench
from .stack import Stack

COMPARED_ROWS_STEP = 16
"""Every 16th row of two frames is compared first."""
COPY_CODES_MIN = 12
"""Number of codes in a frame; frames of fewer codes may be equal at random."""
FILTER_DIFFERENCE_MIN = 0.05
"""Relative difference of the four signals of 2 × 2 tiles with colour filters; channels of a sensor differ less."""
SATURATION_SIDE, SATURATION_FRAMES = 256, 16
"""Central rows and columns, and frames, that show whether a dark stack is saturated."""
RESPONSE_MIN, RESPONSE_MAX = 0.5, 1.5
"""Response of a line over the median response; lines outside are filled."""
MEDIAN_FRAMES = 9
"""Number of frames whose median shows dead and stuck lines."""
DEFECT_LINES_MAX = 0.02
"""Largest fraction of the rows or columns that can be defects; more are uneven light."""


def sound(bench: Bench) -> tuple[Bench, list[str]]:
    """Return the bench without saturated dark stacks and with filled dead and stuck lines, and notes on both.

    Raises InputError for copied frames, and for flat fields of a mosaic without a tile.
    """
    for stack in bench.stacks:
        _refuse_copies(stack)
        stack.release()
    _refuse_mosaic(bench)
    bench, saturated = _without_saturated_darks(bench)
    bench, stuck = with_lines_filled(bench)
    return bench, [note for note in (saturated, stuck) if note]


def _refuse_copies(stack: Stack) -> None:
    """Raise InputError if a frame is a copy of another one."""
    first_frame: dict[bytes, int] = {}
    for number, frame in enumerate(stack.frames):
        rows = np.ascontiguousarray(frame[::COMPARED_ROWS_STEP])
        first = first_frame.setdefault(rows.tobytes(), number)
        if first == number or len(np.unique(rows)) < COPY_CODES_MIN:
            continue
        if np.array_equal(frame, stack.frames[first]):
            raise InputError(
                f"{stack.source}: frames {first + 1} and {number + 1} are identical, and copies show no temporal "
                "noise; leave them out."
            )


def _refuse_mosaic(bench: Bench) -> None:
    """Raise InputError if the four signals of 2 × 2 tiles differ, as with colour filters."""
    flats = [flat for flat in bench.flats if not flat.tile and flat.clipping.usable]
    if not flats or bench.stacks[0].tile or min(flats[0].shape) < 8 or not bench.unlit:
        return
    flat, dark = max(flats, key=lambda stack: float(stack.frame_means[0])), bench.unlit[0]
    if dark.shape != flat.shape:
        return
    signal = flat.frames[0].astype(np.float64) - dark.frames[0]
    height, width = (size // 2 * 2 for size in flat.shape)
    tiles = signal[:height, :width].reshape(height // 2, 2, width // 2, 2).swapaxes(1, 2)
    tiles = tiles.reshape(-1, 4)
    means = np.median(tiles, axis=0)
    error = 1.25 * float(tiles.std(axis=0).mean()) / len(tiles) ** 0.5
    if float(np.ptp(means)) > max(FILTER_DIFFERENCE_MIN * abs(means.mean()), 10 * error):
        shown = ", ".join(f"{mean:.4g}" for mean in means)
        raise InputError(
            f"{flat.source}: the four places of 2 × 2 tiles have signals of {shown} DN, as with colour filters; state "
            'the tile, e.g. tile = [["R", "G"], ["G", "B"]] in the manifest.'
        )


def _without_saturated_darks(bench: Bench) -> tuple[Bench, str]:
    """Return the bench without saturated dark stacks, which have less than half of the variance of darker stacks."""
    points = {id(s): _mean_and_variance(s) for s in bench.stacks if len(s) > 1}
    shortest_s = min((dark.exposure_s for dark in bench.unlit), default=0.0)
    full: dict[int, Stack] = {}
    for dark in bench.unlit:
        mean, variance = points.get(id(dark), (0.0, 0.0))
        darker = [noise for other, noise in points.values() if other < mean]
        if dark.exposure_s > shortest_s and max(darker, default=0.0) > max(2 * variance, 1.0):
            full[id(dark)] = dark
    if not full:
        return bench, ""
    times = ", ".join(f"{stack.exposure_s:g} s" for stack in full.values())
    kept = bench.change(lambda stacks: [stack for stack in stacks if id(stack) not in full])
    return kept, f"dark frames of {times} are saturated and left out"


def _mean_and_variance(stack: Stack) -> tuple[float, float]:
    """Return mean [DN] and temporal variance within rows [DN²] of the centre, without flicker."""
    frames = stack.centre(SATURATION_SIDE).frames[:SATURATION_FRAMES].astype(np.float64)
    stack.release()
    mean = float(frames.mean())
    frames -= frames.mean(axis=2, keepdims=True)
    return mean, float(frames.var(axis=0, ddof=1).mean())


def with_lines_filled(bench: Bench) -> tuple[Bench, str]:
    """Return a bench whose dead and stuck lines have the values of the nearest line of the same filter, and a note."""
    tile = bench.stacks[0].tile or (("",),)
    periods = len(tile), len(tile[0])
    stuck: tuple[set[int], set[int]] = set(), set()
    for number, part in enumerate(bench.of_filters().values()):
        first = number // periods[1], number % periods[1]
        for axis, lines in enumerate(_stuck_lines(part)):
            stuck[axis].update(first[axis] + periods[axis] * line for line in lines.tolist())
    if not any(stuck):
        return bench, ""
    taken = [
        _nearest_others(count, lines, period)
        for count, lines, period in zip(bench.stacks[0].shape, stuck, periods, strict=True)
    ]

    def fill(stacks: Sequence[Stack]) -> list[Stack]:
        return [replace(s, frames=s.frames[:, taken[0]][:, :, taken[1]]) for s in stacks]

    text = " and ".join(
        f"{name}{'s' * (len(lines) > 1)} {', '.join(map(str, sorted(lines)[:5]))}"
        for name, lines in zip(("row", "column"), stuck, strict=True)
        if lines
    )
    note = "lines that respond to light unlike the others have the values of their neighbours"
    return bench.change(fill), f"{note}: {text}"


def _nearest_others(count: int, stuck: set[int], period: int) -> NDArray[np.intp]:
    """Return the number of each line or, for a stuck line, of the nearest line of the same filter, shape (count,)."""
    taken = np.arange(count)
    for number in stuck:
        alike = [k for k in range(number % period, count, period) if k not in stuck]
        taken[number] = min(alike, key=lambda k: abs(k - number), default=number)
    return taken


def _stuck_lines(bench: Bench) -> list[NDArray[np.intp]]:
    """Return dead and stuck rows and columns of a bench with one filter.

    Medians of the flat field nearest to half of the brightest one, minus a dark frame, show them; hot pixels and uneven
    light do not move medians. Lines are no defects if too many of them respond differently.
    """
    darks = (*bench.darks, *bench.biases)
    if not darks or not bench.flats:
        return []
    dark = np.median(darks[0].frames[:MEDIAN_FRAMES], axis=0)
    levels = np.array([float(np.median(flat.frames[0])) for flat in bench.flats])
    half = 0.5 * (levels.max() + float(np.median(dark)))
    flat = bench.flats[int(np.argmin(np.abs(levels - half)))]
    if flat.shape != dark.shape:
        return []
    signal = np.median(flat.frames[:MEDIAN_FRAMES], axis=0) - dark
    lines: list[NDArray[np.intp]] = []
    for axis in (1, 0):
        responses = np.median(signal, axis=axis)
        median = float(np.median(responses))
        ratio = responses / max(median, 1e-300)
        numbers = np.flatnonzero((ratio < RESPONSE_MIN) | (ratio > RESPONSE_MAX))
        are_few = len(numbers) <= max(1, DEFECT_LINES_MAX * len(responses))
        lines.append(numbers if median > 0 and are_few else numbers[:0])
    return lines
