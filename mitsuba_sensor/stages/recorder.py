"""Which noise sources a stage draws from: a frame that notes them."""

from __future__ import annotations

from dataclasses import dataclass, field

from numpy.typing import ArrayLike

from ..core import Array, Frame


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
