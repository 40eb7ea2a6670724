"""Converter of a camera that reads every pixel several times: all readouts combined into one linear code.

The input is the light of the reference exposure. Each readout is a separate chain with its fraction of that light, its
exposure time and its noise; readouts of the same charge have the same electrons (core/counter_rng.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..core import Array, Electrons, Exposure, Frame, arrays
from .stage import Chain, Converter, sample


@dataclass(frozen=True)
class LinearisedReadout:
    """Conversion of a readout's codes to electrons of the reference exposure, and its switch to the next readout.

    black_dn : black level [DN].  electrons_per_dn : electrons of the reference exposure per code [e-/DN].
    begin_dn, end_dn : codes between which the next readout replaces this one; equal for a threshold.
    """

    black_dn: float
    electrons_per_dn: float
    begin_dn: float = math.inf
    end_dn: float = math.inf

    def electrons(self, code: Array, frame: Frame) -> Array:
        """Return code − black level in electrons of the reference exposure."""
        return frame.number(self.electrons_per_dn) * (code - frame.number(self.black_dn))

    def weight_of_next(self, code: Array, frame: Frame) -> Array:
        """Return the weight of the next readout for this code, 0 to 1."""
        if self.begin_dn == self.end_dn:
            return arrays.where(code >= frame.number(self.end_dn), 1.0, 0.0 * code)
        slope = frame.number(1 / (self.end_dn - self.begin_dn))
        return arrays.minimum(
            arrays.maximum(slope * (code - frame.number(self.begin_dn)), 0.0), 1.0
        )


@dataclass(frozen=True)
class Combination:
    """The linear code of several readouts, the most sensitive first.

    bits : bits of the linear code.  gain_dn_per_e : gain [DN per electron of the reference exposure].
    black_level_dn : black level [DN].
    """

    readouts: tuple[LinearisedReadout, ...]
    bits: int
    gain_dn_per_e: float
    black_level_dn: float

    @property
    def highest(self) -> int:
        """Full-scale code, 2^bits − 1."""
        return int(2**self.bits - 1)

    def electrons(self, codes: Sequence[Array], frame: Frame) -> Array:
        """Return electrons of the reference exposure from the codes of all readouts."""
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
        """Return the linear code, rounded half up and clipped to 0 … 2^bits − 1."""
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
    """One readout of every pixel.

    name : name of its noise after the charge.  charge : name of the exposure whose charge it reads; empty: the first.
    photodiode : name of its fixed patterns before the charge, empty for the first photodiode.
    exposure_ratio : its exposure time over the exposure time of the frame.
    sensitivity : its photoelectrons over those of the first photodiode in the same time.
    stages : chain from photons to its code.
    """

    name: str
    charge: str
    photodiode: str
    exposure_ratio: float
    sensitivity: float
    stages: Chain

    @property
    def light_ratio(self) -> float:
        """Its photoelectrons over those of the first readout, in constant light."""
        return self.exposure_ratio * self.sensitivity

    @property
    def begins_photodiode(self) -> bool:
        """True if it is the first readout of a second or later photodiode."""
        return self.photodiode == self.name

    def frame_of(self, frame: Frame) -> Frame:
        """Return the frame with the exposure and the random numbers of this readout."""
        window = replace(frame.window, photodiode=self.photodiode, readout=self.name)
        exposure = self.exposure_of(frame.exposure)
        return replace(frame, exposure=exposure, window=window, charge=self.charge, _blocks={})

    def exposure_of(self, exposure: Exposure) -> Exposure:
        """Return its exposure in a frame of this exposure."""
        if self.exposure_ratio == 1:
            return exposure
        return replace(exposure, time_s=exposure.time_s * self.exposure_ratio)

    def light_of(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return its mean photoelectrons: of its exposure's separate light, if given, else its fraction of the mean of
        the first photodiode in the reference exposure."""
        own, ratio = replace(electrons, by_readout=None), self.light_ratio
        if electrons.by_readout is not None and self.charge in electrons.by_readout:
            own, ratio = electrons.by_readout[self.charge], self.sensitivity
        if ratio == 1:
            return own
        return replace(own, light=frame.number(ratio) * own.light)

    def sample(self, electrons: Electrons, frame: Frame) -> Array:
        """Return its code for mean photoelectrons of the reference exposure, shape (H, W) [DN]."""
        own = self.frame_of(frame)
        return sample(self.stages[1:], self.light_of(electrons, own), own)


@dataclass(frozen=True)
class CombinedReadouts(Converter):
    """All readouts of a pixel, combined into one linear code.

    readouts : the readouts, the most sensitive first.  combination : combination of their codes.
    """

    readouts: tuple[ReadoutChain, ...]
    combination: Combination

    def sample(self, electrons: Electrons, frame: Frame) -> Array:
        """Return the linear code for mean photoelectrons of the reference exposure, shape (H, W)."""
        codes = [readout.sample(electrons, frame) for readout in self.readouts]
        return self.combination.code(codes, frame)

    @property
    def highest(self) -> int:
        """Full-scale linear code."""
        return self.combination.highest

    @property
    def gain_dn_per_v(self) -> float:  # type: ignore[override]
        """Gain of the linear code [DN/e-]; there are no volts before it."""
        return self.combination.gain_dn_per_e

    @property
    def black_level_dn(self) -> float:  # type: ignore[override]
        """Black level of the linear code [DN]."""
        return self.combination.black_level_dn

    @property
    def nominal_gain(self) -> float:
        """Gain of the linear code [DN per photoelectron of the reference exposure]."""
        return self.combination.gain_dn_per_e

    @property
    def reach_px(self) -> int:
        """Largest reach of the readouts [pixels]."""
        return max(sum(stage.reach_px for stage in one.stages) for one in self.readouts)

    @property
    def reach_along_rows_px(self) -> int:
        """Largest reach of the readouts within a row [pixels]."""
        sums = (sum(stage.reach_along_rows_px for stage in one.stages) for one in self.readouts)
        return max(sums)


def combined_of(stages: Chain) -> CombinedReadouts | None:
    """Return the last stage of a camera with several readouts; None for any other camera."""
    if stages and isinstance(stages[-1], CombinedReadouts):
        return stages[-1]
    return None
