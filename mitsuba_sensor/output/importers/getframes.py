"""Presets of getframes (TOML): one flat table of camera parameters, with the gain in e-/ADU and °C."""

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
"""Key of a preset → field of a camera with the same unit."""
IGNORED = (
    "nonlinearity", "read_noise_rts_fraction", "read_noise_rts_factor", "hot_pixel_fraction", "hot_pixel_factor",
    "detector_glow_e_per_s",
)  # fmt: skip
KEYS = {*FIELDS, *IGNORED, "name", "sensor_type", "resolution", "pixel_size_um", "gain_e_per_adu", "qe_curve",
    "quantum_efficiency", "dark_current_ref_temp_c"}  # fmt: skip
MULTIPLYING = ("EMCCD", "EAPD")
SIDE_MAX = 1e6  # pixels


def preset_text(name: str) -> str:
    """Return the text of an installed preset. Raises InputError."""
    try:
        folder = resources.files("getframes.presets.data")
    except ModuleNotFoundError:
        raise InputError(
            f"{PREFIX}{name} needs getframes, which is not installed; run pip install getframes, or give the path of "
            "the preset's .toml."
        ) from None
    files = [file for file in folder.iterdir() if file.name.endswith(".toml")]
    presets = {file.name.removesuffix(".toml"): file for file in files}
    if name not in presets:
        raise InputError(
            f"unknown preset of getframes {name!r}; give one of {', '.join(sorted(presets))}.{nearest(name, presets)}"
        )
    return presets[name].read_text("utf-8")


def read_preset(text: str, file: str, like: Camera) -> Draft:
    """Return the draft of a camera. Raises InputError for other files, and for cameras that multiply electrons."""
    try:
        data = toml_tables(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            f"{file} is not valid TOML: {error}. Give a preset of getframes."
        ) from None
    draft = Draft(file, like)
    draft.refuse_misspelled(data, KEYS)
    if "sensor_type" not in data or "gain_e_per_adu" not in data:
        raise InputError(
            f"{file} has no sensor_type and gain_e_per_adu; give a preset of getframes."
        )
    if data["sensor_type"] in MULTIPLYING:
        raise InputError(
            f"{file} has sensor_type {data['sensor_type']}, which multiplies electrons; give a CCD, CMOS or SCMOS."
        )
    _set_chip(draft, data)
    for key, field in FIELDS.items():
        if key == "bit_depth" and key in data:
            draft.says(field, draft.count(key, data[key], 64), key)
        elif key in data:
            draft.says(field, draft.number(key, data[key], -1e-12), key)
    key = "dark_current_ref_temp_c"
    if key in data:
        kelvin = draft.number(key, data[key], -KELVIN_AT_0_C, 200.0) + KELVIN_AT_0_C
        draft.says("dark_current.at_temperature_k", kelvin, key)
    gain_e_per_dn = draft.number("gain_e_per_adu", data["gain_e_per_adu"])
    draft.set_gain(1 / gain_e_per_dn, "1 over gain_e_per_adu: K")
    _set_qe(draft, data)
    draft.name = str(data.get("name", file))
    draft.description = f"{draft.name}, preset of getframes"
    if ignored := [key for key in IGNORED if key in data]:
        draft.description += f" (ignored: {', '.join(ignored)})"
    return draft


def _set_chip(draft: Draft, data: dict[str, Any]) -> None:
    """Set size and technology."""
    sides = draft.numbers("resolution", data.get("resolution"))
    if len(sides) != 2:
        raise InputError(
            f"{draft.file}: resolution has {len(sides)} numbers; it must have rows and columns."
        )
    for field, side in zip(("sensor.rows", "sensor.columns"), sides, strict=True):
        draft.says(field, draft.count("resolution", side, SIDE_MAX), "resolution")
    pitch = draft.number("pixel_size_um", data.get("pixel_size_um"))
    draft.says("pixel.pitch_x_um", pitch, "pixel_size_um")
    draft.says("pixel.pitch_y_um", pitch, "pixel_size_um")
    why = "the quantum efficiency of a preset includes the fill factor"
    draft.assume("pixel.fill_factor", 1.0, why)
    if data["sensor_type"] == "CCD":
        draft.changes |= {
            "sensor.technology": "ccd",
            "readout.dsnu_col": None,
            "readout.reset": "true_cds",
        }


def _set_qe(draft: Draft, data: dict[str, Any]) -> None:
    """Set the quantum efficiency: a curve, or one number."""
    draft.changes["quantum_efficiency.tile"] = None
    if "qe_curve" not in data:
        value = draft.number("quantum_efficiency", data.get("quantum_efficiency"), 0.0, 1.0)
        draft.changes["quantum_efficiency.wavelengths_nm"] = None
        draft.says("quantum_efficiency.value", value, "quantum_efficiency, at all wavelengths")
        return
    table = draft.table("qe_curve", data["qe_curve"])
    curve = draft.numbers("qe_curve.qe", table.get("qe"), -1e-12, 1.0)
    wavelengths_nm = draft.numbers("qe_curve.wavelength_nm", table.get("wavelength_nm"))
    if not curve or len(curve) != len(wavelengths_nm):
        raise InputError(
            f"{draft.file}: qe_curve has {len(curve)} qe and {len(wavelengths_nm)} wavelength_nm; give pairs."
        )
    draft.says("quantum_efficiency.curves", {"mono": curve}, "qe_curve")
    draft.says("quantum_efficiency.wavelengths_nm", wavelengths_nm, "qe_curve")
    peak_nm = wavelengths_nm[curve.index(max(curve))]
    draft.assume("quantum_efficiency.reference_nm", peak_nm, "the peak of the curve")
