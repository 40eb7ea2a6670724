"""Electron multiplication (EMCCD): a register in front of the amplifier multiplies electrons by impact ionization.

Robbins & Hadwen, IEEE TED 50, 1227 (2003), give the excess noise of a register of so many elements;
Basden, Haniff & Mackay, MNRAS 345, 985 (2003), the law of what leaves it, a gamma law.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import Field, model_validator

from ...core import Array, Electrons, Frame, arrays
from ..datasheet import Count, FileTable, NotNegative, optional
from ..gains import em_excess_noise
from ..stage import Datasheet, Stage
from ..usual_range import THOUSANDS, Usual

SMALLEST_SPREAD = 1e-9
"""Of the excess noise squared above 1: below, no count of electrons shows it."""


class EmGainFields(FileTable):
    """The multiplication register of an EMCCD."""

    em_gain: Annotated[float, Field(ge=1, le=1e6, strict=True)] | None = optional(
        "mean electrons out of the register of an EMCCD per electron in; gain_dn_per_e is K without it",
        300.0,
        title="EM gain G, multiplication gain",
    )
    em_stages: Annotated[Count | None, Usual.of(100, 2000)] = optional(
        "elements of the multiplication register",
        536,
        title="multiplication elements, stages of the register",
    )
    em_full_well_e: Annotated[NotNegative | None, Usual.of(1e4, 1e8, THOUSANDS)] = optional(
        "electrons that the multiplication register holds behind its last element [e-]",
        800000.0,
        title="register full well",
    )

    @model_validator(mode="after")
    def _register_can_multiply(self) -> Self:
        if self.em_gain in (None, 1):
            return self
        if self.em_stages is None:
            raise ValueError(
                f"em_gain is {self.em_gain:g} and em_stages is missing; give the elements of the multiplication "
                "register, e.g. 536"
            )
        if self.em_stages < 64 and self.em_gain > 2**self.em_stages:
            raise ValueError(
                f"em_gain is {self.em_gain:g} and em_stages {self.em_stages}, each of which at most doubles the "
                f"electrons; take a gain up to {2**self.em_stages:g}, or more em_stages"
            )
        return self


@dataclass(frozen=True)
class EmGain(Stage):
    """n electrons become G·n, with variance G²·(F² − 1)·n and a gamma law, in the register of an EMCCD.

    F² = 2(G − 1)·G^(−(m + 1)/m) + 1/G of m elements is the excess noise factor squared, the temporal variance over that
    of shot noise alone: 1 without gain, nearly 2 at high gain (Robbins & Hadwen 2003). The amplifier comes behind the
    register, so that read noise is divided by G in photoelectrons. The law is a gamma law with that mean and variance
    (Basden et al. 2003). There are no spurious charges of the clocks.

    gain : G.  elements : m.  full_well_e : what the register holds at most [e-], or None.
    """

    gain: float
    elements: int
    full_well_e: float | None = None
    domain = "electrons"
    table = "readout"
    fields = EmGainFields
    terms = "electron multiplication, EMCCD, excess noise factor F² (Robbins & Hadwen 2003)"
    no_noise = "set readout.em_gain to 1"
    label = "EM gain"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> EmGain | None:
        """None for a camera without electron multiplication."""
        readout = camera.readout
        if readout.em_gain in (None, 1):
            return None
        return cls(readout.em_gain, readout.em_stages, readout.em_full_well_e)

    @property
    def nominal_gain(self) -> float:
        """G."""
        return self.gain

    @property
    def excess_noise(self) -> float:
        """F²."""
        return em_excess_noise(self.gain, self.elements)

    @property
    def saturation_e(self) -> float | None:
        """What the register holds [e-]."""
        return self.full_well_e

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Electrons behind the last element of the register."""
        if self.gain == 1:
            return electrons

        def multiplied(count: Array) -> Array:
            return self._multiplied(count, frame)

        def parts(light: Array, dark: Array) -> tuple[Array, Array]:
            count = light + dark
            factor = arrays.ratio(multiplied(count), count, 0.0)
            return light * factor, dark * factor

        return electrons.changed(multiplied, parts)

    def _multiplied(self, count: Array, frame: Frame) -> Array:
        """What leaves the register for so many electrons; of less than one, mean and variance alone are right."""
        spread = self.excess_noise - 1  # variance that one electron brings, over G²
        if spread > SMALLEST_SPREAD:
            shape = count * frame.number(1 / spread)
            behind = frame.number(self.gain * spread) * frame.gamma_of_shape("em_gain", shape)
        else:
            behind = frame.number(self.gain) * count
        if self.full_well_e is None:
            return behind
        return arrays.minimum(behind, frame.number(self.full_well_e))
