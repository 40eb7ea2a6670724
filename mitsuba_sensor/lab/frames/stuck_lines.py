"""Rows and columns without a response to light, which clip every stack: left out of a bench, and named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .bench import Bench
from .stack import Stack

LEAST_RESPONSE, LARGEST_RESPONSE = 0.5, 1.5
"""Response of a line over that of the middle one, outside of which it is left out."""
MOST_SHARE = 0.02
"""Share of the rows, or of the columns, up to which they are defects; more are uneven light."""


def without_stuck_lines(bench: Bench) -> tuple[Bench, str]:
    """A bench of one filter without its dead and stuck rows and columns, and a note which these are, or nothing.

    They show in the flat field nearest to half of the brightest one, less a dark frame; in medians, which neither hot
    pixels nor uneven light move.
    """
    darks = (*bench.darks, *bench.biases)
    if not darks or not bench.flats:
        return bench, ""
    dark = np.median(darks[0].frames, axis=0)
    levels = [float(np.median(flat.frames[0])) for flat in bench.flats]
    half = 0.5 * (max(levels) + float(np.median(dark)))
    flat = bench.flats[int(np.argmin(np.abs(np.array(levels) - half)))]
    if flat.shape != darks[0].shape or not flat.mean.size:
        return bench, ""
    signal = np.median(flat.frames, axis=0) - dark
    rows, columns = (_stuck(np.median(signal, axis=axis)) for axis in (1, 0))
    texts: list[str] = []
    for name, lines in (("row", rows), ("column", columns)):
        if len(lines):
            texts.append(f"{name}{'s' * (len(lines) > 1)} {', '.join(map(str, lines[:5]))}")
    if not texts:
        return bench, ""

    def keep(stacks: Sequence[Stack]) -> list[Stack]:
        return [_without(stack, rows, columns) for stack in stacks]

    note = f"without the response of light of the others, and left out: {' and '.join(texts)}"
    return bench.change(keep), note


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


def _without(stack: Stack, rows: np.ndarray, columns: np.ndarray) -> Stack:
    """A stack without some rows and columns; a copy."""
    frames = np.delete(np.delete(stack.frames, rows, axis=1), columns, axis=2)
    photons = stack.photons
    if isinstance(photons, np.ndarray):
        photons = np.delete(np.delete(photons, rows, axis=0), columns, axis=1)
    return replace(stack, frames=frames, photons=photons)
