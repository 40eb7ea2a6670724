"""The converter of a camera that reads every pixel several times: all read-outs, combined into one linear code.

The light of the reference exposure enters. Each read-out is a chain of its own with its share of that light, its own
exposure time and its own noise; read-outs of the same charge draw the same electrons (core/counter_rng.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..core import Array, Electrons, Exposure, Frame
from .combination import Combination
from .stage import Chain, Converter, sample


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
