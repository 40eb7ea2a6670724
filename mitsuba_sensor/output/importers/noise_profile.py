"""The noise profile of a camera in the release of ELD (Wei et al., CVPR 2020): a dict in a .npy.

The profile has no ISO, only K from ``Kmin`` to ``Kmax``. The noise of pixels (``G_scale``, Tukey-lambda with the
shapes ``G_shape``; ``g_scale`` for a normal fit) and of rows (``R_scale``) follows ln σ = slope·ln K + bias. The σ of
single frames scatters around this line.
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
"""ELD's program assumes a range of 16383 − 800 DN; the files have no range."""
ADC_SOURCE = "the program of ELD uses the range 16383 - 800 DN; the file has no range"
PROFILE = "Profile-1"
GAINS_SOURCE = (
    "K of a profile of ELD from Kmin to Kmax in octaves; Kmin is assumed to be ISO 100"
)


def is_profile(data: Mapping[str, object]) -> bool:
    """Return True if a dict has the names of a profile."""
    return {"Kmin", "Kmax", PROFILE} <= data.keys()


def read_profile(data: Mapping[str, object], file: str, like: Camera) -> Draft:
    """Return the draft of a camera at Kmin, with gain settings an octave apart. Raises InputError."""
    draft = Draft(file, like)
    draft.refuse_misspelled(data, ("Kmin", "Kmax", PROFILE, "G_shape"))
    lines = draft.table(PROFILE, data[PROFILE])
    draft.refuse_misspelled(lines, ("G_scale", "R_scale", "g_scale"))
    smallest = draft.number("Kmin", data["Kmin"])
    largest = draft.number("Kmax", data["Kmax"], smallest * (1 - 1e-9))
    pixels, rows = (draft.table(name, lines.get(name)) for name in ("G_scale", "R_scale"))
    shapes = draft.numbers("G_shape", data.get("G_shape"), -0.5, 2.0)
    adc = {
        name: getattr(like.adc, name)
        if like.sources.get(f"adc.{name}") == SET_BY_USER
        else assumed
        for name, assumed in ADC.items()
    }
    octaves = max(0, round(math.log2(largest / smallest)))
    table = []
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
    draft = read_table(table, file, like)
    for name in ADC:
        del draft.sources[f"adc.{name}"]
        draft.assume(f"adc.{name}", adc[name], ADC_SOURCE)
    if "gains" in draft.sources:
        draft.sources["gains"] = f"{draft.file}: {GAINS_SOURCE}, with G_scale and R_scale at K"
    draft.description = f"Camera of the noise profile {file} of ELD, at Kmin; {GAINS_SOURCE}"
    return draft


def _at_gain(draft: Draft, name: str, line: Mapping[str, object], gain: float) -> float:
    """Return σ on the line of a noise source at a gain [DN]."""
    slope = draft.number(f"slope of {name}", line.get("slope"), -10.0, 10.0)
    bias = draft.number(f"bias of {name}", line.get("bias"), -30.0, 30.0)
    return math.exp(slope * math.log(gain) + bias)
