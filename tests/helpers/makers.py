"""What makes the views of a dataset in tests of its processes, which import it as the test's own process does."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

from helpers.waiting import wait_until
from mitsuba_sensor.dataset.plan.configured import PlannedSample
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, PlannedView
from mitsuba_sensor.dataset.run.task import usual_make
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.stopping import whole_step


def make_text(
    store: Store, view: PlannedView, told: Callable[[str], object], dies: str = ""
) -> Iterator[PlannedSample]:
    """A file for each sample, with the ports at which this process and its parent listen."""
    if view.key == dies:
        os.abort()
    for sample in view.samples:
        told("exposing")
        store.commit(
            sample.entry,
            lambda folder: (folder / "a.txt").write_text(repr(listening())),
        )
        yield sample


def listening() -> list[object]:
    """Sockets of this process and its parent that others can connect to, those without a port included."""
    connections = [
        one
        for pid in (os.getpid(), os.getppid())
        for one in psutil.Process(pid).net_connections("all")
    ]
    return [one for one in connections if one.laddr and not one.raddr]


def make_slowly(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """A file for each sample, where a scheduler is killed meanwhile."""
    (pid,) = (store.folder / "scheduler").read_text().split()
    for sample in view.samples:
        store.commit(sample.entry, lambda folder: (folder / "a.txt").write_text("a"))
        with suppress(ProcessLookupError):
            os.kill(int(pid), signal.SIGKILL)
        yield sample


def make_and_kill(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """Kill the program that asked for the view, and tell it something before this process can end for it."""
    program = os.getppid()
    (store.folder.parent / "worker").write_text(str(os.getpid()))
    whole_step.acquire()
    os.kill(program, signal.SIGKILL)
    wait_until(lambda: os.getppid() != program)
    told("exposing")
    whole_step.release()
    wait_until(lambda: False)
    yield view.samples[0]


def make_large(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """Take 0.6 GB and wait to be ended for it."""
    content = bytearray(b"x") * (6 * 10**8)
    signal.pause()
    yield view.samples[len(content)]


def dies_loading(
    store: Store, view: PlannedView, told: Callable[[str], object], times: int
) -> Iterator[PlannedSample]:
    """End the first processes before they have loaded what renders; a file for each sample in the others."""
    begun = store.folder.parent / "begun"
    begun.mkdir(exist_ok=True)
    if len([*begun.iterdir()]) < times:
        (begun / str(os.getpid())).touch()
        os.abort()
    return write_text(store, view, told)


def load_slowly(
    store: Store, view: PlannedView, told: Callable[[str], object], load_s: float
) -> Iterator[PlannedSample]:
    """Load what renders for longer than a view may take; a file for each sample."""
    time.sleep(load_s)
    return write_text(store, view, told)


def make_counted(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """A file for each sample: the worker of a cluster that made it, and how many were being made at once."""
    import distributed

    worker, begun = distributed.get_worker().address, store.folder / "begun"
    for sample in view.samples:
        begun.mkdir(exist_ok=True)
        own = begun / sample.key
        own.touch()
        time.sleep(0.05)
        said = f"{worker} {len([*begun.iterdir()])}"
        store.commit(sample.entry, lambda folder: (folder / "a.txt").write_text(said))  # noqa: B023
        own.unlink()
        yield sample


def write_text(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """A file for each sample."""
    told("exposing")
    for sample in view.samples:
        store.commit(sample.entry, lambda folder: (folder / "a.txt").write_text("a"))
        yield sample


def make_and_log_renders(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """The samples, and a line for each render in a file beside their folder."""
    log_renders(store.folder.parent / "renders")
    return usual_make(store, view, told)


def log_renders(path: Path, waits: bool = False) -> None:
    """From now on each render of this process appends its number to a file.

    waits : the first render of all then waits to be killed.
    """
    from mitsuba_sensor.dataset.run.view_render import ViewRender  # slow

    own = ViewRender.light

    def light(self: Any) -> Any:
        is_first = not path.exists()
        with path.open("a") as log:
            log.write(f"{os.getpid()}\n")
        if waits and is_first:
            signal.pause()
        return own(self)

    if own.__module__ != __name__:
        ViewRender.light = light  # type: ignore[method-assign]


def run_and_log_renders(
    tables: Mapping[str, Any], roots: Path, folder: Path, shard: tuple[int, int]
) -> None:
    """A part of a run; the first render of all waits to be killed."""
    from mitsuba_sensor.dataset.run.run import run

    log_renders(folder.parent / "renders", waits=True)
    plan = DatasetPlan(read_dataset(tables), [roots], "text")
    run(plan, folder, workers=0, shard=shard, progress=False)
