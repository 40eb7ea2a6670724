"""Which noise sources a stage draws from: a frame that notes them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..core import Array, Electrons, Frame
from .stage import Stage


@dataclass(frozen=True, eq=False)
class RecordingFrame(Frame):
    """A frame that notes which sources of temporal noise are drawn from."""

    sources: set[str] = field(default_factory=set)

    def random_bits(self, source: str) -> Array:
        """The random bits, noted."""
        self.sources.add(source)
        return super().random_bits(source)

    def random_bits_at(
        self, source: str, rows: ArrayLike, columns: ArrayLike, frame_index: int
    ) -> Array:
        """The random bits, noted."""
        self.sources.add(source)
        return super().random_bits_at(source, rows, columns, frame_index)


def has_temporal_noise(stage: Stage, before: Stage, frame: Frame) -> bool:
    """Whether a stage draws temporal noise in the first row of this frame.  before : the stage in front of it."""
    window = frame.window.crop_rows(slice(0, 1))
    recording = RecordingFrame(frame.exposure, window, frame.seed, frame.index)
    signal: Array = np.ones(window.shape)
    stage.sample(Electrons(signal) if before.domain == "electrons" else signal, recording)
    return bool(recording.sources)
