"""Mean and variance of each pixel's code for any chain, from a few frames whose random bits form a rank-1 lattice.

K frames of independent random numbers give a mean with an error of σ/√K. Here the K numbers of a source in a pixel are
spread evenly over all probabilities, from a random start, and different sources have different orders (Cranley &
Patterson 1976; Sloan & Joe 1994). The frames come from the stages' own ``sample``; fixed patterns stay.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..core import Array, Frame
from ..core.counter_rng import key_of
from ..core.types import Float64Array, RandomBits
from ..sensor.detection import Detected
from ..sensor.run import FrameRunner, StripWindows, strips_of
from ..stages.stage import Chain, converter_of

FRAMES = 32
"""K: the mean of each pixel is right within 0.06 σ, and σ within 1 %; rarer events than 1 in K may be missed."""


@dataclass(frozen=True, eq=False)
class LatticeFrame(Frame):
    """One frame of a lattice.

    point, points : number of this frame, and number of frames.
    orders : for each noise source, the order of its bits from frame to frame.
    """

    point: int = 0
    points: int = FRAMES
    orders: dict[tuple[str, int], int] = field(default_factory=dict)

    @cached_property
    def key(self) -> int:
        """Key of the random starts, which no ordinary frame shares; it depends on neither exposure nor seed."""
        return key_of("lattice", self.window.camera, self.window.serial, self.charge)

    def random_bits(self, source: str) -> Array:
        """Return the bits of the first frame, shifted."""
        return super().random_bits(source) + np.uint32(self._moved(source))

    def random_bits_at(
        self, source: str, rows: ArrayLike, columns: ArrayLike, frame_index: Array
    ) -> RandomBits:
        """Return the bits of the first frame, shifted."""
        bits = super().random_bits_at(source, rows, columns, frame_index)
        return bits + np.uint32(self._moved(source))

    def _moved(self, source: str) -> int:
        """Return the shift of the bits of this frame."""
        name = source, self.key_of_source(source)
        order = self.orders.setdefault(name, len(self.orders))
        point, half = self.point, self.points // 4
        if order // half % 2:  # another sequence: reversed binary digits
            point = int(f"{point:0{self.points.bit_length() - 1}b}"[::-1], 2)
        return point * (2 * (order % half) + 1) % self.points * (2**32 // self.points)


def lattice_moments(
    stages: Chain, light: Detected, first: Frame, points: int = FRAMES
) -> tuple[Float64Array, Float64Array]:
    """Return mean [DN] and variance [DN²] of the codes of a window, shape (H, W) each.

    first : the frame with its conditions, place and number.  points : number of frames, a power of 2.
    """
    frame = LatticeFrame(
        first.exposure, first.window, index=first.index, gain=first.gain, charge=first.charge, points=points
    )  # fmt: skip
    strips = StripWindows(frame.window, strips_of(stages, frame.window))
    code_type = np.min_scalar_type(converter_of(stages).highest)
    codes = np.empty(frame.window.shape, code_type)
    sums = np.zeros((2, *codes.shape))
    start = codes
    for point in range(points):
        one = replace(frame, point=point)
        for _ in FrameRunner(stages, light, one, strips=strips).frames(
            one.index, 1, lambda _: {"digital": codes}
        ):
            if point == 0:
                start = codes.astype(np.float64)
            off = codes - start
            sums += off, off * off
    mean, square = sums / points
    return start + mean, np.maximum(square - mean**2, 0.0)
