"""Benches that would be measured wrongly without an error: copies, mosaics without a tile, saturated dark frames, and
rows and columns without a response to light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from .bench import Bench
from .stack import Stack

COMPARED = 16
"""Every so many rows of two frames are compared first."""
FEWEST_CODES = 12
"""Of a frame: without noise, offsets of so many codes would put some pixels between two of them."""
LEAST_DIFFERENCE = 0.05
"""Relative difference of the signals at the places of 2 × 2 tiles, from which on they are colour filters; channels of
a sensor differ by less."""
SEEN, SEEN_FRAMES = 256, 16
"""Rows and columns of the centre, and frames, that tell whether a dark stack is saturated."""
LEAST_RESPONSE, LARGEST_RESPONSE = 0.5, 1.5
"""Response of a line over that of the middle one, outside of which it is filled."""
MEDIAN_FRAMES = 9
"""Frames whose median shows dead and stuck lines."""
MOST_LINES = 0.02
"""Share of the rows, or of the columns, up to which they are defects; more are uneven light."""


def sound(bench: Bench) -> tuple[Bench, list[str]]:
    """The bench without saturated dark stacks, dead and stuck lines filled by their neighbours, and notes on both.

    Raises InputError for frames that are copies, and for flat fields of a mosaic without a tile.
    """
    for stack in bench.stacks:
        _refuse_copies(stack)
        stack.release()
    _refuse_mosaic(bench)
    bench, saturated = _without_saturated_darks(bench)
    bench, stuck = with_lines_filled(bench)
    return bench, [note for note in (saturated, stuck) if note]


def _refuse_copies(stack: Stack) -> None:
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
    if float(np.ptp(means)) > max(LEAST_DIFFERENCE * abs(means.mean()), 10 * error):
        shown = ", ".join(f"{mean:.4g}" for mean in means)
        raise InputError(
            f"{flat.source}: the four places of 2 × 2 tiles have signals of {shown} DN, as behind colour filters; give "
            'the tile, e.g. tile = [["R", "G"], ["G", "B"]] in the manifest.'
        )


def _without_saturated_darks(bench: Bench) -> tuple[Bench, str]:
    """The bench without dark stacks at the end of the range, whose noise is less than half of that of darker stacks."""
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
    return kept, f"dark frames of {times} are saturated, and left out"


def _mean_and_variance(stack: Stack) -> tuple[float, float]:
    """Mean [DN] and temporal variance within rows [DN²] at the centre: light that flickers is no noise."""
    frames = stack.centre(SEEN).frames[:SEEN_FRAMES].astype(np.float64)
    stack.release()
    mean = float(frames.mean())
    frames -= frames.mean(axis=2, keepdims=True)
    return mean, float(frames.var(axis=0, ddof=1).mean())


def with_lines_filled(bench: Bench) -> tuple[Bench, str]:
    """A bench whose dead and stuck lines have the values of the nearest others of their filter, and a note."""
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
    note = "without the response of light of the others, and taken from their neighbours"
    return bench.change(fill), f"{note}: {text}"


def _nearest_others(count: int, stuck: set[int], period: int) -> NDArray[np.intp]:
    """For every line its own number, for a stuck one that of the nearest other of the same filter, (count,)."""
    taken = np.arange(count)
    for number in stuck:
        alike = [k for k in range(number % period, count, period) if k not in stuck]
        taken[number] = min(alike, key=lambda k: abs(k - number), default=number)
    return taken


def _stuck_lines(bench: Bench) -> list[NDArray[np.intp]]:
    """Dead and stuck rows and columns of a bench of one filter.

    They show in the flat field nearest to half of the brightest one, less a dark frame; in medians, which neither hot
    pixels nor uneven light move. Where too many lines have another response, it is not the lines.
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
        share = responses / max(float(np.median(responses)), 1e-300)
        numbers = np.flatnonzero((share < LEAST_RESPONSE) | (share > LARGEST_RESPONSE))
        is_few = np.median(responses) > 0 and len(numbers) <= max(
            1, MOST_LINES * len(responses)
        )
        lines.append(numbers if is_few else numbers[:0])
    return lines
