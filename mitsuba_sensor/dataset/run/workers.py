"""Processes of this machine that make views: one pipe to each, no port, and one that dies takes no other with it."""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import connection, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import NamedTuple

from ...core import InputError
from ...files.memory import resident_memory_bytes
from ...stopping import signals_held, undone_if_stopped, whole_step
from ..plan.planned import PlannedView
from ..store.keys import Facts
from ..store.store import Store
from .task import Outcome, TaskLimits, Told
from .worker import serve

ENDS_S = 1.0
"""In which processes end that are told to."""
MEMORY_EVERY_S = 0.2
"""Between two looks at how much memory they take."""


class Worker(NamedTuple):
    """A process, and the pipe to it."""

    process: SpawnProcess
    pipe: Connection


class LocalWorkers:
    """Processes that begin when they are needed.

    processes : how many at most.  memory_gb : one that takes more is ended.  told : called with what they tell.
    """

    def __init__(
        self,
        store: Store,
        processes: int,
        memory_gb: float | None,
        told: Told,
        limits: TaskLimits,
    ) -> None:
        self.processes, self.memory_gb, self.told = processes, memory_gb, told
        self._asked = str(store.folder), limits
        self._idle: list[Worker] = []
        self._busy: dict[Connection, tuple[Worker, PlannedView]] = {}
        self._waiting = deque[PlannedView]()

    @property
    def count(self) -> int:
        """How many views may be under way: for each process the one that it makes, and one that waits for it."""
        return 2 * self.processes

    def begin(self, view: PlannedView) -> None:
        """Give a view to a process that has none, or have it wait for one. Raises InputError if none can be begun."""
        if len(self._busy) == self.processes:
            self._waiting.append(view)
            return
        if self._idle:
            worker = self._idle.pop()
        else:
            worker = self._begin_worker()
        self._busy[worker.pipe] = worker, view
        with suppress(OSError):  # it has died meanwhile, which next_ended sees
            worker.pipe.send(view)

    def next_ended(self) -> tuple[PlannedView, Outcome | None]:
        """The next view that has ended, and its outcome; None if its process has died."""
        while True:
            for pipe in connection.wait(
                list(self._busy), MEMORY_EVERY_S if self.memory_gb else None
            ):
                assert isinstance(pipe, Connection)
                worker, view = self._busy[pipe]
                try:
                    said = pipe.recv()
                except (EOFError, OSError):
                    del self._busy[pipe]
                    worker.process.join(ENDS_S)
                    self._begin_waiting()
                    return view, None
                if isinstance(said, Outcome):
                    del self._busy[pipe]
                    self._idle.append(worker)
                    self._begin_waiting()
                    return view, said
                self.told(*said)
            self._end_too_large()

    def end(self) -> None:
        """Have all processes undo what is unfinished, and wait for that."""
        workers = [*self._idle, *(worker for worker, _ in self._busy.values())]
        for worker in workers:
            worker.process.terminate()
        latest = time.monotonic() + ENDS_S
        for worker in workers:
            worker.process.join(max(latest - time.monotonic(), 0))

    def _begin_waiting(self) -> None:
        if self._waiting:
            self.begin(self._waiting.popleft())

    def _begin_worker(self) -> Worker:
        context = multiprocessing.get_context("spawn")
        try:
            ours, theirs = context.Pipe()
            process = context.Process(target=serve, args=(theirs, *self._asked), daemon=True)
            with whole_step, _without_main():  # a stop ends it after it has begun whole
                process.start()
        except OSError as error:
            raise InputError(
                f"the processes that render could not begin ({error}); try again, or use --workers 0, which has none."
            ) from error
        theirs.close()
        return Worker(process, ours)

    def _end_too_large(self) -> None:
        if self.memory_gb is None:
            return
        for worker, _ in self._busy.values():
            process_id = worker.process.pid
            if process_id is None:
                continue
            if resident_memory_bytes(process_id) > self.memory_gb * 1e9:
                worker.process.terminate()


@contextmanager
def local_workers(
    store: Store, processes: int, memory_gb: float | None, told: Told, limits: TaskLimits
) -> Iterator[LocalWorkers]:
    """Processes that end with the block, and when the program is stopped."""
    if os.name == "posix":
        _begin_tracker()
    workers = LocalWorkers(store, processes, memory_gb, told, limits)
    with undone_if_stopped(workers.end):
        try:
            yield workers
        finally:
            workers.end()


def _begin_tracker() -> None:
    """Begin what tidies up after processes. Whoever begins it takes Ctrl-C from then on, so it is not a worker's
    thread, whose processes would take it too; and a stop, which ends this process at once, is no reason to warn."""
    before = os.environ.get("PYTHONWARNINGS")
    silent = "ignore::UserWarning:multiprocessing.resource_tracker"
    os.environ["PYTHONWARNINGS"] = f"{before},{silent}" if before else silent
    try:
        with signals_held():
            resource_tracker.ensure_running()
    finally:
        del os.environ["PYTHONWARNINGS"]
        if before:
            os.environ["PYTHONWARNINGS"] = before


@contextmanager
def _without_main() -> Iterator[None]:
    """Processes that begin meanwhile do not run the main script again, which may have no guard, or no file."""
    main = sys.modules["__main__"]
    known: Facts = {
        name: vars(main).pop(name) for name in ("__file__", "__spec__") if name in vars(main)
    }
    main.__spec__ = None
    try:
        yield
    finally:
        vars(main).update(known)
