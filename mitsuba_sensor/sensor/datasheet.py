"""The fields of a camera file: what each means, its unit, its range, an example. The check is pydantic's."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0, le=1e30, strict=True)]  # beyond, variances overflow
NotNegative = Annotated[float, Field(ge=0, le=1e30, strict=True)]
Fraction = Annotated[float, Field(gt=0, le=1, strict=True)]
Count = Annotated[int, Field(ge=1, strict=True)]


class Section(BaseModel):
    """A table of a camera file: frozen, equal by value, no unknown fields, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SensorSection(Section):
    """The chip."""

    technology: Literal["cmos", "ccd"] = Field(description="chooses the stages of the chain", examples=["cmos"])
    columns: Count = Field(description="pixels in a row", examples=[1900])
    rows: Count = Field(description="pixels in a column", examples=[1300])


class PixelSection(Section):
    """One pixel."""

    pitch_x_um: Positive = Field(description="width of a pixel [µm]", examples=[5.7])
    pitch_y_um: Positive = Field(description="height of a pixel [µm]", examples=[5.7])
    fill_factor: Fraction = Field(description="share of the pixel that sees light", examples=[0.5])
    full_well_e: Positive = Field(description="saturation capacity [e-]", examples=[33000])
    prnu: NotNegative = Field(0.0, description="photo response non-uniformity, a fraction of the mean", examples=[0.01])


class QuantumEfficiencySection(Section):
    """Electrons per photon, a curve per colour filter, and how the filters repeat over the sensor."""

    wavelengths_nm: Annotated[tuple[Positive, ...], Field(min_length=2)] = Field(
        description="where the curves are given, increasing [nm]", examples=[[400, 700]]
    )
    curves: Annotated[dict[str, tuple[Annotated[float, Field(ge=0, le=1, strict=True)], ...]], Field(min_length=1)] = (
        Field(description="filter name → QE at each wavelength, as a fraction", examples=[{"mono": [0.6, 0.6]}])
    )
    tile: Annotated[tuple[tuple[str, ...], ...], Field(min_length=1)] | None = Field(
        None, description="rows of filter names that repeat over the sensor", examples=[[["R", "G"], ["G", "B"]]]
    )
    reference_nm: Positive | None = Field(
        None, description="the wavelength of photons that come without one [nm]", examples=[550]
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        points = self.wavelengths_nm
        if any(b <= a for a, b in pairwise(points)):
            raise ValueError("wavelengths_nm must increase from each point to the next")
        for name, curve in self.curves.items():
            if len(curve) != len(points):
                raise ValueError(f"curves.{name} has {len(curve)} values for {len(points)} wavelengths_nm")
        if self.tile is None and len(self.curves) > 1:
            raise ValueError('several curves need a tile of their names, e.g. [["R", "G"], ["G", "B"]]')
        for row in self.tile or ():
            if not row or len(row) != len(self.tile[0]):  # type: ignore[index]
                raise ValueError("tile must be a rectangle: every row as long as the first, and none empty")
            for name in row:
                if name not in self.curves:
                    raise ValueError(f"tile names {name!r}, which has no curve; there are {sorted(self.curves)}")
        return self


class DarkCurrentSection(Section):
    """Electrons that come without light: a figure of merit at 300 K, or a measured rate that doubles."""

    fom_na_per_cm2: NotNegative | None = Field(None, description="figure of merit at 300 K [nA/cm²]", examples=[1.0])
    rate_e_per_s: NotNegative | None = Field(
        None, description="rate at at_temperature_k [e-/s per pixel]", examples=[5]
    )
    at_temperature_k: Positive | None = Field(None, description="temperature of rate_e_per_s [K]", examples=[298.15])
    doubling_k: Positive | None = Field(None, description="warming that doubles the rate [K]", examples=[7.0])
    cv: NotNegative = Field(0.0, description="dark pattern D_N: its σ over its mean", examples=[0.1])
    pattern: Literal["gaussian", "lognormal"] = Field(
        "lognormal", description="family of the dark pattern", examples=["lognormal"]
    )

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        measured = (self.rate_e_per_s, self.at_temperature_k, self.doubling_k)
        given = [x is not None for x in measured]
        if (self.fom_na_per_cm2 is None) == (not any(given)):
            raise ValueError("give either fom_na_per_cm2 or rate_e_per_s with at_temperature_k and doubling_k")
        if any(given) and not all(given):
            raise ValueError("rate_e_per_s, at_temperature_k and doubling_k go together; one of them is missing")
        return self


class SourceFollowerSection(Section):
    """Noise of the pixel's amplifier, from its densities (closed form) or as the datasheet's one number."""

    read_noise_e: NotNegative | None = Field(
        None, description="read noise as a datasheet gives it [e- rms]", examples=[3]
    )
    white_nv_per_rthz: NotNegative | None = Field(None, description="white noise density [nV/√Hz]", examples=[15])
    corner_hz: NotNegative = Field(0.0, description="flicker corner frequency [Hz]", examples=[1e6])
    cds_sample_s: Positive = Field(1e-6, description="time between the two CDS samples t_s [s]", examples=[1e-6])
    cds_dominant_s: Positive = Field(0.5e-6, description="dominant time constant of the CDS τ_D [s]", examples=[0.5e-6])
    rtn_uv: NotNegative = Field(0.0, description="random telegraph step ΔV [µV]", examples=[0.0])
    rtn_s: Positive = Field(1e-6, description="random telegraph time constant [s]", examples=[1e-6])
    gain: Positive = Field(1.0, description="A_SF [V/V]", examples=[1.0])

    @model_validator(mode="after")
    def _one_noise(self) -> Self:
        if (self.read_noise_e is None) == (self.white_nv_per_rthz is None):
            raise ValueError("give either read_noise_e or white_nv_per_rthz (with corner_hz, …), and not both")
        return self


class ReadoutSection(Section):
    """From charge to the voltage that the converter sees."""

    sense_gain_uv_per_e: Positive = Field(description="sense node conversion gain A_SN [µV/e-]", examples=[5.0])
    reset: Literal["hard", "soft", "true_cds"] = Field(
        description="kTC noise: hard leaves all of it, soft 1/√2, true_cds none", examples=["hard"]
    )
    column_offset: NotNegative = Field(0.0, description="column offsets, σ over the full-well swing", examples=[0.001])
    column_coupling: Annotated[float, Field(ge=0, le=0.4999, strict=True)] = Field(
        0.0, description="coupling a of neighbouring columns", examples=[0.25]
    )
    cds_gain: Positive = Field(1.0, description="A_CDS [V/V]", examples=[1.0])


class AdcSection(Section):
    """The analogue-to-digital converter."""

    bits: Annotated[int, Field(ge=1, le=24, strict=True)] = Field(description="resolution [bit]", examples=[12])
    full_scale_v: Positive | None = Field(
        None, description="swing of the whole code range V_FS [V]; default: the swing of a full well", examples=[0.165]
    )
    pedestal_dn: NotNegative | None = Field(
        None, description="what darkness reads [DN]; default: 4σ of the noise of a zero exposure", examples=[64]
    )


class LensSection(Section):
    """The lens decides the light; the scene's own thin lens decides the blur."""

    f_number: Positive = Field(2.8, description="focal length over pupil diameter N", examples=[2.8])
    transmission: Fraction = Field(1.0, description="share of the light that passes", examples=[0.95])
    pupil_magnification: Positive = Field(1.0, description="exit over entrance pupil diameter P", examples=[1.0])
    convention: Literal["working", "planar"] = Field(
        "working", description="πLT/(4N_w²)·cos⁴, or EMVA's πLT/(1 + 4N²(1+m)²)·cos⁴", examples=["working"]
    )
