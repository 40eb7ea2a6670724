"""Global and rolling shutter: the exposure of each row of the film, and the sub-frames that form its image.

A frame is the weighted sum of sub-frames, which are renders of the scene at the instants t_k = t_0 + (k + u)·Δ. The
phase u, from 0 to 1, is random for the first pass; later passes lie in between (see :func:`phase_of_pass`). Every row
uses the m consecutive sub-frames around the middle of its exposure, each with weight 1/m. With Δ = exposure/m, exactly
m instants fall into an exposure at any start, so the weights of every row sum to 1 in every pass. Over the passes, all
instants of the exposure are equally probable, so the blur is the blur of the open shutter, without ghosts (systematic
sampling with a random start). A new random u in each of P passes would shorten the blur by 1/(2·m²·P), and make its
length uncertain by twice as much.

For a flickering light source, the weight 1/m is replaced by the light in part j of the m equal parts of the row's
exposure, ∫w over the part divided by ∫w over the exposure. With Δ = exposure/m, the instant lies in this part, so a
moving object appears within half a part of its position at each flash.

Global shutter: all rows open at the start of the frame. Rolling shutter: row r of the film opens r·t_row later, from
top to bottom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import Exposure, Float64Array

if TYPE_CHECKING:
    from ..camera.camera import Camera
    from .waveform import Waveform

GOLDEN_RATIO = (1 + math.sqrt(5)) / 2
STEP_PX = 0.5  # largest image motion between sub-frames: half of what a pixel averages anyway


@dataclass(frozen=True)
class Shutter:
    """Exposure of the rows of a frame.

    open_s : exposure time of a row [s].  row_time_s : delay between the starts of consecutive rows; 0 for a global
    shutter.  begin_s : start of row 0 and of the frame.
    """

    open_s: float
    row_time_s: float = 0.0
    begin_s: float = 0.0

    def start_s(self, rows: ArrayLike) -> Float64Array:
        """Return when rows of the film open [s]."""
        return self.begin_s + np.asarray(rows, dtype=float) * self.row_time_s

    def span_s(self, rows: tuple[int, int]) -> tuple[float, float]:
        """Return the start of the first and the end of the last of the rows [first, last) [s]."""
        first_s, last_s = self.start_s((rows[0], rows[1] - 1)).tolist()
        return first_s, last_s + self.open_s

    def subframes_needed(self, speed_px_per_s: float) -> int:
        """Return how many sub-frames an exposure needs at this image speed; at least 1."""
        return max(math.ceil(self.open_s * speed_px_per_s / STEP_PX - 1e-9), 1)

    def step_s(self, count: int, speed_px_per_s: float, rows: tuple[int, int]) -> float:
        """Return Δ [s] between the sub-frames of the rows [first, last), ``count`` per exposure.

        Rows of a rolling shutter share a sub-frame if the image moves less than STEP_PX between their starts.
        """
        first, last = self.span_s(rows)
        shared = last - first
        if speed_px_per_s > 0:
            shared = min(STEP_PX / speed_px_per_s, shared)
        return max(self.open_s, shared, self.row_time_s) / count


def phase_of_pass(first: float, number: int) -> float:
    """Return the phase u, 0 to 1, of a pass; pass 0 has the phase ``first``.

    Steps of the golden ratio space the phases of any number of passes about evenly.
    """
    return (first + number * GOLDEN_RATIO) % 1.0


def subframes(
    shutter: Shutter,
    rows: tuple[int, int],
    count: int,
    step_s: float,
    phase: float,
    waveform: Waveform | None = None,
) -> tuple[Float64Array, Float64Array]:
    """Return the K instants [s] of the sub-frames of the rows [first, last), and their weights, shape (rows, K).

    step_s : Δ.  count : sub-frames per row; the weights of a row sum to 1.  phase : u, from 0 to 1. Averaged over u, a
    row weights the time ``count``·Δ around the middle of its exposure evenly.  waveform : of flickering light.
    """
    opens = shutter.start_s(np.arange(*rows))
    starts = opens + (shutter.open_s - count * step_s) / 2
    steps_later = (starts - starts[0]) / step_s if step_s else np.zeros(len(starts))
    first = np.ceil(steps_later - phase).astype(np.intp)
    numbers = np.arange(first[0], first[-1] + count)
    offset = numbers - first[:, None]
    shares = np.full((len(starts), count), 1 / count)
    if waveform is not None:
        shares = waveform.shares(opens, shutter.open_s, count)
    nearest = np.take_along_axis(shares, np.clip(offset, 0, count - 1), axis=1)
    weights = np.where((offset >= 0) & (offset < count), nearest, 0.0)
    return starts[0] + (numbers + phase) * step_s, np.asarray(weights)


def displaced_share(
    shutter: Shutter, rows: tuple[int, int], count: int, waveform: Waveform
) -> float:
    """Return the largest fraction of a row's light that twice as many sub-frames would place in the other half."""
    halves = waveform.shares(shutter.start_s(np.arange(*rows)), shutter.open_s, 2 * count)
    return float(np.abs(halves[:, ::2] - halves[:, 1::2]).sum(axis=1).max() / 2)


def shutter_of(camera: Camera, exposure: Exposure, begin_s: float = 0.0) -> Shutter:
    """Return the shutter of the datasheet for this exposure, in a frame that starts at ``begin_s``."""
    sensor = camera.sensor
    row_time_us = sensor.row_time_us or 0.0 if sensor.shutter == "rolling" else 0.0
    return Shutter(exposure.time_s, row_time_us * 1e-6, begin_s)
