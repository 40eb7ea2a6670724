"""Makes tasks in processes of this machine, on a Dask cluster, or in this process, by one loop over their futures.

Processes are those of pebble: spawned, with a time limit for each task; one that dies takes no other with it.
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
from typing import Any, TypeAlias

from ..core import DiskFull, InputError
from ..files import worker_log
from ..files.memory import TOO_MUCH_MEMORY, memory_limit
from ..stopping import end_quietly, signals_held, undo_when_terminated, undone_if_stopped
from .keys import Config, Facts, made_by
from .options import RunOptions
from .plan import Task
from .store import Record, Store

MOST_TRIES = 3
"""Of a task whose process dies."""
LOOKS_EVERY_S = 5.0
"""Between two looks at whether a scheduler still answers, where nothing comes from it."""
ENDS_WITHIN_S = 1.0
"""How long a stop waits for workers; one that is inside a kernel ends after it, and finishes nothing either."""
MOST_LOG = 4000
"""Characters that are kept of what a process printed, from its end."""
LOST = OSError, futures.CancelledError, asyncio.CancelledError
"""What a client raises of a scheduler that does not answer."""
_ONE_AT_A_TIME = threading.Lock()
"""A worker of Dask with several threads makes its tasks one after another: a render uses all its cores."""


@dataclass(frozen=True)
class Outcome:
    """What became of a task.  failed : why it could not be made, or nothing.  log : what its process printed last.
    full : what the disk did not take."""

    task: Task
    failed: str = ""
    log: str = ""
    full: DiskFull | None = None


def make_anew(store: Store, record: Record, task: Task) -> object:
    """:func:`.make.make_task`, for which Mitsuba is loaded here."""
    from .make import load_renderer, make_task

    load_renderer()
    return make_task(store, record, task)


@dataclass(frozen=True)
class Job:
    """What a worker needs besides the task.  capture : whether what is printed on stderr is kept for failures.
    make : commits a task."""

    folder: str
    record: Record
    memory_gb: float | None = None
    capture: bool = True
    make: Callable[[Store, Record, Task], object] = make_anew

    def log_path(self, task: Task) -> Path:
        """Where what a process prints is while it makes a task."""
        return worker_log.place_of(Path(self.folder), task.key)


Ended: TypeAlias = tuple[str, str, DiskFull | None]
"""Why a task has failed, what was printed last, what the disk did not take."""


@dataclass(frozen=True)
class Pool:
    """submit : has a task made.  capacity : how many may be under way.
    check : raises InputError if nobody makes them any more."""

    submit: Callable[[Task], futures.Future[Ended]]
    capacity: Callable[[], int]
    check: Callable[[], object] = lambda: None


def run_task(job: Job, task: Task) -> Ended:
    """Make a task in this process; whatever goes wrong with it is returned."""
    store, log = Store(job.folder), job.log_path(task)
    failed: Ended = ("", "", None)
    try:
        with worker_log.captured(log, job.capture), memory_limit(job.memory_gb):
            if task.key not in store.finished():  # another run may have made it meanwhile
                job.make(store, job.record, task)
    except DiskFull as error:
        failed = (str(error), "", error)
    except InputError as error:
        failed = (str(error), "", None)
    except Exception as error:  # a bug costs one task and not the night
        failed = (f"{type(error).__name__}: {error}", traceback.format_exc()[-MOST_LOG:], None)
    worker_log.forget(log)
    return failed


def outcomes(tasks: Iterable[Task], job: Job, options: RunOptions) -> Iterator[Outcome]:
    """What becomes of the tasks, in the order in which they end. Raises InputError where nobody can make them."""
    left = iter(tasks)
    if (first := next(left, None)) is None:  # no process where nothing is missing
        return
    running: dict[futures.Future[Ended], Task] = {}

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
            done = futures.wait(running, LOOKS_EVERY_S, futures.FIRST_COMPLETED).done
            if not done:
                pool.check()
            for future in done:
                task = running.pop(future)
                why, may_live = _death(future)
                tries[task.key] += 1
                if may_live and tries[task.key] < MOST_TRIES:
                    running[pool.submit(task)] = task
                    continue
                number = tries.pop(task.key)
                times = f" {number} times" if may_live else ""
                if why:
                    log = worker_log.end_of(job.log_path(task), MOST_LOG)
                    said = worker_log.first_line(log) or why
                    yield Outcome(task, f"its process died{times} ({said})", log)
                else:
                    yield Outcome(task, *future.result())


def _death(future: futures.Future[Ended]) -> tuple[str, bool]:
    """Why the process of a task has died, empty if it has not, and whether another try may end better.

    Raises InputError where a worker has not understood what it was given.
    """
    from pebble import ProcessExpired

    try:
        error = future.exception()
    except LOST as lost:
        error = lost
    if error is None:
        return "", False
    if isinstance(error, TimeoutError):
        return "it took longer than --timeout-s", False
    if isinstance(error, ProcessExpired) and error.exitcode == TOO_MUCH_MEMORY:
        return "it took more than --memory-gb", False
    is_killed_worker = type(error).__name__ == "KilledWorker"  # Dask has tried it again itself
    if isinstance(error, ProcessExpired) or is_killed_worker:
        return "nothing was printed: a signal, or too little memory", not is_killed_worker
    if isinstance(error, InputError):
        raise error
    if isinstance(error, LOST):
        raise InputError("the Dask scheduler is gone; run it again to make the rest.")
    said = " ".join(f"{type(error).__name__}: {error}".split())
    raise InputError(
        f"a worker cannot read what this run sends ({said}); install mitsuba-sensor there, in the same version."
    ) from error


def _pool(job: Job, options: RunOptions) -> AbstractContextManager[Pool]:
    limit = next((x for x in ("timeout_s", "memory_gb") if options[x] is not None), "")
    if options["scheduler"] is not None:
        if limit:
            raise InputError(
                f"{limit} is for processes of this machine; give `dask worker` its own --memory-limit, or leave "
                "--scheduler out."
            )
        return _cluster(job, options)
    if options["workers"] == 0:
        if limit:
            raise InputError(
                f"{limit} ends a process that makes samples, and workers is 0; give --workers 1 or more."
            )
        return nullcontext(Pool(partial(_made_here, replace(job, capture=False)), lambda: 1))
    return _processes(job, options["workers"] or usual_workers(), options["timeout_s"])


def _made_here(job: Job, task: Task) -> futures.Future[Ended]:
    future = futures.Future[Ended]()
    future.set_result(run_task(job, task))
    return future


@contextmanager
def _processes(job: Job, workers: int, timeout_s: float | None) -> Iterator[Pool]:
    """Processes of this machine, which end with the block, and with this process however it ends."""
    from pebble import ProcessPool

    context: Any = multiprocessing.get_context("spawn")
    if os.name == "posix":
        _begin_tracker()
    with _without_main(), undone_if_stopped(_end_workers):
        pool = ProcessPool(workers, initializer=_begin_worker, context=context)
        try:
            yield Pool(
                lambda task: pool.schedule(run_task, (job, task), timeout=timeout_s),
                lambda: 2 * workers,  # the one that it makes, and one that waits for it
            )
        finally:
            pool.stop()  # type: ignore[no-untyped-call]
            pool.join()


def _end_workers() -> None:
    """Runs when the run is stopped: nothing is finished any more while what is complete is counted."""
    workers = multiprocessing.active_children()
    for worker in workers:
        worker.terminate()
    for worker in workers:
        worker.join(ENDS_WITHIN_S / len(workers))


def _begin_worker() -> None:
    """Runs in a process before its first task: it ends, and undoes what is unfinished, when the run ends."""
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
    """Begin what tidies up after processes. Whoever begins it takes Ctrl-C from then on, so it is not a worker's
    thread, whose processes would take it too; and a stop, which ends this process at once, is no reason to warn."""
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
    """Processes that begin meanwhile do not run the main script again, which may have no guard, or no file."""
    main = vars(sys.modules["__main__"])
    known: Facts = {name: main.pop(name) for name in ("__file__", "__spec__") if name in main}
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(known)


@contextmanager
def _cluster(job: Job, options: RunOptions) -> Iterator[Pool]:
    """The workers of a Dask scheduler. Raises InputError where there is none."""
    import distributed
    from distributed.utils import silence_logging_cmgr

    address = options["scheduler"]
    given = options["tls_ca"], options["tls_cert"], options["tls_key"]
    names = "tls_ca_file", "tls_client_cert", "tls_client_key"
    tls = {name: file for name, file in zip(names, given, strict=True) if file is not None}
    with silence_logging_cmgr(logging.CRITICAL):
        try:
            security = distributed.Security(require_encryption=True, **tls) if tls else None
            client = distributed.Client(address, timeout="20s", security=security)
        except (
            OSError,
            ValueError,
            TypeError,
        ) as error:  # the last one of TLS without a certificate
            raise InputError(
                f"there is no Dask scheduler at {address} ({error}); start one with `dask scheduler`, and "
                "workers with `dask worker ADDRESS --nthreads 1`."
            ) from None

        def check() -> None:
            if client.status != "running":
                raise InputError(
                    f"the Dask scheduler at {address} is gone; run it again to make the rest."
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


def _in_worker(versions: Config, job: Job, task: Task) -> Ended:
    """Runs in a worker of Dask. Raises InputError where it has other versions of what pixels depend on."""
    for name, version in versions.items():
        if (other := made_by().get(name)) != version:
            raise InputError(
                f"a worker of the Dask cluster has {name} {other or '(not installed)'}, and this run has "
                f"{version or 'none'}; give them the same version."
            )
    with _ONE_AT_A_TIME:
        return run_task(job, task)


def usual_workers() -> int:
    """Processes that a machine can feed: a render uses all its cores, and while it writes another one renders."""
    has_affinity = hasattr(os, "sched_getaffinity")
    cores = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1
    return min(cores, 2)
