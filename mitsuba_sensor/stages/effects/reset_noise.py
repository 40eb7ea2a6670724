"""Reset (kTC) noise of the sense node: residual·√(k_B·T/C_SN), zero-mean and signed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from ...core import Array, Exposure, Frame, arrays
from ...core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C
from ..datasheet import FileTable, optional
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, Stage

RESET_RESIDUAL = {"hard": 1.0, "soft": math.sqrt(0.5), "true_cds": 0.0}
"""Fraction of the kTC noise that remains (paper, sense node reset noise; soft reset: Pain et al. 2000)."""

UNCORRELATED = math.sqrt(2.0)
"""Fraction if reference and signal are sampled after different resets (3T pixel): two equal variances."""


class ResetNoiseFields(FileTable):
    """kTC noise."""

    cmos_only = ("reset", "ktc_residual")
    reset: Literal["hard", "soft", "true_cds"] = Field(
        description="kTC noise: hard leaves all of it, soft 1/√2, true_cds none",
        examples=["hard"],
    )
    ktc_residual: Annotated[float, Field(ge=0, le=UNCORRELATED, strict=True)] | None = optional(
        "remaining fraction of the kTC noise, overrides reset; √2 for 3T sampling",
        0.05,
        title="CDS residue of the reset noise",
    )


@dataclass(frozen=True)
class ResetNoise(Stage):
    """Adds residual·√(k_B·T/C_SN)·z, C_SN = q/A_SN (paper eq. 7, 27, 30). A CCD has none.

    gain_v_per_e : A_SN [V/e-].  residual : fraction that reset and CDS leave: hard reset 1, soft reset 1/√2,
        uncorrelated sampling of a hard reset √2.
    """

    gain_v_per_e: float
    residual: float
    domain = "volts"
    table = "readout"
    fields = ResetNoiseFields
    terms = "reset noise, kTC noise"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> ResetNoise | None:
        """Return None for a CCD, whose true CDS removes all of it."""
        if camera.sensor.technology == "ccd":
            return None
        readout = camera.readout
        if readout.ktc_residual is None:
            residual = RESET_RESIDUAL[readout.reset]
        else:
            residual = readout.ktc_residual
        return cls(sense_gain_v_per_e(camera), residual)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing with noise."""
        sigma = self.sigma_v(frame.exposure)
        if sigma:
            return swing + frame.number(sigma) * frame.normal("reset")
        return swing

    def sigma_v(self, exposure: Exposure) -> float:
        """Return the noise at the temperature of this exposure [V rms]."""
        squared = (
            BOLTZMANN_J_PER_K * exposure.temperature_k * self.gain_v_per_e / ELEMENTARY_CHARGE_C
        )
        return self.residual * arrays.scalar_sqrt(squared)


def reset_noise_v(camera: Datasheet, exposure: Exposure) -> float:
    """Return the reset noise of a camera [V rms]."""
    stage = ResetNoise.from_camera(camera)
    return stage.sigma_v(exposure) if stage else 0.0
