"""Report of one frame: theory of every stage, a sample of it, counts of clipped pixels, light outside the QE curve."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..core import Array, Electrons, Frame, Photons
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from .camera import Camera
from .compensation import LIMIT, compensable
from .frame_theory import Averages, FrameTheory
from .gains import gain_dn_per_e
from .light_levels import detected
from .run import row_strips_of
from .stage import UNITS, Chain, Stage, sample, total

SAMPLED = 2**18
"""Pixels of a frame whose signals are followed behind every stage: σ is then known to 0.14 %. Of larger frames these
are strips of rows, evenly spread."""


@dataclass(eq=False)
class FrameReport:
    """The report of the first frame.

    values : ready for JSON.  theory : of every pixel of the frame.
    """

    values: dict[str, Any]
    theory: FrameTheory


class Sample:
    """Signals of one frame behind every stage, against their theory, summed up strip by strip.

    rows : the strips that are followed.
    """

    def __init__(self, theory: FrameTheory) -> None:
        self.theory, self.stages = theory, theory.stages
        height, width = theory.frame.window.shape
        strips = list(row_strips_of((height, width), NUMPY_FLOAT64.strip_pixels))
        count = min(len(strips), max(SAMPLED * len(strips) // (height * width), 1))
        self.rows = [strips[k * len(strips) // count] for k in range(count)]
        self.sums = np.zeros((len(self.stages), 2))
        self.pixels = 0
        self._lock = threading.Lock()

    def follow(self, backend: NumpyBackend) -> None:
        """Compute the strips on the host."""
        for rows in self.rows:
            frame = self.theory.frame.on(backend)
            part = replace(frame, window=frame.window.crop_rows(rows), _blocks={})
            signal: Array = self.theory.photons.crop_rows(rows)
            signals = []
            for stage in self.stages:
                signal = stage.sample(signal, part)
                signals.append(total(signal))
            self.add(rows, signals)

    def add(self, rows: slice, signals: list[Array]) -> None:
        """The signals behind all stages in one strip."""
        light = detected(self.theory.photons, self.stages[0], self.theory.frame, rows)
        means = self.theory.means(np.asarray(light.light if isinstance(light, Electrons) else light))
