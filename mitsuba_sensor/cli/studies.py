"""study: error against run time, stiff and extreme cases, and what was left out."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import typer

import mitsuba_sensor as ms

from ..io import files
from ..io.journal import Journal
from ..io.metadata import machine, versions
from ..study.html import html
from ..study.page import Bars, Grid, Plot, Progress, Study
from . import options
from .app import app, err, scene_camera, scene_exposure, scene_setup, show
from .study_tables import seconds_bar, sheet

JOURNAL, PAGE, NUMBERS = "measurements.jsonl", "study.html", "study.json"
SPENT = "seconds spent"
"""In the journal: of all runs of the study together."""

study = typer.Typer(
    no_args_is_help=True,
    help="How good the numbers are, what they cost, and what could be left out: tables, plots and a page.\n\n"
    "Each writes study.html (a page that needs nothing else), study.json and a PNG of its first plot. One that was "
    "stopped goes on where it was when the same command is given again. Exit code 1: something that must hold fails.",
)
app.add_typer(study, name="study")


@study.command("error-time", epilog="Example: mitsuba-sensor study error-time scenes/step_wedge.xml --side sensor")
def error_time(
    scene: options.Scene,
    out_dir: options.StudyOut = Path("study/error-time"),
    camera: options.CameraOrScene = None,
    exposure_s: options.ExposureOrScene = None,
    temperature_k: options.TemperatureOrScene = None,
    tolerance: options.Tolerance = 0.01,
    seeds: options.Seeds = 4,
    sides: options.Sides = None,
    variants: options.Variants = None,
    settings: options.Settings = None,
    parameters: options.Parameters = None,
    scene_unit: options.SceneUnit = None,
    columns: options.Columns = None,
    again: options.Again = False,
    as_json: options.Json = False,
) -> None:
    """Error against run time of SCENE, of the render and of the sensor, and the setting to take.

    Samplers, sizes of passes, variants, bands, and what is done about the render's noise, against a reference of known
    error; engines, precisions, samplers of the Poisson law and plans of the sensor. Small pictures do (-D width=48).
    """
    from ..study.error_time import error_time as measured

    words = {
        "tolerance": tolerance,
        "seeds": seeds,
        "sides": tuple(sides or ("render", "sensor")),
        "variants": variants,
    }
    subject = _subject(scene, camera, (exposure_s, temperature_k), settings, parameters, (variants or [None])[0])
    given = {**words, "parameters": subject.parameters, "scene_unit": scene_unit, "columns": columns}
    run = lambda done, progress: measured(  # noqa: E731
        scene, subject.camera, subject.exposure, **given, done=done, progress=progress
    )
    _tell(_measured(out_dir, run, subject.question("error-time", given), again), out_dir, as_json)


@study.command("left-out", epilog="Example: mitsuba-sensor study left-out scenes/still_life.xml --exposure-s 0.001")
def left_out(
    scene: options.Scene,
    out_dir: options.StudyOut = Path("study/left-out"),
    camera: options.CameraOrScene = None,
    exposure_s: options.ExposureOrScene = None,
    temperature_k: options.TemperatureOrScene = None,
    tolerance_dn: options.PlanDn = 0.02,
    frames: options.StudyFrames = None,
    spp: options.Samples = None,
    seed: options.SeedOrScene = None,
    serial: options.SerialOrScene = None,
    settings: options.Settings = None,
    parameters: options.Parameters = None,
    scene_unit: options.SceneUnit = None,
    columns: options.Columns = None,
    variant: options.Variant = None,
    again: options.Again = False,
    as_json: options.Json = False,
) -> None:
    """What each stage of the sensor and each feature of the render does to SCENE, and what leaving it out would save.

    Every change is predicted from theory and measured on frames; the two must agree within three standard errors.
    """
    from ..core.checks import first_given
    from ..study.left_out import left_out as measured

    subject = _subject(scene, camera, (exposure_s, temperature_k), settings, parameters, variant)
    asked = {name: value for name, value in (("spp", spp), ("frames", frames)) if value is not None}
    given: dict[str, Any] = {
        "tolerance_dn": tolerance_dn, "seed": first_given(seed, subject.seed, 1),
        "serial": first_given(serial, subject.serial, 1), "parameters": subject.parameters, "variant": variant,
        "scene_unit": scene_unit, "columns": columns, **asked,
    }  # fmt: skip
    run = lambda done, progress: measured(  # noqa: E731
        scene, subject.camera, subject.exposure, **given, done=done, progress=progress
    )
    _tell(_measured(out_dir, run, subject.question("left-out", given), again), out_dir, as_json)


@study.command(epilog="Example: mitsuba-sensor study extremes -o study/extremes")
def extremes(out_dir: options.StudyOut = Path("study/extremes"), as_json: options.Json = False) -> None:
    """Stiff and extreme cases of every stage on every engine: input, expected, got, verdict; and condition numbers."""
    from ..study.extremes import extremes as measured

    _tell(_measured(out_dir, lambda done, progress: measured(progress=progress), None, False), out_dir, as_json)


@dataclass(frozen=True, eq=False)
class Subject:
    """What a study is about."""

    scene: Path
    camera: ms.Camera
    exposure: ms.Exposure
    parameters: dict[str, str]
    sha256: str
    seed: int | None
    serial: int | None

    def question(self, name: str, words: dict[str, Any]) -> dict[str, Any]:
        """All that decides what is measured."""
        camera = self.camera.model_dump()
        return {
            "study": name, "scene": str(self.scene), "scene_sha256": self.sha256, "camera": camera,
            "exposure": asdict(self.exposure), **words, "machine": machine(), "versions": versions(),
        }  # fmt: skip


def _subject(
    scene: Path, camera: str | None, exposure: tuple[float | None, float | None], settings: list[str] | None,
    parameters: list[str] | None, variant: str | None,
) -> Subject:  # fmt: skip
    """The scene with the camera and exposure that are asked for, or that it names itself."""
    from ..render.scene_file import parse_scene

    given = options.pairs("-D", parameters)
    setup = scene_setup(scene, given, variant)
    sha256 = parse_scene(scene, given).digest()
    chosen, shot = scene_camera(camera, setup, settings), scene_exposure(*exposure, setup)
    return Subject(scene, chosen, shot, given, sha256, setup.seed, setup.serial)


def _measured(
    out_dir: Path, run: Callable[[Any, Progress], Study], question: dict[str, Any] | None, again: bool
) -> Study:
    """Run the study and write what it found; what was measured stays, even if the rest is stopped."""
    started = time.monotonic()
    done: Any = {} if question is None else Journal(out_dir / JOURNAL, question, again)
    before = len(done)
    with seconds_bar(err) as progress, _kept(done, out_dir):
        found = run(done, progress)
    made = {
        "command": _command(sys.argv[1:]), "machine": machine(), "versions": versions(),
        "seconds": round(done.get(SPENT, time.monotonic() - started), 1), "resumed_measurements": before,
    }  # fmt: skip
    found = replace(found, data={**found.data, **made})
    picture = next((part for part in found.parts if isinstance(part, Plot | Bars | Grid)), None)
    with files.output_folder(out_dir, (PAGE, NUMBERS, f"{found.name}.png")) as folder:
        files.write_page(folder / PAGE, html(found))
        files.write_json(folder / NUMBERS, found.to_dict())
        if picture is not None:
            from ..study.plots import png

            files.write_drawing(folder / f"{found.name}.png", png(picture))
    return found


@contextmanager
def _kept(done: Any, out_dir: Path) -> Iterator[None]:
    """Add up the seconds of whatever measures something; tell those who stop a study that it need not begin again."""
    started, before = time.monotonic(), len(done)
    try:
        yield
    except KeyboardInterrupt:
        if len(done) > before:
            words = f"{len(done)} measurements are kept in {out_dir / JOURNAL}; the same command goes on from there"
            err.print(words, highlight=False)
        raise
    finally:
        if len(done) > before:
            done[SPENT] = done.get(SPENT, 0.0) + time.monotonic() - started


def _command(words: Sequence[str]) -> str:
    """What was asked, without where its answer went."""
    kept, left = ["mitsuba-sensor"], iter(words)
    for word in left:
        if word in ("-o", "--out"):
            next(left, None)
        elif word not in ("--json", "--force"):
            kept.append(word)
    return shlex.join(kept)


def _tell(found: Study, out_dir: Path, as_json: bool) -> None:
    show(found.to_dict() if as_json else sheet(found, str(out_dir / PAGE)), as_json)
    if not found.passed:
        raise typer.Exit(1)
