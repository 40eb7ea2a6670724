"""Commands of study: error against run time, what can be left out, stiff and extreme cases."""

import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..core import require
from ..core.options import complete, part_of
from ..render.options import SceneOptions
from . import arguments, options
from .app import app, err
from .help import Command, Group
from .options import AblationFlags, Flags, StudyFlags, WorkPrecisionFlags
from .progress import share_bar
from .values import Flag

if TYPE_CHECKING:
    from ..pages.page import Study
    from ..study.kit import Progress, Subject
    from .inputs import RenderInput

study = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="How good the numbers are, what they cost, and what could be left out: tables, plots and a page.\n\n"
    "Each writes study.html (a page that needs nothing else), study.json and a PNG of its first plot. Exit code 1: "
    "a check failed.",
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
    """Error against run time of SCENE, of the render and of the sensor, and the setting to take.

    Bands, channels, denoising and variants against a reference of known error; engines, precisions and plans of the
    sensor against NumPy in float64, in frames of the scene's size. Small pictures are enough (--width 48).
    """
    from ..study.work_precision import SIDES
    from ..study.work_precision import work_precision as measured
    from .inputs import render_input, taken_by_default

    asked: dict[str, Flag] = dict(
        complete(WorkPrecisionFlags, part_of(WorkPrecisionFlags, flags))
    )
    sides = tuple(asked.pop("sides") or SIDES)
    found, _ = render_input(
        scene, {**flags, "variant": next(iter(asked["variants"] or ()), None)}
    )
    subject = _subject(scene, found, flags)
    measure = partial(measured, subject, sides=sides, **asked)
    defaults = taken_by_default(flags, found.scene.settings, found.camera)
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
    """What each noise source and each feature of the render does to SCENE, and what leaving it out would save.

    Changes are measured in frames with the same random numbers; those of the plan must keep its tolerance.
    """
    from ..core import first_given
    from ..study.ablation import ablation as measured
    from .inputs import render_input, taken_by_default

    asked: dict[str, Flag] = dict(complete(AblationFlags, part_of(AblationFlags, flags)))
    require("tolerance_dn", asked["tolerance_dn"], 0.0, 1e9, "digital numbers, e.g. 0.02")
    found, _ = render_input(scene, flags)
    for name in ("seed", "serial"):
        asked[name] = first_given(asked[name], getattr(found.scene.settings, name), 1)
    subject = _subject(scene, found, flags, spp=asked.pop("spp"), variant=flags["variant"])
    measure = partial(measured, subject, **asked)
    defaults = taken_by_default(flags, found.scene.settings, found.camera)
    _run("ablation", flags, measure, subject, defaults)


@study.command(
    "stress", cls=Command, epilog="Example: mitsuba-sensor study stress -o study/stress"
)
@options.flags(StudyFlags)
def stress(**flags: Flag) -> None:
    """Stiff and extreme cases on every engine: how far each result is from what must come, over how far it may be.

    It takes some minutes.
    """
    from ..study.stress import stress as measured

    _run("stress", flags, measured)


def _subject(scene: str, found: "RenderInput", flags: Flags, **more: Flag) -> "Subject":
    """What a study of a scene is about.  more : options of the render."""
    from ..render.passes.prepared import prepare
    from ..sensor.metering import Metering
    from ..study.kit import Subject

    names = ("scene_unit", "width", "integrator", "ignore_polarization")
    same = {name: flags[name] for name in names}
    render = {"parameters": flags["parameters"] or {}, **same, **more}
    exposure = found.exposure
    if isinstance(exposure, Metering):
        exposure = prepare(scene, found.camera, exposure, **render).metered_first().exposure
    return Subject(scene, found.camera, exposure, render)


def _run(
    name: str,
    flags: Flags,
    measure: "Callable[[Progress], Study]",
    subject: "Subject | None" = None,
    defaults: Sequence[str] = (),
) -> None:
    """Run a study and show what it found.  defaults : what is said of values that nobody gave."""
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
    """The command that was given, without where it writes and how it shows what it found."""
    without, before, asked = ("-o", "--out"), "", ["mitsuba-sensor"]
    for argument in sys.argv[1:]:
        if argument not in (*without, "--json") and before not in without:
            asked.append(argument)
        before = argument
    return shlex.join(asked)
