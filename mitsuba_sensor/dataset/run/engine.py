"""Who makes the views: processes of this machine, a Dask cluster of many, or this process alone."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator
from itertools import chain
from typing import Protocol

from ...core import InputError
from ..options import RunOptions
from ..plan.planned import PlannedView
from ..store.store import Store
from .cluster import SchedulerLost, cluster_workers
from .task import (
    Make,
    Outcome,
    TaskLimits,
    Told,
    deaths_of,
    note_death_of,
    quarantined_by_tries,
    run_task,
    usual_make,
)
from .workers import local_workers

MOST_EARLY_DEATHS = 10
"""Of processes in a row, each before it had begun a view: then the fault is none of the views'."""
Remark = Callable[[str], object]
"""Called with a sentence that the user must read."""


class Workers(Protocol):
    """Processes that make views."""

    @property
    def count(self) -> int:
        """How many views may be under way: those that wait for a worker, too."""

    def begin(self, view: PlannedView) -> None:
        """Have a view made."""

    def next_ended(self) -> tuple[PlannedView, Outcome | None] | None:
        """The next view that has ended, and its outcome, or None if its process has died; None where another number
        of views may be under way."""


def outcomes(
    store: Store,
    views: Iterable[PlannedView],
    options: RunOptions,
    told: Told,
    make: Make = usual_make,
    remark: Remark = lambda text: None,
) -> Iterator[Outcome]:
    """What becomes of the views, in the order in which they end. Nothing is kept of those that have ended.

    make : yields the samples of a view as they are made.
    """
    left = iter(views)
    if options["scheduler"] is not None:
        left = yield from _by_cluster(
            store, left, options, TaskLimits(options["timeout_s"], True, make), told, remark
        )
    limits = TaskLimits(options["timeout_s"], options["workers"] != 0, make)
    if options["workers"] == 0:
        for view in left:
            yield quarantined_by_tries(store, view) or run_task(
                str(store.folder), view, told, limits
            )
        return
    if (first := next(left, None)) is None:  # no process where nothing is missing
        return
    with local_workers(
        store, options["workers"] or 1, options["memory_gb"], told, limits
    ) as workers:
        yield from _spread(workers, store, chain([first], left))


def _by_cluster(
    store: Store,
    views: Iterator[PlannedView],
    options: RunOptions,
    limits: TaskLimits,
    told: Told,
    remark: Remark,
) -> Generator[Outcome, None, Iterator[PlannedView]]:
    """Outcomes of a Dask cluster; returns the views that are left where its scheduler has died."""
    address = options["scheduler"]
    assert address is not None
    if (first := next(views, None)) is None:
        return views
    views = chain([first], views)
    with cluster_workers(address, store, told, limits) as workers:
        try:
            yield from _spread(workers, store, views)
        except SchedulerLost as lost:
            remark(
                f"the Dask scheduler at {address} was gone; this machine alone has made the rest."
            )
            return chain(lost.under_way, views)
    return views


def _spread(workers: Workers, store: Store, views: Iterator[PlannedView]) -> Iterator[Outcome]:
    """Keep as many views under way as there are workers; what killed its worker is tried again."""
    deaths = dict[int, int]()  # of each task under way, by its first number, when it began
    early = 0

    def begin(view: PlannedView) -> Iterator[Outcome]:
        if outcome := quarantined_by_tries(store, view):
            yield outcome
        else:
            deaths[view.first] = deaths_of(store, view)
            workers.begin(view)

    while True:
        while len(deaths) < workers.count and (view := next(views, None)) is not None:
            yield from begin(view)
        if not deaths:
            return
        if (ended := workers.next_ended()) is None:
            continue
        view, outcome = ended
        before = deaths.pop(view.first)
        if outcome is not None:
            early = 0
            yield outcome
            continue
        if note_death_of(store, view) > before:
            early = 0
        else:
            early = early + 1
        if early >= MOST_EARLY_DEATHS:
            raise InputError(
                f"{early} processes in a row have died before they began a view: too little memory, perhaps, or "
                "something ends them; run it again with fewer --workers, or with --workers 0, which has none."
            )
        yield from begin(view)


def usual_workers() -> int:
    """Processes that a machine can feed: a render uses all its cores, and while it writes another one renders."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    if cores > 1:
        return 2
    return 1
