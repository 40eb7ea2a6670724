"""Calibration tables of physics-based noise models (ELD, PMN): K, Tukey-lambda shape, σ_read and σ_row per ISO [DN].

Wei et al., CVPR 2020 and TPAMI 2021 (ELD); Feng et al., ACM MM 2022 (PMN). A row of the table is one ISO; its columns
have the names of either program. Pixel noise is sigTL, the *scale* of SciPy's tukeylambda, or its σ, sigGs. Row noise
is sigR.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import scipy

from ...camera.camera import Camera
from ...core import InputError
from ...core.csv_rows import rows_of
from ...core.errors import shown
from .draft import Draft

NAMES = {
    "iso": ("iso",),
    "gain": ("k", "kmax", "gain_dn_per_e"),
    "shape": ("lam", "lambda", "g_shape", "tukey_lambda"),
    "scale": ("sigtl", "g_scale", "sigma_tl"),
    "sigma": ("siggs", "sigma_read", "read_noise_dn"),
    "row": ("sigr", "r_scale", "sigma_row"),
    "black": ("bl", "black_level"),
    "white": ("wp", "white_level"),
}
"""Column → its names in the programs, in lower case."""
SHAPE_MIN, SHAPE_MAX = -0.45, 0.2
"""Tukey-lambda shapes that the sensor model has."""


def is_table(data: object) -> bool:
    """Return True if a JSON file is a list of rows, or rows by name."""
    rows = list(data.values()) if isinstance(data, dict) else data
    return isinstance(rows, list) and bool(rows) and all(isinstance(row, dict) for row in rows)


def rows_by_name(text: str) -> list[dict[str, str]]:
    """Return the rows of a CSV file, by the names in its header."""
    header, *rows = rows_of(text) or [[]]
    return [dict(zip(header, row, strict=False)) for row in rows]


def read_table(data: Any, file: str, like: Camera) -> Draft:
    """Return the draft of a camera at the lowest ISO, with every ISO as a gain setting. Raises InputError."""
    draft = Draft(file, like)
    if not isinstance(data, dict):
        data = {str(number): values for number, values in enumerate(data, start=1)}
    rows = [_row(name, values, draft) for name, values in data.items()]
    if not rows:
        raise InputError(
            f"{file} has no rows; give one row for each ISO, with iso, K and sigGs."
        )
    rows.sort(key=lambda row: float(row["iso"]))
    first = rows[0]
    if "white" in first:
        white = draft.number("wp", first["white"], 0.0, 2.0**24)
        draft.says("adc.bits", math.ceil(math.log2(white + 1)), f"white level {white:g}")
    settings = [_setting(row, draft) for row in rows]
    lowest = settings[0]
    iso, read_noise_e = f"ISO {lowest['iso']:g}", lowest["read_noise_e"]
    draft.set_gain(lowest["gain_dn_per_e"], f"K at {iso}")
    how = f"pixel noise in the dark over K at {iso}"
    draft.says("source_follower.read_noise_e", read_noise_e, how)
    if "row_noise_e" in lowest:
        draft.says("readout.row_noise_e", lowest["row_noise_e"], f"sigR over K at {iso}")
    if "black_level_dn" in lowest:
        draft.says("adc.black_level_dn", lowest["black_level_dn"], "black level")
    draft.set_clip(lowest["gain_dn_per_e"], lowest.get("black_level_dn", 0.0))
    if "read_noise_shape" in lowest:
        given, used = float(first["shape"]), lowest["read_noise_shape"]
        field = "source_follower.read_noise_shape"
        draft.says("source_follower.read_noise_distribution", "tukey_lambda", "lam")
        if used == given:
            draft.says(field, used, f"lam at {iso}")
        else:
            draft.assume(field, used, f"the nearest to lam {given:g} at {iso}")
    draft.set_gains(settings, "K, pixel noise, row noise, lam and black level of every ISO")
    draft.description = f"Camera of the noise calibration {file}, at {iso}"
    return draft


def _row(name: str, values: Mapping[str, Any], draft: Draft) -> dict[str, Any]:
    """Return a row by our column names; the ISO may be part of the row's name ("SonyA7S2_1600")."""
    given = {
        key.strip().lower(): value
        for key, value in values.items()
        if key is not None and value not in (None, "")
    }
    row: dict[str, object] = {
        ours: next(given[their] for their in theirs if their in given)
        for ours, theirs in NAMES.items()
        if given.keys() & set(theirs)
    }
    number = re.search(r"(\d+)$", name)
    if "iso" not in row and number is not None:
        row["iso"] = float(number[1])
    missing = [column for column in ("iso", "gain") if column not in row]
    if not row.keys() & {"scale", "sigma"}:
        missing.append("sigma")
    if missing:
        wanted = " and ".join("/".join(NAMES[column]) for column in missing)
        names = ", ".join(given)[:200] or "nothing"
        raise InputError(f"{draft.file}: row {shown(name)} has no {wanted}; it has {names}.")
    row["iso"] = draft.number("iso", row["iso"])
    return row


def _setting(row: Mapping[str, Any], draft: Draft) -> dict[str, float]:
    """Return the gain setting of a row; an unsupported shape becomes the nearest one."""
    iso = f"at ISO {row['iso']:g}"
    gain = draft.number(f"K {iso}", row["gain"])
    shape = None
    if "shape" in row:
        shape = draft.number(f"lam {iso}", row["shape"], -0.5, 2.0)
    if "scale" in row:
        sigma_of_scale = float(scipy.stats.tukeylambda.std(shape or 0.0))
        pixel_dn = draft.number(f"sigTL {iso}", row["scale"]) * sigma_of_scale
    else:
        pixel_dn = draft.number(f"sigGs {iso}", row["sigma"])
    setting = {"iso": row["iso"], "gain_dn_per_e": gain}
    setting["read_noise_e"] = math.sqrt(max(pixel_dn**2 - 1 / 12, 0.0)) / gain
    if shape is not None:
        setting["read_noise_shape"] = min(max(shape, SHAPE_MIN), SHAPE_MAX)
    if "row" in row:
        setting["row_noise_e"] = draft.number(f"sigR {iso}", row["row"], -1e-12) / gain
    if "black" in row:
        setting["black_level_dn"] = draft.number(f"bl {iso}", row["black"], -1e-12)
    return setting
