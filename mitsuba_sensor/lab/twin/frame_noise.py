"""Jitter of the black level: what all pixels of a dark frame share, from the scatter of the frames' means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..frames.stack import Stack
from ..quantity import no_value, unknown
from ..statistics.mean_squares import MeanSquare, root, temporal_mean_squares
from .evidence import Fitted, frames_of

FRAME = no_value("σ_frame", "jitter of the black level from frame to frame", "DN", "fit")


def frame_noise(stacks: Sequence[Stack], slope: float = 1.0) -> Fitted:
    """σ of the frames' means beyond what rows, columns and pixels leave in them, of all dark stacks together.

    Between stacks the black level may drift: only what scatters within them counts.
    slope : of the mean code over the signal, which rounding makes other than 1 where noise is small [DN/DN].
    """
    used = [stack for stack in stacks if len(stack) > 1]
    freedom = sum(len(stack) - 1 for stack in used)
    if not freedom:
        return Fitted(unknown(FRAME, "no stack has 2 frames"), "")
    between = within = 0.0
    for stack in used:
        share = (len(stack) - 1) / freedom
        between += share * float(stack.frame_means.var(ddof=1))
        within += share * temporal_mean_squares(stack).variance_of_mean()
    lines = freedom * (min(used[0].shape) - 1)
    terms = [MeanSquare(between, freedom), -MeanSquare(within, max(lines, 1))]
    value, low, high = root(terms, 1 / slope)
    figure = replace(FRAME, value=value, low=low, high=high)
    if not low > 0:
        figure = replace(figure, value=0.0).noted("not told from 0")
    return Fitted(figure, frames_of(*used))
