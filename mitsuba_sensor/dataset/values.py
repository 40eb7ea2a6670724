"""The values that a dataset can vary: what each of them may be."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from ..core import Exposure, InputError, nearest, require, require_seed
from ..core.options import complete, declared
from ..optics.waveform import FROM_FILE, waveform_of
from ..render.options import RenderOptions

LARGEST = sys.float_info.max
LARGEST_WHOLE = 2**63
"""Of whole numbers, but for seeds: the index has 64 bits for each."""
MOST_STOPS = 60.0
MOST_FRAMES = 65535


OF_SCENE = (
    "parameters",
    "traverse",
    "sensor",
    "motion",
    "scene_unit",
    "integrator",
    "ignore_polarization",
    "look_at",
)
NOT_RENDER = dict.fromkeys(OF_SCENE, "belongs to the tables of [[scenes]]") | {
    "sensor": "is sensors in the tables of [[scenes]]",
    "look_at": "is views or path in the tables of [[scenes]]",
    "max_seconds": "would make other samples on another machine; max_spp limits the samples",
    "repeatable": "is always true of a dataset",
    "raw_light": "is for light that is kept; the outputs of the dataset say what is kept",
    "variant": "is chosen by the run",
    "luminance": "would scale each view by its own median; set the emitters of the scene, by the light_scale that "
    "`render --luminance` writes into frame.json",
    "gain": "is varied: gain in [grid], [[list]] or [random]",
}
"""What a [render] table does not have, and why."""
FIELDS = (
    *("exposure_s", "exposure_ev", "gain", "temperature_k", "f_number", "focus_m"),
    *("serial", "frames", "repetition"),
)
"""What can be varied: time [s] or auto, stops on top of it, gain setting, …; docs/datasets.md has what each is."""
PREFIXES = ("parameters", "traverse", "camera", "lights")
"""Values of <default> names, of mi.traverse names, of the datasheet, and of light groups."""

PICTURE = "frame.png"
"""The preview of a sample."""

SAME = {"f_number": "camera.lens.f_number", "focus_m": "camera.lens.focus_m"}
"""A field → what it is the short name of."""


def check_field(name: str) -> str:
    """The name of something that can be varied. Raises ValueError."""
    prefix, dot, rest = name.partition(".")
    if name in FIELDS or (prefix in PREFIXES and dot and rest):
        return name
    known = (*FIELDS, *(f"{one}.NAME" for one in PREFIXES))
    raise ValueError(
        f"cannot vary {name!r}; what can be varied: {', '.join(known)}.{nearest(name, known)}"
    )


def check_value(name: str, value: object) -> None:
    """Raise InputError for a value that this name cannot have. Fields of the camera are checked by its datasheet."""
    kind = name.partition(".")[0]
    if name in ("serial", "repetition"):
        require_seed(name, value)  # type: ignore[arg-type]
        return
    if isinstance(value, int) and not -LARGEST_WHOLE <= value < LARGEST_WHOLE:
        raise InputError(
            f"{name} is {value!r:.100}; a whole number must be from -2^63 to 2^63 - 1. Give a larger one as a text."
        )
    if name == "exposure_s":
        _check_exposure(value)
    elif name == "exposure_ev":
        require(
            name,
            _number(name, value),
            -MOST_STOPS,
            MOST_STOPS,
            "stops on top of exposure_s, e.g. -2",
        )
    elif name == "temperature_k":
        Exposure(0.0, _number(name, value))
    elif name == "frames":
        _check_frames(value)
    elif kind == "lights":
        _check_light(name.partition(".")[2], value)
    elif kind == "traverse":
        for one in value if isinstance(value, tuple) else (value,):
            _number(name, one)
    elif kind == "parameters" and isinstance(value, tuple):
        raise InputError(
            f"{name} is {list(value)}; it must be one text or number, as after -D: {_text(value)!r}."
        )


def check_render(render: Mapping[str, Any], timed: Sequence[str]) -> None:
    """Raise ValueError for a [render] table that a dataset cannot have.  timed : scenes whose views have times."""
    known = [one.name for one in declared(RenderOptions) if one.name not in NOT_RENDER]
    for name in render:
        if name not in known:
            why = NOT_RENDER.get(name, f"is no field of it.{nearest(name, known)}".rstrip(".?"))
            raise ValueError(
                f"[render] has {name!r}, which {why}; the fields of [render] are {', '.join(known)}"
            )
    if "start_s" in render and timed:
        raise ValueError(
            f"[render] has start_s, and the views of scene {timed[0]} have times of their own; leave start_s out, "
            "and add it to these"
        )
    try:
        complete(RenderOptions, {**render})
    except InputError as error:
        raise ValueError(f"render: {str(error).removesuffix('.')}") from None


def plain_value(value: object) -> bool | float | str:
    """A number, a text, or true or false. Raises ValueError."""
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
    """The same, or a list of numbers. Raises ValueError."""
    if not isinstance(value, list | tuple):
        return plain_value(value)
    if not all(
        isinstance(one, int | float) and not isinstance(one, bool) and abs(one) <= LARGEST
        for one in value
    ):
        raise ValueError(f"{value!r:.100} must have finite numbers only, e.g. [0.5, 0.5, 1]")
    return tuple(map(float, value))


def stops_taken(stops: float) -> float:
    """By which factor a preview is brighter for the stops that an exposure takes away."""
    return float(2.0 ** max(-stops, 0.0))


def text_of(value: object) -> str:
    """A value of a <default> as it stands in a scene file."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)


def _text(values: tuple[object, ...]) -> str:
    return ", ".join(map(str, values))


def _check_exposure(value: object) -> None:
    if value == "auto":
        return
    if isinstance(value, str):
        raise InputError(
            f"exposure_s is {value!r}; it must be a number of seconds, e.g. 0.1, or 'auto'."
        )
    Exposure(_number("exposure_s", value))


def _check_light(group: str, value: object) -> None:
    if isinstance(value, str) and FROM_FILE in value:
        raise InputError(
            f"the light of {group} is {value!r}; a dataset reads no waveform from a file: give pwm, sine or mains."
        )
    waveform_of(group, value)


def _check_frames(value: object) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= MOST_FRAMES:
        raise InputError(
            f"frames is {value!r}; it must be a whole number from 1 to {MOST_FRAMES}, e.g. 8."
        )


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} is {value!r}; it must be a number.")
    return value
