"""Flags made from the declarations of the options, those that only the command line has, and how values are read."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypedDict, TypeVar

import typer
from rich.markup import escape

from ..camera.shipped import DEFAULT_CAMERA
from ..capture_options import CaptureOptions
from ..core import InputError, require_seed
from ..core.options import Declared, Option, declared
from ..render.options import FileOptions, RenderOptions, SceneOptions
from ..render.variants import VARIANTS
from ..sensor.options import PERCENTILE, SHARE, FrameOptions, Gain, SensorOptions
from .app import show_all
from .arguments import OUTPUT, camera_fields, camera_names, noise_source_names, one_of
from .flag_names import flag_of

Command = TypeVar("Command", bound=Callable[..., None])
Flag: TypeAlias = Any
"""The value of a flag; its type is the option's."""
Flags = Mapping[str, Flag]

DEFAULT_TEMPERATURE_K = 298.15
FROM_SCENE = "Default: from the scene or render, else"

Settings: TypeAlias = Annotated[
    dict[str, str] | None,
    Option(
        "Change a camera field, e.g. adc.bits=14; FIELD=none unsets it. Repeatable; `cameras show NAME` lists "
        "the fields.",
        flag="--set",
        metavar="FIELD=VALUE",
        text=list[str],
    ),
]
Without: TypeAlias = Annotated[
    list[str] | None,
    Option(
        "Switch off a noise source, e.g. shot_noise. Repeatable; `cameras stages` lists the names.",
        flag="--without",
        metavar="SOURCE",
        text=list[str],
    ),
]
Forced: TypeAlias = Annotated[
    bool, Option("Overwrite an existing file.", False, flag="--force", panel=OUTPUT)
]


class CameraFlags(TypedDict, total=False):
    """The camera and its exposure."""

    camera: Annotated[
        str | None,
        Option(
            "Name from `cameras list`, or .toml file. It replaces the camera fields of the "
            f"scene file. {FROM_SCENE} {DEFAULT_CAMERA}.",
            metavar="NAME",
        ),
    ]
    exposure_s: Annotated[
        str | None,
        Option(
            f"Exposure time [s], or auto; auto brings the {PERCENTILE:g}th percentile of the lit pixels to "
            f"{100 * SHARE:g} % of saturation. {FROM_SCENE} auto.",
            metavar="SECONDS|auto",
        ),
    ]
    meter: Annotated[
        str | None,
        Option(
            "Set the exposure time so this percentile of the lit pixels reaches this fraction of saturation. "
            f"Default: {PERCENTILE:g}:{SHARE:g}.",
            metavar="PERCENTILE:FRACTION",
        ),
    ]
    temperature_k: Annotated[
        float | None,
        Option(
            f"Sensor temperature [K]. {FROM_SCENE} {DEFAULT_TEMPERATURE_K} (+25 °C).",
            metavar="KELVIN",
        ),
    ]
    gain: Gain
    readout: Annotated[
        str | None,
        Option(
            "Use only one readout of a camera that has several. Default: all readouts, combined.",
            metavar="NAME",
        ),
    ]
    settings: Settings
    without: Without


class BudgetFlags(TypedDict, total=False):
    """The exposure of a noise budget."""

    exposure_s: Annotated[
        str | None,
        Option(
            "Exposure time [s]. Default: from the scene or render, else auto; 0.01 for uniform light.",
            metavar="SECONDS|auto",
        ),
    ]


class ChangedCameraFlags(TypedDict, total=False):
    """Changes to a camera file before it is checked."""

    settings: Settings


class NewCameraFlags(TypedDict, total=False):
    """The starting point of a new camera file."""

    like: Annotated[
        str | None,
        Option(
            f"Copy this camera: a name from `cameras list`, or a .toml file. Default: {DEFAULT_CAMERA}.",
            metavar="NAME",
        ),
    ]
    emva: Annotated[
        str | None,
        Option(
            "Convert an EMVA 1288 sheet instead: a TOML file with its rows, e.g. bits = 12.",
            metavar="FILE",
        ),
    ]
    name: Annotated[
        str | None, Option("Camera name. Default: the file's name.", metavar="TEXT")
    ]
    description: Annotated[
        str | None,
        Option("One-line description. Default: names the source.", metavar="TEXT"),
    ]
    settings: Settings
    without: Without
    force: Forced


class ImportFlags(TypedDict, total=False):
    """Values that an imported camera takes if its file has none."""

    like: Annotated[
        str,
        Option(
            "Camera that supplies missing values: a name, or a .toml file.",
            "bayer_2mp",
            metavar="NAME",
        ),
    ]
    settings: Settings
    name: Annotated[
        str | None,
        Option("Camera name. Default: from the file, else the file's name.", metavar="TEXT"),
    ]
    force: Forced


class MapFlags(TypedDict, total=False):
    """The FPN maps to write."""

    serial: Annotated[
        int,
        Option(
            "Serial number of the sensor unit, which selects its fixed-pattern noise.",
            1,
            check=require_seed,
            panel="Sensor",
        ),
    ]
    rows: Annotated[
        int | None,
        Option(
            "Height of the maps [pixels]. Default: the sensor's height.",
            low=1,
            metavar="PIXELS",
            panel="Sensor",
        ),
    ]
    width: Annotated[
        int | None,
        Option(
            "Width of the maps [pixels]. Default: the sensor's width.",
            low=1,
            metavar="PIXELS",
            panel="Sensor",
        ),
    ]


class StudyFlags(TypedDict, total=False):
    """Options of every study."""

    out: Annotated[
        str | None,
        Option(
            "Folder for the page and its data. Default: the command's name; for a study, study/NAME.",
            flag="-o --out",
            metavar="DIR",
            panel=OUTPUT,
        ),
    ]
    as_json: Annotated[
        bool,
        Option("Print only JSON on stdout, for programs.", False, flag="--json", panel=OUTPUT),
    ]


HELP_ALL = inspect.Parameter(
    "help_all",
    inspect.Parameter.KEYWORD_ONLY,
    default=False,
    annotation=Annotated[
        bool,
        typer.Option("--help-all", is_eager=True, callback=show_all, help="Show all options."),
    ],
)

PANELS: dict[type, str] = {
    CameraFlags: "Camera and exposure",
    NewCameraFlags: "Camera and exposure",
    ImportFlags: "Camera and exposure",
    FileOptions: "Scene",
    SceneOptions: "Scene",
    RenderOptions: "Render: samples, bands, noise",
    SensorOptions: "Sensor",
    FrameOptions: "Frames and seeds",
    CaptureOptions: OUTPUT,
}
"""Titles in ``--help``; an option stands under the first of these that declares it."""


def flags(
    *kinds: type, without: tuple[str, ...] = (), first: tuple[str, ...] = ()
) -> Callable[[Command], Command]:
    """Give a command the flags of these options; it takes them as ``**flags``, read but not yet checked.

    The flags stand in ``--help`` in the order of their declaration, before the command's own.
    without : names of options that this command does not have.  first : names of the options in short ``--help``;
        ``--help-all`` then shows all.
    """

    def with_flags(command: Command) -> Command:
        options = {
            one.name: one
            for kind in kinds
            for one in declared(kind)
            if one.option.flag is not None and one.name not in without
        }
        signature = inspect.signature(command, eval_str=True).parameters.values()
        own = [p for p in signature if p.kind is not p.VAR_KEYWORD]
        kind = inspect.Parameter.KEYWORD_ONLY
        made = [
            inspect.Parameter(x.name, kind, default=x.option.default, annotation=_type(x))
            for x in options.values()
        ]
        needed = [p for p in own if p.default is p.empty]
        optional = [p for p in own if p.default is not p.empty]
        optional += [HELP_ALL] if first else []
        parameters = [p.replace(kind=kind) for p in (*needed, *made, *optional)]

        @wraps(command)
        def run(**values: Flag) -> None:
            values.pop(HELP_ALL.name, None)
            read = {one.name: flag_value(one, values[one.name]) for one in options.values()}
            command(**{**values, **read})

        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        run.first = first  # type: ignore[attr-defined]
        return run  # type: ignore[return-value]

    return with_flags


def _type(one: Declared) -> Flag:
    """Return the type of an option for typer, with its flag and help.

    Numbers are texts, so a wrong number gets the same sentence as in Python.
    """
    flag, kinds = flag_of(one), one.kinds
    numeric = NUMBERS.get(kinds)
    text: Flag = one.option.text or (str if one.choices or numeric else kinds[0])
    titles = (title for kind, title in PANELS.items() if one.name in kind.__annotations__)
    option = typer.Option(
        *flag.split(),
        metavar=one.option.metavar or numeric or "|".join(map(str, one.choices)) or None,
        help=escape(one.option.help),
        rich_help_panel=one.option.panel or next(titles, None),
        autocompletion=PROPOSALS.get(one.name) or one_of(one.choices),
    )
    return Annotated[text | None if one.option.default is None else text, option]


def pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    """Read ["a=1", …] as {"a": "1", …}."""
    values = dict[str, str]()
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not name or not equals:
            raise InputError(
                f"{option} {text!r} has no name and value; write {option} NAME=VALUE."
            )
        values[name] = value
    return values


def number(text: str, kind: type = float) -> Flag:
    """Return the number in a text, or the text itself, which the option's check then rejects."""
    try:
        return kind(text)
    except ValueError:
        return text


def _exposure(text: str) -> Flag:
    seconds = number(text)
    if isinstance(seconds, str) and text != "auto":
        raise InputError(
            f"--exposure-s {text!r} is not a number of seconds; give seconds, e.g. 0.01, or auto."
        )
    return seconds


def _maps(file: str) -> Flag:
    from ..files.npz import read_fpn_maps

    return read_fpn_maps(Path(file))


def _traverse(texts: Sequence[str]) -> Flag:
    given = pairs("--traverse", texts)
    return {name: [number(x) for x in value.split(",")] for name, value in given.items()}


def flag_value(one: Declared, value: Flag) -> Flag:
    """Return the unchecked value of a flag from what typer read."""
    if value is None or value == one.option.default:
        return value
    if one.name in READERS:
        return READERS[one.name](value)
    return number(value, one.kinds[0]) if one.kinds in NUMBERS else value


NUMBERS: dict[tuple[type, ...], str] = {(int,): "INTEGER", (float,): "NUMBER"}
"""Types of an option → its metavar."""
READERS: dict[str, Callable[[Flag], Flag]] = {
    "parameters": lambda texts: pairs("-D", texts),
    "settings": lambda texts: pairs("--set", texts),
    "traverse": _traverse,
    "exposure_s": _exposure,
    "maps": _maps,
}
"""Functions that read a value that typer cannot read."""
PROPOSALS: dict[str, Callable[[str], list[str]]] = {
    "camera": camera_names,
    "like": camera_names,
    "settings": camera_fields,
    "without": noise_source_names,
    "exposure_s": one_of(["auto"]),
    "variant": one_of(VARIANTS),
    "variants": one_of(VARIANTS),
    "sides": one_of(["render", "sensor"]),
}
"""Proposed values, if the type of an option does not tell."""
