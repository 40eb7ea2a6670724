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
from .app import Command, Group, app, err, show
from .arguments import argument, one_of, output
from .options import Flag
from .progress import samples_bar, steps_bar
from .tables import ResultTable, cell, counted, rough

if TYPE_CHECKING:
    from ..dataset.checks import Counts
    from ..dataset.forecast import Forecast
    from ..dataset.plan import DatasetPlan
    from ..dataset.run import Failure, RunProgress
    from ..dataset.table import Fault

READ_FIRST = {
    "contact_sheet.png": "an overview of some frames",
    "README.md": "the contents of the folder and how to read them",
    "samples.csv": "one line for each sample",
}
"""Files of a dataset for people."""
FAULTS_MAX = 50
"""Faults in the table of `dataset verify`."""
NOT_DENOISED = (
    "Renders are not denoised; `denoise = true` in `[render]` changes that, but denoising correlates neighbouring "
    "pixels, which training could learn."
)

dataset = typer.Typer(
    cls=Group,
    no_args_is_help=True,
    help="Make thousands of raw frames with clean frames, depth and normals from one TOML file.\n\n"
    "To continue a run that was stopped or killed or filled the disk, repeat its command. Exit code 1: some samples "
    "failed, or files changed; 3: the disk is full.",
)
app.add_typer(dataset, name="dataset")

DatasetToml = Annotated[str, argument("FILE.toml", "Dataset file.")]
CountOnly = Annotated[
    bool, output("--count-only", help="Only count and check, without a render.")
]
DatasetFolder = Annotated[str, argument("DIR", "Folder that `dataset run` wrote.")]
SampleCalled = Annotated[
    str, argument("SAMPLE", "Number of the sample, from 0, or the start of its key.")
]
PictureFile = Annotated[
    str | None,
    output(
        "--picture",
        metavar="FILE.png",
        help="Also write the sample's preview, developed from the raw frame if the dataset stores no preview.",
    ),
]
RemovesDamage = Annotated[
    bool, output("--remove", help="Remove changed files; `dataset run` then recreates them.")
]
ExportFormat = Annotated[
    str,
    argument(
        "FORMAT",
        f"{'; '.join(f'{row.name}: {row.contents}' for row in FORMATS)}.",
        one_of(row.name for row in FORMATS),
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
    """Make all samples of a dataset that DIR does not contain yet.

    Each render and its samples appear together or not at all; repeat the command to continue after a stop. Failures are
    lines in failed.jsonl and do not stop the run. README.md describes the contents, and contact_sheet.png shows
    some frames.
    """
    from ..dataset.plan import load_plan
    from ..dataset.run import run

    plan = load_plan(file, flags.pop("roots") or ["."], flags.pop("untrusted"))
    with samples_bar(err) as progress:
        done = run(plan, out_dir, progress=progress, **flags)
    facts = {name: getattr(done, name) for name in ("made", "there", "render_noise", "remarks")}
    facts["failed"] = [failure.model_dump() for failure in done.failed]
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
    """Count the renders and samples of a dataset, and estimate its disk space, run time and render noise.

    Checks the values, cameras and files of every sample. The estimates come from a short render for each
    camera on this machine. Writes no files.
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
    """Show one sample: its settings, signal and noise, files and preview."""
    from ..dataset.read import Dataset
    from ..files.png import write_png
    from .summaries import sample_facts

    samples = Dataset(folder)
    place = samples.place_of(sample)
    facts = {**sample_facts(samples, place, samples[place]), "picture": picture}
    if picture is not None:
        write_png(Path(picture), samples[place].read("preview"))
    show(facts, as_json, {name: cell(value) for name, value in facts.items()})


@dataset.command("status", cls=Command, epilog="Example: mitsuba-sensor dataset status pairs/")
def status_command(folder: DatasetFolder, as_json: arguments.Json = False) -> None:
    """Show how many samples a dataset has, and which failed, without reading images."""
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
    head = f"{name}: {there} of {counted(record.samples, 'sample')}, {size / 1e6:.3g} MB"
    show(facts if as_json else _with_failed(head, failures), as_json)


@dataset.command("verify", cls=Command, epilog="Example: mitsuba-sensor dataset verify pairs/")
def verify_command(
    folder: DatasetFolder, removes: RemovesDamage = False, as_json: arguments.Json = False
) -> None:
    """Read every file of a dataset and list the files that changed. Exit code 1 if any file changed."""
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
    """Write a dataset in another program's format, with README.md: counts, noise and licence.

    The folder appears complete or not at all; files.json lists the size and SHA-256 of each file.
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
    """Write the frames, images and JSON of each sample into its own folder, as `export files` does."""
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
    count = counted(exported.samples, "sample")
    head = f"{Path(out_dir)}: {count} as {format}; its README.md explains how to read them"
    show(facts if as_json else "\n".join([head, *exported.remarks]), as_json)


def run_sheet(plan: DatasetPlan, done: RunProgress, folder: str) -> RenderableType:
    """Return the new samples of a run and its failures."""
    head = Text.assemble(
        (plan.file.name, "bold"),
        f": {counted(done.made, 'new sample')}, {done.there} already existed → ",
        folder,
    )
    for name, what in READ_FIRST.items():
        if (Path(folder) / name).is_file():
            head.append(f"\n{Path(folder) / name}: {what}")
    for sentence in (done.render_noise, *done.remarks):
        head.append(f"\n{sentence}" if sentence else "")
    return _with_failed(head, done.failed)


def plan_sheet(plan: DatasetPlan, counts: Counts, estimate: Forecast | None) -> RenderableType:
    """Return one line for each scene, and the totals."""
    from ..dataset.card import VISIBLE_RATIO, less_render_noise

    table = ResultTable(("scene", "renders", "samples"))
    for scene, (renders, samples) in counts.by_scene.items():
        table.add_row(scene, str(renders), str(samples))
    renders = sum(several for several, _ in counts.by_scene.values())
    splits = ", ".join(f"{name} {n}" for name, n in counts.by_split.items() if name)
    head = (
        f"{plan.file.name}: {counted(counts.samples, 'sample')} of {counted(renders, 'render')}"
        f"{f' ({splits})' if splits else ''}"
    )
    below = counts.notes()
    if estimate is not None:
        worst = max(estimate.noise_ratios, key=estimate.noise_ratios.__getitem__)
        of_camera = f" for camera {worst}" if len(estimate.noise_ratios) > 1 else ""
        below += [
            f"about {duration(estimate.seconds)} and {estimate.bytes / 1e6:.3g} MB on this machine, if all scenes are "
            f"like {estimate.scene}: {rough(estimate.render_s)} s per render, {rough(estimate.sample_s)} s and "
            f"{rough(estimate.sample_bytes / 1e6)} MB per sample",
            f"render noise{of_camera}: variance {rough(estimate.noise_ratio)} × the sensor's in the median pixel; "
            f"above {VISIBLE_RATIO} it is visible in the frames",
        ]
        if estimate.noise_ratio > VISIBLE_RATIO:
            below.append(f"{less_render_noise(plan.file.render)}.")
    if not plan.file.render.get("denoise"):
        below.append(NOT_DENOISED)
    return Lines(Text(head, style="bold"), table, *map(Text, below))


def fault_sheet(folder: str, faults: Sequence[Fault], removed: bool) -> RenderableType:
    """Return the changed files and what to do."""
    if not faults:
        return f"{folder}: every file is unchanged"
    table = ResultTable(("file", "problem"))
    for fault in faults[:FAULTS_MAX]:
        table.add_row(fault.file, fault.what)
    more = f" (the first {FAULTS_MAX} are shown)" if len(faults) > FAULTS_MAX else ""
    head = f"{folder}: {counted(len(faults), 'damaged file')}{more}"
    below = "To recreate missing files, run `mitsuba-sensor dataset run` with the dataset file."
    if not removed:
        below = f"To remove damaged files, add --remove. {below}"
    return Lines(Text(head, style="bold"), table, Text(below))


def _with_failed(head: str | Text, failed: Sequence[Failure]) -> RenderableType:
    """Return a first line and a table of failures."""
    if not failed:
        return Lines(head)
    table = ResultTable(("scene", "samples", "reason of the failure"))
    for failure in failed:
        table.add_row(failure.scene, str(failure.samples), Text(failure.why))
    return Lines(head, table, Text("to try again, add --retry; failed.jsonl has the logs"))
