"""Presets of getframes (TOML): one flat table of a camera's numbers, the gain in e-/ADU, the temperature in °C."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any

from ...camera.camera import Camera
from ...core import InputError, nearest
from ...core.small_files import toml_tables
from ...core.units import KELVIN_AT_0_C
from .draft import Draft

PREFIX = "getframes:"
FIELDS = {
    "full_well_e": "pixel.full_well_e",
    "bit_depth": "adc.bits",
    "bias_offset_adu": "adc.black_level_dn",
    "read_noise_e": "source_follower.read_noise_e",
    "read_noise_nonuniformity": "source_follower.read_noise_cv",
    "dark_current_e_per_s": "dark_current.rate_e_per_s",
    "dark_current_doubling_temp_c": "dark_current.doubling_k",
    "dark_current_nonuniformity": "dark_current.cv",
    "prnu": "pixel.prnu",
}
"""Key of a preset → field of a camera, in the same unit."""
LEFT_OUT = (
    "nonlinearity", "read_noise_rts_fraction", "read_noise_rts_factor", "hot_pixel_fraction", "hot_pixel_factor",
    "detector_glow_e_per_s",
)  # fmt: skip
GAINED = ("EMCCD", "EAPD")
MOST_PIXELS = 1e6  # of a side


def preset_text(name: str) -> str:
    """The text of an installed preset. Raises InputError."""
    try:
        folder = resources.files("getframes.presets.data")
    except ModuleNotFoundError:
        raise InputError(
            f"{PREFIX}{name} needs getframes, which is not installed; give the path of the preset's .toml, or: "
            "pip install getframes"
        ) from None
    known = {
        one.name.removesuffix(".toml"): one
        for one in folder.iterdir()
        if one.name.endswith(".toml")
    }
    if name not in known:
        raise InputError(
            f"{name!r} is no preset of getframes ({', '.join(sorted(known))}).{nearest(name, known)}"
        )
    return known[name].read_text("utf-8")


def read_preset(text: str, file: str, like: Camera) -> Draft:
    """The draft of a camera. Raises InputError for what is no preset, and for cameras that multiply electrons."""
    try:
        data = toml_tables(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            f"{file} is not valid TOML: {error}. Give a preset of getframes."
        ) from None
    if "sensor_type" not in data or "gain_e_per_adu" not in data:
        raise InputError(
            f"{file} has no sensor_type and gain_e_per_adu, as presets of getframes have. Give one of those."
        )
    draft = Draft(file, like)
    if data["sensor_type"] in GAINED:
        raise InputError(
            f"{file} is an {data['sensor_type']}, which multiplies electrons; give a CCD, CMOS or SCMOS."
        )
    _set_chip(draft, data)
    for key, field in FIELDS.items():
        if key in data:
            whole = key == "bit_depth"
            number = (
                draft.count(key, data[key], 64)
                if whole
                else draft.number(key, data[key], -1e-12)
            )
            draft.says(field, number, key)
    if "dark_current_ref_temp_c" in data:
        celsius = draft.number(
            "dark_current_ref_temp_c", data["dark_current_ref_temp_c"], -KELVIN_AT_0_C, 200.0
        )
        draft.says(
            "dark_current.at_temperature_k", celsius + KELVIN_AT_0_C, "dark_current_ref_temp_c"
        )
    draft.set_gain(
        1 / draft.number("gain_e_per_adu", data["gain_e_per_adu"]), "1 over gain_e_per_adu: K"
    )
    _set_qe(draft, data)
    left = [key for key in LEFT_OUT if key in data]
    draft.name = str(data.get("name", file))
    draft.description = f"{draft.name}, preset of getframes" + (
        f" (left out: {', '.join(left)})" if left else ""
    )
    return draft


def _set_chip(draft: Draft, data: dict[str, Any]) -> None:
    """Size and technology."""
    sides = draft.numbers("resolution", data.get("resolution"))
    if len(sides) != 2:
        raise InputError(
            f"{draft.file}: resolution has {len(sides)} numbers; it must have 2, rows and columns."
        )
    for field, side in zip(("sensor.rows", "sensor.columns"), sides, strict=True):
        draft.says(field, draft.count("resolution", side, MOST_PIXELS), "resolution")
    pitch = draft.number("pixel_size_um", data.get("pixel_size_um"))
    draft.says("pixel.pitch_x_um", pitch, "pixel_size_um")
    draft.says("pixel.pitch_y_um", pitch, "pixel_size_um")
    draft.assume(
        "pixel.fill_factor",
        1.0,
        "the quantum efficiency of a preset is that of the whole pixel",
    )
    if data["sensor_type"] == "CCD":
        draft.changes |= {
            "sensor.technology": "ccd",
            "readout.dsnu_col": None,
            "readout.reset": "true_cds",
        }


def _set_qe(draft: Draft, data: dict[str, Any]) -> None:
    """The curve of a preset, or its one number."""
    draft.changes["quantum_efficiency.tile"] = None
    if "qe_curve" in data:
        table = draft.table("qe_curve", data["qe_curve"])
        curve = draft.numbers("qe_curve.qe", table.get("qe"), -1e-12, 1.0)
        at = draft.numbers("qe_curve.wavelength_nm", table.get("wavelength_nm"))
        if not curve or len(curve) != len(at):
            raise InputError(
                f"{draft.file}: qe_curve has {len(curve)} qe and {len(at)} wavelength_nm; give pairs."
            )
        draft.says("quantum_efficiency.curves", {"mono": curve}, "qe_curve")
        draft.says("quantum_efficiency.wavelengths_nm", at, "qe_curve")
        draft.assume(
            "quantum_efficiency.reference_nm",
            at[curve.index(max(curve))],
            "the peak of the curve",
        )
    else:
        value = draft.number("quantum_efficiency", data.get("quantum_efficiency"), 0.0, 1.0)
        draft.changes["quantum_efficiency.wavelengths_nm"] = None
        draft.says("quantum_efficiency.value", value, "quantum_efficiency, at all wavelengths")
