"""Global and rolling shutter: when each row of the film is open, and which sub-frames at which instants make its image.

A frame is the weighted sum of sub-frames: renders of the scene at the instants t_k = t_0 + (k +
u)·Δ, with a u from 0 to 1 that is random for the first pass; those of later passes lie between (see
:func:`phase_of_pass`). Every row takes the m consecutive ones about the middle of its own exposure,
each with weight 1/m. With Δ = exposure/m exactly m of the instants fall into an exposure, wherever
it starts, so that the weights of every row add up to 1 in every pass, and over the passes every
instant of the exposure has the same probability: the blur is that of the open shutter, without
ghosts of the sub-frames (systematic sampling with a random start). A new random u in each of P
passes would make the blur short by 1/(2·m²·P), and its length uncertain by twice as much.

Of a lamp that flickers, sub-frame j of a row has the share of the light that the lamp gives in part j of the m equal
parts of the row's exposure, ∫w over the part by ∫w over the exposure, in place of 1/m. Where Δ = exposure/m the instant
lies within that part, so that what moves is seen by each flash where it is within half a part.

Global shutter: all rows open at the begin of the frame. Rolling: row r of the film opens r·t_row later, read from top
to bottom.
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
STEP_PX = 0.5  # largest motion of the image from one sub-frame to the next: half of what a pixel averages anyway


@dataclass(frozen=True)
class Shutter:
    """open_s : exposure time of a row [s].  row_time_s : from the start of a row to that of the next; 0 is global.
    begin_s : when row 0 opens, which is when the frame begins."""

    open_s: float
    row_time_s: float = 0.0
    begin_s: float = 0.0

    def start_s(self, rows: ArrayLike) -> Float64Array:
        """When rows of the film open [s]."""
        return self.begin_s + np.asarray(rows, dtype=float) * self.row_time_s

    def span_s(self, rows: tuple[int, int]) -> tuple[float, float]:
        """From the start of the first of the rows [first, last) to the end of the last [s]."""
        first_s, last_s = self.start_s((rows[0], rows[1] - 1)).tolist()
        return first_s, last_s + self.open_s

    def subframes_needed(self, speed_px_per_s: float) -> int:
        """How many sub-frames an exposure needs when the image moves this fast; at least 1."""
        return max(math.ceil(self.open_s * speed_px_per_s / STEP_PX - 1e-9), 1)

    def step_s(self, count: int, speed_px_per_s: float, rows: tuple[int, int]) -> float:
        """Δ [s] between the sub-frames of the rows [first, last), ``count`` of them in an exposure.

        Where the image hardly moves while a row is open, neighbouring rows of a rolling shutter share a sub-frame:
        those that open within the time in which it moves by STEP_PX, at most all of them.
        """
        first, last = self.span_s(rows)
        shared = last - first
        if speed_px_per_s > 0:
            shared = min(STEP_PX / speed_px_per_s, shared)
        return max(self.open_s, shared, self.row_time_s) / count


def phase_of_pass(first: float, number: int) -> float:
    """Phase u of the pass with this number, 0 to 1, where the pass 0 has the phase ``first``.

    Steps of the golden ratio: however many passes there are, their phases are about evenly apart.
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
    """Sub-frames Δ = ``step_s`` apart for the rows [first, last) of the film, ``count`` for each row.

    Returns their K instants [s], and the share of each in each row, (rows, K); every row adds up to 1.
    phase : u, from 0 to 1. Averaged over u, a row weights the time ``count``·Δ about the middle of its exposure evenly.
    waveform : of a light that flickers; None of one that does not.
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
    own = np.take_along_axis(shares, np.clip(offset, 0, count - 1), axis=1)
    weights = np.where((offset >= 0) & (offset < count), own, 0.0)
    return starts[0] + (numbers + phase) * step_s, np.asarray(weights)


def displaced_share(
    shutter: Shutter, rows: tuple[int, int], count: int, waveform: Waveform
) -> float:
    """The largest share of the light of a row that twice as many sub-frames would have in the other half of a part."""
    halves = waveform.shares(shutter.start_s(np.arange(*rows)), shutter.open_s, 2 * count)
    return float(np.abs(halves[:, ::2] - halves[:, 1::2]).sum(axis=1).max() / 2)


def shutter_of(camera: Camera, exposure: Exposure, begin_s: float = 0.0) -> Shutter:
    """The shutter that the datasheet describes, open for this exposure, in a frame that begins at ``begin_s``."""
    sensor = camera.sensor
    row_time_us = sensor.row_time_us or 0.0 if sensor.shutter == "rolling" else 0.0
    return Shutter(exposure.time_s, row_time_us * 1e-6, begin_s)
