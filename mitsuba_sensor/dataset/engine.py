"""Makes tasks in processes of this machine, on a Dask cluster, or in this process, by one loop over their futures.

pebble spawns the processes, with a time limit for each task; a process that dies ends no other process.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import sys
import threading
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from multiprocessing import connection, resource_tracker
from pathlib import Path
from typing import Any, NamedTuple

from ..core import DiskFull, InputError
from ..files import worker_log
from ..files.memory import TOO_MUCH_MEMORY, memory_limit
from ..stopping import end_quietly, signals_held, undo_when_terminated, undone_if_stopped
from .keys import Config, Facts, made_by
from .options import RunOptions
from .plan import Task
from .store import Record, Store

TRIES_MAX = 3
"""Tries of a task whose process dies."""
CHECK_PERIOD_S = 5.0
"""Time between checks of a silent scheduler."""
STOP_WAIT_S = 1.0
"""Time that a stop waits for workers; a worker inside a kernel ends after it, and finishes nothing either."""
LOG_CHARACTERS_MAX = 4000
"""Characters that are kept from the end of a process's output."""
LOST = OSError, futures.CancelledError, asyncio.CancelledError
"""Errors of a client whose scheduler does not answer."""
_ONE_AT_A_TIME = threading.Lock()
"""A Dask worker with several threads makes its tasks one after another: a render uses all its cores."""


class Outcome(NamedTuple):
    """Outcome of a task.  failed : why it could not be made, or an empty text.  log : last output of its process.
    full : the error of a full disk."""

    failed: str = ""
    log: str = ""
    full: DiskFull | None = None


def make_anew(store: Store, record: Record, task: Task) -> object:
    """Make a task in this process, after loading Mitsuba."""
    from .make import load_renderer, make_task

    load_renderer()
    return make_task(store, record, task)


@dataclass(frozen=True)
class Job:
    """What a worker needs besides the task.  capture : True to keep stderr for failures.  make : commits a task."""

    folder: str
    record: Record
    memory_gb: float | None = None
    capture: bool = True
    make: Callable[[Store, Record, Task], object] = make_anew

    def log_path(self, task: Task) -> Path:
        """Return the file of the output of a process while it makes a task."""
        return worker_log.place_of(Path(self.folder), task.key)


@dataclass(frozen=True)
class Pool:
    """submit : starts a task.  capacity : tasks that may be under way.
    check : raises InputError if no worker is left."""

    submit: Callable[[Task], futures.Future[Outcome]]
    capacity: Callable[[], int]
    check: Callable[[], object] = lambda: None


def run_task(job: Job, task: Task) -> Outcome:
    """Make a task in this process, and return what went wrong."""
    store, log, outcome = Store(job.folder), job.log_path(task), Outcome()
    try:
        with worker_log.captured(log, job.capture), memory_limit(job.memory_gb):
            if task.key not in store.finished():  # another run may have made it meanwhile
                job.make(store, job.record, task)
    except InputError as error:
        outcome = Outcome(str(error), full=error if isinstance(error, DiskFull) else None)
    except Exception as error:  # a bug costs one task and not the night
        printed = traceback.format_exc()[-LOG_CHARACTERS_MAX:]
        outcome = Outcome(f"{type(error).__name__}: {error}", printed)
    worker_log.forget(log)
    return outcome


def outcomes(
    tasks: Iterable[Task], job: Job, options: RunOptions
) -> Iterator[tuple[Task, Outcome]]:
    """Yield the outcomes of tasks, in the order in which they end. Raises InputError without workers."""
    left = iter(tasks)
    if (first := next(left, None)) is None:  # no process where nothing is missing
        return
    running: dict[futures.Future[Outcome], Task] = {}

    def forget_logs() -> None:
        for task in running.values():
            worker_log.forget(job.log_path(task))

    with undone_if_stopped(forget_logs), _pool(job, options) as pool:
        left, tries = chain([first], left), Counter[str]()
        while True:
            while len(running) < pool.capacity() and (task := next(left, None)) is not None:
                running[pool.submit(task)] = task
            if not running:
                return
            done = futures.wait(running, CHECK_PERIOD_S, futures.FIRST_COMPLETED).done
            if not done:
                pool.check()
            for future in done:
                task = running.pop(future)
                why, may_live = _death(future)
                tries[task.key] += 1
                if may_live and tries[task.key] < TRIES_MAX:
                    running[pool.submit(task)] = task
                    continue
                number = tries.pop(task.key)
                times = f" {number} times" if may_live else ""
                if why:
                    log = worker_log.end_of(job.log_path(task), LOG_CHARACTERS_MAX)
                    why = worker_log.first_line(log) or why
                    yield task, Outcome(f"its process died{times} ({why})", log)
                else:
                    yield task, future.result()


def _death(future: futures.Future[Outcome]) -> tuple[str, bool]:
    """Return why the process of a task died (an empty text if it did not), and True if another try may succeed.

    Raises InputError if a worker cannot read what it was sent.
    """
    from pebble import ProcessExpired

    try:
        error = future.exception()
    except LOST as lost:
        error = lost
    if error is None:
        return "", False
    if isinstance(error, TimeoutError):
        return "it took longer than the time limit", False
    if isinstance(error, ProcessExpired) and error.exitcode == TOO_MUCH_MEMORY:
        return "it took more memory than the limit", False
    is_killed_worker = type(error).__name__ == "KilledWorker"  # Dask has tried it again itself
    if isinstance(error, ProcessExpired) or is_killed_worker:
        return "without output: a signal, or too little memory", not is_killed_worker
    if isinstance(error, InputError):
        raise error
    if isinstance(error, LOST):
        raise InputError("the Dask scheduler is gone; repeat the command to make the rest.")
    why = " ".join(f"{type(error).__name__}: {error}".split())
    raise InputError(
        f"a worker cannot read what this run sends ({why}); install mitsuba-sensor there, in the same version."
    ) from error


def _pool(job: Job, options: RunOptions) -> AbstractContextManager[Pool]:
    limit = next((x for x in ("timeout_s", "memory_gb") if options[x] is not None), "")
    if options["scheduler"] is not None:
        if limit:
            raise InputError(
                f"{limit} limits processes of this machine; give `dask worker` its own --memory-limit, or remove "
                "scheduler=."
            )
        return _cluster(job, options)
    if options["workers"] == 0:
        if limit:
            raise InputError(
                f"{limit} ends a process that makes samples, but workers is 0; give workers=1 or more."
            )
        return nullcontext(Pool(partial(_made_here, replace(job, capture=False)), lambda: 1))
    return _processes(job, options["workers"] or usual_workers(), options["timeout_s"])


def _made_here(job: Job, task: Task) -> futures.Future[Outcome]:
    future = futures.Future[Outcome]()
    future.set_result(run_task(job, task))
    return future


@contextmanager
def _processes(job: Job, workers: int, timeout_s: float | None) -> Iterator[Pool]:
    """Yield processes of this machine, which end with the block, and with this process however it ends."""
    from pebble import ProcessPool

    context: Any = multiprocessing.get_context("spawn")
    if os.name == "posix":
        _begin_tracker()
    with _without_main(), undone_if_stopped(_end_workers):
        pool = ProcessPool(workers, initializer=_begin_worker, context=context)
        try:
            yield Pool(
                lambda task: pool.schedule(run_task, (job, task), timeout=timeout_s),
                lambda: 2 * workers,  # each has one task, and one waits for it
            )
        finally:
            pool.stop()  # type: ignore[no-untyped-call]
            pool.join()


def _end_workers() -> None:
    """End the workers of a stopped run, so nothing is finished while complete samples are counted."""
    workers = multiprocessing.active_children()
    for worker in workers:
        worker.terminate()
    for worker in workers:
        worker.join(STOP_WAIT_S / len(workers))


def _begin_worker() -> None:
    """Prepare a process for its tasks: it ends, and undoes what is unfinished, when the run ends."""
    undo_when_terminated()
    parent = multiprocessing.parent_process()
    assert parent is not None
    sentinel = parent.sentinel

    def end_with_parent() -> None:
        connection.wait([sentinel])
        worker_log.forget_open()
        end_quietly()

    threading.Thread(target=end_with_parent, daemon=True).start()


def _begin_tracker() -> None:
    """Start the resource tracker here: its thread takes Ctrl-C from then on, so it must not be the thread of a worker.

    A stop ends this process at once, which is no reason to warn.
    """
    before = os.environ.get("PYTHONWARNINGS", "")
    silent = "ignore::UserWarning:multiprocessing.resource_tracker"
    os.environ["PYTHONWARNINGS"] = f"{before},{silent}".lstrip(",")
    try:
        with signals_held():
            resource_tracker.ensure_running()
    finally:
        os.environ["PYTHONWARNINGS"] = before


@contextmanager
def _without_main() -> Iterator[None]:
    """Let new processes not run the main script again, which may have no guard, or no file."""
    main = vars(sys.modules["__main__"])
    hidden: Facts = {name: main.pop(name) for name in ("__file__", "__spec__") if name in main}
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(hidden)


@contextmanager
def _cluster(job: Job, options: RunOptions) -> Iterator[Pool]:
    """Yield the workers of a Dask scheduler. Raises InputError if it does not answer."""
    import distributed
    from distributed.utils import silence_logging_cmgr

    address = options["scheduler"]
    names = {"tls_ca": "ca_file", "tls_cert": "client_cert", "tls_key": "client_key"}
    tls = {f"tls_{x}": options[name] for name, x in names.items() if options[name] is not None}  # type: ignore[literal-required]
    with silence_logging_cmgr(logging.CRITICAL):
        try:
            security = distributed.Security(require_encryption=True, **tls) if tls else None
            client = distributed.Client(address, timeout="20s", security=security)
        except (
            OSError,
            ValueError,
            TypeError,
        ) as error:  # TypeError: TLS without a certificate
            raise InputError(
                f"there is no Dask scheduler at {address} ({error}); start one with `dask scheduler`, and "
                "workers with `dask worker ADDRESS --nthreads 1`."
            ) from None

        def check() -> None:
            if client.status != "running":
                raise InputError(
                    f"the Dask scheduler at {address} is gone; repeat the command to make the rest."
                )

        executor = client.get_executor(pure=False)
        try:
            yield Pool(
                lambda task: executor.submit(_in_worker, made_by(), job, task),
                lambda: 2 * max(len(client.nthreads()), 1),
                check,
            )
        except LOST:
            check()
            raise
        finally:
            client.close(timeout=1)


def _in_worker(versions: Config, job: Job, task: Task) -> Outcome:
    """Run a task in a Dask worker. Raises InputError if a library that decides pixels has another version there."""
    for name, version in versions.items():
        if (other := made_by().get(name)) != version:
            raise InputError(
                f"a worker of the Dask cluster has {name} {other or '(not installed)'}, but this run has "
                f"{version or 'none'}; give them the same version."
            )
    with _ONE_AT_A_TIME:
        return run_task(job, task)


def usual_workers() -> int:
    """Return the usual number of processes: a render uses all cores; while one process writes, another renders."""
    return min(os.cpu_count() or 1, 2)
