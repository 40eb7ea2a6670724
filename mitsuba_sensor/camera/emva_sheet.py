"""A camera from the summary sheet of EMVA 1288: its rows in the sheet's order, and the camera file that they make."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

from ..core import InputError, require
from ..core.units import KELVIN_AT_0_C
from ..optics.spectra import OTHER_SENSOR, SILICON_NM, silicon_qe
from .camera import QE_CURVES, Camera, checked_camera

BLACK_LEVEL_SIGMAS = 4
MOST_BLACK = 1 / 8  # of the codes
SHEET = "EMVA 1288 sheet"
Value: TypeAlias = (
    Any  # of a row: a number, two of them, a text, or None where an optional row is left empty
)


class Row(NamedTuple):
    """One row of the sheet.

    key : name of its value.  question : with the unit.  low, high, example : allowed range and example, in this unit.
    fields : keys of the camera file that have its value; other rows follow from these or are not used.
    factor, offset : from this unit to that of the camera file.
    percent_from : of a percentage, the smallest number that is not mistaken for a fraction.
    pair : it has two numbers.  optional : it may be empty.
    """

    key: str
    question: str
    low: float
    high: float
    example: str
    fields: tuple[str, ...] = ()
    factor: float = 1.0
    offset: float = 0.0
    percent_from: float = 0.0
    whole: bool = False
    pair: bool = False
    optional: bool = False

    def value(self, text: str) -> Value:
        """The value of what is typed. Raises InputError with the value, the allowed range and an example."""
        text = text.strip()
        if not text:
            if self.optional:
                return None
            raise InputError(f"{self.question} is empty; the camera needs it.")
        if not self.pair:
            return self._number(text)
        parts = [part for part in re.split(r"\s*[x×*;]\s*|\s+", text) if part]
        if len(parts) == 1 and self.key == "pitch_um":  # of square pixels
            parts *= 2
        if len(parts) != 2:
            raise InputError(
                f"{self.question} is {text!r}; give two numbers, e.g. {self.example}."
            )
        return tuple(map(self._number, parts))

    def _number(self, text: str) -> float:
        alone = text.removesuffix("%").strip() if self.percent_from else text
        number = require(
            self.question, _plain_number(alone), self.low, self.high, f"e.g. {self.example}"
        )
        if self.whole and not number.is_integer():
            raise InputError(
                f"{self.question} is {number:g}; it must be a whole number, e.g. {self.example}."
            )
        if alone == text and 0 < number < self.percent_from:
            raise InputError(
                f"{self.question} is {text}, which is {text} %; write {100 * number:.6g} if it is a fraction, or "
                f"'{text} %' if it is meant."
            )
        value = float(f"{number * self.factor + self.offset:.10g}")
        return int(value) if self.whole else value


def _plain_number(text: str) -> Any:
    """The number in a text, with a decimal point or comma, or as a fraction; a text that is none as it is."""
    try:
        numbers = [float(part.replace(",", ".")) for part in text.split("/")]
        return numbers[0] / math.prod(numbers[1:])
    except (ValueError, ZeroDivisionError):
        return text


ROWS = (
    Row(
        "pitch_um",
        "pixel size [µm]",
        0.1,
        1000,
        "5.86",
        ("pixel.pitch_x_um", "pixel.pitch_y_um"),
        pair=True,
    ),
    Row(
        "size",
        "resolution, columns x rows",
        1,
        10**6,
        "1920 x 1200",
        ("sensor.columns", "sensor.rows"),
        whole=True,
        pair=True,
    ),
    Row("bits", "bit depth [bit]", 1, 24, "12", ("adc.bits",), whole=True),
    Row(
        "wavelength_nm",
        "wavelength of the measurement [nm]",
        SILICON_NM[0],
        SILICON_NM[-1],
        OTHER_SENSOR,
        ("quantum_efficiency.reference_nm",),
    ),
    Row(
        "qe",
        "quantum efficiency QE [%]",
        0.01,
        100,
        "77",
        (QE_CURVES,),
        factor=0.01,
        percent_from=1.5,
    ),
    Row(
        "gain_dn_per_e",
        "overall system gain K [DN/e-], or 1/8.16 where the sheet has 8.16 e-/DN",
        1e-6,
        1e4,
        "0.1225, or 1/8.16",
        ("readout.gain_dn_per_e",),
    ),
    Row(
        "read_noise_e",
        "temporal dark noise σ_d [e-]",
        0,
        1e5,
        "6.83",
        ("source_follower.read_noise_e",),
    ),
    Row("snr_max_db", "maximum SNR [dB]", 0, 100, "45.1", optional=True),
    Row(
        "absolute_sensitivity_e",
        "absolute sensitivity threshold [e-]",
        0,
        1e6,
        "7.7",
        optional=True,
    ),
    Row("saturation_e", "saturation capacity [e-]", 1, 1e9, "32691", ("pixel.full_well_e",)),
    Row("dynamic_range_db", "dynamic range [dB]", 0, 200, "72.5", optional=True),
    Row("dsnu_e", "DSNU [e-]", 0, 1e6, "2.1", ("pixel.dsnu_e",)),
    Row("prnu", "PRNU [%]", 0, 100, "0.5", ("pixel.prnu",), factor=0.01, percent_from=0.05),
    Row("linearity_percent", "linearity error LE [%]", 0, 100, "0.2", optional=True),
    Row("dark_e_per_s", "dark current [e-/s]", 0, 1e9, "5", ("dark_current.rate_e_per_s",)),
    Row(
        "dark_temperature_k",
        "temperature of the dark current [°C]",
        -200,
        200,
        "25",
        ("dark_current.at_temperature_k",),
        offset=KELVIN_AT_0_C,
    ),
)
"""In the order of the summary sheet of EMVA 1288 Release 4."""

KEYS = {row.key: row.fields for row in ROWS if row.fields}

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
    "snr_max_db": ("SNR_max", "dB", "snr_max_db"),
    "absolute_sensitivity_e": ("µ_e.min", "e-", "absolute_sensitivity_e"),
    "dynamic_range_db": ("DR", "dB", "dynamic_range_db"),
}
"""Rows that follow from others: symbol, unit, and the figure of the camera."""


def is_asked(row: Row, values: Mapping[str, Value]) -> bool:
    """Whether a row is needed beside those that are known: a dark current of 0 has no temperature."""
    return row.key != "dark_temperature_k" or values.get("dark_e_per_s") != 0


def camera_of_sheet(values: Mapping[str, Value], name: str, description: str) -> Camera:
    """The camera of these values, by the keys of ROWS. Raises InputError."""
    wavelengths_nm, curve = silicon_qe(values["qe"], values["wavelength_nm"])
    tables: dict[str, Any] = {
        "name": name,
        "description": description,
        "sensor": {"technology": "cmos"},
        "pixel": {"fill_factor": 1.0},
        "quantum_efficiency": {"curves": {"mono": curve}, "wavelengths_nm": wavelengths_nm},
        "dark_current": {},
        "source_follower": {},
        "readout": {"reset": "true_cds"},
        "adc": {"black_level_dn": black_level_dn(values)},
        "sources": dict(ASSUMED),
    }
    for row in ROWS:
        value = values.get(row.key)
        if value is None:
            continue
        what = re.split(r" \[|,", row.question)[0]
        for field, number in zip(row.fields, value if row.pair else (value,), strict=False):
            tables["sources"][field] = f"{SHEET}: {what}"
            if field != QE_CURVES:
                table, key = field.split(".")
                tables[table][key] = number
    tables["sources"][QE_CURVES] += (
        f" at {values['wavelength_nm']:g} nm; the rest assumed, typical silicon"
    )
    return checked_camera(tables, name)


def black_level_dn(values: Mapping[str, Value]) -> int:
    """4σ of the dark noise, or less where the saturation capacity needs the codes [DN]; a sheet does not have it."""
    highest = 2 ** values["bits"] - 1
    noise_dn = values["read_noise_e"] * values["gain_dn_per_e"]
    wanted = min(math.ceil(BLACK_LEVEL_SIGMAS * noise_dn), int(highest * MOST_BLACK))
    free = math.floor(highest - values["gain_dn_per_e"] * values["saturation_e"])
    return int(max(min(wanted, free), 0))


def comparisons(values: Mapping[str, Value], camera: Camera) -> list[str]:
    """Rows of the sheet that follow from others, beside the camera's figures; and what the camera leaves out."""
    figures = camera.emva1288()
    said = []
    for key, (symbol, unit, name) in COMPARED.items():
        if values.get(key) is not None:
            said.append(
                f"{symbol}: {values[key]:.4g} {unit} on the sheet, {getattr(figures, name):.4g} {unit} of this camera"
            )
    if figures.saturation_e < 0.999 * values["saturation_e"]:
        said.append(
            f"saturation capacity: {values['saturation_e']:.6g} e- on the sheet, and at {figures.saturation_e:.6g} e- "
            f"the {camera.adc.bits} bits end: K or the bit depth are of another mode of the camera"
        )
    if values.get("linearity_percent"):
        said.append(
            "linearity error: the camera is linear; adc.ile takes the error of a curve, as a fraction"
        )
    return said
