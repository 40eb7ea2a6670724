"""Quantum yield: an ultraviolet photon frees η > 1 electrons, with Fano noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from ...core import Electrons, Frame, arrays
from ..datasheet import Chance, FileTable, optional
from ..stage import Datasheet, Stage


class QuantumYieldFields(FileTable):
    """Electrons per interacting photon."""

    quantum_yield: tuple[Annotated[float, Field(ge=1, strict=True)], ...] | None = optional(
        "electrons per interacting photon at each of wavelengths_nm, 1 in the visible",
        [2.0, 1.0],
    )
    fano_factor: Chance = optional(
        "Fano factor where the yield is above 1", 0.1, 0.1, title="Fano factor F_F"
    )

    @model_validator(mode="after")
    def _one_per_wavelength(self) -> Self:
        points: tuple[Any, ...] = getattr(self, "wavelengths_nm", ())
        if self.quantum_yield is not None and len(self.quantum_yield) != len(points):
            raise ValueError(
                f"quantum_yield has {len(self.quantum_yield)} values for {len(points)} wavelengths_nm"
            )
        return self


@dataclass(frozen=True)
class QuantumYield(Stage):
    """n interactions give n·η ± √(n·(F·η + var η)) electrons, rounded; for η = 1 nothing changes.

    fano : Fano factor F of the pair production, about 0.1 in silicon (Janesick 2001).
    """

    fano: float
    domain = "electrons"
    table = "quantum_efficiency"
    fields = QuantumYieldFields
    terms = "quantum yield η_i (J)"
    no_noise = (
        "set quantum_efficiency.fano_factor to 0, or unset quantum_efficiency.quantum_yield"
    )

    @classmethod
    def from_camera(cls, camera: Datasheet) -> QuantumYield | None:
        """Return None if the yield is 1 everywhere."""
        section = camera.quantum_efficiency
        if bursts(section.quantum_yield):
            return cls(section.fano_factor)
        return None

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return electrons for interactions; whole numbers stay whole."""
        n, mean = electrons.light, electrons.yield_mean
        spread = arrays.sqrt(n * (frame.number(self.fano) * mean + electrons.yield_variance))
        smooth = n * mean + spread * frame.normal("quantum_yield")
        burst = arrays.floor(smooth + 0.5)
        light = arrays.where(mean == 1, n, arrays.maximum(burst, 0.0))
        return replace(electrons, light=light, yield_mean=1.0, yield_variance=0.0)


def bursts(quantum_yield: Sequence[float] | None) -> bool:
    """Return whether any photon frees more than one electron."""
    return any(electrons != 1 for electrons in quantum_yield or ())
