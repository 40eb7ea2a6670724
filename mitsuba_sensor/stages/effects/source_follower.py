"""Source follower: the amplifier in the pixel, S·A_SF, linear or with the V/V non-linearity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from ...core import Array, Frame
from ..datasheet import FileTable, Positive, optional
from ..gains import full_well_at_node_v
from ..stage import Datasheet, LinearGain, Stage


class SourceFollowerFields(FileTable):
    """Gain of the pixel's amplifier."""

    gain: Positive = optional("gain of the source follower A_SF [V/V]", 1.0, 1.0)
    vv_nonlinearity: Annotated[float, Field(gt=0.5, strict=True)] = optional(
        "V/V non-linearity γ: gain at full well over gain at zero",
        1.05,
        1.0,
        title="V/V non-linearity γ",
    )


@dataclass(frozen=True)
class SourceFollower(LinearGain):
    """S·A_SF, 0.7–1 typical (paper eq. 31)."""

    table = "source_follower"
    fields = SourceFollowerFields
    terms = "source follower, A_SF (J)"
    no_noise = "set source_follower.gain and source_follower.vv_nonlinearity"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Stage:
        """Return a linear amplifier, unless the datasheet has a V/V non-linearity."""
        follower = camera.source_follower
        if follower.vv_nonlinearity == 1:
            return SourceFollower(follower.gain)
        return NonlinearSourceFollower(
            follower.gain, follower.vv_nonlinearity, full_well_at_node_v(camera)
        )


@dataclass(frozen=True)
class NonlinearSourceFollower(Stage):
    """A_SF·S·[1 + (γ−1)·S/S_FW]: the gain changes with the swing (paper eq. 9, 34, applied to the swing).

    gain : A_SF for small signals.  ratio : γ, gain at full well over gain at zero, above ½.  full_swing_v : S_FW [V].
    """

    gain: float
    ratio: float
    full_swing_v: float
    domain = "volts"

    @property
    def nominal_gain(self) -> float:
        """Small-signal A_SF [V/V]."""
        return self.gain

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing after the parabola."""
        return (frame.number(self.gain) * swing) * (1 + frame.number(self._bend) * swing)

    @property
    def _bend(self) -> float:
        return (self.ratio - 1) / self.full_swing_v


class CdsGainFields(FileTable):
    """Gain of the CDS amplifier."""

    cds_gain: Positive = optional("gain of the CDS amplifier A_CDS [V/V]", 1.0, 1.0)


@dataclass(frozen=True)
class CdsGain(LinearGain):
    """S·A_CDS, 1 typical."""

    table = "readout"
    fields = CdsGainFields
    terms = "gain of the CDS stage A_CDS (J)"
    label = "CDS gain"
    no_noise = "set readout.cds_gain to 1"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> CdsGain:
        """Return the stage with the gain of the datasheet."""
        return cls(camera.readout.cds_gain)
