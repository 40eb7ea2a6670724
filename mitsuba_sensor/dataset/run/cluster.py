"""Workers of a Dask cluster, which its user has begun: the only module that knows Dask."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from concurrent import futures
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from threading import Lock
from typing import TYPE_CHECKING, TypeAlias

from ... import __version__
from ...core import InputError
from ..plan.planned import PlannedView
from ..store.keys import Config, made_by
from ..store.store import Store
from .task import Outcome, TaskLimits, Told, run_task

if TYPE_CHECKING:
    from distributed import Client, Worker
    from distributed import Future as AnyFuture

    Future: TypeAlias = AnyFuture[Outcome]
    Event: TypeAlias = Future | str

TOPIC = "mitsuba-sensor"  # of events that workers send
OF_SCHEDULER = "all"
"""Topic of Dask's own events: a worker has come or gone."""
LOST = OSError, futures.CancelledError, asyncio.CancelledError
"""What a client raises of a scheduler that does not answer."""
ENDS_S = 1
"""In which a client takes its leave."""
WORKERS_CHANGED = "workers changed"
LOOKS_EVERY_S = 5.0
"""Between two looks at whether the scheduler still answers, where nothing comes from it."""
TOLD_EVERY_S = 1.0
VIEWS_OF_WORKER = 2
"""The one that it makes, and one that waits for it: the next one begins without waiting for this process."""

_ONE_AT_A_TIME: defaultdict[str, Lock] = defaultdict(Lock)
"""Of each worker in this process: one with several threads makes its views one after another, as a render uses them
all, and what is printed goes into the log of one view."""


class SchedulerLost(Exception):
    """A scheduler does not answer any more.  under_way : the views that it had been given, and that have not ended."""

    def __init__(self, under_way: list[PlannedView]) -> None:
        super().__init__("the scheduler is gone")
        self.under_way = under_way


class ClusterWorkers:
    """Workers that come and go, behind a client of their scheduler.

    The scheduler tells when a view has ended, and when workers come or go: it is asked for nothing after each view.
    """

    def __init__(self, client: Client, store: Store, limits: TaskLimits) -> None:
        self.client, self._asked = client, (str(store.folder), limits, made_by())
        self._events: SimpleQueue[Event] = SimpleQueue()
        self._ended, self._begun = deque[tuple[str, Outcome | None]](), 0
        self._under_way: dict[str, tuple[PlannedView, Future | None]] = {}
        with self._unless_lost():
            client.subscribe_topic(OF_SCHEDULER, self._note_event)
            self._count_workers()

    @property
    def count(self) -> int:
        """How many views may be under way, at least those of one worker."""
        return VIEWS_OF_WORKER * max(self._workers, 1)

    def begin(self, view: PlannedView) -> None:
        """Give a view to the scheduler. Raises SchedulerLost, of which the view is part."""
        self._begun += 1
        key = f"view-{self._begun}"
        self._under_way[key] = view, None
        with self._unless_lost():
            future = self.client.submit(_in_worker, *self._asked, view, key=key, pure=False)
            self._under_way[key] = view, future  # the scheduler forgets one that nobody has
            future.add_done_callback(self._events.put)

    def next_ended(self) -> tuple[PlannedView, Outcome | None] | None:
        """The next view that has ended, and its outcome, or None if its process has died; None where another number
        of workers is there. Raises SchedulerLost, and InputError for a worker of other versions."""
        with self._unless_lost():
            if not self._ended and WORKERS_CHANGED in self._take_events():
                self._count_workers()
                return None
            key, outcome = self._ended.popleft()
        return self._under_way.pop(key)[0], outcome

    def _note_event(self, event: tuple[float, Config]) -> None:
        if event[1].get("action") in ("add-worker", "remove-worker"):
            self._events.put(WORKERS_CHANGED)

    def _count_workers(self) -> None:
        self._workers = len(self.client.nthreads())

    def _take_events(self) -> list[Event]:
        """Wait for something to happen; all that has, the outcomes of what has ended taken."""
        events: list[Event] = []
        while not events:
            with suppress(Empty):
                events.append(self._events.get(timeout=LOOKS_EVERY_S))
                while not self._events.empty():
                    events.append(self._events.get())
            if self.client.status != "running":
                raise futures.CancelledError
        self._take_outcomes([event for event in events if not isinstance(event, str)])
        return events

    def _take_outcomes(self, ended: Sequence[Future]) -> None:
        made: dict[str, Future] = {}
        for future in ended:
            if future.status == "cancelled":
                raise futures.CancelledError
            if future.status == "error":
                _require_death(future.exception())
                self._ended.append((str(future.key), None))
            else:
                made[str(future.key)] = future
        if made:
            self._ended += self.client.gather(made, errors="skip").items()

    @contextmanager
    def _unless_lost(self) -> Iterator[None]:
        """Raise SchedulerLost where the block meets a connection that is lost."""
        try:
            if self.client.status == "running":
                yield
                return
        except LOST:
            pass
        raise SchedulerLost([view for view, _ in self._under_way.values()])


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
            with suppress(*LOST, ValueError):
                client.unsubscribe_topic(OF_SCHEDULER)
            client.close(timeout=ENDS_S)


def _require_death(error: BaseException) -> None:
    """Raise InputError unless a view has failed because its process died: all other errors become outcomes."""
    import distributed

    if isinstance(error, InputError):
        raise error
    if not isinstance(error, distributed.KilledWorker):
        said = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(
            f"the scheduler or a worker cannot read what mitsuba-sensor {__version__} sends ({said}); install it "
            "there, in the same version."
        ) from error


def _in_worker(folder: str, limits: TaskLimits, versions: Config, view: PlannedView) -> Outcome:
    """Runs in a worker. Raises InputError where it has other versions of what pixels depend on."""
    import distributed

    worker = distributed.get_worker()
    _require_versions(worker.address, made_by(), versions)
    with _ONE_AT_A_TIME[worker.address]:
        return run_task(folder, view, _telling(worker), limits)


def _telling(worker: Worker) -> Told:
    """Sends what a worker tells to the run, at most once a second: a thousand workers have one scheduler."""
    waiting, latest_s = 0, -math.inf

    def tell(what: str, done: int) -> None:
        nonlocal waiting, latest_s
        waiting += done
        if time.monotonic() - latest_s >= TOLD_EVERY_S:
            worker.log_event(TOPIC, (what, waiting))
            waiting, latest_s = 0, time.monotonic()

    return tell


def _require_versions(address: str, own: Config, versions: Config) -> None:
    """Raise InputError, naming both versions, where a worker has others than the run."""
    for name, version in versions.items():
        if (other := own.get(name)) != version:
            raise InputError(
                f"the worker {address} has {name} {other or '(not installed)'}, and this run has "
                f"{version or 'none'}; give them the same version."
            )
