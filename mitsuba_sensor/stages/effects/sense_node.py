"""Sense node: charge becomes a voltage swing, S = A_SN·N, linear or with the V/e non-linearity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import model_validator

from ...core import Array, Electrons, Frame, arrays
from ..datasheet import Chance, FileTable, Positive, optional
from ..gains import sense_gain_v_per_e, ve_nonlinearity_at_full_well
from ..stage import Datasheet, Stage
from ..usual_range import MV_TO_V, VOLTS_TO_UV, Usual

OF_VOLTS = (
    "needs voltages, which gain_dn_per_e alone does not give; add sense_gain_uv_per_e, e.g. 50"
)


class SenseNodeFields(FileTable):
    """Overall system gain, and conversion gain of the sense node."""

    gain_dn_per_e: Annotated[Positive | None, Usual.of(1e-4, 1e3)] = optional(
        "overall system gain K, instead of adc.full_scale_v [DN/e-]",
        0.1225,
        title="overall system gain K (E), as given",
    )

    sense_gain_uv_per_e: Annotated[Positive | None, Usual.of(0.1, 1e3, VOLTS_TO_UV)] = optional(
        "conversion gain A_SN of the sense node, unless gain_dn_per_e or ve_k1_c is given [µV/e-]",
        5.0,
    )
    v_ref_v: Annotated[Positive, Usual.of(0.3, 30, MV_TO_V)] = optional(
        "reference voltage of the sense node V_REF [V]",
        3.1,
        3.1,
        title="reference voltage V_REF",
    )
    ve_nonlinearity: Chance = optional(
        "V/e- non-linearity α of the sense node, 0 is linear",
        1.0,
        0.0,
        title="V/e- non-linearity α",
    )
    ve_k1_c: Positive | None = optional(
        "k₁ of Konnik & Welsh 2014, eq. 8, instead of sense_gain_uv_per_e: A_SN = V_REF·q/k₁ [C]",
        10.909e-15,
        title="k₁ (K)",
    )

    @model_validator(mode="after")
    def _one_sense_gain(self) -> Self:
        if self.sense_gain_uv_per_e is not None and self.ve_k1_c is not None:
            raise ValueError(
                "give either sense_gain_uv_per_e or ve_k1_c, which implies it, not both"
            )
        if self.sense_gain_uv_per_e is None and self.ve_k1_c is None:
            if self.gain_dn_per_e is None:
                raise ValueError(
                    "the gain is missing; give gain_dn_per_e, the overall system gain K [DN/e-] (1/8.16 for 8.16 e- "
                    "per DN), or sense_gain_uv_per_e, the conversion gain [µV/e-]"
                )
            if self.ve_nonlinearity:
                raise ValueError(f"ve_nonlinearity {OF_VOLTS}")
        if self.ve_k1_c is not None and not self.ve_nonlinearity:
            raise ValueError(
                "ve_k1_c needs the V/e- non-linearity; set ve_nonlinearity, e.g. 1.0"
            )
        return self


@dataclass(frozen=True)
class SenseNode(Stage):
    """S = A_SN·N (paper eq. 29, linear).  gain_v_per_e : A_SN [V/e-], 1–10 µV/e- typical."""

    gain_v_per_e: float
    domain = "volts"
    table = "readout"
    fields = SenseNodeFields
    terms = "conversion gain A_SN (J), CVF, C_SN = q/A_SN"
    no_noise = "set readout.sense_gain_uv_per_e and readout.ve_nonlinearity"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Stage:
        """Return a linear node, unless the V/e non-linearity shows at full well."""
        gain, readout = sense_gain_v_per_e(camera), camera.readout
        if ve_nonlinearity_at_full_well(camera):
            return NonlinearSenseNode(gain, readout.v_ref_v, readout.ve_nonlinearity)
        return SenseNode(gain)

    @property
    def nominal_gain(self) -> float:
        """A_SN [V/e-]."""
        return self.gain_v_per_e

    def sample(self, electrons: Electrons, frame: Frame) -> Array:
        """Return the swing (H, W) [V]."""
        return frame.number(self.gain_v_per_e) * electrons.total


@dataclass(frozen=True)
class NonlinearSenseNode(Stage):
    """S = −(V_REF/α)·expm1(−α·A_SN·N/V_REF): the capacitance grows as the voltage drops (paper eq. 8, 33).

    gain_v_per_e : small-signal A_SN [V/e-].  v_ref_v : V_REF [V].  alpha : strength, above 0 to 1.
    """

    gain_v_per_e: float
    v_ref_v: float
    alpha: float
    domain = "volts"

    @property
    def nominal_gain(self) -> float:
        """Small-signal A_SN [V/e-]."""
        return self.gain_v_per_e

    def sample(self, electrons: Electrons, frame: Frame) -> Array:
        """Return the swing (H, W) [V], below V_REF/α."""
        return frame.number(-self.v_ref_v / self.alpha) * arrays.expm1(
            frame.number(-self._rate) * electrons.total
        )

    @property
    def _rate(self) -> float:
        return self.alpha * self.gain_v_per_e / self.v_ref_v
