"""Electron multiplication (EMCCD): a register in front of the amplifier multiplies electrons by impact ionization.

Robbins & Hadwen, IEEE TED 50, 1227 (2003), give the excess noise of a register of so many elements;
Basden, Haniff & Mackay, MNRAS 345, 985 (2003), the distribution of its output, a gamma distribution.
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

SPREAD_MIN = 1e-9
"""A smaller F² − 1 shows in no count of electrons."""


class EmGainFields(FileTable):
    """The multiplication register of an EMCCD."""

    em_gain: Annotated[float, Field(ge=1, le=1e6, strict=True)] | None = optional(
        "EM gain: mean output electrons of the register per input electron; gain_dn_per_e is "
        "K without it",
        300.0,
        title="EM gain G, multiplication gain",
    )
    em_stages: Annotated[Count | None, Usual.of(100, 2000)] = optional(
        "elements of the multiplication register",
        536,
        title="multiplication elements, stages of the register",
    )
    em_full_well_e: Annotated[NotNegative | None, Usual.of(1e4, 1e8, THOUSANDS)] = optional(
        "full well of the multiplication register at its output [e-]",
        800000.0,
        title="register full well",
    )

    @model_validator(mode="after")
    def _register_can_multiply(self) -> Self:
        if self.em_gain in (None, 1):
            return self
        if self.em_stages is None:
            raise ValueError(
                f"em_gain is {self.em_gain:g}, but em_stages is missing; give the elements of the multiplication "
                "register, e.g. 536"
            )
        if self.em_stages < 64 and self.em_gain > 2**self.em_stages:
            raise ValueError(
                f"em_gain is {self.em_gain:g} and em_stages is {self.em_stages}, each of which at most doubles the "
                f"electrons; use a gain up to {2**self.em_stages:g}, or more em_stages"
            )
        return self


@dataclass(frozen=True)
class EmGain(Stage):
    """The register of an EMCCD: n electrons give a gamma distribution of mean G·n and variance G²·(F² − 1)·n.

    F² = 2(G − 1)·G^(−(m + 1)/m) + 1/G for m elements is the excess noise factor squared, the temporal variance over the
    variance of shot noise alone: 1 without gain, nearly 2 at high gain (Robbins & Hadwen 2003). The amplifier follows
    the register, so read noise in photoelectrons is divided by G. Clock-induced charge is not modelled.

    gain : G.  elements : m.  full_well_e : most electrons in the register [e-], or None.
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
        """Return None for a camera without electron multiplication."""
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
        """Most electrons in the register [e-]."""
        return self.full_well_e

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return the output electrons of the register."""
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
        """Return the output for counts; below one electron only mean and variance are exact."""
        spread = self.excess_noise - 1  # variance per electron, over G²
        if spread > SPREAD_MIN:
            shape = count * frame.number(1 / spread)
            out = frame.number(self.gain * spread) * frame.gamma_of_shape("em_gain", shape)
        else:
            out = frame.number(self.gain) * count
        if self.full_well_e is None:
            return out
        return arrays.minimum(out, frame.number(self.full_well_e))
