"""A camera from a file with the rows of an EMVA 1288 summary sheet, and a comparison with the sheet."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from ..core import InputError
from ..core.small_files import toml_tables
from ..core.units import KELVIN_AT_0_C
from ..files.texts import text_of_file
from ..optics.spectra import silicon_qe
from ..stages.datasheet import FileTable, NotNegative, Positive, Side, optional
from .camera import QE_CURVES, Camera, checked_camera
from .datasheet_errors import sentence

BLACK_LEVEL_SIGMAS = 4
BLACK_LEVEL_MAX = 1 / 8  # of the codes
SHEET = "EMVA 1288 sheet"
SIZE_OF_TEXT = re.compile(r"^\s*(\w+)\s*=\s*(\d+)\s*[x×*]\s*(\d+)", re.MULTILINE)
"""A pair as sheets print it, ``size = 1440x1080``, which is not TOML."""
PERCENT_MIN = {"qe_percent": 1.5, "prnu_percent": 0.05}
"""Percentage → smallest value; a smaller number is probably a fraction."""
FULL_SCALE_REACHED = 0.7, 1.1
"""Range of K·saturation capacity over the full-scale code on consistent sheets: the ADC ends near the capacity."""
FULL_SCALE_MISSED = 0.5
"""Below this fraction of the full-scale code, K contradicts the saturation capacity if 1/K fits."""


def _pair(value: object) -> object:
    """Return one number for both sides of a square pixel."""
    return (value, value) if isinstance(value, int | float) else value


class EmvaSheet(FileTable):
    """The rows of an EMVA 1288 Release 4 summary sheet, in its order, and the f-number of the lens."""

    pitch_um: Annotated[tuple[Positive, Positive], BeforeValidator(_pair)] = Field(
        description="pixel size, one number or width and height [µm]", examples=[5.86]
    )
    size: tuple[Side, Side] = Field(
        description="resolution, columns and rows", examples=[[1920, 1200]]
    )
    bits: Annotated[int, Field(ge=1, le=24, strict=True)] = Field(
        description="bit depth [bit]", examples=[12]
    )
    wavelength_nm: Positive = Field(
        description="wavelength of the measurement [nm]", examples=[525]
    )
    qe_percent: Annotated[float, Field(gt=0, le=100, strict=True)] = Field(
        description="quantum efficiency QE [%]", examples=[77]
    )
    gain_dn_per_e: Positive = Field(
        description="overall system gain K, the reciprocal of the e-/DN of some sheets [DN/e-]",
        examples=[0.1225],
    )
    read_noise_e: NotNegative = Field(
        description="temporal dark noise σ_d [e-]", examples=[6.83]
    )
    snr_max_db: NotNegative | None = optional("maximum SNR [dB]", 45.1)
    absolute_sensitivity_e: NotNegative | None = optional(
        "absolute sensitivity threshold [e-]", 7.7
    )
    saturation_e: Annotated[float, Field(ge=1, le=1e9, strict=True)] = Field(
        description="saturation capacity [e-]", examples=[32691]
    )
    dynamic_range_db: NotNegative | None = optional("dynamic range [dB]", 72.5)
    dsnu_e: NotNegative = Field(description="DSNU [e-]", examples=[0])
    prnu_percent: Annotated[float, Field(ge=0, le=100, strict=True)] = Field(
        description="PRNU [%]", examples=[1]
    )
    linearity_percent: NotNegative | None = optional("linearity error LE [%]", 0.2)
    dark_e_per_s: NotNegative = Field(description="dark current [e-/s]", examples=[5])
    dark_temperature_c: Annotated[float, Field(ge=-200, le=200, strict=True)] | None = optional(
        "temperature of the dark current [°C]", 25
    )
    f_number: Annotated[float, Field(ge=0.01, le=1e6, strict=True)] | None = optional(
        "f-number of the lens, which a sheet does not have", 2.8
    )

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        for name, least in PERCENT_MIN.items():
            percent = getattr(self, name)
            if 0 < percent < least:
                raise ValueError(
                    f"{name} is {percent:g}, which looks like a fraction; write {100 * percent:.6g}, or, for "
                    f"{percent:g} %, edit the camera file afterwards"
                )
        if self.dark_e_per_s and self.dark_temperature_c is None:
            raise ValueError(
                "dark_temperature_c is missing; add the temperature of the dark current"
            )
        gain, full_dn = self.gain_dn_per_e, 2.0**self.bits - 1
        code_dn, reciprocal_dn = gain * self.saturation_e, self.saturation_e / gain
        low, high = FULL_SCALE_REACHED
        is_reached = FULL_SCALE_MISSED * full_dn <= code_dn <= high * full_dn
        if not is_reached and low * full_dn <= reciprocal_dn <= high * full_dn:
            raise ValueError(
                f"gain_dn_per_e is {gain:g}, so saturation_e = {self.saturation_e:g} gives {code_dn:.4g} DN, but the "
                f"full-scale code is {full_dn:g} DN; {gain:g} looks like e-/DN: write {1 / gain:.6g}, which gives "
                f"{reciprocal_dn:.4g} DN"
            )
        return self


KEYS = {
    "pitch_um": ("pixel.pitch_x_um", "pixel.pitch_y_um"),
    "size": ("sensor.columns", "sensor.rows"),
    "bits": ("adc.bits",),
    "wavelength_nm": ("quantum_efficiency.reference_nm",),
    "qe_percent": (QE_CURVES,),
    "gain_dn_per_e": ("readout.gain_dn_per_e",),
    "read_noise_e": ("source_follower.read_noise_e",),
    "saturation_e": ("pixel.full_well_e",),
    "dsnu_e": ("pixel.dsnu_e",),
    "prnu_percent": ("pixel.prnu",),
    "dark_e_per_s": ("dark_current.rate_e_per_s",),
    "dark_temperature_c": ("dark_current.at_temperature_k",),
    "f_number": ("lens.f_number",),
}
"""Row → keys of the camera file with its value."""

ASSUMED = {
    "sensor.technology": "assumed: CMOS; the sheet does not give it",
    "pixel.fill_factor": "the quantum efficiency of a sheet includes the fill factor",
    "quantum_efficiency.wavelengths_nm": "assumed: range of a typical silicon sensor; the sheet has one wavelength",
    "readout.reset": "assumed: correlated double sampling leaves no kTC noise",
    "adc.black_level_dn": "assumed: 4σ of the dark noise, or less if the saturation capacity needs the codes",
    "lens.f_number": "assumed: f/2.8; the sheet has no lens, so set the f-number of yours",
}
"""Sources of numbers that a sheet does not have."""

COMPARED = {
    "snr_max_db": ("SNR_max", "dB"),
    "absolute_sensitivity_e": ("µ_e.min", "e-"),
    "dynamic_range_db": ("DR", "dB"),
}
"""Rows that follow from others → symbol and unit; :class:`EmvaFigures` has them under the same name."""


def read_sheet(path: str | Path) -> EmvaSheet:
    """Return the rows in a TOML file. Raises InputError."""
    text = text_of_file(Path(path), "give a TOML file with the rows of an EMVA 1288 sheet")
    try:
        return EmvaSheet.model_validate(toml_tables(text))
    except tomllib.TOMLDecodeError as error:
        if pair := SIZE_OF_TEXT.search(text):
            name, columns, rows = pair.groups()
            raise InputError(
                f"{path}: {pair[0].strip()} is not TOML; write {name} = [{columns}, {rows}]."
            ) from None
        raise InputError(
            f"{path} is not valid TOML: {error}; write rows like bits = 12 and size = [1920, 1200]."
        ) from None
    except ValidationError as error:
        raise InputError(sentence(error, EmvaSheet, str(path), "sheet")) from None


def camera_of_sheet(sheet: EmvaSheet, name: str, description: str) -> Camera:
    """Return the camera of a sheet. Raises InputError."""
    qe = float(f"{sheet.qe_percent / 100:.10g}")
    wavelengths_nm, curve = silicon_qe(qe, sheet.wavelength_nm)
    values: dict[str, Any] = sheet.model_dump(exclude_none=True)
    values |= {"qe_percent": {"mono": curve}, "prnu_percent": sheet.prnu_percent / 100}
    if sheet.dark_temperature_c is not None:
        values["dark_temperature_c"] = sheet.dark_temperature_c + KELVIN_AT_0_C
    tables: dict[str, Any] = {
        "name": name,
        "description": description,
        "sensor": {"technology": "cmos"},
        "pixel": {"fill_factor": 1.0},
        "quantum_efficiency": {"wavelengths_nm": wavelengths_nm},
        "dark_current": {},
        "source_follower": {},
        "lens": {"f_number": 2.8},
        "readout": {"reset": "true_cds"},
        "adc": {"black_level_dn": black_level_dn(sheet)},
        "sources": dict(ASSUMED),
    }
    for row, fields in KEYS.items():
        if row not in values:
            continue
        meaning = (EmvaSheet.model_fields[row].description or "").split(" [")[0].split(",")[0]
        numbers = values[row] if len(fields) > 1 else (values[row],)
        for field, value in zip(fields, numbers, strict=True):
            table, key = field.split(".")
            tables[table][key] = float(f"{value:.10g}") if isinstance(value, float) else value
            tables["sources"][field] = f"{SHEET}: {meaning}"
    if sheet.f_number is not None:
        tables["sources"]["lens.f_number"] = "given with the sheet"
    tables["sources"][QE_CURVES] += (
        f" at {sheet.wavelength_nm:g} nm; other wavelengths assumed: typical silicon"
    )
    return checked_camera(tables, name)


def black_level_dn(sheet: EmvaSheet) -> int:
    """Return 4σ of the dark noise [DN], or less if the saturation capacity needs the codes; a sheet has no value."""
    highest, gain = 2**sheet.bits - 1, sheet.gain_dn_per_e
    noise_dn = math.ceil(BLACK_LEVEL_SIGMAS * sheet.read_noise_e * gain)
    free_dn = math.floor(highest - gain * sheet.saturation_e)
    return int(max(min(noise_dn, int(highest * BLACK_LEVEL_MAX), free_dn), 0))


def comparisons(sheet: EmvaSheet, camera: Camera) -> list[str]:
    """Return notes that compare rows of the sheet with the camera, and name what the camera ignores."""
    figures = camera.emva1288()
    notes = [
        f"{symbol}: {getattr(sheet, name):.4g} {unit} on the sheet, {getattr(figures, name):.4g} {unit} in this camera"
        for name, (symbol, unit) in COMPARED.items()
        if getattr(sheet, name) is not None
    ]
    if figures.saturation_e < 0.999 * sheet.saturation_e:
        notes.append(
            f"saturation capacity: {sheet.saturation_e:.6g} e- on the sheet, but {camera.adc.bits} bits saturate at "
            f"{figures.saturation_e:.6g} e-; check whether K and bit depth belong to the same camera mode"
        )
    if sheet.linearity_percent:
        notes.append(
            "linearity error: ignored, so the camera is linear; set adc.ile for a curve"
        )
    return notes
