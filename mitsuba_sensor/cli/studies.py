"""study: error against run time, what can be left out, and stiff and extreme cases."""

from __future__ import annotations

import inspect
import shlex
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, get_type_hints

import typer

from ..core.checks import first_given
from ..io import files
from ..io.measurements import Measurements
from ..io.metadata import machine, versions
from . import options
from .app import app, err, scene_camera, scene_exposure, scene_setup, show
from .study_tables import seconds_bar, sheet

PAGE, NUMBERS, MEASUREMENTS = "study.html", "study.json", "measurements"

study = typer.Typer(
    no_args_is_help=True,
    help="How good the numbers are, what they cost, and what could be left out: tables, plots and a page.\n\n"
    "Each writes study.html (a page that needs nothing else), study.json and a PNG of its first plot. One that was "
    "stopped goes on where it was when the same command is given again. Exit code 1: something that must hold fails.",
)
app.add_typer(study, name="study")


@dataclass(frozen=True)
class StudyOptions:
    """Of every study."""

    out_dir: options.StudyOut = Path("study")
    force: options.Again = False
    as_json: options.Json = False


@dataclass(frozen=True)
class SceneOptions:
    """Of a study of a scene."""

    scene: options.Scene
    out_dir: options.StudyOut = Path("study")
    camera: options.CameraOrScene = None
    exposure_s: options.ExposureOrScene = None
    temperature_k: options.TemperatureOrScene = None
    settings: options.Settings = None
    parameters: options.Parameters = None
    scene_unit: options.SceneUnit = None
    columns: options.Columns = None
    force: options.Again = False
    as_json: options.Json = False


@dataclass(frozen=True)
class WorkPrecisionOptions(SceneOptions):
    """Of work-precision."""

    tolerance: options.Tolerance = 0.01
    seeds: options.Seeds = 4
    sides: options.Sides = None
    variants: options.Variants = None


@dataclass(frozen=True)
class AblationOptions(SceneOptions):
    """Of ablation."""

    tolerance_dn: options.PlanDn = 0.02
    frames: options.StudyFrames = 24
    spp: options.Samples = 32
    seed: options.SeedOrScene = None
    serial: options.SerialOrScene = None
    variant: options.Variant = None


def command(name: str, asked: type, example: str) -> Callable[[Callable[[Any], None]], None]:
    """A command whose options are the fields of a dataclass, which its function is given."""

    def add(run: Callable[[Any], None]) -> None:
        def called(**given: Any) -> None:
            run(asked(**given))

        hints = get_type_hints(asked, include_extras=True)
        parameters = [one.replace(annotation=hints[one.name]) for one in inspect.signature(asked).parameters.values()]
        called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        called.__annotations__, called.__doc__ = {}, run.__doc__
        study.command(name, epilog=f"Example: mitsuba-sensor study {name} {example}")(called)

    return add


@command("work-precision", WorkPrecisionOptions, "scenes/step_wedge.xml --side sensor")
def work_precision(asked: WorkPrecisionOptions) -> None:
    """Error against run time of SCENE, of the render and of the sensor, and the setting to take.

    Samplers, sizes of passes, variants, bands, and what is done about the render's noise, against a reference of known
    error; engines, precisions, samplers of the Poisson law and plans of the sensor. Small pictures do (-D width=48).
    """
    from ..study.work_precision import SIDES
    from ..study.work_precision import work_precision as measured

    given = {"tolerance": asked.tolerance, "seeds": asked.seeds, "variants": asked.variants}
    subject, question, _ = _subject(asked, (asked.variants or [None])[0], {})
    sides = tuple(asked.sides or SIDES)
    _run(asked, "work-precision", {**question, **given}, lambda kit: measured(kit, subject, sides=sides, **given))


@command("ablation", AblationOptions, "scenes/still_life.xml --exposure-s 0.001")
def ablation(asked: AblationOptions) -> None:
    """What each stage of the sensor and each feature of the render does to SCENE, and what leaving it out would save.

    Every change is predicted from theory and measured on frames; the two must agree within three standard errors.
    """
    from ..study.ablation import ablation as measured

    subject, question, setup = _subject(asked, asked.variant, {"spp": asked.spp, "variant": asked.variant})
    given = {
        "tolerance_dn": asked.tolerance_dn,
        "frames": asked.frames,
        "seed": first_given(asked.seed, setup.seed, 1),
        "serial": first_given(asked.serial, setup.serial, 1),
    }
    _run(asked, "ablation", {**question, **given}, lambda kit: measured(kit, subject, **given))


@command("stress", StudyOptions, "-o study/stress")
def stress(asked: StudyOptions) -> None:
    """Stiff and extreme cases of every stage on every engine: input, expected, got, verdict; and condition numbers."""
    from ..study.stress import stress as measured

    _run(asked, "stress", {}, measured)


def _subject(asked: SceneOptions, variant: str | None, more: dict[str, Any]) -> tuple[Any, dict[str, Any], Any]:
    """The scene with the camera and exposure that are asked for, or that it names itself; all that decides what is
    measured of it; and the scene's settings. more : options of the render."""
    from ..render.scene_file import parse_scene
    from ..study.subject import Subject

    given = options.pairs("-D", asked.parameters)
    setup = scene_setup(asked.scene, given, variant)
    camera = scene_camera(asked.camera, setup, asked.settings)
    exposure = scene_exposure(asked.exposure_s, asked.temperature_k, setup)
    render = {"parameters": given, "scene_unit": asked.scene_unit, "columns": asked.columns, **more}
    about = {"scene": str(asked.scene), "scene_sha256": parse_scene(asked.scene, given).digest()}
    question = {**about, "camera": camera.model_dump(), "exposure": asdict(exposure), "render": render}
    return Subject(asked.scene, camera, exposure, render), question, setup


def _run(
    asked: StudyOptions | SceneOptions, name: str, question: dict[str, Any], measure: Callable[[Any], Any]
) -> None:
    """Run the study and write what it found; what was measured stays, even if the rest is stopped."""
    from ..study.drawing import png
    from ..study.html import html
    from ..study.kit import Kit
    from ..study.page import Table

    out_dir = Path("study") / name if asked.out_dir == Path("study") else asked.out_dir
    made: dict[str, Any] = {"machine": machine(), "versions": versions()}
    known = Measurements(out_dir / MEASUREMENTS, {"study": name, **question, **made}, asked.force)
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
    with files.output_folder(out_dir, (PAGE, NUMBERS, f"{name}.png")) as folder:
        files.write_page(folder / PAGE, html(found))
        files.write_json(folder / NUMBERS, found.to_dict())
        if picture is not None:
            files.write_drawing(folder / f"{name}.png", png(picture))
    show(found.to_dict() if asked.as_json else sheet(found, str(out_dir / PAGE)), asked.as_json)
    if not found.passed:
        raise typer.Exit(1)


def _command() -> str:
    """What was asked, without where its answer went."""
    kept, left = ["mitsuba-sensor"], iter(sys.argv[1:])
    for word in left:
        if word in ("-o", "--out"):
            next(left, None)
        elif word not in ("--json", "--force"):
            kept.append(word)
    return shlex.join(kept)
