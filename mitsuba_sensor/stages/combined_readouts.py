"""The converter of a camera that reads every pixel several times: all read-outs, combined into one linear code.

The light of the reference exposure enters. Each read-out is a chain of its own with its share of that light, its own
exposure time and its own noise; read-outs of the same charge draw the same electrons (core/counter_rng.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..core import Array, Electrons, Exposure, Frame, arrays
from .stage import Chain, Converter, sample


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


@dataclass(frozen=True)
class ReadoutChain:
    """One read-out of every pixel.

    name : of its noise behind the charge.  charge : of the exposure whose charge it reads, empty for the first one.
    photodiode : of its fixed patterns in front of the charge, empty for the first one.
    exposure_ratio : its exposure time over that of the frame.
    sensitivity : its photoelectrons over those of the first photodiode in the same time.
    stages : from photons to its code.
    """

    name: str
    charge: str
    photodiode: str
    exposure_ratio: float
    sensitivity: float
    stages: Chain

    @property
    def light_ratio(self) -> float:
        """Its photoelectrons over those of the first read-out, in light that does not change."""
        return self.exposure_ratio * self.sensitivity

    @property
    def begins_photodiode(self) -> bool:
        """Whether it is the first read-out of a photodiode behind the first one."""
        return self.photodiode == self.name

    def frame_of(self, frame: Frame) -> Frame:
        """The frame with the exposure and the streams of random numbers of this read-out."""
        window = replace(frame.window, photodiode=self.photodiode, readout=self.name)
        exposure = self.exposure_of(frame.exposure)
        return replace(frame, exposure=exposure, window=window, charge=self.charge, _blocks={})

    def exposure_of(self, exposure: Exposure) -> Exposure:
        """Its exposure in a frame of this exposure."""
        if self.exposure_ratio == 1:
            return exposure
        return replace(exposure, time_s=exposure.time_s * self.exposure_ratio)

    def light_of(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Its mean photoelectrons: of its own exposure where that has a light of its own, else its share of those of
        the first photodiode in the reference exposure."""
        own, ratio = replace(electrons, by_readout=None), self.light_ratio
        if electrons.by_readout is not None and self.charge in electrons.by_readout:
            own, ratio = electrons.by_readout[self.charge], self.sensitivity
        if ratio == 1:
            return own
        return replace(own, light=frame.number(ratio) * own.light)

    def sample(self, electrons: Electrons, frame: Frame) -> Array:
        """Its code of mean photoelectrons of the reference exposure, (H, W) [DN]."""
        own = self.frame_of(frame)
        return sample(self.stages[1:], self.light_of(electrons, own), own)


@dataclass(frozen=True)
class CombinedReadouts(Converter):
    """All read-outs of a pixel, combined into one linear code.

    readouts : the most sensitive first.  combination : of their codes.
    """

    readouts: tuple[ReadoutChain, ...]
    combination: Combination

    def sample(self, electrons: Electrons, frame: Frame) -> Array:
        """Mean photoelectrons of the reference exposure → linear code (H, W)."""
        codes = [readout.sample(electrons, frame) for readout in self.readouts]
        return self.combination.code(codes, frame)

    @property
    def highest(self) -> int:
        """The largest linear code."""
        return self.combination.highest

    @property
    def gain_dn_per_v(self) -> float:  # type: ignore[override]
        """DN of the linear code per electron: there are no volts in front of it."""
        return self.combination.gain_dn_per_e

    @property
    def black_level_dn(self) -> float:  # type: ignore[override]
        """The linear code of darkness [DN]."""
        return self.combination.black_level_dn

    @property
    def nominal_gain(self) -> float:
        """DN of the linear code per photoelectron of the reference exposure."""
        return self.combination.gain_dn_per_e

    @property
    def reach_px(self) -> int:
        """The largest reach of its read-outs."""
        return max(sum(stage.reach_px for stage in one.stages) for one in self.readouts)

    @property
    def reach_along_rows_px(self) -> int:
        """The largest reach of its read-outs within a row."""
        sums = (sum(stage.reach_along_rows_px for stage in one.stages) for one in self.readouts)
        return max(sums)

    def names(self) -> tuple[str, ...]:
        """Names of the read-outs."""
        return tuple(one.name for one in self.readouts)


def combined_of(stages: Chain) -> CombinedReadouts | None:
    """The last stage of a camera with several read-outs; None of any other."""
    if stages and isinstance(stages[-1], CombinedReadouts):
        return stages[-1]
    return None
