"""A camera from the summary sheet of EMVA 1288: its rows in the sheet's order, and the camera file that they make."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

from ..core import InputError, require
from ..core.units import KELVIN_AT_0_C
from ..optics.spectra import OTHER_SENSOR, SILICON_NM, silicon_qe
from .camera import Camera
from .camera_file import camera_from

BLACK_LEVEL_SIGMAS = 4
MOST_BLACK = 1 / 8  # of the codes
SHEET = "EMVA 1288 sheet"
Value: TypeAlias = (
    Any  # of a row: a number, two of them, a text, or None where an optional row is left empty
)


class Row(NamedTuple):
    """One row of the sheet.

    key : name of its value.  question : what is asked, with the unit.  read : the value of a text; raises InputError.
    optional : whether it may stay empty.
    """

    key: str
    question: str
    read: Callable[[str, str], Value]
    optional: bool = False

    def value(self, text: str) -> Value:
        """What is typed, read. Raises InputError with the value, the allowed range and an example."""
        text = text.strip()
        if text:
            return self.read(self.question, text)
        if not self.optional:
            raise InputError(f"{self.question} is empty; the camera needs it.")
        return None


def _number(
    low: float, high: float, example: str, factor: float = 1.0, offset: float = 0.0
) -> Callable[[str, str], float]:
    """Reads a number in a range.  factor, offset : of the value in the unit of the camera file."""

    def read(question: str, text: str) -> float:
        number = _plain_number(text)
        value = require(question, number, low, high, f"e.g. {example}")
        return float(f"{value * factor + offset:.10g}")

    return read


def _percent(
    low: float, high: float, example: str, least: float
) -> Callable[[str, str], float]:
    """Reads a percentage. A number that may be meant as a fraction, below ``least``, needs its %."""
    read_number = _number(low, high, example, factor=0.01)

    def read(question: str, text: str) -> float:
        alone = text.removesuffix("%").strip()
        value = read_number(question, alone)
        if alone == text and 0 < value * 100 < least:
            raise InputError(
                f"{question} is {text}, which is {text} %; write {100 * value * 100:.6g} if it is a fraction, or "
                f"'{text} %' if it is meant."
            )
        return value

    return read


def _plain_number(text: str) -> Any:
    """The number in a text, with a decimal point or comma, as a fraction too; a text that is none as it is."""
    parts = [part.strip().replace(",", ".") for part in text.split("/")]
    try:
        numbers = [float(part) for part in parts]
        if len(numbers) == 1:
            return numbers[0]
        return numbers[0] / numbers[1]
    except (ValueError, ZeroDivisionError):
        return text


def _whole(low: int, high: int, example: str) -> Callable[[str, str], int]:
    def read(question: str, text: str) -> int:
        number = require(
            question, _plain_number(text), low, high, f"a whole number, e.g. {example}"
        )
        if number != int(number):
            raise InputError(
                f"{question} is {number:g}; it must be a whole number, e.g. {example}."
            )
        return int(number)

    return read


def _pair(read_one: Callable[[str, str], Value], alone: bool) -> Callable[[str, str], Value]:
    """Reads ``1920 x 1200``.  alone : whether one number stands for two equal ones."""

    def read(question: str, text: str) -> Value:
        parts = [part for part in re.split(r"\s*[x×*;]\s*|\s+", text) if part]
        if len(parts) == 1 and alone:
            parts *= 2
        if len(parts) != 2:
            raise InputError(f"{question} is {text!r}; give two numbers, e.g. 1920 x 1200.")
        return tuple(read_one(question, part) for part in parts)

    return read


ROWS = (
    Row("pitch_um", "pixel size [µm]", _pair(_number(0.1, 1000, "5.86"), alone=True)),
    Row(
        "size",
        "resolution, columns x rows",
        _pair(_whole(1, 10**6, "1920"), alone=False),
    ),
    Row("bits", "bit depth [bit]", _whole(1, 24, "12")),
    Row(
        "wavelength_nm",
        "wavelength of the measurement [nm]",
        _number(SILICON_NM[0], SILICON_NM[-1], OTHER_SENSOR),
    ),
    Row("qe", "quantum efficiency QE [%]", _percent(0.01, 100, "77", least=1.5)),
    Row(
        "gain_dn_per_e",
        "overall system gain K [DN/e-], or 1/8.16 where the sheet has 8.16 e-/DN",
        _number(1e-6, 1e4, "0.1225, or 1/8.16"),
    ),
    Row("read_noise_e", "temporal dark noise σ_d [e-]", _number(0, 1e5, "6.83")),
    Row("snr_max_db", "maximum SNR [dB]", _number(0, 100, "45.1"), optional=True),
    Row(
        "absolute_sensitivity_e",
        "absolute sensitivity threshold [e-]",
        _number(0, 1e6, "7.7"),
        optional=True,
    ),
    Row("saturation_e", "saturation capacity [e-]", _number(1, 1e9, "32691")),
    Row("dynamic_range_db", "dynamic range [dB]", _number(0, 200, "72.5"), optional=True),
    Row("dsnu_e", "DSNU [e-]", _number(0, 1e6, "2.1")),
    Row("prnu", "PRNU [%]", _percent(0, 100, "0.5", least=0.05)),
    Row("linearity_percent", "linearity error LE [%]", _number(0, 100, "0.2"), optional=True),
    Row("dark_e_per_s", "dark current [e-/s]", _number(0, 1e9, "5")),
    Row(
        "dark_temperature_k",
        "temperature of the dark current [°C]",
        _number(-200, 200, "25", offset=KELVIN_AT_0_C),
    ),
)
"""In the order of the summary sheet of EMVA 1288 Release 4."""

KEYS = {
    "pitch_um": ("pixel.pitch_x_um", "pixel.pitch_y_um"),
    "size": ("sensor.columns", "sensor.rows"),
    "bits": ("adc.bits",),
    "wavelength_nm": ("quantum_efficiency.reference_nm",),
    "qe": ("quantum_efficiency.curves",),
    "gain_dn_per_e": ("readout.gain_dn_per_e",),
    "read_noise_e": ("source_follower.read_noise_e",),
    "saturation_e": ("pixel.full_well_e",),
    "dsnu_e": ("pixel.dsnu_e",),
    "prnu": ("pixel.prnu",),
    "dark_e_per_s": ("dark_current.rate_e_per_s",),
    "dark_temperature_k": ("dark_current.at_temperature_k",),
}
"""Row → the keys of the camera file that it gives. The others follow from these, or are not used."""

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
    pitch_x_um, pitch_y_um = values["pitch_um"]
    columns, rows = values["size"]
    black_dn = black_level_dn(values)
    wavelengths_nm, curve = silicon_qe(values["qe"], values["wavelength_nm"])
    dark: dict[str, Value] = {"rate_e_per_s": values["dark_e_per_s"]}
    if values.get("dark_temperature_k") is not None:
        dark["at_temperature_k"] = values["dark_temperature_k"]
    tables: dict[str, Value] = {
        "name": name,
        "description": description,
        "sensor": {"technology": "cmos", "columns": columns, "rows": rows},
        "pixel": {
            "pitch_x_um": pitch_x_um,
            "pitch_y_um": pitch_y_um,
            "fill_factor": 1.0,
            "full_well_e": values["saturation_e"],
            "prnu": values["prnu"],
            "dsnu_e": values["dsnu_e"],
        },
        "quantum_efficiency": {
            "curves": {"mono": curve},
            "wavelengths_nm": wavelengths_nm,
            "reference_nm": values["wavelength_nm"],
        },
        "dark_current": dark,
        "source_follower": {"read_noise_e": values["read_noise_e"]},
        "readout": {
            "gain_dn_per_e": values["gain_dn_per_e"],
            "reset": "true_cds",
        },
        "adc": {"bits": values["bits"], "black_level_dn": black_dn},
        "sources": _sources(values),
    }
    return camera_from(tables, name)


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


def _sources(values: Mapping[str, Value]) -> dict[str, str]:
    """Where each number of the file comes from."""
    at = f"QE at {values['wavelength_nm']:g} nm"
    band = "assumed: the sheet has one wavelength; a typical silicon sensor has this range"
    said = {
        "sensor.technology": "assumed: CMOS; the sheet does not say it",
        "sensor.columns": f"{SHEET}: resolution",
        "sensor.rows": f"{SHEET}: resolution",
        "pixel.pitch_x_um": f"{SHEET}: pixel size",
        "pixel.pitch_y_um": f"{SHEET}: pixel size",
        "pixel.fill_factor": "the quantum efficiency of a sheet is that of the whole pixel",
        "pixel.full_well_e": f"{SHEET}: saturation capacity",
        "pixel.prnu": f"{SHEET}: PRNU",
        "quantum_efficiency.curves": f"{SHEET}: {at}; the rest assumed, typical silicon",
        "quantum_efficiency.wavelengths_nm": band,
        "quantum_efficiency.reference_nm": f"{SHEET}: wavelength",
        "dark_current.rate_e_per_s": f"{SHEET}: dark current",
        "source_follower.read_noise_e": f"{SHEET}: temporal dark noise",
        "readout.gain_dn_per_e": f"{SHEET}: overall system gain K",
        "readout.reset": "assumed: correlated double sampling leaves no kTC noise",
        "pixel.dsnu_e": f"{SHEET}: DSNU, as offsets of the pixels",
        "adc.bits": f"{SHEET}: bit depth",
        "adc.black_level_dn": "assumed: 4σ of the dark noise, if the saturation capacity leaves the codes",
    }
    if values.get("dark_temperature_k") is not None:
        said["dark_current.at_temperature_k"] = f"{SHEET}: temperature of the dark current"
    return said
