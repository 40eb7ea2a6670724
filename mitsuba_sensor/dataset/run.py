"""Makes a dataset: finds what is missing, has it made, and writes the table."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TypeAlias, Unpack

from pydantic import BaseModel, ValidationError

from ..core import InputError
from ..core.options import complete, documents
from ..core.progress import automatic_progress, is_asked
from ..files import durable
from ..files.appearing import refuse_empty, require_folder
from ..render.variants import restores_variant
from ..stopping import remark_if_stopped
from .checks import check_scenes, checked_counts, growth_refused
from .engine import Job, Outcome, outcomes
from .file import read_dataset_text
from .keys import Facts
from .options import RunOptions
from .plan import DatasetPlan, Place, Task, load_plan
from .store import EARLIER, Store
from .table import Table

FAILED = "failed.jsonl"
FAILED_BYTES_MAX = 2**26
NEW_FOLDER = "give a new folder"


class Failure(BaseModel):
    """A line of FAILED: a task that could not be made.  first : values of its first sample.  log : last output of its
    process."""

    task: str
    scene: str
    samples: int
    first: Facts
    why: str
    log: str = ""

    def line(self) -> bytes:
        """Return the line of the file."""
        return self.model_dump_json().encode() + b"\n"


@dataclass
class RunProgress:
    """Progress of a run.

    samples : of the dataset, or of this part of it.  there : complete before this run.  made : by this run.
    failed : tasks that could not be made.  remarks : sentences for the user.  render_noise : a sentence at the end.
    """

    samples: int
    there: int = 0
    made: int = 0
    now: str = "starting"
    failed: list[Failure] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    render_noise: str = ""

    @property
    def done(self) -> int:
        """Number of complete samples."""
        return self.there + self.made

    def standing(self, seconds: float) -> tuple[str, float]:
        """Return the current step and the fraction of complete samples; NaN without samples.

        seconds : since the start of this run.
        """
        speed = f"{self.made / seconds:.2g} samples/s, " if self.made and seconds else ""
        failed = f", {len(self.failed)} failed" if self.failed else ""
        share = self.done / self.samples if self.samples else math.nan
        return f"{speed}{self.now}{failed}", share

    def counted(self) -> str:
        """Return the number of complete samples as text."""
        return f"{self.done} of {self.samples} samples" if self.samples else "counting samples"


Show: TypeAlias = Callable[[RunProgress], object]


@contextmanager
def shown_run(progress: Show | bool | None) -> Iterator[Show]:
    """Yield the function that a run reports to: as given, nothing for False, a line every ten seconds for None."""
    if callable(progress):
        yield progress
    elif not is_asked(progress):
        yield lambda progress: None
    else:
        with automatic_progress("dataset run", "starting") as teller:

            def tell(now: RunProgress) -> None:
                if teller is not None:
                    doing, share = now.standing(teller.seconds)
                    teller.tell(f"{now.counted()}, {doing}", share)
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
    """Make every missing sample of the dataset of a TOML file in the folder ``out``.

    ::

        made = make_dataset("pairs.toml", "out/pairs")
        print(made.made, made.render_noise)

    roots : further folders with scenes and cameras.  progress : see :func:`run`.
    Raises InputError, and DiskFull.
    """
    return run(load_plan(file, roots), out, progress=progress, **options)


@documents(RunOptions)
@restores_variant
def run(
    plan: DatasetPlan,
    out: str | Path,
    *,
    progress: Show | bool | None = None,
    **options: Unpack[RunOptions],
) -> RunProgress:
    """Make every missing sample of a dataset in ``out``.

    progress : None reports every ten seconds on stderr; False reports nothing; a function is called with a
        :class:`RunProgress` after every step.
    Raises InputError; DiskFull if the disk is full: complete samples stay, and another run continues.
    """
    refuse_empty(out, "out=", "give the name of a folder, e.g. out='out'")
    with shown_run(progress) as show:
        return _Run(plan, Store(out), complete(RunOptions, options), show).make()


class _Run:
    """A run.  chosen : all options.  show : called after every step."""

    def __init__(self, plan: DatasetPlan, store: Store, chosen: RunOptions, show: Show) -> None:
        self.plan, self.store, self.chosen, self.show = plan, store, chosen, show
        self.progress = RunProgress(0)
        self.finished = store.finished()
        self.samples_of = dict[str, int]()  # finished task → number of its samples
        self._incomplete = array(
            "Q"
        )  # places of lights with a missing task, one after the other
        remark_if_stopped(self._said_when_stopped)

    def make(self) -> RunProgress:
        """Make what is missing."""
        plan, store, progress = self.plan, self.store, self.progress
        check_same(plan, store)
        self.show(progress)
        counts = checked_counts(plan, self._count)
        progress.remarks += counts.notes()
        if len(self.samples_of) < counts.tasks:
            require_folder(store.folder)
            progress.now = "checking the scenes"
            self.show(progress)
            check_scenes(plan)  # before anything is written
            store.clean()
        record = plan.record(counts.samples)
        self._put_outdated_aside()
        store.write_record(record)
        failures = read_failures(store)
        job = Job(str(store.folder), record, self.chosen["memory_gb"])
        self.show(progress)
        for task, outcome in outcomes(self._missing(failures), job, self.chosen):
            self._note(task, outcome)
            self.show(progress)
        self._rewrite_failures()
        self._finish(counts.samples)
        return progress

    def _is_ours(self, task: Task) -> bool:
        """Return True if a task is in this part of the dataset."""
        part, parts = self.chosen["shard"] or (1, 1)
        return task.number % parts == part - 1

    def _count(self, task: Task) -> None:
        """Count a task before anything is made."""
        is_there, is_ours = task.key in self.finished, self._is_ours(task)
        samples = len(task.samples)
        if is_there:
            self.samples_of[task.key] = samples
        elif is_ours and self._incomplete[-len(task.place) :].tolist() != [*task.place]:
            self._incomplete.extend(task.place)
        self.progress.samples += is_ours * samples
        self.progress.there += is_ours * is_there * samples

    def _put_outdated_aside(self) -> None:
        """Move the shards of an earlier dataset file away. Raises InputError if the file is unchanged."""
        store = self.store  # which another run may have tidied meanwhile
        outdated = [
            shard
            for key, shard in store.finished().items()
            if key in self.finished and key not in self.samples_of
        ]
        if not outdated:
            return
        record = store.record()
        if record is not None and record.text == self.plan.text:
            scene = store.rows(outdated[0])[0].values.get("scene")
            raise InputError(
                f"{store.folder} was made from another scene {scene!r}, or other cameras: a file that the dataset file "
                f"names has changed; restore it, or {NEW_FOLDER}."
            )
        for shard in outdated:
            store.put_aside(shard)
        several = f"{len(outdated)} shard{'s' * (len(outdated) != 1)}"
        self.progress.remarks.append(
            f"moved {several} to {store.folder / EARLIER}, because the dataset file no longer has their samples or "
            "splits; that folder is not read, so remove it to save space."
        )

    def _missing(self, failures: dict[str, Failure]) -> Iterator[Task]:
        """Yield the tasks to be made."""
        self.progress.now = "rendering"
        places = zip(*[iter(self._incomplete)] * len(Place._fields), strict=True)
        for task in chain.from_iterable(map(self.plan.tasks_at, map(Place._make, places))):
            if not self._is_ours(task) or task.key in self.samples_of:
                continue
            if task.key in failures and not self.chosen["retry"]:
                self.progress.failed.append(failures[task.key])
            else:
                yield task

    def _note(self, task: Task, outcome: Outcome) -> None:
        """Record the outcome of a task."""
        if outcome.full is not None:
            raise outcome.full
        if not outcome.failed:
            self.samples_of[task.key] = len(task.samples)
            self.progress.made += len(task.samples)
            return
        failure = Failure(
            task=task.key,
            scene=task.scene,
            samples=len(task.samples),
            first=dict(min(task.samples).values),
            why=outcome.failed,
            log=outcome.log,
        )
        self.progress.failed.append(failure)
        durable.append_lasting(self.store.folder / FAILED, failure.line())

    def _rewrite_failures(self) -> None:
        """Leave only failures of missing tasks in FAILED, each once."""
        path = self.store.folder / FAILED
        left = [x for x in read_failures(self.store).values() if x.task not in self.samples_of]
        content = b"".join(failure.line() for failure in left)
        if not left:
            durable.remove_file(path)
        elif content != durable.read_small(path, FAILED_BYTES_MAX):
            durable.write_lasting(path, [content])

    def _finish(self, planned: int) -> None:
        """Write the table and the files for people."""
        from . import card

        table, failed = Table(self.store), len(self.progress.failed)
        try:
            self.progress.render_noise = card.write_overview(
                self.store, self.plan.file, table, planned, failed
            )
        except (InputError, OSError) as error:  # all samples are there: the run has not failed
            what = f"{card.CARD}, {card.SHEET} or {card.TABLE} in {self.store.folder}"
            self.progress.remarks.append(f"{what} was not written: {error}")

    def _said_when_stopped(self) -> str:
        """Return how many samples are on disk, including samples that this process has not heard of yet."""
        samples_of, count = dict(self.samples_of), 0
        for key, shard in self.store.finished().items():
            with suppress(InputError):  # a damaged shard has no samples
                count += samples_of.get(key) or len(self.store.rows(shard))
        return f"{count} samples are complete; the same command continues from there"


def check_same(plan: DatasetPlan, store: Store) -> None:
    """Raise InputError if a folder has another dataset than the plan, or a dataset of other versions or files."""
    folder, record = store.folder, store.record()
    if record is None:
        return
    for name, version in plan.made_by.items():
        if (before := record.made_by.get(name)) != version:
            raise InputError(
                f"{folder} was made with {name} {before or '(not installed)'}, but {version or 'none'} is installed; "
                f"install that version, or {NEW_FOLDER}."
            )
    changed = record.text != plan.text and growth_refused(
        read_dataset_text(record.text), plan.file
    )
    if changed:
        raise InputError(
            f"{folder} was made from another dataset file, with other values of {changed}; a dataset can only gain "
            f"scenes, cameras, rows, values of [grid] and draws: restore the file, or {NEW_FOLDER}."
        )


def read_failures(store: Store) -> dict[str, Failure]:
    """Return task → the latest reason why it could not be made, without invalid lines."""
    failures = dict[str, Failure]()
    for line in durable.read_small(store.folder / FAILED, FAILED_BYTES_MAX).splitlines():
        with suppress(ValidationError):
            failure = Failure.model_validate_json(line)
            failures[failure.task] = failure
    return failures
