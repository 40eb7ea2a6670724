"""Commands of study: error against run time, what can be left out, and stiff and extreme cases."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ..core.checks import first_given
from ..core.options import complete
from ..io import files
from ..io.measurements import Measurements
from ..io.metadata import machine, versions
from ..render.options import SceneOptions
from . import options
from .app import app, err, render_input, show
from .study_options import AblationFlags, Force, StudyOut, WorkPrecisionFlags
from .study_tables import seconds_bar, sheet

if TYPE_CHECKING:
    from ..render.scene_settings import SceneSettings
    from ..study.subject import Subject

PAGE, NUMBERS, MEASUREMENTS = "study.html", "study.json", "measurements"

study = typer.Typer(
    no_args_is_help=True,
    help="How good the numbers are, what they cost, and what could be left out: tables, plots and a page.\n\n"
    "Each writes study.html (a page that needs nothing else), study.json and a PNG of its first plot. One that was "
    "stopped goes on where it was when the same command is given again. Exit code 1: something that must hold fails.",
)
app.add_typer(study, name="study")


@dataclass(frozen=True)
class Output:
    """Where the results of a study go. force : measure again what the folder holds."""

    folder: Path
    force: bool
    as_json: bool


@study.command(
    "work-precision", epilog="Example: mitsuba-sensor study work-precision scenes/step_wedge.xml --side sensor"
)
@options.flags(options.CameraFlags, SceneOptions, WorkPrecisionFlags, without=("motion", "variant"))
def work_precision(
    scene: options.Scene,
    out_dir: StudyOut = Path("study/work-precision"),
    force: Force = False,
    as_json: options.Json = False,
    **flags: options.Flag,
) -> None:
    """Error against run time of SCENE, of the render and of the sensor, and the setting to take.

    Samplers, sizes of passes, variants, bands, and what is done about the render's noise, against a reference of known
    error; engines, precisions, samplers of the Poisson law and plans of the sensor. Small pictures do (-D width=48).
    """
    from ..study.work_precision import SIDES
    from ..study.work_precision import work_precision as measured

    asked = complete(WorkPrecisionFlags, {name: flags[name] for name in WorkPrecisionFlags.__annotations__})
    variants, sides = asked["variants"], tuple(asked["sides"] or SIDES)
    given: dict[str, Any] = {"tolerance": asked["tolerance"], "seeds": asked["seeds"], "variants": variants}
    subject, question, _ = _subject(scene, {**flags, "variant": variants[0] if variants else None}, {})
    to = Output(out_dir, force, as_json)
    _run(to, "work-precision", {**question, **given}, lambda kit: measured(kit, subject, sides=sides, **given))


@study.command("ablation", epilog="Example: mitsuba-sensor study ablation scenes/still_life.xml --exposure-s 0.001")
@options.flags(options.CameraFlags, SceneOptions, AblationFlags, without=("motion",))
def ablation(
    scene: options.Scene,
    out_dir: StudyOut = Path("study/ablation"),
    force: Force = False,
    as_json: options.Json = False,
    **flags: options.Flag,
) -> None:
    """What each stage of the sensor and each feature of the render does to SCENE, and what leaving it out would save.

    Every change is predicted from theory and measured on frames; the two must agree within three standard errors.
    """
    from ..study.ablation import ablation as measured

    asked = complete(AblationFlags, {name: flags[name] for name in AblationFlags.__annotations__})
    subject, question, settings = _subject(scene, flags, {"spp": asked["spp"], "variant": flags["variant"]})
    given: dict[str, Any] = {
        "tolerance_dn": asked["tolerance_dn"],
        "frames": asked["frames"],
        "seed": first_given(asked["seed"], settings.seed, 1),
        "serial": first_given(asked["serial"], settings.serial, 1),
    }
    to = Output(out_dir, force, as_json)
    _run(to, "ablation", {**question, **given}, lambda kit: measured(kit, subject, **given))


@study.command("stress", epilog="Example: mitsuba-sensor study stress -o study/stress")
def stress(out_dir: StudyOut = Path("study/stress"), force: Force = False, as_json: options.Json = False) -> None:
    """Stiff and extreme cases of every stage on every engine: input, expected, got, verdict; and condition numbers."""
    from ..study.stress import stress as measured

    _run(Output(out_dir, force, as_json), "stress", {}, measured)


def _subject(scene: Path, flags: options.Flags, more: dict[str, Any]) -> tuple[Subject, dict[str, Any], SceneSettings]:
    """The scene with the camera and exposure that are asked for, or that it names itself; all that decides what is
    measured of it; and the scene's settings. more : options of the render."""
    from ..study.subject import Subject

    found, _ = render_input(scene, flags)
    parameters = flags["parameters"] or {}
    render = {"parameters": parameters, "scene_unit": flags["scene_unit"], "width": flags["width"], **more}
    about = {"scene": str(scene), "scene_sha256": found.scene.file.digest()}
    question = {**about, "camera": found.camera.model_dump(), "exposure": asdict(found.exposure), "render": render}
    return Subject(scene, found.camera, found.exposure, render), question, found.scene.settings


def _run(to: Output, name: str, question: dict[str, Any], measure: Callable[[Any], Any]) -> None:
    """Run the study and write what it found; what was measured stays, even if the rest is stopped."""
    from ..study.drawing import png
    from ..study.html import html
    from ..study.kit import Kit
    from ..study.page import Table

    made: dict[str, Any] = {"machine": machine(), "versions": versions()}
    known = Measurements(to.folder / MEASUREMENTS, {"study": name, **question, **made}, to.force)
    before = len(known)
    with seconds_bar(err) as progress:
        kit = Kit(known, progress)
        try:
            found = measure(kit)
        except KeyboardInterrupt:
            if kit.new:
                kept = f"{len(known)} measurements are kept in {known.folder}; the same command goes on from there"
                err.print(kept, highlight=False, soft_wrap=True)
            raise
    about = {"scene": question.get("scene"), "camera": question.get("camera", {}).get("name")}
    about |= {"command": _command(), **made, "seconds": round(kit.seconds, 1), "resumed_measurements": before}
    exposure = {"exposure": question["exposure"]} if "exposure" in question else {}
    found = replace(found, data={**found.data, **{k: v for k, v in about.items() if v is not None}, **exposure})
    picture = next((part for part in found.parts if not isinstance(part, Table)), None)
    with files.output_folder(to.folder, (PAGE, NUMBERS, f"{name}.png")) as folder:
        files.write_page(folder / PAGE, html(found))
        files.write_json(folder / NUMBERS, found.to_dict())
        if picture is not None:
            files.write_drawing(folder / f"{name}.png", png(picture))
    show(found.to_dict() if to.as_json else sheet(found, str(to.folder / PAGE)), to.as_json)
    if not found.passed:
        raise typer.Exit(1)


def _command() -> str:
    """What was asked, without where its answer went."""
    kept, arguments = ["mitsuba-sensor"], iter(sys.argv[1:])
    for argument in arguments:
        if argument in ("-o", "--out"):
            next(arguments, None)
        elif argument not in ("--json", "--force"):
            kept.append(argument)
    return shlex.join(kept)
