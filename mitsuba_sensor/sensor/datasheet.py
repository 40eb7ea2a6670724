"""The fields of a camera file: what each means, its unit, its range, an example. The check is pydantic's."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, model_validator

from .qe_file import read_curves

Positive = Annotated[float, Field(ge=1e-30, le=1e30, strict=True)]  # beyond, variances under- and overflow
NotNegative = Annotated[float, Field(ge=0, le=1e30, strict=True)]
Fraction = Annotated[float, Field(gt=0, le=1, strict=True)]
Count = Annotated[int, Field(ge=1, strict=True)]


Chance = Annotated[float, Field(ge=0, le=1, strict=True)]
LineCoupling = Annotated[float, Field(ge=0, le=0.4999, strict=True)]
MapCoupling = Annotated[float, Field(ge=0, le=0.45, strict=True)]


class Section(BaseModel):
    """A table of a camera file: frozen, equal by value, no unknown fields, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SensorSection(Section):
    """The chip."""

    technology: Literal["cmos", "ccd"] = Field(description="chooses the stages of the chain", examples=["cmos"])
    columns: Count = Field(description="pixels in a row", examples=[1900])
    rows: Count = Field(description="pixels in a column", examples=[1300])
    shutter: Literal["global", "rolling"] = Field(
        "global", description="all rows open at once, or one after the other from the top", examples=["rolling"]
    )
    row_time_us: Positive | None = Field(
        None, description="time from the start of a row to that of the next, of a rolling shutter [µs]", examples=[15.0]
    )

    @model_validator(mode="after")
    def _rolls_with_a_row_time(self) -> Self:
        if self.shutter == "rolling" and self.row_time_us is None:
            raise ValueError("a rolling shutter needs row_time_us, the datasheet's line time [µs], e.g. 15")
        return self


class PixelSection(Section):
    """One pixel."""

    pitch_x_um: Positive = Field(description="width of a pixel [µm]", examples=[5.7])
    pitch_y_um: Positive = Field(description="height of a pixel [µm]", examples=[5.7])
    fill_factor: Fraction = Field(description="share of the pixel that sees light", examples=[0.5])
    full_well_e: Annotated[float, Field(ge=1, le=1e30, strict=True)] = Field(
        description="saturation capacity [e-]", examples=[33000]
    )
    prnu: NotNegative = Field(0.0, description="photo response non-uniformity, a fraction of the mean", examples=[0.01])
    prnu_distribution: Literal["gaussian", "lognormal", "ar"] = Field(
        "gaussian", description="family of the gain pattern", examples=["gaussian"]
    )
    prnu_coupling: MapCoupling = Field(0.0, description="coupling a of an ar gain pattern", examples=[0.25])
    dsnu_e: NotNegative = Field(0.0, description="pixel offsets, σ as electrons [e-]", examples=[2.0])
    dsnu_coupling: MapCoupling = Field(0.0, description="coupling a of neighbouring pixel offsets", examples=[0.25])


def _plausible(value: Any) -> bool:
    """Whether a QE is absent or a fraction."""
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 1)


class QuantumEfficiencySection(Section):
    """Electrons per photon, a curve per colour filter, and how the filters repeat over the sensor."""

    value: Chance | None = Field(
        None, description="one QE for all of wavelengths_nm, instead of curves, as a fraction", examples=[0.6]
    )
    file: str | None = Field(
        None, description="CSV file of the curves, instead of wavelengths_nm and curves", examples=["qe.csv"]
    )
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
    quantum_yield: tuple[Annotated[float, Field(ge=1, strict=True)], ...] | None = Field(
        None, description="electrons per interacting photon at each wavelength, 1 in the visible", examples=[[2.0, 1.0]]
    )
    fano_factor: Chance = Field(0.1, description="Fano factor where the yield is above 1", examples=[0.1])

    @model_validator(mode="before")
    @classmethod
    def _from_value_or_file(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict):
            return data
        if not _plausible(data.get("value")) or not isinstance(data.get("file"), str | None):
            return data | {
                "curves": {"mono": [0.0, 1.0]},
                "wavelengths_nm": [1.0, 2.0],
            }  # their own check says what is wrong
        ways = [name for name in ("value", "file", "curves") if data.get(name) is not None]
        if len(ways) > 1:
            raise ValueError(f"give either {ways[0]} or {ways[1]}, and not both")
        if ways == ["file"]:
            return data | {"file": None} | read_curves(data["file"], (info.context or {}).get("folder", "."))
        if ways != ["value"]:
            return data
        points = data.get("wavelengths_nm")
        if not isinstance(points, list | tuple) or not points:
            raise ValueError("value needs wavelengths_nm, the band in which it holds, e.g. [400, 700]")
        return data | {"value": None, "curves": {"mono": [data["value"]] * len(points)}, "tile": None}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        points = self.wavelengths_nm
        if self.quantum_yield is not None and len(self.quantum_yield) != len(points):
            raise ValueError(f"quantum_yield has {len(self.quantum_yield)} values for {len(points)} wavelengths_nm")
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


class DarkComponentSection(Section):
    """A share of the pixels whose mean dark signal follows a law of its own."""

    weight: Chance = Field(description="share of the pixels", examples=[0.001])
    family: Literal["uniform", "normal"] = Field(description="law of the part", examples=["uniform"])
    low: NotNegative | None = Field(None, description="lower end of a uniform part [unit]", examples=[45])
    high: Positive | None = Field(None, description="upper end of a uniform part [unit]", examples=[440])
    mean: Positive | None = Field(None, description="mean of a normal part [unit]", examples=[18])
    sigma: NotNegative | None = Field(None, description="σ of a normal part [unit]", examples=[4])
    unit: Literal["e_per_s", "e", "dn"] = Field(description="unit of the numbers of this part", examples=["dn"])

    @model_validator(mode="after")
    def _complete(self) -> Self:
        wanted, other = (("low", "high"), ("mean", "sigma"))[:: 1 if self.family == "uniform" else -1]
        if any(getattr(self, name) is None for name in wanted) or any(
            getattr(self, name) is not None for name in other
        ):
            raise ValueError(
                f"a {self.family} part has {wanted[0]} and {wanted[1]}, and neither {other[0]} nor {other[1]}"
            )
        if self.low is not None and self.high is not None and self.high <= self.low:
            raise ValueError(f"low is {self.low:g} and high is {self.high:g}; high must be the larger")
        return self


class DarkCurrentSection(Section):
    """Electrons that come without light: a figure of merit at 300 K, or a measured rate."""

    fom_na_per_cm2: NotNegative | None = Field(None, description="figure of merit at 300 K [nA/cm²]", examples=[1.0])
    diffusion_fom_na_per_cm2: NotNegative | None = Field(
        None, description="figure of merit of the diffusion part of an MPP pixel at 300 K [nA/cm²]", examples=[0.01]
    )
    rate_e_per_s: NotNegative | None = Field(
        None, description="rate at at_temperature_k [e-/s per pixel]", examples=[5]
    )
    at_temperature_k: Annotated[float, Field(ge=50, strict=True)] | None = Field(
        None, description="temperature of rate_e_per_s [K]", examples=[298.15]
    )
    doubling_k: Positive | None = Field(
        None, description="warming that doubles the rate [K]; without it the rate follows silicon", examples=[7.0]
    )
    cv: NotNegative = Field(0.0, description="dark pattern D_N: its σ over its mean", examples=[0.1])
    distribution: Literal["gaussian", "lognormal", "gamma", "wald", "logistic", "ar"] = Field(
        "lognormal", description="family of the dark pattern", examples=["lognormal"]
    )
    coupling: MapCoupling = Field(0.0, description="coupling a of an ar dark pattern", examples=[0.25])
    components: tuple[DarkComponentSection, ...] = Field(
        (),
        description="superimposed parts",
        examples=[[{"weight": 0.001, "family": "uniform", "low": 45, "high": 440, "unit": "dn"}]],
    )
    rts_fraction: Chance = Field(0.0, description="share of pixels with a telegraph signal", examples=[0.001])
    rts_amplitude_e_per_s: NotNegative = Field(0.0, description="step of the telegraph signal [e-/s]", examples=[200])
    rts_switching: Annotated[float, Field(ge=1e-4, le=1, strict=True)] = Field(
        0.1, description="chance per frame that a trap is drawn anew", examples=[0.1]
    )
    rts_duty: Chance = Field(0.5, description="share of the time that a trap is on", examples=[0.5])

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        figure, rate = self.fom_na_per_cm2 is not None, self.rate_e_per_s is not None
        if figure == rate:
            raise ValueError("give either fom_na_per_cm2 or rate_e_per_s (with at_temperature_k), and not both")
        if rate != (self.at_temperature_k is not None):
            raise ValueError("rate_e_per_s and at_temperature_k go together; one of them is missing")
        if self.doubling_k is not None and not rate:
            raise ValueError("doubling_k needs rate_e_per_s and at_temperature_k; fom_na_per_cm2 has a law of its own")
        if self.diffusion_fom_na_per_cm2 is not None and not figure:
            raise ValueError("diffusion_fom_na_per_cm2 stands beside fom_na_per_cm2, the depletion part; give both")
        if sum(part.weight for part in self.components) > 1:
            raise ValueError(
                f"the weights of components add up to {sum(p.weight for p in self.components):g}; at most 1"
            )
        if self.distribution != "ar" and self.coupling:
            raise ValueError('coupling belongs to distribution = "ar"; the other families have independent pixels')
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
    band_hz: tuple[NotNegative, Positive] | None = Field(
        None, description="finite noise band [Hz] instead of all frequencies", examples=[[1.0, 20e6]]
    )
    gain: Positive = Field(1.0, description="A_SF [V/V]", examples=[1.0])
    vv_nonlinearity: Annotated[float, Field(gt=0.5, strict=True)] = Field(
        1.0, description="V/V non-linearity γ: gain at full well over gain at zero", examples=[1.05]
    )

    @model_validator(mode="after")
    def _one_noise(self) -> Self:
        if (self.read_noise_e is None) == (self.white_nv_per_rthz is None):
            raise ValueError("give either read_noise_e or white_nv_per_rthz (with corner_hz, …), and not both")
        if self.band_hz is not None and self.band_hz[1] <= self.band_hz[0]:
            raise ValueError(f"band_hz is {list(self.band_hz)}; its second frequency must be the higher one")
        return self


class ReadoutSection(Section):
    """From charge to the voltage that the converter sees."""

    sense_gain_uv_per_e: Positive | None = Field(
        None, description="sense node conversion gain A_SN [µV/e-]", examples=[5.0]
    )
    reset: Literal["hard", "soft", "true_cds"] = Field(
        description="kTC noise: hard leaves all of it, soft 1/√2, true_cds none", examples=["hard"]
    )
    dsnu_col: NotNegative = Field(0.0, description="column offsets, σ over the full-well swing", examples=[0.001])
    dsnu_col_coupling: LineCoupling = Field(0.0, description="coupling a of neighbouring columns", examples=[0.25])
    dsnu_row: NotNegative = Field(0.0, description="row offsets, σ over the full-well swing", examples=[0.0005])
    dsnu_row_coupling: LineCoupling = Field(0.0, description="coupling a of neighbouring rows", examples=[0.25])
    prnu_col: NotNegative = Field(0.0, description="spread of the column gains, σ over 1", examples=[0.002])
    prnu_col_coupling: LineCoupling = Field(0.0, description="coupling a of the column gains", examples=[0.25])
    dsnu_residual: Chance = Field(
        1.0, description="share of column and pixel offsets that the analogue CDS leaves", examples=[1.0]
    )
    ktc_residual: Chance | None = Field(
        None, description="share of the kTC noise left, instead of what reset implies", examples=[0.05]
    )
    v_ref_v: Positive = Field(3.1, description="reference voltage of the sense node V_REF [V]", examples=[3.1])
    ve_nonlinearity: Chance = Field(
        0.0, description="V/e- non-linearity α of the sense node, 0 is linear", examples=[1.0]
    )
    ve_k1_c: Positive | None = Field(
        None, description="k₁ of the V/e- law of the paper's eq. 8 [C], instead of A_SN", examples=[10.909e-15]
    )
    cds_gain: Positive = Field(1.0, description="A_CDS [V/V]", examples=[1.0])

    @model_validator(mode="after")
    def _one_gain(self) -> Self:
        if (self.sense_gain_uv_per_e is None) == (self.ve_k1_c is None):
            raise ValueError("give either sense_gain_uv_per_e or ve_k1_c, which implies it, and not both")
        if self.ve_k1_c is not None and not self.ve_nonlinearity:
            raise ValueError("ve_k1_c belongs to the V/e- non-linearity; set ve_nonlinearity, e.g. 1.0")
        return self


class AdcSection(Section):
    """The analogue-to-digital converter."""

    bits: Annotated[int, Field(ge=1, le=24, strict=True)] = Field(description="resolution [bit]", examples=[12])
    full_scale_v: Positive | None = Field(
        None, description="swing of the whole code range V_FS [V]; default: the swing of a full well", examples=[0.165]
    )
    black_level_dn: NotNegative | None = Field(
        None, description="what darkness reads [DN]; default: 4σ of the noise of a zero exposure", examples=[64]
    )
    gamma: Annotated[float, Field(gt=0, lt=2.718281828459045, strict=True)] | None = Field(
        None, description="integral non-linearity γ: gain at zero over gain at full scale, below e", examples=[1.04]
    )
    ile: Annotated[float, Field(ge=0, lt=0.25, strict=True)] | None = Field(
        None, description="the same as an end-point error, a fraction of full scale", examples=[0.0099]
    )
    dnl_lsb: dict[str, Annotated[float, Field(ge=-1, strict=True)]] = Field(
        default_factory=dict,
        description="code → its step's width less one [LSB]; -1 is a missing code",
        examples=[{"7": -1.0}],
    )

    @model_validator(mode="after")
    def _one_curve(self) -> Self:
        if self.gamma is not None and self.ile is not None:
            raise ValueError("give either gamma or ile, and not both; gamma = 1.04 is an ile of 0.0099")
        for code in self.dnl_lsb:
            if not code.isdecimal() or not 0 < int(code) < 2**self.bits - 1:
                last = 2**self.bits - 2
                raise ValueError(f"dnl_lsb names the code {code!r}; codes with two edges run from 1 to {last}")
        return self
