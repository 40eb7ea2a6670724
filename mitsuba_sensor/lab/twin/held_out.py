"""Frames that a fit does not see, to compare with those of the twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..bench import Bench
from ..stack import Stack

SHARE, FEWEST = 0.25, 8
"""Of the frames of a stack that are held out, and of how many at least: 2 stay out and 6 in."""


def held_out(bench: Bench) -> tuple[Bench, Bench]:
    """(the frames to fit, the frames to compare with): the last quarter of each stack of 8 frames or more is held out.

    Both are views of the same frames.
    """
    return _part(bench, True), _part(bench, False)


def _part(bench: Bench, first: bool) -> Bench:
    biases, darks, flats = (_parts(some, first) for some in (bench.biases, bench.darks, bench.flats))
    return Bench(biases, darks, flats, (), bench.wavelength_nm)


def _parts(stacks: Sequence[Stack], first: bool) -> tuple[Stack, ...]:
    return tuple(found for stack in stacks if (found := _of(stack, first)) is not None)


def _of(stack: Stack, first: bool) -> Stack | None:
    count = int(SHARE * len(stack)) if len(stack) >= FEWEST else 0
    if first:
        return replace(stack, frames=stack.frames[: len(stack) - count]) if count else stack
    return replace(stack, frames=stack.frames[len(stack) - count :]) if count else None
