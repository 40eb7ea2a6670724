"""Commands of study: error against run time, what can be left out, stiff and extreme cases, and the paper's figures."""

import shlex
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..core import first_given
from ..core.options import complete, part_of
from ..core.stopping import remark_if_stopped
from ..core.versions import machine, versions
from ..files import texts
from ..files.appearing import output_folder, require_folder, write_drawing
from ..output.measurements import Measurements
from ..render.options import SceneOptions
from ..sensor.metering import Metering
from . import arguments, options
from .app import CHECKS, RenderInput, app, err, out, render_input, show
from .options import AblationFlags, Flag, Flags, StudyFlags, WorkPrecisionFlags
from .study_sheet import study_sheet
from .terminal import seconds_bar

if TYPE_CHECKING:
    from ..study.kit import Kit, Subject
    from ..study.page import Study

PAGE, NUMBERS, MEASUREMENTS = "study.html", "study.json", "measurements"

study = typer.Typer(
    no_args_is_help=True,
    help="How good the numbers are, what they cost, and what could be left out: tables, plots and a page.\n\n"
    "Each writes study.html (a page that needs nothing else), study.json and a PNG of its first plot; paper of every "
    "plot. One that was stopped goes on where it was when the same command is given again. Exit code 1: something that "
    "must hold fails.",
)
app.add_typer(study, name="study", rich_help_panel=CHECKS)


@study.command(
    "work-precision", epilog="Example: mitsuba-sensor study work-precision scenes/step_wedge.xml --side sensor"
)
@options.flags(options.CameraFlags, SceneOptions, WorkPrecisionFlags, StudyFlags, without=("motion", "variant"))
def work_precision(scene: arguments.Scene, **flags: Flag) -> None:
    """Error against run time of SCENE, of the render and of the sensor, and the setting to take.

    Samplers, sizes of passes, variants, bands, and what is done about the render's noise, against a reference of known
    error; engines, precisions, samplers of the Poisson law and plans of the sensor. Small pictures do (-D width=48).
    """
    from ..study.work_precision import RECORDS, SIDES
    from ..study.work_precision import work_precision as measured

    asked: dict[str, Flag] = dict(complete(WorkPrecisionFlags, part_of(WorkPrecisionFlags, flags)))
    sides = tuple(asked.pop("sides") or SIDES)
    found, _ = render_input(scene, {**flags, "variant": next(iter(asked["variants"] or ()), None)})
    subject, question = _subject(scene, found, flags)
    measure = partial(measured, subject=subject, sides=sides, **asked)
    _run("work-precision", flags, {**question, **asked}, measure, RECORDS)


@study.command("ablation", epilog="Example: mitsuba-sensor study ablation scenes/still_life.xml --exposure-s 0.001")
@options.flags(options.CameraFlags, SceneOptions, AblationFlags, StudyFlags, without=("motion",))
def ablation(scene: arguments.Scene, **flags: Flag) -> None:
    """What each stage of the sensor and each feature of the render does to SCENE, and what leaving it out would save.

    Every change is predicted from theory and measured on frames; the two must agree within three standard errors.
    """
    from ..study.ablation import ablation as measured

    asked: dict[str, Flag] = dict(complete(AblationFlags, part_of(AblationFlags, flags)))
    found, _ = render_input(scene, flags)
    asked |= {name: first_given(asked[name], getattr(found.scene.settings, name), 1) for name in ("seed", "serial")}
    subject, question = _subject(scene, found, flags, spp=asked.pop("spp"), variant=flags["variant"])
    _run("ablation", flags, {**question, **asked}, partial(measured, subject=subject, **asked))


@study.command("stress", epilog="Example: mitsuba-sensor study stress -o study/stress")
@options.flags(StudyFlags)
def stress(**flags: Flag) -> None:
    """Stiff and extreme cases of every stage on every engine: input, expected, got, verdict; and condition numbers."""
    from ..study.stress import RECORDS
    from ..study.stress import stress as measured

    _run("stress", flags, {}, measured, RECORDS)


@study.command("paper", epilog="Example: mitsuba-sensor study paper -o study/paper")
@options.flags(StudyFlags)
def paper(**flags: Flag) -> None:
    """Every table and figure of section 4 of Konnik & Welsh 2014 for Table 1's camera, beside what is printed.

    Radiometric function, photon transfer, SNR, PRNU, spectrograms and non-whiteness, dark signal with fits; linear and
    with the paper's curves; closed forms that must hold; a sentence wherever the text cannot be met. A few minutes.
    """
    from ..study.paper import RECORDS
    from ..study.paper import paper as measured

    _run("paper", flags, {}, measured, RECORDS, every_picture=True)


def _subject(scene: str, found: RenderInput, flags: Flags, **more: Flag) -> "tuple[Subject, dict[str, Flag]]":
    """What a study of a scene is about, and all that decides what is measured of it. more : options of the render."""
    from ..render.passes.prepared import prepare
    from ..study.kit import Subject

    parameters = flags["parameters"] or {}
    same = {name: flags[name] for name in ("scene_unit", "width", "integrator", "ignore_polarization")}
    render = {"parameters": parameters, **same, **more}
    about = {"scene": str(scene), "scene_sha256": found.scene.file.digest()}
    exposure = found.exposure
    if isinstance(exposure, Metering):
        exposure = prepare(scene, found.camera, exposure, **render).metered_first().exposure
    question = {**about, "camera": found.camera.model_dump(), "exposure": asdict(exposure), "render": render}
    return Subject(scene, found.camera, exposure, render), question


def _run(
    name: str,
    flags: Flags,
    question: dict[str, Flag],
    measure: "Callable[[Kit], Study]",
    records: tuple[type, ...] = (),
    every_picture: bool = False,
) -> None:
    """Run the study and write what it found; what was measured stays, even if the rest is stopped.

    records : classes that its measurements consist of.
    """
    from ..study.html_page import html
    from ..study.kit import Kit
    from ..study.page import Table, png

    out_dir, made = first_given(flags["out"], f"study/{name}"), {"machine": machine(), "versions": versions()}
    require_folder(out_dir)
    folder = Path(out_dir)
    asked_for = {"study": name, **question, **made}
    known = Measurements(folder / MEASUREMENTS, asked_for, flags["force"], records)
    about = {"scene": question["scene"], "camera": question["camera"]["name"]} if question else {}
    pairs, where = zip(sys.argv, sys.argv[1:], strict=False), ("-o", "--out")  # the command is without these
    asked = [one for before, one in pairs if one not in (*where, "--json", "--force") and before not in where]
    about |= {"command": shlex.join(["mitsuba-sensor", *asked]), **made, "resumed_measurements": len(known)}
    about |= {"exposure": question["exposure"]} if question else {}
    remark_if_stopped(partial(_kept, known))
    with seconds_bar(err) as progress:
        kit = Kit(known, progress)
        found = measure(kit)
    found = replace(found, data={**found.data, **about, "seconds": round(kit.seconds, 1)})
    pictures = [part for part in found.parts if not isinstance(part, Table)][: None if every_picture else 1]
    named = {f"{name}-{k}.png" if k > 1 else f"{name}.png": one for k, one in enumerate(pictures, start=1)}
    with output_folder(folder, [*dict.fromkeys((PAGE, NUMBERS, f"{name}.png", *named))]) as scratch:
        texts.write_page(scratch / PAGE, html(found))
        texts.write_json(scratch / NUMBERS, found.to_dict())
        for file, picture in named.items():
            write_drawing(scratch / file, png(picture))
    show(found.to_dict() if flags["as_json"] else study_sheet(found, str(folder / PAGE), out.width), flags["as_json"])
    if not found.passed:
        raise typer.Exit(1)


def _kept(known: Measurements) -> str | None:
    """What a stopped study leaves."""
    n = len(known)
    which = "1 measurement is" if n == 1 else f"{n} measurements are"
    return f"{which} kept in {known.folder}; the same command goes on from there" if n else None
