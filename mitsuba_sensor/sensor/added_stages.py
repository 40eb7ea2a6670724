"""Checks one stage of the user's against the chain it is added to: random streams of its own, and the precision."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..core.backend import NUMPY_FLOAT32
from ..core.counter_rng import RandomBits
from ..core.errors import InputError
from ..core.exposure import Exposure
from ..core.frame import Frame
from ..core.sensor_window import SensorWindow
from ..core.signals import Electrons, Photons
from ..core.types import Array
from .stage import Chain, Stage, total


@dataclass(frozen=True, eq=False)
class _Recorder(Frame):
    """A frame that notes which noise sources are drawn from."""

    sources: set[str] = field(default_factory=set)

    def random_bits(self, source: str) -> Array:
        """As of a frame."""
        self.sources.add(source)
        return super().random_bits(source)

    def random_bits_at(self, source: str, rows: ArrayLike, columns: ArrayLike, frame_index: int) -> RandomBits:
        """As of a frame."""
        self.sources.add(source)
        return super().random_bits_at(source, rows, columns, frame_index)


def check_added(stages: Chain, added: Stage, wavelength_nm: float) -> None:
    """Expose a window of 8 × 8 pixels to light of this wavelength and look at what ``added`` does.

    Raises InputError where it draws from the noise source of another stage, whose noise would be the same numbers,
    where it turns float32 into float64, which a compiled engine does not have, and where it adds up Electrons.
    """
    signal: Array = Photons(np.full((8, 8, 1), 1e3), np.array([wavelength_nm]))
    users: dict[str, int] = {}
    for place, stage in enumerate(stages):
        frame = _Recorder(Exposure(1.0), SensorWindow(0, (8, 8), backend=NUMPY_FLOAT32))
        before, signal = signal, stage.sample(signal, frame)
        if stage is added and _precision(before) == np.float32 != _precision(signal):
            raise InputError(
                f"{type(stage).__name__} makes {_precision(signal)} of float32, and the engines would differ; "
                "take numbers from frame.number(…), which keeps the precision of the signal."
            )
        if stage is added and isinstance(before, Electrons) and not isinstance(signal, Electrons):
            raise InputError(
                f"{type(stage).__name__} returns a {type(signal).__name__}, and the stage behind it takes "
                "photoelectrons and dark electrons apart; return Electrons, e.g. dataclasses.replace(signal, light=…)."
            )
        for source in frame.sources:
            first = users.setdefault(source, place)
            if first != place and (stage is added or stages[first] is added):
                raise InputError(
                    f"{type(added).__name__} draws from the noise source {source!r}, as another stage of this camera "
                    "does, and both would have the same noise; give it a source of a name of its own."
                )


def _precision(signal: Array) -> np.dtype[np.generic] | None:
    """The type of the numbers of an array."""
    return getattr(total(signal), "dtype", None)
