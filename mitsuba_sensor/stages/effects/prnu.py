"""Photo response non-uniformity (PRNU): fixed gains of the pixels (PRNU1288) and of the columns (PRNU_col).

Fixed offsets of columns, rows and pixels (column FPN, row FPN, pixel FPN) are in dsnu.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

from pydantic import model_validator

from ...core import Array, Electrons, Frame, SensorWindow, arrays
from ..datasheet import FileTable, LineCoupling, MapCoupling, NotNegative, optional
from ..fpn_distributions import (
    AutoregressiveRectified,
    FpnDistribution,
    LogNormal,
    Rectified,
    require_drawable,
)
from ..stage import Datasheet, Stage, cut_to_zero
from ..usual_range import PERCENT, Usual


class PrnuFields(FileTable):
    """PRNU of the pixels."""

    prnu: Annotated[NotNegative, Usual.of(0, 0.1, PERCENT)] = optional(
        "photo response non-uniformity, a fraction of the mean", 0.01, 0.0
    )
    prnu_distribution: Literal["gaussian", "lognormal", "ar"] = optional(
        "distribution of the pixels' gains", "gaussian", "gaussian"
    )
    prnu_coupling: MapCoupling = optional(
        "correlation a of neighbouring gains, for the distribution ar",
        0.25,
        0.0,
    )

    @model_validator(mode="after")
    def _drawable(self) -> Self:
        kind = LogNormal if self.prnu_distribution == "lognormal" else Rectified
        require_drawable("prnu", self.prnu, kind, self.prnu_distribution)
        return self


class PrnuColumnFields(FileTable):
    """Gains of the columns."""

    cmos_only = ("prnu_col",)
    prnu_col: Annotated[NotNegative, Usual.of(0, 0.1, PERCENT)] = optional(
        "spread of the column gains, σ over 1", 0.002, 0.0
    )
    prnu_col_coupling: LineCoupling = optional(
        "correlation a of the gains of neighbouring columns", 0.25, 0.0
    )


@dataclass(frozen=True)
class Prnu(Stage):
    """mean' = mean · max(0, 1 + PRNU·z), one z per pixel and camera (paper eq. 15), or another distribution.

    distribution : of the gain; its cv is the PRNU, 0.01–0.02 typical (Janesick 2001).
    """

    distribution: FpnDistribution
    domain = "electrons"
    table = "pixel"
    fields = PrnuFields
    terms = "photo response non-uniformity PRNU, PRNU1288_pixel (E), P_N (J)"
    label = "PRNU"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Prnu:
        """Return the stage with the distribution that the datasheet names."""
        pixel = camera.pixel
        if pixel.prnu_distribution == "ar":
            return cls(AutoregressiveRectified(pixel.prnu, pixel.prnu_coupling))
        return cls(
            (LogNormal if pixel.prnu_distribution == "lognormal" else Rectified)(pixel.prnu)
        )

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return the mean photoelectrons times the gain map."""
        if self.distribution.cv == 0 and "prnu" not in frame.window.given:
            return electrons
        gain = self.fpn_maps(frame.window)["prnu"]
        return replace(electrons, light=arrays.product(electrons.light, gain))

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return ``prnu``, the gain of every pixel, 1 on average."""
        return {
            "prnu": window.measured_or("prnu", lambda: self.distribution.map_of(window, "prnu"))
        }

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Return the mask of pixels whose gain would be negative."""
        return cut_to_zero(self, "prnu", self.distribution.cv, frame.window)


@dataclass(frozen=True)
class PrnuColumn(Stage):
    """S·(1 + cv·x_j), x_j of variance 1, correlated between neighbouring columns (paper eq. 28). A CCD has none.

    cv : σ of the gain over its mean.  coupling : a of the AR process, 0 … 0.4999.
    """

    cv: float
    coupling: float = 0.0
    domain = "volts"
    table = "readout"
    fields = PrnuColumnFields
    terms = "PRNU1288_col (E), gain differences of columns"
    label = "PRNU column"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> PrnuColumn | None:
        """Return None for a CCD, which has one amplifier."""
        if camera.sensor.technology == "ccd":
            return None
        return cls(camera.readout.prnu_col, camera.readout.prnu_col_coupling)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing times the gains of the columns."""
        if self.cv == 0 and "prnu_col" not in frame.window.given:
            return swing
        return swing * self.fpn_maps(frame.window)["prnu_col"]

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return ``prnu_col``, the gain of every column, 1 on average, (1, W)."""
        return {"prnu_col": window.measured_or("prnu_col", lambda: self._gains(window))}

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Return the mask of columns whose gain is not positive."""
        return cut_to_zero(self, "prnu_col", self.cv, frame.window)

    def _gains(self, window: SensorWindow) -> Array:
        return 1 + window.number(self.cv) * window.line_map("prnu_col", self.coupling)
