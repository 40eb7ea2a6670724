"""CDS gain: the amplifier behind the correlated double sampling, S·A_CDS."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from ..datasheet import FileTable, Positive
from ..stage import Datasheet, LinearGain, Stage


class CdsGainFields(FileTable):
    """Gain of the CDS amplifier."""

    cds_gain: Positive = Field(
        1.0, description="gain of the CDS amplifier A_CDS [V/V]", examples=[1.0]
    )


@dataclass(frozen=True)
class CdsGain(LinearGain):
    """S·A_CDS, 1 typical."""

    table = "readout"
    fields = CdsGainFields
    terms = "gain of the CDS stage A_CDS (J)"
    label = "CDS gain"
    no_noise = "set readout.cds_gain to 1"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> CdsGain:
        """The gain of the datasheet."""
        return cls(camera.readout.cds_gain)
