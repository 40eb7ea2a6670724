"""Flags of the command line, made from the declarations of the options; and those that only the command line has."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Annotated, TypeAlias, TypedDict, TypeVar

import typer
from rich.markup import escape

from ..camera.shipped import DEFAULT_CAMERA
from ..capture_options import CaptureOptions
from ..core import require_seed
from ..core.options import Declared, Option, declared
from ..render.options import FileOptions, RenderOptions, SceneOptions
from ..render.samples import MOST_IN_ALL
from ..render.variants import VARIANTS
from ..sensor.options import PERCENTILE, SHARE, FrameOptions, Gain, SensorOptions
from .arguments import OUTPUT
from .completion import camera_fields, camera_names, noise_source_names, one_of
from .flag_names import flag_of
from .help import show_all
from .values import Flag, flag_value

Command = TypeVar("Command", bound=Callable[..., None])
Flags = Mapping[str, Flag]

DEFAULT_TEMPERATURE_K = 298.15

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
            "A name from `cameras list`, or the path of a .toml of your own. It is taken as it is, without what the "
            f"scene file sets in its own. Default: that of the scene or render, else {DEFAULT_CAMERA}.",
            metavar="NAME",
        ),
    ]
    exposure_s: Annotated[
        str | None,
        Option(
            f"Exposure time in seconds, or auto (metered); auto takes the {PERCENTILE:g}th percentile of the lit "
            f"pixels to {100 * SHARE:g} % of saturation. Default: that of the scene or render, else auto.",
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
            "Temperature of the sensor in kelvin. Default: that of the scene or render, else "
            f"{DEFAULT_TEMPERATURE_K} (+25 °C).",
            metavar="KELVIN",
        ),
    ]
    gain: Gain
    readout: Annotated[
        str | None,
        Option(
            "One read-out of a camera that has several, as if the camera had no other. Default: all, combined.",
            metavar="NAME",
        ),
    ]
    settings: Settings
    without: Without


class ChangedCameraFlags(TypedDict, total=False):
    """What is changed in a camera file before it is looked at."""

    settings: Settings


class NewCameraFlags(TypedDict, total=False):
    """What a new camera file begins with."""

    like: Annotated[
        str | None,
        Option(
            f"Camera to start from: a name from `cameras list`, or a .toml. Default: {DEFAULT_CAMERA}.",
            metavar="NAME",
        ),
    ]
    emva: Annotated[
        str | None,
        Option(
            "Camera of an EMVA 1288 sheet instead, from a file with its rows, NAME = VALUE in each line.",
            metavar="FILE",
        ),
    ]
    name: Annotated[
        str | None,
        Option(
            "Name of the camera. Default: asked at a terminal, else that of the file.",
            metavar="TEXT",
        ),
    ]
    description: Annotated[
        str | None,
        Option(
            "One line about the camera. Default: asked at a terminal, else derived.",
            metavar="TEXT",
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
        Option(
            "Name of the camera. Default: what the file says, else its own name.",
            metavar="TEXT",
        ),
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
            panel="Sensor",
        ),
    ]
    rows: Annotated[
        int | None,
        Option(
            "Height of the maps. Default: the whole sensor.",
            low=1,
            metavar="PIXELS",
            panel="Sensor",
        ),
    ]
    width: Annotated[
        int | None,
        Option(
            "Width of the maps. Default: the whole sensor.",
            low=1,
            metavar="PIXELS",
            panel="Sensor",
        ),
    ]


class StudyFlags(TypedDict, total=False):
    """Flags of every study."""

    out: Annotated[
        str | None,
        Option(
            "Folder for the page and its data. Default: the command's name; for a study, study/ and its name.",
            flag="-o --out",
            metavar="DIR",
            panel="Output",
        ),
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
            metavar="NAME",
            text=list[str],
        ),
    ]


class AblationFlags(TypedDict, total=False):
    """Flags of ``study ablation``."""

    tolerance_dn: Annotated[float, Option("Tolerance of the plan that is tested, in DN.", 0.02)]
    frames: Annotated[
        int, Option("Frames of each of the 8 cameras that are measured.", 8, low=2, example="8")
    ]
    spp: Annotated[
        int,
        Option(
            "Samples per pixel of the render; renders that are compared have a quarter of them.",
            32,
            low=8,
            high=MOST_IN_ALL,
            example="32",
        ),
    ]
    seed: Annotated[
        int | None,
        Option(
            "Seed of the first frame. Default: that of the scene or render, else 1.",
            check=require_seed,
        ),
    ]
    serial: Annotated[
        int | None,
        Option(
            "Serial number of the first camera. Default: that of the scene or render, else 1.",
            check=require_seed,
        ),
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
    WorkPrecisionFlags: "Study",
    AblationFlags: "Study",
}


def flags(
    *kinds: type, without: tuple[str, ...] = (), first: tuple[str, ...] = ()
) -> Callable[[Command], Command]:
    """Give a command the flags of these options; it takes them as ``**flags``, read but not yet checked.

    The flags stand in ``--help`` in the order of their declaration, before the command's own.
    without : names of options that this command does not have.  first : names of those that ``--help`` shows, where
        all are more than a screen; ``--help-all`` shows all.
    """

    def with_flags(command: Command) -> Command:
        known = (one for kind in kinds for one in declared(kind) if one.option.flag is not None)
        found = {one.name: one for one in known if one.name not in without}
        signature = inspect.signature(command, eval_str=True).parameters.values()
        own = [p for p in signature if p.kind is not p.VAR_KEYWORD]
        kind = inspect.Parameter.KEYWORD_ONLY
        made = [
            inspect.Parameter(x.name, kind, default=x.option.default, annotation=_type(x))
            for x in found.values()
        ]
        needed = [p for p in own if p.default is p.empty]
        optional = [p for p in own if p.default is not p.empty]
        optional += [HELP_ALL] if first else []
        parameters = [p.replace(kind=kind) for p in (*needed, *made, *optional)]

        @wraps(command)
        def run(**values: Flag) -> None:
            values.pop(HELP_ALL.name, None)
            read = {one.name: flag_value(one, values[one.name]) for one in found.values()}
            command(**{**values, **read})

        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        run.first = first  # type: ignore[attr-defined]
        return run  # type: ignore[return-value]

    return with_flags


def _type(one: Declared) -> Flag:
    """The type of an option as typer wants it, with its flag and its help. Numbers are texts, so that a wrong one gets
    the same sentence as in Python."""
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


NUMBERS: dict[tuple[type, ...], str] = {(int,): "INTEGER", (float,): "NUMBER"}
"""Kinds of an option → its metavar."""
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
"""For the value of an option, where its type does not say."""
