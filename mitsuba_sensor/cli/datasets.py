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
    "contact_sheet.png": "some of the frames",
    "README.md": "what is in the folder, and how to read it",
    "samples.csv": "a line for each sample",
}
"""Files of a dataset for people."""

FAULTS_SHOWN_MAX = 50
"""Faults in the table of `dataset verify`."""
WRITE_ONE = "--picture FILE.png writes one"
NOT_DENOISED = (
    "Renders are not denoised unless `[render]` has `denoise = true`: a denoiser leaves errors that are correlated "
    "between neighbouring pixels, so training could learn them."
)

dataset = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="Raw frames by the thousand, each with its clean frame, depth and normals, from one TOML file.\n\n"
    "To continue a run after a stop, a crash or a full disk, repeat the command. Exit code 1: some samples could not "
    "be made, or have changed since they were written; 3: the disk is full.",
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
        help="Only count and check, without a render.",
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
        help="Write its preview here; it is developed from the raw frame if the dataset stores no preview.",
        rich_help_panel=arguments.OUTPUT,
        autocompletion=shell_files,
    ),
]
RemovesDamage = Annotated[
    bool,
    typer.Option(
        "--remove",
        help="Remove changed files; `dataset run` recreates them.",
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
    """Make every sample of a dataset that DIR lacks.

    A light and all its samples appear whole or not at all; after a stop, the same command continues. A light that
    cannot be made is a line in DIR/failed.jsonl, and the rest is made. README.md in DIR says what is there and how to
    read it; contact_sheet.png shows some of the frames.
    """
    from ..dataset.plan import load_plan
    from ..dataset.run import run

    plan = load_plan(file, flags.pop("roots") or ["."], flags.pop("untrusted"))
    with samples_bar(err) as progress:
        done = run(plan, out_dir, progress=progress, **flags)
    facts = {
        "made": done.made,
        "there": done.there,
        "failed": [failure.model_dump() for failure in done.failed],
        "render_noise": done.render_noise,
        "remarks": done.remarks,
    }
    show(facts if as_json else run_sheet(plan, done, out_dir), as_json)
    if done.failed:
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
    """Count the renders and samples of a dataset, and estimate disk space and time. Writes nothing.

    Checks values, cameras and files of every sample. A short render for each camera on this machine estimates time,
    bytes and render noise.
    """
    from ..dataset.checks import check_scenes, checked_counts
    from ..dataset.forecast import forecast
    from ..dataset.plan import load_plan

    plan = load_plan(file, flags["roots"] or ["."], flags["untrusted"])
    with steps_bar(err) as now:
        now(0, 1, "counting")
        counts = checked_counts(plan)
        check_scenes(plan)
        now(0, 1, "short renders")
        estimate = None if count_only else forecast(plan, counts)
    facts = asdict(counts) | ({"forecast": asdict(estimate)} if estimate else {})
    show(facts if as_json else plan_sheet(plan, counts, estimate), as_json)


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
    """Show the settings, signal, noise and files of one sample."""
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
    """Show how many samples a dataset has, and what could not be made. Reads no images."""
    from ..dataset.file import read_dataset_text
    from ..dataset.run import read_failures
    from ..dataset.store import Store
    from ..dataset.table import Table

    store = Store(folder)
    record, there = store.require_record(), len(Table(store))
    failures, name = [*read_failures(store).values()], read_dataset_text(record.text).name
    size = store.size()
    facts = {
        "name": name,
        "there": there,
        "samples": record.samples,
        "bytes": size,
        "failed": [failure.model_dump() for failure in failures],
    }
    head = f"{name}: {there} of {record.samples} samples, {size / 1e6:.3g} MB"
    show(facts if as_json else _with_failed(head, failures), as_json)


@dataset.command("verify", cls=Command, epilog="Example: mitsuba-sensor dataset verify pairs/")
def verify_command(
    folder: DatasetFolder, removes: RemovesDamage = False, as_json: arguments.Json = False
) -> None:
    """Read every file of a dataset, and list changed files. Exit code 1 if there are any."""
    from ..dataset.store import Store
    from ..dataset.table import remove_faults, verify

    store = Store(folder)
    with steps_bar(err) as now:
        faults = verify(store, lambda done, total: now(done, total, "shards"))
    if removes:
        remove_faults(store, faults)
    facts = [fault._asdict() for fault in faults]
    show(facts if as_json else fault_sheet(folder, faults, removes), as_json)
    if faults:
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
    """Write a dataset as files for another program, with a card: README.md with counts, noise and licence.

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
    """Write the files of each sample into a separate folder: frames, pictures and JSON, as `export files` does."""
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
    facts = {**exported._asdict(), "format": format, "folder": out_dir}
    head = f"{Path(out_dir)}: {exported.samples} samples as {format}; README.md there explains how to read them"
    show(facts if as_json else "\n".join([head, *exported.remarks]), as_json)


def run_sheet(plan: DatasetPlan, done: RunProgress, folder: str) -> RenderableType:
    """Return what a run made, and what it could not make."""
    head = Text.assemble(
        (plan.file.name, "bold"),
        f": {done.made} samples made, {done.there} were there already → ",
        folder,
    )
    for name, what in READ_FIRST.items():
        if (Path(folder) / name).is_file():
            head.append(f"\n{Path(folder) / name}: {what}")
    for sentence in (done.render_noise, *done.remarks):
        head.append(f"\n{sentence}" if sentence else "")
    return _with_failed(head, done.failed)


def plan_sheet(plan: DatasetPlan, counts: Counts, estimate: Forecast | None) -> RenderableType:
    """Return a line for each scene, and the sums."""
    from ..dataset.card import VISIBLE_RATIO, less_render_noise

    table = ResultTable(("scene", "renders", "samples"))
    for scene, (renders, samples) in counts.by_scene.items():
        table.add_row(scene, str(renders), str(samples))
    renders = sum(several for several, _ in counts.by_scene.values())
    splits = ", ".join(f"{name} {n}" for name, n in counts.by_split.items() if name)
    head = (
        f"{plan.file.name}: {_counted(counts.samples, 'sample')} of {_counted(renders, 'render')}"
        f"{f' ({splits})' if splits else ''}"
    )
    below = counts.notes()
    if estimate is not None:
        worst = max(estimate.noise_ratios, key=estimate.noise_ratios.__getitem__)
        of_camera = f" for camera {worst}" if len(estimate.noise_ratios) > 1 else ""
        below += [
            f"about {duration(estimate.seconds)} and {estimate.bytes / 1e6:.3g} MB on this machine, if all scenes are "
            f"like {estimate.scene}: {rough(estimate.render_s)} s a render, {rough(estimate.sample_s)} s and "
            f"{rough(estimate.sample_bytes / 1e6)} MB a sample",
            f"render noise {rough(estimate.noise_ratio)}{of_camera}: the variance of the render over the temporal "
            f"variance of the sensor, in the median pixel; above {VISIBLE_RATIO} it is visible in the frames",
        ]
        if estimate.noise_ratio > VISIBLE_RATIO:
            below.append(f"{less_render_noise(plan.file.render)}.")
    if not plan.file.render.get("denoise"):
        below.append(NOT_DENOISED)
    return Lines(Text(head, style="bold"), table, *map(Text, below))


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def fault_sheet(folder: str, faults: Sequence[Fault], removed: bool) -> RenderableType:
    """Return the changed files, and the remedy."""
    if not faults:
        return f"{folder}: every file is unchanged"
    table = ResultTable(("file", "what is wrong"))
    for fault in faults[:FAULTS_SHOWN_MAX]:
        table.add_row(fault.file, fault.what)
    more = f" (the first {FAULTS_SHOWN_MAX} are shown)" * (len(faults) > FAULTS_SHOWN_MAX)
    head = f"{folder}: {_counted(len(faults), 'damaged file')}{more}"
    below = "`mitsuba-sensor dataset run` with the dataset file recreates missing files."
    if not removed:
        below = f"`mitsuba-sensor dataset verify {folder} --remove` removes damaged files; then {below}"
    return Lines(Text(head, style="bold"), table, Text(below))


def _with_failed(head: str | Text, failed: Sequence[Failure]) -> RenderableType:
    """Return a first line, and what could not be made."""
    if not failed:
        return Lines(head)
    table = ResultTable(("scene", "samples", "why they could not be made"))
    for failure in failed:
        table.add_row(failure.scene, str(failure.samples), Text(failure.why))
    return Lines(head, table, Text("--retry tries them again; failed.jsonl has their logs"))
