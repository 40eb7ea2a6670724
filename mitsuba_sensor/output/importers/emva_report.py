"""EMVA 1288 reports in XML, as the package emva1288 writes them: the value of a name is its text or its <Value>."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from ...camera.camera import Camera
from ...core import InputError
from ...core.units import KELVIN_AT_0_C
from ...files.texts import xml_tree
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
"""Quantity → its names in a report, in small letters."""
OPEN_AIR_K = KELVIN_AT_0_C + 25.0


def read_report(text: str, file: str, like: Camera) -> Draft:
    """The draft of a camera. Raises InputError for what is no XML and for a report without gain or dark noise."""
    tree = xml_tree(text, file, "Give the report that emva1288 writes with its xml()")
    said = {
        quantity: x
        for quantity, names in NAMES.items()
        if (x := _value(tree, names)) is not None
    }
    draft = Draft(file, like)
    if not said.keys() & {"gain", "inverse"} or "read" not in said:
        names = ", ".join(dict.fromkeys(one.tag for one in tree.iter()))[:200]
        raise InputError(
            f"{file} has no K and sigma_d of EMVA 1288, which a camera needs; it has {names}."
        )
    gain = (
        draft.number("K", said["gain"])
        if "gain" in said
        else 1 / draft.number("inverse_K", said["inverse"])
    )
    draft.assume(
        "adc.bits",
        draft.bits,
        f"as {like.name}; the report does not say it (--set adc.bits=12)",
    )
    draft.set_gain(gain, "K")
    draft.says(
        "source_follower.read_noise_e", draft.number("sigma_d", said["read"], -1e-9), "sigma_d"
    )
    if "well" in said:
        draft.says(
            "pixel.full_well_e",
            draft.number("u_e_sat", said["well"], 1.0),
            "u_e_sat, the saturation capacity",
        )
    else:
        draft.set_clip(gain, like.adc.black_level_dn or 0.0)
    _set_light_and_dark(said, draft)
    draft.description = f"Camera of the EMVA 1288 report {file}"
    return draft


def _set_light_and_dark(said: dict[str, str], draft: Draft) -> None:
    """Quantum efficiency, dark current and non-uniformities, where the report has them."""
    if "qe" in said:
        draft.changes["quantum_efficiency.tile"] = None
        draft.says(
            "quantum_efficiency.value",
            draft.number("QE", said["qe"], 0.0, 100.0) / 100,
            "QE [%], at all wavelengths",
        )
    dark = number_of(said.get("dark"))  # a report whose fit failed has nan, or a negative one
    if dark is not None and dark >= 0:
        draft.says(
            "dark_current.rate_e_per_s", draft.number("u_I", dark, -1e-9), "dark current"
        )
        draft.assume(
            "dark_current.at_temperature_k", OPEN_AIR_K, "25 °C; the report does not say it"
        )
    if "prnu" in said:
        draft.says(
            "pixel.prnu",
            draft.number("PRNU1288", said["prnu"], -1e-9, 100.0) / 100,
            "PRNU1288 [%]",
        )
    if "dsnu" in said:
        spread = draft.number("DSNU1288", said["dsnu"], -1e-9)
        well = draft.changes.get("pixel.full_well_e", draft.like.pixel.full_well_e)
        draft.says(
            "readout.dsnu_col",
            spread / well,
            "DSNU1288 over the full well, taken as offsets of columns",
        )


def _value(tree: Element, names: tuple[str, ...]) -> str | None:
    """The text of the first element of one of these names, or of its child <Value> or <data>."""
    for one in tree.iter():
        if one.tag.lower() in names:
            inner = next((x.text for x in one if x.tag.lower() in ("value", "data")), one.text)
            if inner and inner.strip():
                return inner.strip()
    return None
