"""Flags of the command line, made from the declarations of the options; and those that only the command line has."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, TypeAlias, TypedDict, TypeVar

import typer

from ..capture_options import CaptureOptions
from ..core import InputError, require_seed
from ..core.options import Declared, Option, declared
from ..files import npz
from ..render.options import FileOptions, RenderOptions, SceneOptions
from ..render.passes.passes import MOST_IN_ALL
from ..render.variants import VARIANTS
from ..sensor.metering import PERCENTILE, SHARE
from ..sensor.options import FrameOptions, Gain, SensorOptions
from .arguments import OUTPUT
from .completion import camera_fields, camera_names, noise_source_names, one_of

Command = TypeVar("Command", bound=Callable[..., None])
Flag: TypeAlias = Any  # the value of one flag; its type is that of the option
Flags = Mapping[str, Flag]

DEFAULT_CAMERA, DEFAULT_TEMPERATURE_K = "konnik_table1", 298.15

Settings: TypeAlias = Annotated[
    dict[str, str] | None,
    Option(
        "Change a field of the camera: --set adc.bits=14; FIELD=none unsets it. Repeatable; `cameras show NAME` lists "
        "the fields.",
        flag="--set",
        metavar="FIELD=VALUE",
        text=list[str],
    ),
]

Without: TypeAlias = Annotated[
    list[str] | None,
    Option(
        "Switch a noise source of the camera off: --without shot_noise. Repeatable; `cameras stages` lists the stages.",
        flag="--without",
        metavar="SOURCE",
        text=list[str],
    ),
]


class CameraFlags(TypedDict, total=False):
    """Which camera takes the picture, and with which exposure."""

    camera: Annotated[
        str | None,
        Option(
            "A name from `cameras list`, or the path of a .toml of your own. Default: the scene file's, else "
            f"{DEFAULT_CAMERA}.",
            metavar="NAME",
        ),
    ]
    exposure_s: Annotated[
        str | None,
        Option(
            f"Exposure time in seconds, or auto: metered, so that the {PERCENTILE:g}th percentile of the lit pixels is "
            f"at {100 * SHARE:g} % of saturation. Default: the scene file's, else auto.",
            metavar="SECONDS|auto",
        ),
    ]
    meter: Annotated[
        str | None,
        Option(
            "Meter the exposure time so that this percentile of the lit pixels reaches this share of saturation. "
            f"Default: {PERCENTILE:g}:{SHARE:g}.",
            metavar="PERCENTILE:SHARE",
        ),
    ]
    temperature_k: Annotated[
        float | None,
        Option(
            f"Temperature of the sensor in kelvin. Default: the scene file's, else {DEFAULT_TEMPERATURE_K} (+25 °C).",
            metavar="KELVIN",
        ),
    ]
    gain: Gain
    settings: Settings
    without: Without


class NewCameraFlags(TypedDict, total=False):
    """What a new camera file begins with."""

    like: Annotated[
        str,
        Option(
            "Camera to start from: a name from `cameras list`, or a .toml.",
            DEFAULT_CAMERA,
            metavar="NAME",
        ),
    ]
    settings: Settings
    without: Without
    force: Annotated[bool, Option("Write over an existing file.", False, flag="--force")]


class ImportFlags(TypedDict, total=False):
    """What an imported camera takes where its file says nothing."""

    like: Annotated[
        str,
        Option(
            "Camera whose numbers hold where the file says nothing: a name, or a .toml.",
            "bayer_2mp",
            metavar="NAME",
        ),
    ]
    settings: Settings
    name: Annotated[
        str | None,
        Option("Name of the camera. Default: what the file says, else its own name."),
    ]
    force: Annotated[bool, Option("Write over an existing file.", False, flag="--force")]


class MapFlags(TypedDict, total=False):
    """Which FPN maps are written."""

    serial: Annotated[
        int,
        Option(
            "Serial number of the camera: selects its fixed-pattern noise.",
            1,
            check=require_seed,
        ),
    ]
    rows: Annotated[
        int | None,
        Option("Height of the maps. Default: the whole sensor.", low=1, metavar="PIXELS"),
    ]
    width: Annotated[
        int | None,
        Option("Width of the maps. Default: the whole sensor.", low=1, metavar="PIXELS"),
    ]


class StudyFlags(TypedDict, total=False):
    """Flags of every study."""

    out: Annotated[
        str | None,
        Option(
            "Folder for the page. Default: study/ and the study's name.",
            flag="-o --out",
            metavar="DIR",
        ),
    ]
    force: Annotated[
        bool, Option("Measure again what the folder holds already.", False, flag="--force")
    ]
    as_json: Annotated[bool, Option("Only JSON on stdout, for programs.", False, flag="--json")]


class WorkPrecisionFlags(TypedDict, total=False):
    """Flags of ``study work-precision``."""

    tolerance: Annotated[
        float,
        Option(
            "Relative error of a pixel's irradiance for which a setting is recommended.", 0.01
        ),
    ]
    seeds: Annotated[
        int,
        Option(
            "Independent runs of each setting; their spread makes the intervals.",
            4,
            low=2,
            example="4",
        ),
    ]
    sides: Annotated[
        list[str] | None,
        Option(
            "render or sensor: only this half. Repeatable. Default: both.",
            flag="--side",
            metavar="render|sensor",
            text=list[str],
        ),
    ]
    variants: Annotated[
        list[str] | None,
        Option(
            "A Mitsuba variant to compare. Repeatable. Default: all that work.",
            flag="--variant",
            text=list[str],
        ),
    ]


class AblationFlags(TypedDict, total=False):
    """Flags of ``study ablation``."""

    tolerance_dn: Annotated[float, Option("Of the plan that is put to the test, in DN.", 0.02)]
    frames: Annotated[
        int, Option("Frames of each of the 8 cameras that are measured.", 8, low=2, example="8")
    ]
    spp: Annotated[
        int,
        Option(
            "Samples per pixel of the render, a quarter of it of each comparison.",
            32,
            low=8,
            high=MOST_IN_ALL,
            example="32",
        ),
    ]
    seed: Annotated[
        int | None,
        Option("Of the first frame. Default: the scene file's, else 1.", check=require_seed),
    ]
    serial: Annotated[
        int | None,
        Option("Of the first camera. Default: the scene file's, else 1.", check=require_seed),
    ]


PANELS: dict[type, str] = {  # titles in --help, above the options that are declared there first
    CameraFlags: "Camera and exposure",
    NewCameraFlags: "Camera and exposure",
    ImportFlags: "Camera and exposure",
    FileOptions: "Scene",
    SceneOptions: "Scene",
    RenderOptions: "Render: samples, bands, noise",
    SensorOptions: "Sensor",
    FrameOptions: "Frames and seeds",
    CaptureOptions: OUTPUT,
    StudyFlags: OUTPUT,
    MapFlags: "Sensor",
    WorkPrecisionFlags: "Study",
    AblationFlags: "Study",
}


def flags(*kinds: type, without: tuple[str, ...] = ()) -> Callable[[Command], Command]:
    """Give a command the flags of these options; it takes them as ``**flags``, read but not yet checked.

    The flags stand in ``--help`` in the order of their declaration, before the command's own.
    without : names of options that this command does not have.
    """

    def with_flags(command: Command) -> Command:
        known = (one for kind in kinds for one in declared(kind) if one.option.flag is not None)
        found = {one.name: one for one in known if one.name not in without}
        own = [
            p
            for p in inspect.signature(command, eval_str=True).parameters.values()
            if p.kind is not p.VAR_KEYWORD
        ]
        needed, optional = (
            [p for p in own if p.default is p.empty],
            [p for p in own if p.default is not p.empty],
        )
        kind = inspect.Parameter.KEYWORD_ONLY
        made = [
            inspect.Parameter(x.name, kind, default=x.option.default, annotation=_type(x))
            for x in found.values()
        ]
        parameters = [p.replace(kind=kind) for p in (*needed, *made, *optional)]

        def run(**values: Flag) -> None:
            read = {one.name: _read(one, values[one.name]) for one in found.values()}
            command(**{**values, **read})

        run.__name__, run.__doc__, run.__module__ = (
            command.__name__,
            command.__doc__,
            command.__module__,
        )
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        return run  # type: ignore[return-value]

    return with_flags


def pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    """["a=1", …] → {"a": "1", …}"""
    found = [[part.strip() for part in text.partition("=")] for text in texts]
    for text, (name, equals, _) in zip(texts, found, strict=True):
        if not name or not equals:
            raise InputError(
                f"{option} {text!r} has no name and value; write {option} NAME=VALUE."
            )
    return {name: value for name, _, value in found}


def number(text: str, kind: type = float) -> Flag:
    """The number in a text; a text that is none as it is, for the check of the option."""
    try:
        return kind(text)
    except ValueError:
        return text


def _seconds(text: str) -> float:
    """The number in the text. Raises InputError, with the seconds where a time is given in another unit."""
    if not isinstance(value := number(text), str):
        return float(value)
    parts = re.fullmatch(r"\s*([\d.,]+(?:e-?\d+)?)\s*(?:/\s*(\d+)|([a-zµ]*))\s*", text)
    meant = number(parts[1].replace(",", ".")) if parts else text
    factor = (
        (1 / int(parts[2]) if parts[2] else SECONDS.get(parts[3]))
        if parts and parts[2] != "0"
        else None
    )
    example = (
        f"{meant * factor:.4g}" if factor is not None and not isinstance(meant, str) else "0.01"
    )
    raise InputError(
        f"--exposure-s {text!r} is no number of seconds; give seconds, e.g. {example}, or auto."
    )


def _read(one: Declared, value: Flag) -> Flag:
    """The value of a flag, not yet checked, from what typer read."""
    if value is None or value == one.option.default:
        return value
    if one.name in READERS:
        return READERS[one.name](value)
    return number(value, one.kinds[0]) if one.kinds in ((int,), (float,)) else value


def _type(one: Declared) -> Flag:
    """The type of an option as typer wants it, with its flag and its help. Numbers are texts, so that a wrong one gets
    the same sentence as in Python."""
    flag, kinds = one.option.flag or f"--{one.name.replace('_', '-')}", one.kinds
    numeric = NUMBERS.get(kinds)
    text: Flag = one.option.text or (str if one.choices or numeric else kinds[0])
    text = text | None if one.option.default is None else text
    metavar = one.option.metavar or numeric or ("|".join(map(str, one.choices)) or None)
    panel = one.option.panel or next(
        (title for kind, title in PANELS.items() if one.name in kind.__annotations__), None
    )
    proposals = PROPOSALS.get(one.name) or one_of(one.choices)
    flag_of = partial(typer.Option, *flag.split(), metavar=metavar, help=one.option.help)
    return Annotated[text, flag_of(rich_help_panel=panel, autocompletion=proposals)]


SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0}
NUMBERS: dict[tuple[type, ...], str] = {
    (int,): "INTEGER",
    (float,): "NUMBER",
}  # kinds of an option → its metavar
READERS: dict[
    str, Callable[[Flag], Flag]
] = {  # how the text of an option becomes its value, where typer does not know
    "parameters": lambda texts: pairs("-D", texts),
    "settings": lambda texts: pairs("--set", texts),
    "traverse": lambda texts: {
        k: [number(x) for x in v.split(",")] for k, v in pairs("--traverse", texts).items()
    },
    "exposure_s": lambda text: text if text == "auto" else _seconds(text),
    "maps": npz.read_fpn_maps,
}
PROPOSALS: dict[
    str, Callable[[str], list[str]]
] = {  # for the value of an option, where its type does not say
    "camera": camera_names,
    "like": camera_names,
    "settings": camera_fields,
    "without": noise_source_names,
    "exposure_s": one_of(["auto"]),
    "variant": one_of(VARIANTS),
    "variants": one_of(VARIANTS),
    "sides": one_of(["render", "sensor"]),
}
