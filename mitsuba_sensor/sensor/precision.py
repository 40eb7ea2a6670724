"""Effect of float32: the same pixels with the same random bits once more in float64."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..core import Array, Frame
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from ..stages.stage import Chain, converter_of, sample

SHARE, LARGEST_DN = (
    0.01,
    1.0,
)  # more pixels than this, or a larger step, and float64 is the better choice


@dataclass(frozen=True)
class Float32:
    """How far float32 frames are from float64 frames made with equal random bits."""

    share_of_pixels: float  # that differ at all, 0 … 1
    # The largest difference, at least that of one electron: one draw in 100 000 lies so near to the next count.
    largest_dn: float

    @property
    def precision(self) -> Literal["float32", "float64"]:
        """float64 where more than 1 % of the pixels or more than 1 DN move."""
        if self.share_of_pixels > SHARE or self.largest_dn > LARGEST_DN:
            return "float64"
        return "float32"

    def explain(self) -> str:
        """One line for people."""
        if not self.share_of_pixels and self.precision == "float32":
            return "float32: no pixel differs from float64"
        end = "precision float64 is better"
        if self.precision == "float32":
            end = "float32 is enough"
        share = f"{100 * self.share_of_pixels:.2g} % of the pixels"
        return f"float32: {share} differ from float64, by at most {self.largest_dn:g} DN; {end}"


def float32_effect(stages: Chain, light: Array, frames: Sequence[Frame]) -> Float32:
    """Both precisions in some frames.  light : behind the first stage, of the window of the frames."""
    moved = []
    with np.errstate(over="ignore", invalid="ignore"):
        for frame in frames:
            single, double = (
                sample(stages[1:], light, frame.on(backend))
                for backend in (NUMPY_FLOAT32, NUMPY_FLOAT64)
            )
            moved.append(np.abs(np.subtract(single, double, dtype=np.float64)))
    differences = np.nan_to_num(
        moved, nan=converter_of(stages).highest, posinf=converter_of(stages).highest
    )
    electron_dn = np.floor(np.prod([stage.nominal_gain for stage in stages]))
    return Float32(float(np.mean(differences > 0)), float(max(differences.max(), electron_dn)))
