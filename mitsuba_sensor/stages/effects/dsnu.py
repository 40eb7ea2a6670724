"""Dark signal non-uniformity (DSNU) of columns, rows and pixels: column FPN, row FPN and pixel FPN, fixed offsets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

from ...core import Array, Frame, SensorWindow
from ...core.backend import normals
from ..datasheet import Chance, FileTable, LineCoupling, MapCoupling, NotNegative, optional
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, ElectronMaps
from ..usual_range import PERCENT, Usual


class DsnuColumnFields(FileTable):
    """Offsets of the columns."""

    cmos_only = ("dsnu_col",)
    dsnu_col: Annotated[NotNegative, Usual.of(0, 0.05, PERCENT)] = optional(
        "column offsets, σ over the full-well swing", 0.001, 0.0
    )
    dsnu_col_coupling: LineCoupling = optional(
        "correlation a of the offsets of neighbouring columns", 0.25, 0.0
    )
    dsnu_residual: Chance = optional(
        "fraction of column and pixel offsets that the analogue CDS leaves",
        1.0,
        1.0,
        title="DSNU, DSNU1288 (E), after an analogue CDS",
    )


class DsnuRowFields(FileTable):
    """Offsets of the rows."""

    cmos_only = ("dsnu_row",)
    dsnu_row: Annotated[NotNegative, Usual.of(0, 0.05, PERCENT)] = optional(
        "row offsets, σ over the full-well swing", 0.0005, 0.0
    )
    dsnu_row_coupling: LineCoupling = optional(
        "correlation a of the offsets of neighbouring rows", 0.25, 0.0
    )


class DsnuPixelFields(FileTable):
    """Offsets of the pixels."""

    cmos_only = ("dsnu_e",)
    dsnu_e: NotNegative = optional("pixel offsets, σ as electrons [e-]", 2.0, 0.0)
    dsnu_coupling: MapCoupling = optional(
        "correlation a of the offsets of neighbouring pixels", 0.25, 0.0
    )


@dataclass(frozen=True)
class FixedOffset(ElectronMaps):
    """An offset that does not depend on the signal (paper eq. 28, 32). A CCD has one amplifier and no offsets.

    sigma_e : σ of the offsets, as electrons at the sense node.  gain_v_per_e : one electron at this stage [V/e-].
    coupling : a of the isotropic AR process.  residual : fraction of the offsets that the CDS leaves, 0 … 1.
    source : name of the random stream; the map is called ``<source>_e``.
    axis : 0 for offsets of rows, 1 of columns, None of pixels.
    """

    sigma_e: float
    gain_v_per_e: float
    coupling: float = 0.0
    residual: float = 1.0
    domain = "volts"
    fields: ClassVar[type[FileTable]]
    source: ClassVar[str]
    axis: ClassVar[int | None] = None

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Self | None:
        """Return the stage, or None for a CCD. σ of lines is a fraction of the full well; a CDS keeps row offsets."""
        if camera.sensor.technology == "ccd":
            return None
        table = getattr(camera, cls.table)
        sigma, coupling = (getattr(table, name) for name in list(cls.fields.model_fields)[:2])
        unit_e = 1.0 if cls.axis is None else camera.pixel.full_well_e
        residual = 1.0 if cls.axis == 0 else camera.readout.dsnu_residual
        per_e = sense_gain_v_per_e(camera) * camera.source_follower.gain
        return cls(sigma * unit_e, per_e, coupling, residual)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing with the camera's offsets."""
        if self.sigma_e == 0 and self._name not in frame.window.given:
            return swing
        offsets = self.fpn_maps(frame.window)[self._name]
        return swing + frame.number(self.residual * self.gain_v_per_e) * offsets

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return the offsets in electrons, 0 on average: (1, W), (H, 1) or (H, W)."""

        def offsets() -> Array:
            if self.axis is not None:
                unit = window.line_map(self.source, self.coupling, axis=self.axis)
            elif self.coupling:
                unit = window.correlated(self.source, self.coupling)
            else:
                unit = window.fixed_map(self.source, normals)
            return window.number(self.sigma_e) * unit

        return {self._name: window.measured_or(self._name, offsets)}

    def gains_of_maps(self) -> dict[str, float]:
        """Return the swing that an electron leaves after the CDS [V/e-]."""
        return {self._name: self.residual * self.gain_v_per_e}

    @property
    def _name(self) -> str:
        return f"{self.source}_e"


@dataclass(frozen=True)
class DsnuColumn(FixedOffset):
    """One offset per column, which may correlate with its neighbours' (paper eq. 28, 32). A CCD has none."""

    source = "dsnu_col"
    axis = 1
    table = "readout"
    fields = DsnuColumnFields
    terms = "DSNU1288_col (E), column FPN, offset FPN"
    label = "DSNU column"


@dataclass(frozen=True)
class DsnuRow(FixedOffset):
    """One offset per row, which may correlate with its neighbours' (paper eq. 28). A CCD has none."""

    source = "dsnu_row"
    axis = 0
    table = "readout"
    fields = DsnuRowFields
    terms = "DSNU1288_row (E), row FPN"
    label = "DSNU row"


@dataclass(frozen=True)
class DsnuPixel(FixedOffset):
    """One offset per pixel, which may correlate with its neighbours' (paper eq. 28). A CCD has none."""

    source = "dsnu_pixel"
    table = "pixel"
    fields = DsnuPixelFields
    terms = "DSNU1288_pixel (E), pixel FPN"
    label = "DSNU pixel"
