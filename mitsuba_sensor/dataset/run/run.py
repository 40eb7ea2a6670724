"""Makes a dataset: finds out what is missing, has it made, and writes its index."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias, Unpack

from ...core import DiskFull
from ...core.options import complete, documents
from ...core.progress import automatic_progress, is_asked
from ...files.appearing import require_folder
from ...files.worker_log import forget, is_begun
from ...render.variants import restores_variant
from ..index.origin import is_recorded, write_origin
from ..index.same_origin import check_same
from ..index.writer import IndexWriter
from ..options import RunOptions
from ..plan.planned import DatasetPlan, PlannedView, load_plan
from ..store.store import Store
from .engine import outcomes, usual_workers
from .overview import write_overview
from .places import place_of
from .scene_checks import check_scenes
from .task import Outcome, log_path


@dataclass
class RunProgress:
    """How far a run is.  samples : of the dataset, or of this shard; before splits and shards leave any out.
    there : complete before this run.  made : by it.  failed : views in quarantine, with the reason.
    changed : the folder was made from another text of the dataset file, whose samples stay in it.
    remarks : sentences that the user must read.  render_noise : how large it is in the frames, at the end."""

    samples: int
    there: int = 0
    made: int = 0
    now: str = "starting"
    failed: list[Outcome] = field(default_factory=list)
    changed: bool = False
    remarks: list[str] = field(default_factory=list)
    render_noise: str = ""

    @property
    def done(self) -> int:
        """Samples that are complete."""
        return self.there + self.made

    def standing(self, seconds: float) -> tuple[str, float]:
        """What is done now, and the share of the samples that is complete; NaN where there is none.

        seconds : since this run began.
        """
        rate = 0.0
        if seconds:
            rate = self.made / seconds
        speed = ""
        if rate:
            speed = f"{rate:.2g} samples/s, "
        failed = ""
        if self.failed:
            failed = f", {len(self.failed)} views failed"
        share = self.done / self.samples if self.samples else math.nan
        return f"{speed}{self.now}{failed}", share

    def counted(self) -> str:
        """How many samples are complete."""
        return f"{self.done} of {self.samples} samples"


Show = Callable[[RunProgress], object]


@contextmanager
def shown_run(progress: Show | bool | None) -> Iterator[Show]:
    """What a run reports to: the given function, nothing for False, and for None a line every ten seconds."""
    if callable(progress):
        yield progress
        return
    if not is_asked(progress):
        yield lambda found: None
        return
    with automatic_progress("dataset run", "starting") as teller:

        def tell(found: RunProgress) -> None:
            if teller is not None:
                doing, share = found.standing(teller.seconds)
                teller.tell(f"{found.counted()}, {doing}", share)
                teller.tick()

        yield tell


@documents(RunOptions)
def make_dataset(
    file: str | Path,
    out: str | Path,
    *,
    roots: Sequence[str | Path] = (),
    progress: Show | bool | None = None,
    **options: Unpack[RunOptions],
) -> RunProgress:
    """Make everything of the dataset of a TOML file that is missing in the folder ``out``.

    ::

        made = make_dataset("pairs.toml", "out/pairs")
        print(made.made, made.render_noise)

    roots : folders below which scenes and cameras are read, too.  progress : see :func:`run`.
    Raises InputError, and DiskFull.
    """
    return run(load_plan(file, roots), Path(out), progress=progress, **options)


@documents(RunOptions)
@restores_variant
def run(
    plan: DatasetPlan,
    out: Path,
    *,
    progress: Show | bool | None = None,
    **options: Unpack[RunOptions],
) -> RunProgress:
    """Make everything of a dataset that is missing in ``out``.

    progress : None says every ten seconds on stderr how far it is; False says nothing; a
        function is called with a :class:`RunProgress` after every step.
    Raises InputError; DiskFull where the disk takes no more: what is complete stays, and another run goes on.
    """
    with shown_run(progress) as show:
        return make_missing(plan, Path(out), complete(RunOptions, options), show)


def make_missing(plan: DatasetPlan, out: Path, chosen: RunOptions, show: Show) -> RunProgress:
    """The run itself.  chosen : all options.  show : called after every step."""
    shard = chosen["shard"] or (1, 1)
    if chosen["workers"] is None:
        chosen["workers"] = usual_workers() if shard == (1, 1) else 0
    store, progress = Store(out), RunProgress(0)
    check_same(plan, store)
    writer = IndexWriter(plan, store, numbers_of_shard(plan, shard))
    if not (writer.is_whole and is_recorded(plan, out)):  # else nothing is written
        require_folder(out)
    if not writer.is_whole:
        check_scenes(plan)  # before anything is written
    progress.changed = write_origin(plan, store.folder)
    store.clean()
    progress.samples, progress.there = round(plan.samples / shard[1]), writer.there
    known = store.quarantined()
    show(progress)

    told_of, ended = 0, 0

    def count(more_told: int, more_ended: int) -> None:
        """Of the samples that workers tell of, which may come late, and of the views that have ended."""
        nonlocal told_of, ended
        told_of, ended = told_of + more_told, ended + more_ended
        progress.made = max(told_of, ended)

    def told(what: str, done: int) -> None:
        count(done, 0)
        progress.now = progress.now if done else what
        show(progress)

    left_out = {} if chosen["retry"] else known
    asked = dict[int, int]()
    views = _missing(writer, progress, known, left_out, asked)
    for one in outcomes(store, views, chosen, told, remark=progress.remarks.append):
        if one.full is not None:
            path, size, why = one.full
            raise DiskFull(Path(path), size, why)
        if one.failed:
            progress.failed.append(one)
        elif one.view in known:
            store.release(one.view)
        writer.ended(one.first, not one.failed)
        missing = asked.pop(one.first, 0)
        if one.failed:
            count(0, one.samples)
        else:  # a worker whose scheduler has died may have made some and not said so
            count(0, missing)
        show(progress)
    store.remove_empty_quarantine()
    index = writer.index()
    if len(index) == plan.samples:  # a run that was killed may have left some
        store.remove_lights(store.names("lights"))
    overview = write_overview(plan, store, index)
    progress.render_noise = overview.render_noise
    progress.remarks += overview.remarks
    return progress


_Failed: TypeAlias = Mapping[str, Mapping[str, object]]


def _missing(
    writer: IndexWriter,
    progress: RunProgress,
    known: _Failed,
    left_out: _Failed,
    asked: dict[int, int],
) -> Iterator[PlannedView]:
    """Tasks of which something is missing; those that another run has begun come last.

    known, left_out : key → facts of the views that are in quarantine, and of those that are not tried again.
    asked : gets how many samples of each task are missing, by the number of its first one.
    """
    store, later = writer.store, list[PlannedView]()
    logs = {path.stem for path in log_path(store, "*").parent.glob("*.log")}
    for view in writer.tasks():
        samples, log = missing_samples(view, store), log_path(store, view.task_key)
        progress.there += len(view.samples) - samples
        missing = samples or place_of(store, view).lacks_view()
        begun = log.stem in logs and is_begun(log)
        if not missing:  # the process that made it may have been killed before it tidied up
            if log.stem in logs and not begun:
                forget(log)
            if view.key in known:
                store.release(view.key)
            writer.ended(view.first, True)
        elif view.key in left_out:
            why = str(left_out[view.key].get("why", ""))
            progress.failed.append(Outcome(view.key, view.first, failed=why))
            writer.ended(view.first, False)
        elif begun:
            later.append(view)
        else:
            asked[view.first] = samples
            yield view
    store.shards.forget()
    for view in later:
        if missing_of(view, store):
            asked[view.first] = missing_samples(view, store)
            yield view
        else:
            writer.ended(view.first, True)


def missing_of(view: PlannedView, store: Store) -> int:
    """How much of a view is missing: samples, and their shared files."""
    return place_of(store, view).lacks_view() + missing_samples(view, store)


def missing_samples(view: PlannedView, store: Store) -> int:
    """How many samples of a view are missing."""
    return len(place_of(store, view).missing())


def numbers_of_shard(plan: DatasetPlan, shard: tuple[int, int]) -> range:
    """The numbers of the i-th of n parts, equally large where splits leave none out; a view may be in several."""
    number, shards = shard
    return range(*(plan.numbers * end // shards for end in (number - 1, number)))
