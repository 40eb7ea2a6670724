"""Commands of study: error against run time, what can be left out, and stiff and extreme cases; and how they report."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Annotated, TypedDict

import typer
from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from ..core import first_given, require_seed
from ..core.options import Option, complete, part_of
from ..io import files
from ..io.measurements import Measurements
from ..io.metadata import machine, versions
from ..render.options import SceneOptions
from ..render.passes import MOST_IN_ALL
from ..study.kit import Kit, Subject
from ..study.page import Grid, Study, Table, html, png, text
from . import options
from .app import RenderInput, app, err, out, render_input, show
from .options import Flag, Flags
from .terminal import columns_table

Texts = list[str]
PAGE, NUMBERS, MEASUREMENTS = "study.html", "study.json", "measurements"
STYLES = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}  # of a mark
LONGEST = 48  # rows of a table that a terminal still shows; of a longer one only those that are not as they must be

study = typer.Typer(
    no_args_is_help=True,
    help="How good the numbers are, what they cost, and what could be left out: tables, plots and a page.\n\n"
    "Each writes study.html (a page that needs nothing else), study.json and a PNG of its first plot. One that was "
    "stopped goes on where it was when the same command is given again. Exit code 1: something that must hold fails.",
)
app.add_typer(study, name="study")


class StudyFlags(TypedDict, total=False):
    """Flags of every study."""

    out: Annotated[
        Path | None,
        Option("Folder for the page. Default: study/ and the study's name.", flag="-o --out", metavar="DIR"),
    ]
    force: Annotated[bool, Option("Measure again what the folder holds already.", False, flag="--force")]
    as_json: Annotated[bool, Option("Only JSON on stdout, for programs.", False, flag="--json")]


class WorkPrecisionFlags(TypedDict, total=False):
    """Flags of ``study work-precision``."""

    tolerance: Annotated[
        float, Option("Relative error of a pixel's irradiance for which a setting is recommended.", 0.01)
    ]
    seeds: Annotated[
        int, Option("Independent runs of each setting; their spread makes the intervals.", 4, low=2, example="4")
    ]
    sides: Annotated[
        Texts | None, Option("render or sensor: only this half. Repeatable. Default: both.", flag="--side", text=Texts)
    ]
    variants: Annotated[
        Texts | None,
        Option("A Mitsuba variant to compare. Repeatable. Default: all that work.", flag="--variant", text=Texts),
    ]


class AblationFlags(TypedDict, total=False):
    """Flags of ``study ablation``."""

    tolerance_dn: Annotated[float, Option("Of the plan that is put to the test, in DN.", 0.02)]
    frames: Annotated[int, Option("Frames of each of the 64 cameras that are measured.", 24, low=2, example="24")]
    spp: Annotated[int, Option("Samples per pixel of every render.", 32, low=1, high=MOST_IN_ALL, example="32")]
    seed: Annotated[int | None, Option("Of the first frame. Default: the scene file's, else 1.", check=require_seed)]
    serial: Annotated[int | None, Option("Of the first camera. Default: the scene file's, else 1.", check=require_seed)]


@study.command(
    "work-precision", epilog="Example: mitsuba-sensor study work-precision scenes/step_wedge.xml --side sensor"
)
@options.flags(options.CameraFlags, SceneOptions, WorkPrecisionFlags, StudyFlags, without=("motion", "variant"))
def work_precision(scene: options.Scene, **flags: Flag) -> None:
    """Error against run time of SCENE, of the render and of the sensor, and the setting to take.

    Samplers, sizes of passes, variants, bands, and what is done about the render's noise, against a reference of known
    error; engines, precisions, samplers of the Poisson law and plans of the sensor. Small pictures do (-D width=48).
    """
    from ..study.work_precision import SIDES
    from ..study.work_precision import work_precision as measured

    asked: dict[str, Flag] = dict(complete(WorkPrecisionFlags, part_of(WorkPrecisionFlags, flags)))
    sides = tuple(asked.pop("sides") or SIDES)
    found, _ = render_input(scene, {**flags, "variant": next(iter(asked["variants"] or ()), None)})
    subject, question = _subject(scene, found, flags)
    _run("work-precision", flags, {**question, **asked}, partial(measured, subject=subject, sides=sides, **asked))


@study.command("ablation", epilog="Example: mitsuba-sensor study ablation scenes/still_life.xml --exposure-s 0.001")
@options.flags(options.CameraFlags, SceneOptions, AblationFlags, StudyFlags, without=("motion",))
def ablation(scene: options.Scene, **flags: Flag) -> None:
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
    from ..study.stress import stress as measured

    _run("stress", flags, {}, measured)


def _subject(scene: Path, found: RenderInput, flags: Flags, **more: Flag) -> tuple[Subject, dict[str, Flag]]:
    """What a study of a scene is about, and all that decides what is measured of it. more : options of the render."""
    parameters = flags["parameters"] or {}
    render = {"parameters": parameters, "scene_unit": flags["scene_unit"], "width": flags["width"], **more}
    about = {"scene": str(scene), "scene_sha256": found.scene.file.digest()}
    question = {**about, "camera": found.camera.model_dump(), "exposure": asdict(found.exposure), "render": render}
    return Subject(scene, found.camera, found.exposure, render), question


def _run(name: str, flags: Flags, question: dict[str, Flag], measure: Callable[[Kit], Study]) -> None:
    """Run the study and write what it found; what was measured stays, even if the rest is stopped."""
    folder, made = flags["out"] or Path("study") / name, {"machine": machine(), "versions": versions()}
    known = Measurements(folder / MEASUREMENTS, {"study": name, **question, **made}, flags["force"])
    about = {"scene": question["scene"], "camera": question["camera"]["name"]} if question else {}
    pairs, where = zip(sys.argv, sys.argv[1:], strict=False), ("-o", "--out")  # the command is without these
    asked = [one for before, one in pairs if one not in (*where, "--json", "--force") and before not in where]
    about |= {"command": shlex.join(["mitsuba-sensor", *asked]), **made, "resumed_measurements": len(known)}
    about |= {"exposure": question["exposure"]} if question else {}
    with seconds_bar(err) as progress:
        kit = Kit(known, progress)
        try:
            found = measure(kit)
        except KeyboardInterrupt:
            if kit.new:
                kept = f"{len(known)} measurements are kept in {known.folder}; the same command goes on from there"
                err.print(kept, highlight=False, soft_wrap=True)
            raise
    found = replace(found, data={**found.data, **about, "seconds": round(kit.seconds, 1)})
    with files.output_folder(folder, (PAGE, NUMBERS, f"{name}.png")) as scratch:
        files.write_page(scratch / PAGE, html(found))
        files.write_json(scratch / NUMBERS, found.to_dict())
        for picture in [part for part in found.parts if not isinstance(part, Table)][:1]:
            files.write_drawing(scratch / f"{name}.png", png(picture))
    show(found.to_dict() if flags["as_json"] else sheet(found, str(folder / PAGE), out.width), flags["as_json"])
    if not found.passed:
        raise typer.Exit(1)


@contextmanager
def seconds_bar(console: Console) -> Iterator[Callable[[float, float, str], None]]:
    """A bar over the seconds that a study expects to take, and what it does now. Yields what a kit reports to."""
    texts = TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(BarColumn(), *texts, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None)

        def tell(done_s: float, expected_s: float, now: str) -> None:
            left_s = max(expected_s - done_s, 0.0)
            left = f"about {left_s / 60:.0f} min" if left_s > 90 else f"about {left_s:.0f} s"
            if progress.tasks[task].total is None:
                console.print(f"this takes {left}", highlight=False)
            progress.update(task, completed=done_s, total=expected_s, description=f"{left} left [dim]{now}")

        yield tell


def sheet(found: Study, page: str, width: int) -> RenderableType:
    """The whole study in the terminal, its findings and as much of its tables as fits into so many characters."""
    verdict = ("everything that must hold does", "bold green") if found.passed else ("not all holds", "bold red")
    lines: list[RenderableType] = [Text.assemble((found.title, "bold"), " – ", verdict, " → ", (page, "bold"))]
    lines += (Text(f"• {finding}") for finding in found.findings)
    for part in found.parts:
        if isinstance(part, Grid):
            drawn = columns_table("", *part.columns)
            drawn.title, drawn.title_justify, drawn.title_style = part.title, "left", "bold"
            for name, marks, texts in zip(part.rows, part.marks, part.texts, strict=True):
                drawn.add_row(name, *(Text(cell, STYLES[mark]) for cell, mark in zip(texts, marks, strict=True)))
            lines.append(drawn)
        elif isinstance(part, Table) and part.rows:
            held = Text(f"{part.title}: all {len(part.rows)} rows as they must be")
            lines += [held] if set(part.marks) == {"good"} else _table(part, width)
    return Group(*lines)


def _table(table: Table, width: int) -> Iterator[RenderableType]:
    """As many of its columns, from the left, as fit, and what of it stands only in the page."""
    rows = list(zip(table.marks or ("",) * len(table.rows), table.rows, strict=True))
    shown = rows if len(rows) <= LONGEST else [row for row in rows if row[0] in ("bad", "best")][:LONGEST]
    cells = [[f"{v:.3g}" if isinstance(v, float) else text(v) for v in row] for _, row in shown]
    columns = zip(table.columns, zip(*cells, strict=True) if cells else [()] * len(table.columns), strict=True)
    longest = (max(map(len, (*heading.split(), "", *column))) for heading, column in columns)  # they break at spaces
    count = max(sum(used <= width for used in accumulate(min(one, 30) + 2 for one in longest)), 1)
    drawn = columns_table(*table.columns[:count])
    for index, column in enumerate(drawn.columns):
        if shown and all(isinstance(row[index], int | float | None) for _, row in shown):
            column.justify = "right"
    for (mark, _), texts in zip(shown, cells, strict=True):
        drawn.add_row(*map(Text, texts[:count]), style=STYLES[mark])
    yield from (Text(f"\n{table.title}", style="bold"), drawn)
    hidden = {"rows": len(rows) - len(shown), "columns": len(table.columns) - count}
    if more := " and ".join(f"{number} more {name}" for name, number in hidden.items() if number):
        yield Text(f"{more} stand in the page", style="dim")
