"""Inter-pixel capacitance (IPC): a pixel's charge also raises the voltage of its neighbours' sense nodes.

Moore, Ninkov & Forrest, Opt. Eng. 45, 076402 (2006), measure it by the correlation of neighbours in flat fields;
Kannawadi et al., PASP 128, 095001 (2016), give its effect on images of points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from ...core import Array, Electrons, Frame
from ..datasheet import FileTable, optional
from ..stage import Datasheet, Stage


class InterPixelCapacitanceFields(FileTable):
    """Coupling of the sense nodes."""

    cmos_only = ("ipc_coupling", "ipc_corner_coupling")

    ipc_coupling: Annotated[float, Field(ge=0, le=0.2, strict=True)] = optional(
        "inter-pixel capacitance: fraction of a pixel's signal in each of its 4 neighbours",
        0.01,
        0.0,
        title="IPC coupling α",
    )
    ipc_corner_coupling: Annotated[float, Field(ge=0, le=0.1, strict=True)] = optional(
        "the same fraction for each of its 4 diagonal neighbours", 0.001, 0.0
    )

    @model_validator(mode="after")
    def _centre_is_largest(self) -> Self:
        side, corner = self.ipc_coupling, self.ipc_corner_coupling
        centre = 1 - 4 * side - 4 * corner
        if centre < max(side, corner):
            raise ValueError(
                f"ipc_coupling is {side:g} and ipc_corner_coupling {corner:g}, which leave {centre:.3g} in the pixel "
                "itself, less than in a neighbour; use smaller couplings, e.g. 0.01 and 0.001"
            )
        return self


@dataclass(frozen=True)
class InterPixelCapacitance(Stage):
    """Each pixel shows α of the charge of each of its four neighbours and 1 − 4α of its own, after the shot noise.

    Nothing is random: the noise of neighbours becomes correlated, and the variance of a flat field falls to Σk² =
    (1 − 4α)² + 4α², so that a photon transfer curve shows K·Σk² (Moore et al. 2006). No charge is lost: at the edge of
    the window a pixel keeps the fractions of its missing neighbours. Noise of the amplifiers is not coupled.

    side : α, of each of the four neighbours.  corner : of each diagonal neighbour, which leaves 1 − 4α − 4·corner.
    """

    side: float
    corner: float = 0.0
    domain = "electrons"
    table = "readout"
    fields = InterPixelCapacitanceFields
    terms = "inter-pixel capacitance, IPC, deterministic crosstalk (Moore et al. 2006)"
    label = "inter-pixel capacitance"
    no_noise = "set readout.ipc_coupling and readout.ipc_corner_coupling to 0"
    reach_px: ClassVar[int] = 1

    @classmethod
    def from_camera(cls, camera: Datasheet) -> InterPixelCapacitance | None:
        """Return None for a camera without coupling."""
        side, corner = camera.readout.ipc_coupling, camera.readout.ipc_corner_coupling
        if side or corner:
            return cls(side, corner)
        return None

    @property
    def centre(self) -> float:
        """Fraction of its own charge that a pixel shows."""
        return 1 - 4 * self.side - 4 * self.corner

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return the charge that each sense node shows [e-], no longer whole numbers."""

        def coupled(charge: Array) -> Array:
            return self._coupled(charge, frame)

        return electrons.changed(coupled, lambda light, dark: (coupled(light), coupled(dark)))

    def _coupled(self, charge: Array, frame: Frame) -> Array:
        """Return Σ k·charge over the pixel and its eight neighbours."""

        def around(*places: tuple[int, int]) -> Array:
            first, second, third, fourth = (frame.neighbour(charge, *place) for place in places)
            return (first + second) + (third + fourth)

        shown = frame.number(self.centre) * charge
        if self.side:
            sides = around((-1, 0), (1, 0), (0, -1), (0, 1))
            shown = shown + frame.number(self.side) * sides
        if self.corner:
            corners = around((-1, -1), (1, 1), (-1, 1), (1, -1))
            shown = shown + frame.number(self.corner) * corners
        return shown
