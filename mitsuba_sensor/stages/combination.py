"""Combination of several read-outs of a pixel into one linear code: linearised, handed over, rounded.

Each code becomes electrons of the reference exposure, ê = (code − black level)/(K·s·T/T_ref), by the nominal gain K,
sensitivity s and exposure time T of its read-out. The most sensitive read-out counts until its code reaches where it
hands over to the next; between the begin of a blend and its end the two are averaged by a weight that is linear in the
code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..core import Array, Frame, arrays


@dataclass(frozen=True)
class LinearisedReadout:
    """How the codes of a read-out become electrons of the reference exposure, and where it hands over to the next.

    black_dn : its black level [DN].  electrons_per_dn : of the reference exposure [e-/DN].
    begin_dn, end_dn : codes between which the next read-out takes over; equal for a threshold.
    """

    black_dn: float
    electrons_per_dn: float
    begin_dn: float = math.inf
    end_dn: float = math.inf

    def electrons(self, code: Array, frame: Frame) -> Array:
        """(code − black level) as electrons of the reference exposure."""
        return frame.number(self.electrons_per_dn) * (code - frame.number(self.black_dn))

    def weight_of_next(self, code: Array, frame: Frame) -> Array:
        """Weight of the next read-out where this one has such a code, 0 to 1."""
        if self.begin_dn == self.end_dn:
            return arrays.where(code >= frame.number(self.end_dn), 1.0, 0.0 * code)
        slope = frame.number(1 / (self.end_dn - self.begin_dn))
        return arrays.minimum(
            arrays.maximum(slope * (code - frame.number(self.begin_dn)), 0.0), 1.0
        )


@dataclass(frozen=True)
class Combination:
    """The linear code of read-outs, the most sensitive first.

    bits : of the linear code.  gain_dn_per_e : DN per electron of the reference exposure.
    black_level_dn : the code of darkness [DN].
    """

    readouts: tuple[LinearisedReadout, ...]
    bits: int
    gain_dn_per_e: float
    black_level_dn: float

    @property
    def highest(self) -> int:
        """The largest code, 2^bits − 1."""
        return int(2**self.bits - 1)

    def electrons(self, codes: Sequence[Array], frame: Frame) -> Array:
        """Electrons of the reference exposure, of the codes of all read-outs."""
        *before, last = range(len(self.readouts))
        found = self.readouts[last].electrons(codes[last], frame)
        for number in reversed(before):
            readout, code = self.readouts[number], codes[number]
            own = readout.electrons(code, frame)
            weight = readout.weight_of_next(code, frame)
            blended = own + weight * (found - own)
            found = arrays.where(weight >= 1.0, found, blended)
        return found

    def code(self, codes: Sequence[Array], frame: Frame) -> Array:
        """The linear code, rounded half up and clipped to 0 … 2^bits − 1."""
        electrons = self.electrons(codes, frame)
        ideal = (
            frame.number(self.gain_dn_per_e) * electrons
            + frame.number(self.black_level_dn)
            + frame.number(0.5)
        )
        highest = frame.number(self.highest)
        return arrays.minimum(arrays.maximum(arrays.floor(ideal), 0.0), highest)
