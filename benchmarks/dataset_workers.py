"""What many workers of a Dask cluster take of the program that has them make a dataset: throughput and bottleneck.

python benchmarks/dataset_workers.py   # about two minutes, 0.3 GB in a temporary folder

Scheduler, workers and the run itself are each in a process of their own on this machine; a worker is a thread that
sleeps as long as a render takes, and writes the files of its samples.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest import mock

import psutil

from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.plan.configured import PlannedSample
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, PlannedView
from mitsuba_sensor.dataset.run import run as run_module
from mitsuba_sensor.dataset.run.engine import outcomes
from mitsuba_sensor.dataset.run.overview import Overview
from mitsuba_sensor.dataset.store.store import Store

FORECAST_WORKERS = 1000
FORECAST_SAMPLES = (1, 20, 1000)
"""Of a view."""
Work = Callable[[str, Path, DatasetPlan], None]
"""Makes a case by the workers of a scheduler."""
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.interval": "60s",
}
"""What real workers do on machines of their own, and would slow these down."""
TINY_BYTES = 2000
"""Of the file of a sample: 16 × 16 pixels and what is known of them."""


@dataclass(frozen=True)
class Case:
    """views, samples : tasks, and samples of each.  render_s : that a worker sleeps for one."""

    views: int
    samples: int
    render_s: float

    @property
    def plan(self) -> DatasetPlan:
        """A dataset of so many views."""
        light = {"parameters.radiance": {"log_uniform": [1e-5, 1e-3]}}
        tables: dict[str, Any] = {
            "name": "workers",
            "store": {"shard_samples": 0},  # what the stand-in writes are no shards
            "render": {"width": 16, "spp": 16},
            "outputs": ["raw"],
            "scenes": [{"name": "flat", "file": "flat_field"}],
            "cameras": [{"camera": "konnik_table1"}],
            "grid": {"repetition": [*range(self.samples)]},
            "random": {"draws": self.views, "values": light},
        }
        text = "# a stand-in"
        return DatasetPlan(read_dataset(tables), [Path()], text)


def make_stand_in(
    store: Store, view: PlannedView, told: Callable[[str], object], render_s: float
) -> Iterator[PlannedSample]:
    """Sleep as long as a render takes, and write a small file for each sample, which is not flushed to the disk."""
    told("rendering")
    time.sleep(render_s)
    folder = store.folder / "samples" / view.key[:2]
    folder.mkdir(parents=True, exist_ok=True)
    for sample in view.samples:
        (folder / sample.key).write_bytes(bytes(TINY_BYTES))
        yield sample


def make_nothing(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """A task that does nothing."""
    return iter(())


def serve_scheduler(pipe: Connection) -> None:
    """A scheduler in this process, until it is ended."""
    from distributed import Scheduler

    logging.disable()

    async def serve() -> None:
        async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
            pipe.send(scheduler.address)
            await scheduler.finished()

    asyncio.run(serve())


def serve_workers(pipe: Connection, address: str, count: int) -> None:
    """Workers in this process, each a thread, until it is ended."""
    import dask
    from distributed import Worker

    logging.disable()
    dask.config.set(QUIET)

    async def serve() -> None:
        async with asyncio.TaskGroup() as group:
            for _ in range(count):
                worker = Worker(address, nthreads=1, dashboard=False, memory_limit=0)
                await worker
                group.create_task(worker.finished())
            pipe.send(count)

    asyncio.run(serve())


@contextmanager
def begun(function: Callable[..., None], *arguments: object) -> Iterator[tuple[int, Any]]:
    """A process, until the block ends: its number, and the first that it says."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=function, args=(theirs, *arguments), daemon=True)
    process.start()
    try:
        yield process.pid or 0, ours.recv()
    finally:
        process.kill()
        process.join()


def processor_s(process_id: int) -> float:
    """Seconds of a processor that a process has taken."""
    times = psutil.Process(process_id).cpu_times()
    return times.user + times.system


@dataclass(frozen=True)
class Measured:
    """seconds : from the first view to the last one.  the others : processor seconds of each process meanwhile."""

    views: int
    samples: int
    seconds: float
    run_s: float
    scheduler_s: float
    workers_s: float


def measure(
    case: Case, workers: int, work: Callable[[str, Path, DatasetPlan], int]
) -> Measured:
    """Have ``work`` make the case by so many workers; it returns the number of tasks."""
    with ExitStack() as stack:
        scheduler, address = stack.enter_context(begun(serve_scheduler))
        threads, _ = stack.enter_context(begun(serve_workers, address, workers))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        plan = case.plan
        processes = psutil.Process().pid, scheduler, threads
        before, began = [processor_s(one) for one in processes], time.perf_counter()
        work(address, folder / "out", plan)
        took = time.perf_counter() - began
        taken_s = [processor_s(one) - was for one, was in zip(processes, before, strict=True)]
    return Measured(case.views, plan.samples, took, *taken_s)


def have_nothing_made(address: str, folder: Path, plan: DatasetPlan) -> None:
    """Views that nothing is made of: what it takes to hand them out."""
    folder.mkdir()
    asked = complete(RunOptions, {"workers": 0, "scheduler": address})
    ended = outcomes(Store(folder), plan.views(), asked, lambda what, done: None, make_nothing)
    assert sum(1 for _ in ended) == plan.samples


def have_made(address: str, folder: Path, plan: DatasetPlan, render_s: float) -> None:
    """A whole run, its plan and index included; only the pages for people are left out, which read samples."""
    made = partial(outcomes, make=partial(make_stand_in, render_s=render_s))
    page = mock.Mock(return_value=Overview("", ""))
    with mock.patch.multiple(run_module, outcomes=made, write_overview=page):
        progress = run_module.run(plan, folder, scheduler=address, progress=False)
    assert progress.made == plan.samples and not progress.failed, progress


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=200)
    parser.add_argument("--noops", type=int, default=10**4)
    parser.add_argument("--views", type=int, default=4000)
    parser.add_argument("--samples", type=int, default=20, help="of each view")
    parser.add_argument("--render-s", type=float, default=2.0)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    import distributed  # noqa: F401, its time is none of a task's

    noops = measure(Case(asked.noops, 1, 0.0), asked.workers, have_nothing_made)
    case = Case(asked.views, asked.samples, asked.render_s)
    made = measure(case, asked.workers, partial(have_made, render_s=asked.render_s))
    costs = costs_of(noops, made)
    if asked.json:
        print(
            json.dumps({"noops": asdict(noops), "made": asdict(made), "costs": asdict(costs)})
        )
        return
    print("\n".join(lines(asked.workers, case, noops, made, costs)))


@dataclass(frozen=True)
class Costs:
    """Milliseconds of a processor, of the run and of the scheduler, for a view and for each of its samples."""

    run_view_ms: float
    run_sample_ms: float
    scheduler_view_ms: float
    scheduler_sample_ms: float

    def shortest_view_s(self, workers: int, samples: int) -> tuple[float, str]:
        """Seconds that a worker must take for a view of so many samples, that none waits; and who makes them wait."""
        run_ms = self.run_view_ms + samples * self.run_sample_ms
        scheduler_ms = self.scheduler_view_ms + samples * self.scheduler_sample_ms
        slowest_ms, name = max((run_ms, "the run"), (scheduler_ms, "the scheduler"))
        return workers * slowest_ms / 1e3, name


def costs_of(noops: Measured, made: Measured) -> Costs:
    """What a view takes by itself, from views without samples; the rest of a run's time is its samples'."""
    found = list[float]()
    for name in ("run_s", "scheduler_s"):
        view_ms = getattr(noops, name) / noops.views * 1e3
        all_ms = getattr(made, name) * 1e3
        found += [view_ms, max(all_ms - made.views * view_ms, 0) / made.samples]
    return Costs(*found)


def lines(
    workers: int, case: Case, noops: Measured, made: Measured, costs: Costs
) -> Iterator[str]:
    """What was measured, and what follows from it for many workers."""
    yield f"{noops.views} views without samples, {workers} workers: {noops.views / noops.seconds:.0f} views/s"
    yield f"  processor time of a view: run {costs.run_view_ms:.2f} ms, scheduler {costs.scheduler_view_ms:.2f} ms"
    best = workers * case.samples / case.render_s
    rate = made.samples / made.seconds
    yield (
        f"{case.views} views of {case.samples} samples, {case.render_s:g} s each, {workers} workers: {rate:.0f} "
        f"samples/s of the {best:.0f} that they could make"
    )
    shares = made.run_s / made.seconds, made.scheduler_s / made.seconds
    yield f"  share of one processor: run {shares[0]:.0%}, scheduler {shares[1]:.0%}"
    yield (
        f"  processor time of a sample more: run {costs.run_sample_ms:.2f} ms, scheduler "
        f"{costs.scheduler_sample_ms:.2f} ms"
    )
    for samples in FORECAST_SAMPLES:
        view_s, name = costs.shortest_view_s(FORECAST_WORKERS, samples)
        yield (
            f"forecast: {FORECAST_WORKERS} workers are busy where a view of {samples} samples takes {view_s:.2g} s or "
            f"more, then {FORECAST_WORKERS * samples / view_s:.0f} samples/s; {name} is the bottleneck"
        )


if __name__ == "__main__":
    main()
