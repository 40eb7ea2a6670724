"""Workers of a Dask cluster, which its user has begun: the only module that knows Dask."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from concurrent import futures
from contextlib import contextmanager, suppress
from typing import Any

from ..core import InputError
from .keys import Config, made_by
from .planned import PlannedView
from .store import Store
from .task import Outcome, TaskLimits, Told, run_task

TOPIC = "mitsuba-sensor"  # of events that workers send
LOST = OSError, futures.CancelledError, asyncio.CancelledError
"""What a client raises of a scheduler that does not answer."""
ENDS_S = 1
"""In which a client takes its leave."""


class SchedulerLost(Exception):
    """A scheduler does not answer any more.  under_way : the views that it had been given, and that have not ended."""

    def __init__(self, under_way: list[PlannedView]) -> None:
        super().__init__("the scheduler is gone")
        self.under_way = under_way


class ClusterWorkers:
    """Workers that come and go, behind a client of their scheduler."""

    def __init__(self, client: Any, store: Store, limits: TaskLimits) -> None:
        import distributed

        self.client, self._asked = client, (str(store.folder), limits)
        self._ended, self._begun = distributed.as_completed(raise_errors=False), 0
        self._under_way = dict[str, PlannedView]()

    @property
    def count(self) -> int:
        """How many workers there are now, at least one. Raises SchedulerLost."""
        with self._unless_lost():
            return max(len(self.client.scheduler_info(n_workers=-1)["workers"]), 1)

    def begin(self, view: PlannedView) -> None:
        """Give a view to the scheduler. Raises SchedulerLost, of which the view is part."""
        self._begun += 1
        key = f"view-{self._begun}"
        self._under_way[key] = view
        with self._unless_lost():
            future = self.client.submit(
                _in_worker, *self._asked, made_by(), view, key=key, pure=False
            )
            self._ended.add(future)

    def next_ended(self) -> tuple[PlannedView, Outcome | None]:
        """The next view that has ended, and its outcome; None if its process has died. Raises SchedulerLost."""
        import distributed

        with self._unless_lost():
            future = next(self._ended)
            outcome = None
            with suppress(distributed.KilledWorker):
                outcome = future.result()
        return self._under_way.pop(future.key), outcome

    @contextmanager
    def _unless_lost(self) -> Iterator[None]:
        """Raise SchedulerLost where the block meets a connection that is lost."""
        try:
            if self.client.status == "running":
                yield
                return
        except LOST:
            pass
        raise SchedulerLost([*self._under_way.values()])


@contextmanager
def cluster_workers(
    address: str, store: Store, told: Told, limits: TaskLimits
) -> Iterator[ClusterWorkers]:
    """The workers of a scheduler. Raises InputError where there is none."""
    import distributed
    from distributed.utils import silence_logging_cmgr

    with silence_logging_cmgr(logging.CRITICAL):
        try:
            client = distributed.Client(address, timeout="20s")
        except (OSError, ValueError) as error:
            raise InputError(
                f"there is no Dask scheduler at {address} ({error}); start one with `dask scheduler`, and "
                "workers with `dask worker ADDRESS --nthreads 1`."
            ) from None
        try:
            client.subscribe_topic(TOPIC, lambda event: told(*event[1]))
            yield ClusterWorkers(client, store, limits)
        finally:
            client.close(timeout=ENDS_S)


def _in_worker(folder: str, limits: TaskLimits, versions: Config, view: PlannedView) -> Outcome:
    """Runs in a worker. Raises InputError where it has other versions of what pixels depend on."""
    import distributed

    worker = distributed.get_worker()
    if (own := made_by()) != versions:
        raise InputError(
            f"worker {worker.address} has {own}, and this run {versions}; give them the same versions."
        )
    return run_task(
        folder, view, lambda what, done: worker.log_event(TOPIC, (what, done)), limits
    )
