"""A camera from the rows of the summary sheet of EMVA 1288 in a file, and what the sheet says of the camera."""

from __future__ import annotations

import math
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
MOST_BLACK = 1 / 8  # of the codes
SHEET = "EMVA 1288 sheet"
FRACTIONS = {"qe_percent": 1.5, "prnu_percent": 0.05}
"""Percentage → the smallest number that is not taken for a fraction."""


def _pair(value: object) -> object:
    """One number for both sides of a square pixel."""
    return (value, value) if isinstance(value, int | float) else value


class EmvaSheet(FileTable):
    """The rows of the summary sheet of EMVA 1288 Release 4, in its order."""

    pitch_um: Annotated[tuple[Positive, Positive], BeforeValidator(_pair)] = Field(
        description="pixel size, one number or across and down [µm]", examples=[5.86]
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
        description="overall system gain K, one over the e-/DN of some sheets [DN/e-]",
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

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        for name, least in FRACTIONS.items():
            percent = getattr(self, name)
            if 0 < percent < least:
                raise ValueError(
                    f"{name} is {percent:g}, which looks like a fraction; write {100 * percent:.6g}, or change the "
                    f"camera file afterwards if {percent:g} % is meant"
                )
        if self.dark_e_per_s and self.dark_temperature_c is None:
            raise ValueError("dark_temperature_c is missing; the dark current depends on it")
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
}
"""Row → the keys of the camera file that have its value."""

ASSUMED = {
    "sensor.technology": "assumed: CMOS; the sheet does not say it",
    "pixel.fill_factor": "the quantum efficiency of a sheet is that of the whole pixel",
    "quantum_efficiency.wavelengths_nm": "assumed: the sheet has one wavelength; a typical silicon sensor has this "
    "range",
    "readout.reset": "assumed: correlated double sampling leaves no kTC noise",
    "adc.black_level_dn": "assumed: 4σ of the dark noise, if the saturation capacity leaves the codes",
}
"""Sources of the numbers that are on no sheet."""

COMPARED = {
    "snr_max_db": ("SNR_max", "dB"),
    "absolute_sensitivity_e": ("µ_e.min", "e-"),
    "dynamic_range_db": ("DR", "dB"),
}
"""Rows that follow from others: symbol and unit; the camera's figure has the same name."""


def read_sheet(path: str | Path) -> EmvaSheet:
    """The rows in a TOML file, ``NAME = VALUE`` in each line. Raises InputError."""
    text = text_of_file(Path(path), "give a text file with the rows of an EMVA 1288 sheet")
    try:
        return EmvaSheet.model_validate(toml_tables(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is not valid TOML: {error}.") from None
    except ValidationError as error:
        raise InputError(sentence(error, EmvaSheet, str(path), "sheet")) from None


def camera_of_sheet(sheet: EmvaSheet, name: str, description: str) -> Camera:
    """The camera of a sheet. Raises InputError."""
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
        "readout": {"reset": "true_cds"},
        "adc": {"black_level_dn": black_level_dn(sheet)},
        "sources": dict(ASSUMED),
    }
    for row, fields in KEYS.items():
        if row not in values:
            continue
        what = (
            (EmvaSheet.model_fields[row].description or "").partition(" [")[0].partition(",")[0]
        )
        for field, value in zip(
            fields, values[row] if len(fields) > 1 else (values[row],), strict=True
        ):
            table, key = field.split(".")
            tables[table][key] = float(f"{value:.10g}") if isinstance(value, float) else value
            tables["sources"][field] = f"{SHEET}: {what}"
    tables["sources"][QE_CURVES] += (
        f" at {sheet.wavelength_nm:g} nm; the rest assumed, typical silicon"
    )
    return checked_camera(tables, name)


def black_level_dn(sheet: EmvaSheet) -> int:
    """4σ of the dark noise, or less where the saturation capacity needs the codes [DN]; a sheet does not have it."""
    highest, gain = 2**sheet.bits - 1, sheet.gain_dn_per_e
    wanted = min(
        math.ceil(BLACK_LEVEL_SIGMAS * sheet.read_noise_e * gain), int(highest * MOST_BLACK)
    )
    free = math.floor(highest - gain * sheet.saturation_e)
    return int(max(min(wanted, free), 0))


def comparisons(sheet: EmvaSheet, camera: Camera) -> list[str]:
    """Rows of the sheet that follow from others, beside the camera's figures; and what the camera leaves out."""
    figures = camera.emva1288()
    notes = [
        f"{symbol}: {getattr(sheet, name):.4g} {unit} on the sheet, {getattr(figures, name):.4g} {unit} of this camera"
        for name, (symbol, unit) in COMPARED.items()
        if getattr(sheet, name) is not None
    ]
    if figures.saturation_e < 0.999 * sheet.saturation_e:
        notes.append(
            f"saturation capacity: {sheet.saturation_e:.6g} e- on the sheet, and at {figures.saturation_e:.6g} e- "
            f"the {camera.adc.bits} bits end: K or the bit depth are of another mode of the camera"
        )
    if sheet.linearity_percent:
        notes.append(
            "linearity error: the camera is linear; adc.ile takes the error of a curve, as a fraction"
        )
    return notes
