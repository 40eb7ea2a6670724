"""EMVA 1288 reports in XML, as the package emva1288 writes them: each quantity is a text or a <Value>."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from ...camera.camera import Camera
from ...core import InputError
from ...core.units import KELVIN_AT_0_C
from ...files.texts import xml_tree
from ...optics.spectra import silicon_qe
from .draft import Draft, number_of

NAMES = {
    "gain": ("k",),
    "inverse": ("inverse_k",),
    "qe": ("qe",),
    "read": ("sigma_d",),
    "well": ("u_e_sat",),
    "dark": ("u_i_mean", "u_i_var"),
    "prnu": ("prnu1288",),
    "dsnu": ("dsnu1288",),
}
"""Quantity → its names in a report, in lower case."""
GREEN_NM = 550.0  # if neither the report nor the similar camera has a wavelength
AMBIENT_K = KELVIN_AT_0_C + 25.0


def read_report(text: str, file: str, like: Camera) -> Draft:
    """Return the draft of a camera. Raises InputError for invalid XML, and for a report without gain or dark noise."""
    tree = xml_tree(text, file, "Give the report that emva1288 writes with its xml()")
    values = {quantity: _value(tree, names) for quantity, names in NAMES.items()}
    report = {quantity: value for quantity, value in values.items() if value is not None}
    draft = Draft(file, like)
    if not report.keys() & {"gain", "inverse"} or "read" not in report:
        tags = ", ".join(dict.fromkeys(element.tag for element in tree.iter()))[:200]
        raise InputError(
            f"{file} has no K and sigma_d of EMVA 1288, which a camera needs; it has {tags}."
        )
    if "gain" in report:
        gain = draft.number("K", report["gain"])
    else:
        gain = 1 / draft.number("inverse_K", report["inverse"])
    why = f"as {like.name}, because the report has no bit depth (set adc.bits)"
    draft.assume("adc.bits", draft.bits, why)
    draft.set_gain(gain, "K")
    read_noise_e = draft.number("sigma_d", report["read"], -1e-9)
    draft.says("source_follower.read_noise_e", read_noise_e, "sigma_d")
    if "well" in report:
        full_well_e = draft.number("u_e_sat", report["well"], 1.0)
        draft.says("pixel.full_well_e", full_well_e, "u_e_sat, the saturation capacity")
    else:
        draft.set_clip(gain, like.adc.black_level_dn or 0.0)
    _set_light_and_dark(report, draft)
    draft.description = f"Camera of the EMVA 1288 report {file}"
    return draft


def _set_light_and_dark(report: dict[str, str], draft: Draft) -> None:
    """Set quantum efficiency, dark current and non-uniformities, if the report has them."""
    if "qe" in report:
        efficiency = draft.number("QE", report["qe"], 0.0, 100.0) / 100
        draft.changes["quantum_efficiency.tile"] = None
        at_nm = draft.like.quantum_efficiency.reference_nm or GREEN_NM
        wavelengths_nm, curve = silicon_qe(efficiency, at_nm)
        how = f"QE [%] at {at_nm:g} nm; other wavelengths as typical silicon"
        draft.says("quantum_efficiency.curves", {"mono": curve}, how)
        draft.assume("quantum_efficiency.wavelengths_nm", wavelengths_nm, "typical silicon")
        draft.assume("quantum_efficiency.reference_nm", at_nm, f"as {draft.like.name}")
    dark = number_of(report.get("dark"))  # nan or negative if the fit failed
    if dark is not None and dark >= 0:
        rate = draft.number("u_I", dark, -1e-9)
        why = "25 °C, because the report has no temperature"
        draft.says("dark_current.rate_e_per_s", rate, "dark current")
        draft.assume("dark_current.at_temperature_k", AMBIENT_K, why)
    if "prnu" in report:
        prnu = draft.number("PRNU1288", report["prnu"], -1e-9, 100.0) / 100
        draft.says("pixel.prnu", prnu, "PRNU1288 [%]")
    if "dsnu" in report:
        dsnu_e = draft.number("DSNU1288", report["dsnu"], -1e-9)
        well_e = draft.changes.get("pixel.full_well_e", draft.like.pixel.full_well_e)
        how = "DSNU1288 over the full well, taken as offsets of columns"
        draft.says("readout.dsnu_col", dsnu_e / well_e, how)


def _value(tree: Element, names: tuple[str, ...]) -> str | None:
    """Return the first text of an element of these names, or of its child <Value> or <data>."""
    for element in tree.iter():
        if element.tag.lower() in names:
            inner = [one for one in element if one.tag.lower() in ("value", "data")]
            text = (inner or [element])[0].text
            if text and text.strip():
                return text.strip()
    return None
