"""Commands of dataset: plan, run, show, status, verify, repair, push and export."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.text import Text

from ..core import InputError
from ..core.progress import duration
from ..dataset.exports.formats import FORMATS, ExportOptions
from ..dataset.options import RootOptions, RunOptions
from . import arguments, options
from .app import app, err, show
from .completion import one_of, shell_files
from .help import Command, Group
from .progress import samples_bar, steps_bar
from .tables import FittedTable, rough
from .values import Flag

if TYPE_CHECKING:
    from ..dataset.plan.planned import DatasetPlan
    from ..dataset.run.forecast import Counts, Forecast
    from ..dataset.run.run import RunProgress

READ_FIRST = {
    "contact_sheet.png": "some of the frames, to look at",
    "README.md": "what is in the folder, and how to read it",
    "samples.csv": "a line for each sample",
}
"""Files of a dataset for people."""

WRITE_ONE = "--picture FILE.png writes one"
COUNTED = ("scene", "renders", "samples")
MEASURED = ("render [s]", "sample [s]", "sample [MB]", "render noise")
"""Headings of a plan; the second ones where a short render was made."""
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
OpensPicture = Annotated[
    bool,
    typer.Option(
        "--open",
        help="Open its picture with the program of this desktop.",
        rich_help_panel=arguments.OUTPUT,
    ),
]
StoreAddress = Annotated[
    str,
    typer.Argument(
        metavar="ADDRESS",
        help="Where it is put: s3://BUCKET/NAME, or another address that fsspec knows.",
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

    Every sample appears whole or not at all, whatever happens; the same command goes on after a stop. What cannot be
    made is put into DIR/quarantine with its log, and the rest is made. README.md in DIR says what is there and how to
    read it, contact_sheet.png shows some of the frames.
    """
    from ..dataset.plan.planned import load_plan
    from ..dataset.run.run import run

    plan = load_plan(file, flags.pop("roots") or ["."])
    with samples_bar(err) as progress:
        found = run(plan, Path(out_dir), progress=progress, **flags)
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

    Values, cameras and files of every sample are checked; a short render of each scene on this machine tells the time
    and the bytes.
    """
    from ..dataset.plan.planned import load_plan
    from ..dataset.run.engine import usual_workers
    from ..dataset.run.forecast import counts_of, forecast

    plan = load_plan(file, flags["roots"] or ["."])
    if count_only:
        counts = counts_of(plan)
        show(asdict(counts) if as_json else plan_sheet(plan, counts, None), as_json)
        return
    with steps_bar(err) as now:
        found = forecast(plan, usual_workers(), now)
    show(found.to_dict() if as_json else plan_sheet(plan, found.counts, found), as_json)


@dataset.command(
    "show", cls=Command, epilog="Example: mitsuba-sensor dataset show pairs/ 3 --open"
)
def show_command(
    folder: DatasetFolder,
    sample: SampleCalled,
    picture: PictureFile = None,
    opens: OpensPicture = False,
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
    elif opens:
        raise InputError(f"pictures are in shards; {WRITE_ONE}, which --open shows.")
    where = picture or f"in the shard; {WRITE_ONE}"
    show(facts if as_json else sample_sheet(facts, where), as_json)
    if opens and typer.launch(str(picture)) != 0:
        err.print(f"no program here shows pictures; the picture is {picture}")


@dataset.command("status", cls=Command, epilog="Example: mitsuba-sensor dataset status pairs/")
@options.flags(RootOptions)
def status_command(
    folder: DatasetFolder, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """Say how much of a dataset is there, and what could not be made. Reads records, no pictures."""
    from ..dataset.index.repair import holdings, store_of
    from ..dataset.index.same_origin import plan_of

    store, plan = store_of(Path(folder)), plan_of(Path(folder), flags["roots"])
    held = holdings(store, plan)
    failed = {key: str(facts.get("why")) for key, facts in store.quarantined().items()}
    found = {"name": plan.file.name, **held._asdict(), "quarantine": failed}
    head = (
        f"{plan.file.name}: {held.there} of {held.samples} samples, {held.bytes / 1e6:.3g} MB"
    )
    if held.others:
        head += (
            f"\n{held.others} samples of earlier files of the dataset too, {held.others_bytes / 1e6:.3g} MB, which "
            f"ms.Dataset and exports leave out"
        )
    show(found if as_json else _with_failed(head, failed), as_json)


@dataset.command("verify", cls=Command, epilog="Example: mitsuba-sensor dataset verify pairs/")
@options.flags(RootOptions)
def verify_command(
    folder: DatasetFolder, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """Read every file of a dataset, and say what is not as it was written. Exit code 1 if anything is not.

    The files that it was made from are compared, too, where they are here. DIR may be the address of a dataset that
    `dataset push` has put into an object store.
    """
    from .dataset_faults import fault_sheet, faults_of

    with steps_bar(err) as now:
        faults = faults_of(folder, _verified(now), flags["roots"])
    show(
        [fault._asdict() for fault in faults] if as_json else fault_sheet(folder, faults),
        as_json,
    )
    if any(fault.is_damage for fault in faults):
        raise typer.Exit(1)


@dataset.command("repair", cls=Command, epilog="Example: mitsuba-sensor dataset repair pairs/")
@options.flags(RootOptions, RunOptions, without=("shard",))
def repair_command(
    folder: DatasetFolder, as_json: arguments.Json = False, **flags: Flag
) -> None:
    """Make again what `dataset verify` finds, and what is missing; everything else stays as it is."""
    from ..dataset.index.repair import discard, store_of, verify
    from ..dataset.index.same_origin import plan_of, require_same_versions
    from ..dataset.run.run import run

    place = Path(folder)
    store_of(place)
    roots = flags.pop("roots")
    plan = plan_of(place, roots)
    require_same_versions(plan.made_by, place)
    with steps_bar(err) as now:
        faults = list(verify(place, _verified(now), roots))
    broken = discard(place, faults)
    with samples_bar(err) as progress:
        found = run(plan, place, progress=progress, **flags)
    head = f"entries that were not as they were written: {len(broken)}; samples made again: {found.made}"
    head += "".join(f"\n{remark}" for remark in found.remarks)
    failed = {one.view: one.failed for one in found.failed}
    show(
        {**_summary(found), "broken": broken} if as_json else _with_failed(head, failed),
        as_json,
    )
    if found.failed:
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
    """Write a dataset as the files of another program, with a card: README.md with counts, noise, licence and hashes.

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


@dataset.command(
    "push",
    cls=Command,
    epilog="Example: mitsuba-sensor dataset push pairs/ s3://bucket/pairs",
)
def push_command(
    folder: DatasetFolder, address: StoreAddress, as_json: arguments.Json = False
) -> None:
    """Put a dataset of shards into an object store, S3 for example; only what is not there yet is uploaded.

    Of a dataset that is not complete yet: push it again later. ms.Dataset("s3://bucket/pairs") reads what is there.
    How you are known to a store is set as for its own programs, for S3 by AWS_PROFILE or AWS_ACCESS_KEY_ID.
    """
    from ..dataset.index.push import push

    with steps_bar(err) as now:
        found = push(Path(folder), address, lambda done, total: now(done, total, "uploaded"))
    said = (
        f"{address}: {found.files} shards and parts of the index uploaded, {found.there} were there already; "
        f"with record and pages {found.bytes / 1e6:.3g} MB uploaded"
    )
    show(asdict(found) if as_json else said, as_json)


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
    if found.changed:
        head.append(
            f"\n{folder} was made from another text of the file before; samples that this one does not have stay there "
            f"and are in no index: `mitsuba-sensor dataset status {folder}` counts them"
        )
    for sentence in (found.render_noise, *found.remarks):
        head.append(f"\n{sentence}" if sentence else "")
    return _with_failed(head, {one.view: one.failed for one in found.failed})


def plan_sheet(plan: DatasetPlan, counts: Counts, found: Forecast | None) -> RenderableType:
    """A line for each scene, and the sums."""
    from ..dataset.exports.summary import LESS_RENDER_NOISE, VISIBLE_RATIO

    headings = COUNTED if found is None else (*COUNTED, *MEASURED)
    table = FittedTable(headings, keys=1)
    for scene, (views, samples) in counts.by_scene.items():
        cells = [""] * (len(headings) - len(COUNTED))
        if found and scene in found.scenes:
            cost = found.scenes[scene]
            numbers = cost.render_s, cost.sample_s, cost.sample_bytes / 1e6, cost.noise_ratio
            cells = [rough(x) for x in numbers]
        table.add_row(scene, str(views), str(samples), *cells)
    renders = "1 render" if counts.views == 1 else f"{counts.views} renders"
    splits = ", ".join(f"{name} {n}" for name, n in counts.by_split.items() if name)
    head = f"{plan.file.name}: {counts.samples} samples of {renders}{f' ({splits})' if splits else ''}"
    below = []
    if found is not None:
        size = f"{found.bytes / 1e6:.3g} MB"
        below = [
            f"about {duration(found.seconds)} and {size} on this machine",
            f"Render noise is the variance of the render over that of the sensor, in the median pixel; above "
            f"{VISIBLE_RATIO} it is seen in the frames.",
        ]
        if any(cost.noise_ratio > VISIBLE_RATIO for cost in found.scenes.values()):
            below.append(LESS_RENDER_NOISE)
    if not plan.file.render.get("denoise"):
        below.append(NOT_DENOISED)
    return Lines(Text(head, style="bold"), table, *map(Text, below))


def _verified(now: Callable[[int, int, str], object]) -> Callable[[int, int], object]:
    """What tells how many entries are verified, of how many.  now : told what is done."""
    return lambda done, total: now(done, total, "verified")


def _with_failed(head: str | Text, failed: Mapping[str, str]) -> RenderableType:
    """A first line, and the views in quarantine."""
    table = FittedTable(("view", "why it is in quarantine"), keys=1)
    for key, why in failed.items():
        table.add_row(key, Text(why))
    if failed:
        return Lines(head, table)
    return Lines(head)


def _summary(found: RunProgress) -> dict[str, object]:
    failed = [{"view": one.view, "why": one.failed} for one in found.failed]
    return {
        "made": found.made,
        "there": found.there,
        "failed": failed,
        "render_noise": found.render_noise,
        "remarks": found.remarks,
    }
