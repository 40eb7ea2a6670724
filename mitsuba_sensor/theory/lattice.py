"""Mean and variance of each pixel's code for any chain: a few frames whose random bits are a rank-1 lattice.

K frames of plain random numbers give a mean with an error of σ/√K. Here the K numbers of a source in a pixel lie evenly
over all probabilities, from a random start, and those of two sources are in orders that do not go together (Cranley &
Patterson 1976; Sloan & Joe 1994). The stages' own ``sample`` makes the frames, whatever it does; fixed patterns stay.
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
"""K: a mean is right to 0.06 σ in each pixel, a σ to 1 %."""


@dataclass(frozen=True, eq=False)
class LatticeFrame(Frame):
    """One of the frames of a lattice.

    point, points : its number, and how many there are.
    orders : by source of noise, in which order its bits go from point to point.
    """

    point: int = 0
    points: int = FRAMES
    orders: dict[tuple[str, int], int] = field(default_factory=dict)

    @cached_property
    def key(self) -> int:
        """Key of the random starts: those of no frame, and the same in every exposure and for every seed."""
        return key_of("lattice", self.window.camera, self.window.serial, self.charge)

    def random_bits(self, source: str) -> Array:
        """The bits of the first point, moved on."""
        return super().random_bits(source) + np.uint32(self._moved(source))

    def random_bits_at(
        self, source: str, rows: ArrayLike, columns: ArrayLike, frame_index: Array
    ) -> RandomBits:
        """The bits of the first point, moved on."""
        bits = super().random_bits_at(source, rows, columns, frame_index)
        return bits + np.uint32(self._moved(source))

    def _moved(self, source: str) -> int:
        """How far the bits of this point lie beyond those of the first."""
        name = source, self.key_of_source(source)
        order = self.orders.setdefault(name, len(self.orders))
        point, half = self.point, self.points // 4
        if order // half % 2:  # another sequence: the digits of the number from behind
            point = int(f"{point:0{self.points.bit_length() - 1}b}"[::-1], 2)
        return point * (2 * (order % half) + 1) % self.points * (2**32 // self.points)


def lattice_moments(
    stages: Chain, light: Detected, first: Frame, points: int = FRAMES
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the codes of a window, (H, W) each [DN, DN²].

    first : conditions, place and number of the frame that they are of.  points : a power of 2.
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
