"""Who makes the views: processes of this machine, a Dask cluster of many, or this process alone."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import chain
from multiprocessing import resource_tracker
from typing import Any

from ..core import InputError
from ..stopping import signals_held, undone_if_stopped
from .keys import Facts
from .options import RunOptions
from .planned import PlannedView
from .store import Store
from .task import Make, Outcome, TaskLimits, Told, deaths_of, note_death_of, quarantined_by_tries, run_task, usual_make

TOPIC = "mitsuba-sensor"  # of events that workers send
MOST_EARLY_DEATHS = 10
"""Of processes in a row, each before it had begun a view: then the fault is none of the views'."""
ENDS_S = 1.0
"""In which workers of a stopped run end."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,  # we count ourselves, and only those that had begun
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.98,
    "distributed.worker.multiprocessing-method": "spawn",
    "distributed.comm.timeouts.connect": "60s",
    "distributed.worker.daemon": True,
    "distributed.nanny.pre-spawn-environ": {},  # which would make arrays slow: one thread, memory given back at once
    "distributed.admin.low-level-log-length": 100,  # logs of the scheduler, so that its memory stays as it is
    "distributed.diagnostics.computations.max-history": 1,
    "distributed.diagnostics.erred-tasks.max-history": 1,
}


def outcomes(
    store: Store, views: Iterable[PlannedView], options: RunOptions, told: Told, make: Make = usual_make
) -> Iterator[Outcome]:
    """What becomes of the views, in the order in which they end. Nothing is kept of those that have ended.

    make : yields the samples of a view as they are made.
    """
    limits = TaskLimits(options["timeout_s"], options["workers"] != 0 or options["scheduler"] is not None, make)
    if options["workers"] == 0 and options["scheduler"] is None:
        for view in views:
            yield quarantined_by_tries(store, view) or run_task(str(store.folder), view, told, limits)
        return
    if (first := next(iter(views := iter(views)), None)) is not None:  # no cluster where nothing is missing
        yield from _by_dask(store, chain([first], views), options, (told, limits))


def _by_dask(
    store: Store, views: Iterator[PlannedView], options: RunOptions, asked: tuple[Told, TaskLimits]
) -> Iterator[Outcome]:
    told, limits = asked
    with ExitStack() as stack:
        client, count = _client(options, stack)
        client.subscribe_topic(TOPIC, lambda event: told(*event[1]))
        yield from _spread(client, store, views, count, limits)


def _client(options: RunOptions, stack: ExitStack) -> tuple[Any, Callable[[], int]]:
    """A Dask client, closed with the stack, and how many views may be under way."""
    import dask
    import distributed

    stack.enter_context(dask.config.set(SETTINGS))
    if options["scheduler"] is not None:
        try:
            client = stack.enter_context(distributed.Client(options["scheduler"], timeout="20s"))
        except (OSError, ValueError) as error:
            raise InputError(
                f"there is no Dask scheduler at {options['scheduler']} ({error}); start one with `dask scheduler`, and "
                "workers with `dask worker ADDRESS --nthreads 1`."
            ) from None
        return client, lambda: max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)
    if os.name == "posix":
        _begin_tracker()
    stack.enter_context(_without_main())
    memory = f"{options['memory_gb']}GB" if options["memory_gb"] else 0
    try:
        cluster = stack.enter_context(
            distributed.LocalCluster(
                n_workers=options["workers"],
                threads_per_worker=1,
                memory_limit=memory,
                processes=True,
                dashboard_address="127.0.0.1:0",
                silence_logs=50,
                preload=["mitsuba_sensor.dataset.worker"],
            )
        )
    except (RuntimeError, OSError, TimeoutError) as error:
        raise InputError(
            f"the processes that render could not begin ({error}); try again, or use --workers 0, which has none."
        ) from error
    if hasattr(os, "WNOHANG"):
        stack.enter_context(undone_if_stopped(partial(_end_workers, cluster)))
    client = stack.enter_context(distributed.Client(cluster))
    return client, lambda: options["workers"] or 1


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
    known: Facts = {name: vars(main).pop(name) for name in ("__file__", "__spec__") if name in vars(main)}
    main.__spec__ = None
    try:
        yield
    finally:
        vars(main).update(known)


def _spread(
    client: Any, store: Store, views: Iterator[PlannedView], count: Callable[[], int], limits: TaskLimits
) -> Iterator[Outcome]:
    """Keep as many views under way as there are workers; what killed its worker is tried again."""
    import distributed

    under_way = dict[str, tuple[PlannedView, int]]()  # with the number of processes that had died of it
    futures, tries, early = distributed.as_completed(raise_errors=False), 0, 0

    def submit(view: PlannedView) -> None:
        nonlocal tries
        tries += 1
        future = client.submit(_in_worker, str(store.folder), view, limits, key=f"view-{tries}", pure=False)
        under_way[future.key] = view, deaths_of(store, view)
        futures.add(future)

    def fill() -> Iterator[Outcome]:
        for _ in range(count() - len(under_way)):
            if (view := next(views, None)) is None:
                return
            if found := quarantined_by_tries(store, view):
                yield found
            else:
                submit(view)

    yield from fill()
    while under_way:
        future = next(futures)
        view, before = under_way.pop(future.key)
        if future.status == "finished":
            early = 0
            yield future.result()
        elif isinstance(error := future.exception(), distributed.KilledWorker):
            early = 0 if note_death_of(store, view) > before else early + 1
            if early >= MOST_EARLY_DEATHS:
                raise InputError(
                    f"{early} processes in a row have died before they began a view: too little memory, perhaps, or "
                    "something ends them; run it again with fewer --workers, or with --workers 0, which has none."
                )
            if found := quarantined_by_tries(store, view):
                yield found
            else:
                submit(view)
        else:
            raise error
        del future
        while len(under_way) < count() and (more := list(fill())):
            yield from more


def _end_workers(cluster: Any) -> None:
    """Have the workers of a cluster undo what is unfinished, and wait for that."""
    from distributed.core import Status

    pids = set()
    for nanny in tuple(cluster.workers.values()):
        nanny.status = Status.closing  # which begins no new process
        pids |= {nanny.pid} if nanny.pid else set()
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)
    end = time.monotonic() + ENDS_S
    while pids and time.monotonic() < end:
        for pid in tuple(pids):
            with suppress(ChildProcessError):
                if os.waitpid(pid, os.WNOHANG)[0] == 0:
                    continue
            pids.remove(pid)
        time.sleep(0.005)


def _in_worker(folder: str, view: PlannedView, limits: TaskLimits) -> Outcome:
    """Runs in a worker."""
    import distributed

    worker = distributed.get_worker()
    return run_task(folder, view, lambda what, done: worker.log_event(TOPIC, (what, done)), limits)


def usual_workers() -> int:
    """Processes that a machine can feed: a render uses all its cores, and while it writes another one renders."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return 2 if cores > 1 else 1
