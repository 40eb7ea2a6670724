"""What the first stage makes of the photons of a window: once for all frames, for report, theory and plan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core import Array, Electrons, Frame, Photons
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, aligned_float32
from ..core.types import Float64Array
from .run import row_strips_of
from .stage import Stage
from .threads import for_each

LAYERS = ("light", "yield_mean", "yield_variance", "variance_e2")  # of Electrons: one value per pixel before the count


@dataclass(frozen=True, eq=False)
class Detected:
    """Light on a window.

    photons : as they were given.
    signal : mean photoelectrons (:class:`Electrons`, of chain konnik2014 photons) on NumPy, (H, W).
    """

    photons: Photons
    signal: Array

    @property
    def mean_e(self) -> Float64Array:
        """Mean photoelectrons (photons), (H, W) float64."""
        signal = self.signal.light if isinstance(self.signal, Electrons) else self.signal
        return np.asarray(signal, dtype=np.float64)

    def crop_rows(self, rows: slice) -> Detected:
        """The light of some rows of the window."""
        photons = self.photons.crop_rows(rows)
        if not isinstance(self.signal, Electrons):
            return Detected(photons, self.signal[rows])
        layers = {name: getattr(self.signal, name) for name in LAYERS}
        return Detected(photons, Electrons(**{k: x[rows] if np.ndim(x) else x for k, x in layers.items()}))


def detect(photons: Photons, stage: Stage, frame: Frame) -> Detected:
    """Strip by strip, in the precision of the frame's backend.

    photons : of the window of ``frame``.  stage : the first one of the chain.
    """
    backend = NUMPY_FLOAT64 if frame.window.backend.precision == "float64" else NUMPY_FLOAT32
    whole, shape = frame.on(backend), frame.window.shape
    found: dict[str, Array] = {}

    def layers(rows: slice) -> dict[str, Array]:
        part = replace(whole, window=whole.window.crop_rows(rows), _blocks={})
        signal = stage.sample(photons.crop_rows(rows), part)
        return {k: getattr(signal, k) for k in LAYERS} if isinstance(signal, Electrons) else {"": signal}

    def write(rows: slice) -> None:
        for name, values in layers(rows).items():
            if np.ndim(values):
                found[name][rows] = values

    first, *others = row_strips_of(shape, backend.strip_pixels)
    for name, values in layers(first).items():
        if np.ndim(values) == 0:
            found[name] = values
        else:
            found[name] = aligned_float32(shape) if values.dtype == np.float32 else np.empty(shape, values.dtype)
            found[name][first] = values
    for_each(write, others)
    return Detected(photons, found[""] if "" in found else Electrons(**found))
