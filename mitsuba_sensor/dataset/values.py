"""The values that a dataset can vary, and the check of each."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from ..core import InputError, nearest, require, require_seed
from ..core.errors import require_count
from ..core.exposure import TEMPERATURE_MAX_K, TIME_MAX_S
from ..core.options import complete, declared
from ..optics.waveform import FROM_FILE, waveform_of
from ..render.options import RenderOptions

LARGEST = sys.float_info.max
WHOLE_END = 2**63
"""End of whole numbers, except seeds: the index has 64-bit integers."""
STOPS_MAX = 60.0
FRAMES_MAX = 65535

OF_SCENE = (
    *("parameters", "traverse", "sensor", "motion", "scene_unit", "integrator"),
    *("ignore_polarization", "look_at"),
)
NOT_RENDER = dict.fromkeys(OF_SCENE, "belongs to the tables of [[scenes]]") | {
    "sensor": "is sensors in the tables of [[scenes]]",
    "look_at": "is views or path in the tables of [[scenes]]",
    "max_seconds": "would make other samples on another machine; max_spp limits the samples",
    "repeatable": "is always true of a dataset",
    "raw_light": "keeps undenoised light; the outputs of the dataset list what is kept",
    "variant": "is chosen by the run",
    "luminance": "would scale each view by its own median; set the emitters of the scene, by the light_scale that "
    "`render --luminance` writes into frame.json",
    "gain": "is varied: gain in [grid], [[list]] or [random]",
}
"""Options of a render that a [render] table cannot have, and why."""
FIELDS = (
    *("exposure_s", "exposure_ev", "gain", "temperature_k", "f_number", "focus_m"),
    *("serial", "frames", "repetition"),
)
"""Fields that can vary; docs/datasets.md explains each."""
PREFIXES = ("parameters", "traverse", "camera", "lights")
"""Prefixes of <default> names, mi.traverse names, datasheet fields and light groups."""

PICTURE = "frame.png"
"""The preview of a sample."""

SAME = {"f_number": "camera.lens.f_number", "focus_m": "camera.lens.focus_m"}
"""Short name → datasheet field."""


def check_field(name: str) -> str:
    """Return the name of a field that can vary. Raises ValueError."""
    prefix, dot, rest = name.partition(".")
    if name in FIELDS or (prefix in PREFIXES and dot and rest):
        return name
    fields = (*FIELDS, *(f"{x}.NAME" for x in PREFIXES))
    raise ValueError(
        f"cannot vary {name!r}; give one of {', '.join(fields)}.{nearest(name, fields)}"
    )


def check_value(name: str, value: Any) -> None:
    """Raise InputError for a value that this field cannot have. The datasheet checks the fields of the camera."""
    kind, _, inner = name.partition(".")
    if kind in ("serial", "repetition"):
        require_seed(name, value)
    elif isinstance(value, int) and not -WHOLE_END <= value < WHOLE_END:
        raise InputError(
            f"{name} is {value!r:.100}; a whole number must be from -2^63 to 2^63 - 1. Give a larger number as text."
        )
    elif kind == "exposure_s" and value != "auto":
        require(name, value, 0, TIME_MAX_S, "a number of seconds, e.g. 0.1, or 'auto'")
    elif kind == "exposure_ev":
        require(name, value, -STOPS_MAX, STOPS_MAX, "exposure compensation in stops, e.g. -2")
    elif kind == "temperature_k":
        require(name, value, 0, TEMPERATURE_MAX_K, "kelvin, e.g. 298.15")
    elif kind == "frames":
        require_count(name, value, 1, FRAMES_MAX, 8)
    elif kind == "lights":
        if isinstance(value, str) and FROM_FILE in value:
            raise InputError(
                f"{name} is {value!r}; a dataset reads no waveform from a file: give pwm, sine or mains."
            )
        waveform_of(inner, value)
    elif kind == "traverse":
        for number in value if isinstance(value, tuple) else (value,):
            require(name, number, -LARGEST, LARGEST, "e.g. 0.5")
    elif kind == "parameters" and isinstance(value, tuple):
        text = ", ".join(map(str, value))
        raise InputError(
            f"{name} is {[*value]}; it must be one text or number, as after -D: {text!r}."
        )


def check_render(render: Mapping[str, Any], timed: Sequence[str]) -> None:
    """Raise ValueError for a [render] table that a dataset cannot have.  timed : scenes whose views have times."""
    allowed = [x.name for x in declared(RenderOptions) if x.name not in NOT_RENDER]
    for name in render:
        if name not in allowed:
            unknown = f"is not a field.{nearest(name, allowed)}".rstrip(".?")
            raise ValueError(
                f"[render] has {name!r}, which {NOT_RENDER.get(name, unknown)}; the fields of [render] are "
                f"{', '.join(allowed)}"
            )
    if "start_s" in render and timed:
        raise ValueError(
            f"[render] has start_s, but the views of scene {timed[0]} have times; remove start_s and add it to the "
            "times"
        )
    try:
        complete(RenderOptions, {**render})
    except InputError as error:
        raise ValueError(f"render: {str(error).removesuffix('.')}") from None


def plain_value(value: object) -> bool | float | str:
    """Return a number, a text or a truth value. Raises ValueError for other values."""
    if isinstance(value, dict):
        raise ValueError(
            'this is a table; put a name with dots in quotes, e.g. "camera.adc.bits" = [10, 12]'
        )
    if not isinstance(value, bool | int | float | str) or (
        isinstance(value, float) and not abs(value) <= LARGEST
    ):
        raise ValueError(f"{value!r:.100} must be a finite number, a text, true or false")
    return value


def value_or_list(value: object) -> bool | float | str | tuple[float, ...]:
    """Return a plain value or a tuple of numbers. Raises ValueError for other values."""
    if not isinstance(value, list | tuple):
        return plain_value(value)
    if all(type(x) in (int, float) and abs(x) <= LARGEST for x in value):
        return tuple(map(float, value))
    raise ValueError(f"{value!r:.100} must have only finite numbers, e.g. [0.5, 0.5, 1]")


def preview_gain(stops: float) -> float:
    """Return the factor that makes a preview as bright as without a negative exposure compensation [stops]."""
    return float(2.0 ** max(-stops, 0.0))


def text_of(value: object) -> str:
    """Return the value of a <default> as a scene file has it."""
    return str(value).lower() if isinstance(value, bool) else str(value)
