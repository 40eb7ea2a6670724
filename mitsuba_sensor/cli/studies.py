"""The commands below study: error and run time, what can be omitted, stiff and extreme cases."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from ..core import require, require_seed
from ..core.options import Option, complete, part_of
from ..render.options import SceneOptions
from ..render.samples import MOST_IN_ALL
from . import arguments, options
from .app import Command, Group, app, err
from .options import Flag, Flags, StudyFlags
from .progress import share_bar

if TYPE_CHECKING:
    from ..pages.page import Study
    from ..study.kit import Progress, Subject
    from .inputs import RenderInput

PANEL = "Study"


class WorkPrecisionFlags(TypedDict, total=False):
    """Options of ``study work-precision``."""

    tolerance: Annotated[
        float,
        Option(
            "Relative error of a pixel's irradiance that the recommended setting keeps.",
            0.01,
            low=1e-6,
            high=1,
            example="0.01",
            panel=PANEL,
        ),
    ]
    seeds: Annotated[
        int,
        Option(
            "Independent runs of each setting; their spread gives the intervals.",
            4,
            low=2,
            example="4",
            panel=PANEL,
        ),
    ]
    sides: Annotated[
        list[str] | None,
        Option(
            "Measure only the render or only the sensor. Repeatable. Default: both.",
            flag="--side",
            metavar="render|sensor",
            text=list[str],
            panel=PANEL,
        ),
    ]
    variants: Annotated[
        list[str] | None,
        Option(
            "Mitsuba variant to compare. Repeatable. Default: all that work here.",
            flag="--variant",
            metavar="NAME",
            text=list[str],
            panel=PANEL,
        ),
    ]


class AblationFlags(TypedDict, total=False):
    """Options of ``study ablation``."""

    tolerance_dn: Annotated[
        float, Option("Tolerance of the tested plan [DN].", 0.02, panel=PANEL)
    ]
    frames: Annotated[
        int, Option("Frames of each of 8 sensor units.", 8, low=2, example="8", panel=PANEL)
    ]
    spp: Annotated[
        int,
        Option(
            "Samples per pixel of the render; renders that are compared have a quarter of them.",
            32,
            low=8,
            high=MOST_IN_ALL,
            example="32",
            panel=PANEL,
        ),
    ]
    seed: Annotated[
        int | None,
        Option(
            f"Seed of the first frame. {options.FROM_SCENE} 1.", check=require_seed, panel=PANEL
        ),
    ]
    serial: Annotated[
        int | None,
        Option(
            f"Serial number of the first sensor unit. {options.FROM_SCENE} 1.",
            check=require_seed,
            panel=PANEL,
        ),
    ]


study = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="Measure error and run time on your scene, and find out what it does not need.\n\n"
    "Each study writes study.html (a self-contained page), study.json and a PNG of its first plot. Exit code 1: a "
    "check failed.",
)
app.add_typer(study, name="study")


@study.command(
    "work-precision",
    cls=Command,
    epilog="Example: mitsuba-sensor study work-precision step_wedge --side sensor",
)
@options.flags(
    options.CameraFlags,
    SceneOptions,
    WorkPrecisionFlags,
    StudyFlags,
    without=("motion", "variant"),
    first=("out", "as_json", "camera", "exposure_s", "width", "sides", "tolerance", "seeds"),
)
def work_precision(scene: arguments.Scene, **flags: Flag) -> None:
    """Measure error versus run time of SCENE's render and sensor, and recommend a setting.

    Compares bands, channels, denoising and variants with a long render, and engines, precisions and plans of the sensor
    with NumPy in float64. A small width is enough (--width 48).
    """
    from ..study.work_precision import SIDES
    from ..study.work_precision import work_precision as measured
    from .inputs import defaults_line, render_input

    asked: dict[str, Flag] = dict(
        complete(WorkPrecisionFlags, part_of(WorkPrecisionFlags, flags))
    )
    sides = tuple(asked.pop("sides") or SIDES)
    variant = next(iter(asked["variants"] or ()), None)
    given, _ = render_input(scene, {**flags, "variant": variant})
    subject = _subject(scene, given, flags)
    measure = partial(measured, subject, sides=sides, **asked)
    defaults = defaults_line(flags, given.scene.settings, given.camera)
    _run("work-precision", flags, measure, subject, defaults)


@study.command(
    "ablation",
    cls=Command,
    epilog="Example: mitsuba-sensor study ablation still_life --exposure-s 0.001",
)
@options.flags(
    options.CameraFlags,
    SceneOptions,
    AblationFlags,
    StudyFlags,
    without=("motion",),
    first=("out", "as_json", "camera", "exposure_s", "width", "frames", "spp", "tolerance_dn"),
)
def ablation(scene: arguments.Scene, **flags: Flag) -> None:
    """Measure what each noise source and render feature changes in SCENE, and the time saved without it.

    Compares frames with the same random numbers. Exit code 1 if the plan exceeds its tolerance.
    """
    from ..core import first_given
    from ..study.ablation import ablation as measured
    from .inputs import defaults_line, render_input

    asked: dict[str, Flag] = dict(complete(AblationFlags, part_of(AblationFlags, flags)))
    require("tolerance_dn", asked["tolerance_dn"], 0.0, 1e9, "digital numbers, e.g. 0.02")
    given, _ = render_input(scene, flags)
    for name in ("seed", "serial"):
        asked[name] = first_given(asked[name], getattr(given.scene.settings, name), 1)
    subject = _subject(scene, given, flags, spp=asked.pop("spp"), variant=flags["variant"])
    measure = partial(measured, subject, **asked)
    defaults = defaults_line(flags, given.scene.settings, given.camera)
    _run("ablation", flags, measure, subject, defaults)


@study.command(
    "stress", cls=Command, epilog="Example: mitsuba-sensor study stress -o study/stress"
)
@options.flags(StudyFlags)
def stress(**flags: Flag) -> None:
    """Run stiff and extreme cases on every engine, and compare each deviation with its limit.

    Takes a few minutes.
    """
    from ..study.stress import stress as measured

    _run("stress", flags, measured)


def _subject(scene: str, given: "RenderInput", flags: Flags, **more: Flag) -> "Subject":
    """Return the subject of a study.  more : options of the render."""
    from ..render.passes.prepared import prepare
    from ..sensor.metering import Metering
    from ..study.kit import Subject

    names = ("scene_unit", "width", "integrator", "ignore_polarization")
    same = {name: flags[name] for name in names}
    render = {"parameters": flags["parameters"] or {}, **same, **more}
    exposure = given.exposure
    if isinstance(exposure, Metering):
        exposure = prepare(scene, given.camera, exposure, **render).metered_first().exposure
    return Subject(scene, given.camera, exposure, render)


def _run(
    name: str,
    flags: Flags,
    measure: "Callable[[Progress], Study]",
    subject: "Subject | None" = None,
    defaults: Sequence[str] = (),
) -> None:
    """Run a study and print it.  defaults : the sentence about values that nobody set."""
    from ..core import first_given
    from ..files.appearing import refuse_empty
    from ..study.kit import NUMBERS, PAGE, run_study
    from .measuring import finish

    out = first_given(flags["out"], f"study/{name}")
    refuse_empty(out, "-o", "give the name of a folder, e.g. -o study/out")
    about: dict[str, object] = {"command": _command()}
    if subject is not None:
        about |= {"scene": str(subject.scene), "camera": subject.camera.name}
        about["exposure"] = asdict(subject.exposure)
    with share_bar(err) as progress:
        outcome = run_study(Path(out), measure, about, progress)
    finish(outcome, out, (PAGE, NUMBERS, f"{name}*.png"), flags["as_json"], defaults)


def _command() -> str:
    """Return the command without its output options."""
    arguments = ["mitsuba-sensor", *sys.argv[1:]]
    for flag in ("-o", "--out"):
        if flag in arguments:
            del arguments[(place := arguments.index(flag)) : place + 2]
    return shlex.join(one for one in arguments if one != "--json")
