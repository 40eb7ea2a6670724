"""Dark signal non-uniformity (DSNU) of columns, rows and pixels: column FPN, row FPN and pixel FPN, fixed offsets."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

from pydantic import Field

from ...core import Array, Frame, Moments, SensorWindow
from ...core.backend import normals
from ..datasheet import Chance, FileTable, LineCoupling, MapCoupling, NotNegative
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, Stage
from ..usual_range import PERCENT, Usual


class DsnuColumnFields(FileTable):
    """Offsets of the columns."""

    cmos_only: ClassVar[Mapping[str, float | str]] = {"dsnu_col": 0.0}
    dsnu_col: Annotated[NotNegative, Usual.of(0, 0.05, PERCENT)] = Field(
        0.0, description="column offsets, σ over the full-well swing", examples=[0.001]
    )
    dsnu_col_coupling: LineCoupling = Field(
        0.0,
        description="how alike offsets of neighbouring columns are: a of their autoregression",
        examples=[0.25],
    )
    dsnu_residual: Chance = Field(
        1.0,
        title="DSNU, DSNU1288 (E), behind an analogue CDS",
        description="share of column and pixel offsets that the analogue CDS leaves",
        examples=[1.0],
    )


class DsnuRowFields(FileTable):
    """Offsets of the rows."""

    cmos_only: ClassVar[Mapping[str, float | str]] = {"dsnu_row": 0.0}
    dsnu_row: Annotated[NotNegative, Usual.of(0, 0.05, PERCENT)] = Field(
        0.0, description="row offsets, σ over the full-well swing", examples=[0.0005]
    )
    dsnu_row_coupling: LineCoupling = Field(
        0.0,
        description="how alike offsets of neighbouring rows are: a of their autoregression",
        examples=[0.25],
    )


class DsnuPixelFields(FileTable):
    """Offsets of the pixels."""

    cmos_only: ClassVar[Mapping[str, float | str]] = {"dsnu_e": 0.0}
    dsnu_e: NotNegative = Field(
        0.0, description="pixel offsets, σ as electrons [e-]", examples=[2.0]
    )
    dsnu_coupling: MapCoupling = Field(
        0.0,
        description="how alike offsets of neighbouring pixels are: a of their autoregression",
        examples=[0.25],
    )


@dataclass(frozen=True)
class FixedOffset(Stage):
    """An offset that does not depend on the signal (paper eq. 28, 32).

    sigma_e : σ of the offsets, as electrons at the sense node.  gain_v_per_e : one electron at this stage [V/e-].
    coupling : a of the isotropic AR process.  residual : what the CDS leaves of the offsets, 0 … 1.
    source : name of the random stream; the map is called ``<source>_e``.
    """

    sigma_e: float
    gain_v_per_e: float
    coupling: float = 0.0
    residual: float = 1.0
    domain = "volts"
    source: ClassVar[str]

    @classmethod
    def of(
        cls, camera: Datasheet, sigma_e: float, coupling: float, residual: float = 1.0
    ) -> Self | None:
        """None for a CCD, which has one amplifier."""
        per_e = sense_gain_v_per_e(camera) * camera.source_follower.gain
        if camera.sensor.technology == "ccd":
            return None
        return cls(sigma_e, per_e, coupling, residual)

    @abstractmethod
    def unit_map(self, window: SensorWindow) -> Array:
        """The map with variance 1: (1, W), (H, 1) or (H, W)."""

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing with the camera's offsets."""
        if self.sigma_e == 0 and self._name not in frame.window.given:
            return swing
        return (
            swing
            + frame.number(self.residual * self.gain_v_per_e)
            * self.fpn_maps(frame.window)[self._name]
        )

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the spatial variance."""
        mean, variance = m.frame.window.map_moments(self._name, 0.0, self.sigma_e**2)
        gain = self.residual * self.gain_v_per_e
        return m.add(mean=gain * mean, spatial=gain**2 * variance)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """The offsets in electrons, 0 on average."""
        return {
            self._name: window.measured_or(
                self._name, lambda: window.number(self.sigma_e) * self.unit_map(window)
            )
        }

    def gains_of_maps(self) -> dict[str, float]:
        """What the CDS leaves of an electron [V/e-]."""
        return {self._name: self.residual * self.gain_v_per_e}

    @property
    def _name(self) -> str:
        return f"{self.source}_e"


@dataclass(frozen=True)
class DsnuColumn(FixedOffset):
    """One offset per column; neighbouring columns may be alike (paper eq. 28, 32). A CCD has none."""

    source: ClassVar[str] = "dsnu_col"
    table = "readout"
    fields = DsnuColumnFields
    terms = "DSNU1288_col (E), column FPN, offset FPN"
    label = "DSNU column"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> DsnuColumn | None:
        """σ is a fraction of the full well. None for a CCD."""
        readout = camera.readout
        return cls.of(
            camera,
            readout.dsnu_col * camera.pixel.full_well_e,
            readout.dsnu_col_coupling,
            readout.dsnu_residual,
        )

    def unit_map(self, window: SensorWindow) -> Array:
        """(1, W), variance 1."""
        return window.line_map(self.source, self.coupling, axis=1)


@dataclass(frozen=True)
class DsnuRow(FixedOffset):
    """One offset per row; neighbouring rows may be alike (paper eq. 28). A CCD has none."""

    source: ClassVar[str] = "dsnu_row"
    table = "readout"
    fields = DsnuRowFields
    terms = "DSNU1288_row (E), row FPN"
    label = "DSNU row"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> DsnuRow | None:
        """σ is a fraction of the full well. None for a CCD."""
        return cls.of(
            camera,
            camera.readout.dsnu_row * camera.pixel.full_well_e,
            camera.readout.dsnu_row_coupling,
        )

    def unit_map(self, window: SensorWindow) -> Array:
        """(H, 1), variance 1."""
        return window.line_map(self.source, self.coupling, axis=0)


@dataclass(frozen=True)
class DsnuPixel(FixedOffset):
    """One offset per pixel; neighbouring pixels may be alike (paper eq. 28). A CCD has none."""

    source: ClassVar[str] = "dsnu_pixel"
    table = "pixel"
    fields = DsnuPixelFields
    terms = "DSNU1288_pixel (E), pixel FPN"
    label = "DSNU pixel"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> DsnuPixel | None:
        """None for a CCD."""
        pixel = camera.pixel
        return cls.of(camera, pixel.dsnu_e, pixel.dsnu_coupling, camera.readout.dsnu_residual)

    def unit_map(self, window: SensorWindow) -> Array:
        """(H, W), variance 1."""
        if self.coupling:
            return window.correlated(self.source, self.coupling)
        return window.fixed_map(self.source, normals)
