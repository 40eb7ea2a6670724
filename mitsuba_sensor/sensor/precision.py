"""Float32 or float64: which of them an exposure is computed in, and how far float32 frames are from float64 frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..camera.camera import Camera
from ..core import Array, Frame, InputError
from ..core.backend import FLOAT32_LIMIT, NUMPY_FLOAT32, NUMPY_FLOAT64
from ..stages.gains import adc_gain_dn_per_v
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


COUNTABLE_E, COUNTABLE_DN = 2**24, 2**23
"""What float32 counts: whole electrons; digital numbers, which are rounded and therefore need halves too."""


def float32_counts(camera: Camera) -> bool:
    """Whether float32 holds single electrons of a full well and the codes of this camera."""
    countable = camera.pixel.full_well_e <= COUNTABLE_E and 2**camera.code_bits <= COUNTABLE_DN
    return countable and adc_gain_dn_per_v(camera) <= FLOAT32_LIMIT


def check_float32(camera: Camera) -> None:
    """Raise InputError where float32, asked for, cannot compute this camera's codes."""
    gain = adc_gain_dn_per_v(camera)
    if gain > FLOAT32_LIMIT:
        raise InputError(
            f"precision is 'float32', which holds numbers up to {FLOAT32_LIMIT:g}, and the converter of {camera.name} "
            f"makes {gain:.3g} DN of a volt; leave the precision out, or mend the gains and adc.full_scale_v."
        )
    if camera.adc.dnl_lsb and 2**camera.adc.bits > COUNTABLE_DN:
        raise InputError(
            f"precision is 'float32', which has no halves between codes from {COUNTABLE_DN} on, and {camera.name} has "
            f"adc.dnl_lsb and {camera.adc.bits} bits; leave the precision out, or take 23 bits or fewer."
        )


def precision_of(asked: str, camera: Camera, planned: str | None) -> str:
    """ "float32" or "float64": as asked, else as the plan found, else float32 while it can count single electrons."""
    if asked == "float32":
        check_float32(camera)
    if asked != "auto":
        return asked
    if planned is not None:
        return planned
    return "float32" if float32_counts(camera) else "float64"
