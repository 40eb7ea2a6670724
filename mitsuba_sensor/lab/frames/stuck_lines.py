"""Rows and columns without a response to light, which clip every stack: filled by their neighbours, and named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .bench import Bench
from .stack import Stack

LEAST_RESPONSE, LARGEST_RESPONSE = 0.5, 1.5
"""Response of a line over that of the middle one, outside of which it is filled."""
REASON = "without the response of light of the others"
FRAMES = 9
"""Frames whose median shows dead and stuck lines."""
MOST_SHARE = 0.02
"""Share of the rows, or of the columns, up to which they are defects; more are uneven light."""


class StuckLines(NamedTuple):
    """Numbers of rows and of columns."""

    rows: np.ndarray
    columns: np.ndarray

    @property
    def text(self) -> str:
        """Their names, nothing where there are none."""
        texts: list[str] = []
        for name, lines in (("row", self.rows), ("column", self.columns)):
            if len(lines):
                plural = "s" * (len(lines) > 1)
                texts.append(f"{name}{plural} {', '.join(map(str, lines[:5]))}")
        return " and ".join(texts)


def with_lines_filled(bench: Bench) -> tuple[Bench, str]:
    """A bench whose dead and stuck lines have the values of the nearest others of their filter, and a note."""
    rows, columns = set[int](), set[int]()
    tile = bench.stacks[0].tile or (("",),)
    height, width = len(tile), len(tile[0])
    for number, part in enumerate(bench.of_filters().values()):
        found = _find(part)
        rows |= {number // width + height * int(row) for row in found.rows}
        columns |= {number % width + width * int(column) for column in found.columns}
    lines = StuckLines(np.array(sorted(rows), np.intp), np.array(sorted(columns), np.intp))
    if not lines.text:
        return bench, ""
    shape = bench.stacks[0].shape
    taken_rows = _nearest_others(shape[0], lines.rows, height)
    taken_columns = _nearest_others(shape[1], lines.columns, width)

    def fill(stacks: Sequence[Stack]) -> list[Stack]:
        filled: list[Stack] = []
        for stack in stacks:
            frames = stack.frames[:, taken_rows][:, :, taken_columns]
            filled.append(replace(stack, frames=frames))
        return filled

    return bench.change(fill), f"{REASON}, and taken from their neighbours: {lines.text}"


def _nearest_others(count: int, stuck: np.ndarray, period: int) -> np.ndarray:
    """For every line its own number, for a stuck one that of the nearest other of the same filter, (count,)."""
    numbers = np.arange(count)
    others = np.setdiff1d(numbers, stuck)
    taken = numbers.copy()
    for number in stuck:
        alike = others[(others - number) % period == 0]
        if len(alike):
            taken[number] = alike[np.argmin(np.abs(alike - number))]
    return taken


def _find(bench: Bench) -> StuckLines:
    """Dead and stuck rows and columns of a bench of one filter.

    They show in the flat field nearest to half of the brightest one, less a dark frame; in medians, which neither hot
    pixels nor uneven light move.
    """
    darks = (*bench.darks, *bench.biases)
    nothing = StuckLines(np.empty(0, np.intp), np.empty(0, np.intp))
    if not darks or not bench.flats:
        return nothing
    dark = np.median(darks[0].frames[:FRAMES], axis=0)
    levels = [float(np.median(flat.frames[0])) for flat in bench.flats]
    half = 0.5 * (max(levels) + float(np.median(dark)))
    flat = bench.flats[int(np.argmin(np.abs(np.array(levels) - half)))]
    if flat.shape != darks[0].shape or not flat.mean.size:
        return nothing
    signal = np.median(flat.frames[:FRAMES], axis=0) - dark
    rows, columns = (_stuck(np.median(signal, axis=axis)) for axis in (1, 0))
    return StuckLines(rows, columns)


def _stuck(responses: np.ndarray) -> np.ndarray:
    """Numbers of the lines with another response; none where too many have one."""
    middle = float(np.median(responses))
    if middle <= 0:
        return np.empty(0, np.intp)
    share = responses / middle
    numbers = np.flatnonzero((share < LEAST_RESPONSE) | (share > LARGEST_RESPONSE))
    if len(numbers) > max(1.0, MOST_SHARE * len(responses)):
        return np.empty(0, np.intp)
    return numbers
