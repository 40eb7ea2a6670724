"""Commands of dataset: plan, run, show, status, verify, export and unpack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.text import Text

from ..core.progress import duration
from ..dataset.exports.formats import FORMATS, ExportOptions
from ..dataset.options import RootOptions, RunOptions
from . import arguments, options
from .app import app, err, show
from .completion import one_of, shell_files
from .help import Command, Group
from .progress import samples_bar, steps_bar
from .tables import ResultTable, rough
from .values import Flag

if TYPE_CHECKING:
    from ..dataset.checks import Counts
    from ..dataset.forecast import Forecast
    from ..dataset.plan import DatasetPlan
    from ..dataset.run import Failure, RunProgress
    from ..dataset.table import Fault

READ_FIRST = {
    "contact_sheet.png": "some of the frames, to look at",
    "README.md": "what is in the folder, and how to read it",
    "samples.csv": "a line for each sample",
}
"""Files of a dataset for people."""

MOST_SHOWN = 50
"""Faults in the table of `dataset verify`."""
WRITE_ONE = "--picture FILE.png writes one"
NOT_DENOISED = (
    "Renders are not denoised unless `[render]` has `denoise = true`: what a denoiser leaves is alike in neighbouring "
    "pixels, which training could learn."
)

dataset = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="Raw frames by the thousand, each with its clean frame, depth and normals, from one TOML file.\n\n"
    "A run that was stopped, killed or out of disk goes on when the same command is given again. Exit code 1: some "
    "samples could not be made, or are not as they were written; 3: the disk is full.",
)
app.add_typer(dataset, name="dataset")

DatasetToml = Annotated[
    str,
    typer.Argument(metavar="FILE.toml", help="The dataset file.", autocompletion=shell_files),
]
CountOnly = Annotated[
    bool,
    typer.Option(
        "--count-only",
        help="Count and check only; nothing is rendered.",
        rich_help_panel=arguments.OUTPUT,
    ),
]
DatasetFolder = Annotated[
    str,
    typer.Argument(
        metavar="DIR", help="Folder that `dataset run` made.", autocompletion=shell_files
    ),
]
SampleCalled = Annotated[
    str,
    typer.Argument(
        metavar="SAMPLE",
        help="Its number in the dataset, from 0, or the beginning of its key.",
    ),
]
PictureFile = Annotated[
    str | None,
    typer.Option(
        "--picture",
        metavar="FILE.png",
        help="Write its picture there, developed from the raw frame where the dataset stores none.",
        rich_help_panel=arguments.OUTPUT,
        autocompletion=shell_files,
    ),
]
RemovesDamage = Annotated[
    bool,
    typer.Option(
        "--remove",
        help="Remove what is not as it was written; `dataset run` makes it again.",
        rich_help_panel=arguments.OUTPUT,
    ),
]
ExportFormat = Annotated[
    str,
    typer.Argument(
        metavar="FORMAT",
        help=f"{'; '.join(f'{row.name}: {row.contents}' for row in FORMATS)}.",
        autocompletion=one_of(row.name for row in FORMATS),
    ),
]


@dataset.command(
    "run",
    cls=Command,
    epilog="Example: mitsuba-sensor dataset run examples/low_light_pairs.toml -o pairs/",
)
@options.flags(
    RootOptions, RunOptions, first=("out_dir", "as_json", "roots", "workers", "retry")
)
def run_command(
    file: DatasetToml,
    out_dir: arguments.Out,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Make everything of a dataset that DIR does not have yet.

    A light and all its samples appear whole or not at all, whatever happens; the same command goes on after a stop.
    What cannot be made is a line in DIR/failed.jsonl, and the rest is made. README.md in DIR says what is there and how
    to read it, contact_sheet.png shows some of the frames.
    """
    from ..dataset.plan import load_plan
    from ..dataset.run import run

    plan = load_plan(file, flags.pop("roots") or ["."], flags.pop("untrusted"))
    with samples_bar(err) as progress:
        found = run(plan, out_dir, progress=progress, **flags)
    show(_summary(found) if as_json else run_sheet(plan, found, out_dir), as_json)
    if found.failed:
        raise typer.Exit(1)


@dataset.command(
    "plan",
    cls=Command,
    epilog="Example: mitsuba-sensor dataset plan examples/low_light_pairs.toml",
)
@options.flags(RootOptions)
def plan_command(
    file: DatasetToml,
    count_only: CountOnly = False,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Say how many renders and samples a dataset has, and what disk and time it will take. Writes nothing.

    Values, cameras and files of every sample are checked; one short render on this machine tells the time, the bytes
    and the render noise.
    """
    from ..dataset.checks import check_scenes, checked_counts
    from ..dataset.forecast import forecast
    from ..dataset.plan import load_plan

    plan = load_plan(file, flags["roots"] or ["."], flags["untrusted"])
    with steps_bar(err) as now:
        now(0, 1, "counting")
        counts = checked_counts(plan)
        check_scenes(plan)
        now(0, 1, "a short render")
        found = None if count_only else forecast(plan, counts)
    facts = asdict(counts) | ({"forecast": asdict(found)} if found else {})
    show(facts if as_json else plan_sheet(plan, counts, found), as_json)


@dataset.command(
    "show",
    cls=Command,
    epilog="Example: mitsuba-sensor dataset show pairs/ 3 --picture three.png",
)
def show_command(
    folder: DatasetFolder,
    sample: SampleCalled,
    picture: PictureFile = None,
    as_json: arguments.Json = False,
) -> None:
    """Say what one sample is: its settings, signal and noise, its files, and where its picture is."""
    from ..dataset.read import Dataset
    from ..files.png import write_png
    from .sample_sheet import sample_facts, sample_sheet

    samples = Dataset(folder)
    place = samples.place_of(sample)
    facts = {**sample_facts(samples, place, samples[place]), "picture": picture}
    if picture is not None:
        write_png(Path(picture), samples[place].read("preview"))
    where = picture or f"in the shard; {WRITE_ONE}"
    show(facts if as_json else sample_sheet(facts, where), as_json)


@dataset.command("status", cls=Command, epilog="Example: mitsuba-sensor dataset status pairs/")
def status_command(folder: DatasetFolder, as_json: arguments.Json = False) -> None:
    """Say how much of a dataset is there, and what could not be made. Reads no pictures."""
    from ..dataset.file import read_dataset_text
    from ..dataset.run import read_failures
    from ..dataset.store import Store
    from ..dataset.table import Table

    store = Store(folder)
    record, table = store.require_record(), Table(store)
    failures, name = read_failures(store), read_dataset_text(record.text).name
    facts = {
        "name": name,
        "there": len(table),
        "samples": record.samples,
        "bytes": store.size(),
        "failed": [failure.model_dump() for failure in failures.values()],
    }
    head = f"{name}: {len(table)} of {record.samples} samples, {store.size() / 1e6:.3g} MB"
    show(facts if as_json else _with_failed(head, [*failures.values()]), as_json)


@dataset.command("verify", cls=Command, epilog="Example: mitsuba-sensor dataset verify pairs/")
def verify_command(
    folder: DatasetFolder, removes: RemovesDamage = False, as_json: arguments.Json = False
) -> None:
    """Read every file of a dataset, and say what is not as it was written. Exit code 1 if anything is not."""
    from ..dataset.store import Store
    from ..dataset.table import remove_faults, verify

    store = Store(folder)
    with steps_bar(err) as now:
        faults = verify(store, lambda done, total: now(done, total, "shards"))
    if removes:
        remove_faults(store, faults)
    facts = [fault._asdict() for fault in faults]
    show(facts if as_json else fault_sheet(folder, faults, removes), as_json)
    if any(fault.is_damage for fault in faults):
        raise typer.Exit(1)


@dataset.command(
    "export",
    cls=Command,
    epilog="Example: mitsuba-sensor dataset export webdataset pairs/ -o shards/",
)
@options.flags(
    ExportOptions,
    first=("out_dir", "as_json", "split", "arrays", "images", "incomplete", "force"),
)
def export_command(
    format: ExportFormat,
    folder: DatasetFolder,
    out_dir: arguments.Out,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Write a dataset as the files of another program, with a card: README.md with counts, noise and licence.

    The folder appears whole or not at all; files.json in it has the size and SHA-256 of each file.
    """
    _export(format, folder, out_dir, as_json, flags)


@dataset.command(
    "unpack", cls=Command, epilog="Example: mitsuba-sensor dataset unpack pairs/ -o out/"
)
@options.flags(ExportOptions, without=("arrays", "images", "shard_mb", "licence"))
def unpack_command(
    folder: DatasetFolder,
    out_dir: arguments.Out,
    as_json: arguments.Json = False,
    **flags: Flag,
) -> None:
    """Write the files of each sample into a folder of its own: frames, pictures and JSON, as `export files` does."""
    _export("files", folder, out_dir, as_json, flags)


def _export(
    format: str, folder: str, out_dir: str, as_json: bool, flags: Mapping[str, Any]
) -> None:
    from ..dataset.exports.export import export

    with steps_bar(err) as now:
        exported = export(
            folder,
            format,
            out_dir,
            progress=lambda done, total: now(done, total, "samples"),
            **flags,
        )
    found = {**exported._asdict(), "format": format, "folder": out_dir}
    head = f"{Path(out_dir)}: {exported.samples} samples as {format}; README.md there says how to read them"
    show(found if as_json else "\n".join([head, *exported.remarks]), as_json)


def run_sheet(plan: DatasetPlan, found: RunProgress, folder: str) -> RenderableType:
    """What a run made, and what it could not."""
    head = Text.assemble(
        (plan.file.name, "bold"),
        f": {found.made} samples made, {found.there} were there already → ",
        folder,
    )
    for name, what in READ_FIRST.items():
        if (Path(folder) / name).is_file():
            head.append(f"\n{Path(folder) / name}: {what}")
    for sentence in (found.render_noise, *found.remarks):
        head.append(f"\n{sentence}" if sentence else "")
    return _with_failed(head, found.failed)


def plan_sheet(plan: DatasetPlan, counts: Counts, found: Forecast | None) -> RenderableType:
    """A line for each scene, and the sums."""
    from ..dataset.card import LESS_RENDER_NOISE, VISIBLE_RATIO

    table = ResultTable(("scene", "renders", "samples"))
    for scene, (renders, samples) in counts.by_scene.items():
        table.add_row(scene, str(renders), str(samples))
    renders = sum(several for several, _ in counts.by_scene.values())
    splits = ", ".join(f"{name} {n}" for name, n in counts.by_split.items() if name)
    head = (
        f"{plan.file.name}: {counts.samples} samples of {renders} render{'s' * (renders != 1)}"
        f"{f' ({splits})' if splits else ''}"
    )
    below = []
    if found is not None:
        below = [
            f"about {duration(found.seconds)} and {found.bytes / 1e6:.3g} MB on this machine, if all scenes are like "
            f"{found.scene}: {rough(found.render_s)} s a render, {rough(found.sample_s)} s and "
            f"{rough(found.sample_bytes / 1e6)} MB a sample",
            f"render noise {rough(found.noise_ratio)}: the variance of the render over that of the sensor, in the "
            f"median pixel; above {VISIBLE_RATIO} it is seen in the frames",
        ]
        if found.noise_ratio > VISIBLE_RATIO:
            below.append(LESS_RENDER_NOISE)
    if not plan.file.render.get("denoise"):
        below.append(NOT_DENOISED)
    return Lines(Text(head, style="bold"), table, *map(Text, below))


def fault_sheet(folder: str, faults: Sequence[Fault], removed: bool) -> RenderableType:
    """What is not as it was written, file by file, and what to do."""
    damaged = [fault for fault in faults if fault.is_damage]
    if not faults:
        return f"{folder}: every file is as it was written"
    table = ResultTable(("file", "what is wrong"))
    for fault in faults[:MOST_SHOWN]:
        table.add_row(fault.file, fault.what)
    more = f" (the first {MOST_SHOWN} are shown)" if len(faults) > MOST_SHOWN else ""
    head = f"{folder}: {len(damaged)} files are not as they were written{more}"
    below = "`mitsuba-sensor dataset run` with the dataset file makes again what is missing."
    if damaged and not removed:
        below = (
            f"`mitsuba-sensor dataset verify {folder} --remove` removes them, and then {below}"
        )
    return Lines(Text(head, style="bold"), table, Text(below if damaged else ""))


def _with_failed(head: str | Text, failed: Sequence[Failure]) -> RenderableType:
    """A first line, and what could not be made."""
    if not failed:
        return Lines(head)
    table = ResultTable(("scene", "samples", "why they could not be made"))
    for failure in failed:
        table.add_row(failure.scene, str(failure.samples), Text(failure.why))
    return Lines(head, table, Text("--retry tries them again; failed.jsonl has their logs"))


def _summary(found: RunProgress) -> dict[str, object]:
    return {
        "made": found.made,
        "there": found.there,
        "failed": [failure.model_dump() for failure in found.failed],
        "render_noise": found.render_noise,
        "remarks": found.remarks,
    }
