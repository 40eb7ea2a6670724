"""The noise profile of a camera in the release of ELD (Wei et al., CVPR 2020): a dict in a .npy.

The profile has no ISO: K is between ``Kmin`` and ``Kmax``, and the noise of the pixels (``G_scale``, of a Tukey-lambda
distribution of the shapes ``G_shape``; ``g_scale``, if it were normal) and of rows (``R_scale``) follows it, ln σ =
slope·ln K + bias, about which the σ of single frames scatter.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping

from ...camera.camera import SET_BY_USER, Camera
from .draft import Draft
from .noise_table import read_table

LOWEST_ISO = 100
ADC = {"bits": 14, "black_level_dn": 800.0}
"""Of the program that the profiles are for, which takes 16383 − 800 DN as the range of raw values; the files have
neither."""
OF_PROGRAM = "the program of ELD takes 16383 - 800 DN as the range, the file has none"
PROFILE = "Profile-1"
MEANT = "K of a profile of ELD from Kmin to Kmax in octaves; ISO 100 is taken for Kmin"


def is_profile(data: Mapping[str, object]) -> bool:
    """Whether a dict has the names of a profile."""
    return {"Kmin", "Kmax", PROFILE} <= data.keys()


def read_profile(data: Mapping[str, object], file: str, like: Camera) -> Draft:
    """The draft of a camera at Kmin, with gain settings an octave apart. Raises InputError."""
    draft = Draft(file, like)
    smallest = draft.number("Kmin", data["Kmin"])
    largest = draft.number("Kmax", data["Kmax"], smallest * (1 - 1e-9))
    laws = draft.table(PROFILE, data[PROFILE])
    pixels = draft.table("G_scale", laws.get("G_scale"))
    rows = draft.table("R_scale", laws.get("R_scale"))
    shapes = draft.numbers("G_shape", data.get("G_shape"), -0.5, 2.0)
    adc = {name: _set_or(like, name, value) for name, value in ADC.items()}
    octaves = max(0, round(math.log2(largest / smallest)))
    table: list[dict[str, float]] = []
    for octave in range(octaves + 1):
        gain = smallest * (largest / smallest) ** (octave / max(octaves, 1))
        table.append(
            {
                "iso": LOWEST_ISO * 2.0**octave,
                "K": gain,
                "lam": statistics.median(shapes),
                "sigTL": _at_gain(draft, "G_scale", pixels, gain),
                "sigR": _at_gain(draft, "R_scale", rows, gain),
                "bl": adc["black_level_dn"],
                "wp": 2.0 ** adc["bits"] - 1,
            }
        )
    made = read_table(table, file, like)
    for name in ADC:
        del made.sources[f"adc.{name}"]
        made.assume(f"adc.{name}", adc[name], OF_PROGRAM)
    if "gains" in made.sources:
        made.sources["gains"] = f"{made.file}: {MEANT}; lines of G_scale and R_scale at K"
    made.description = f"Camera of the noise profile {file} of ELD, at Kmin; {MEANT}"
    return made


def _set_or(like: Camera, name: str, otherwise: float) -> float:
    """A field of the converter where the user has set it."""
    if like.sources.get(f"adc.{name}") == SET_BY_USER:
        return float(getattr(like.adc, name))
    return otherwise


def _at_gain(draft: Draft, name: str, law: Mapping[str, object], gain: float) -> float:
    """The most likely σ of a noise at a gain [DN]."""
    slope = draft.number(f"slope of {name}", law.get("slope"), -10.0, 10.0)
    bias = draft.number(f"bias of {name}", law.get("bias"), -30.0, 30.0)
    return math.exp(slope * math.log(gain) + bias)
