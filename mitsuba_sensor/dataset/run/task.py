"""One task of a run: a view with its samples, made in this process; what became of it."""

from __future__ import annotations

import faulthandler
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from ...core import DiskFull, InputError
from ...files.worker_log import fatal_tries, forget, last_said, log_of, logged, note_death
from ...stopping import whole_step
from ..plan.configured import PlannedSample
from ..plan.planned import PlannedView
from ..store.store import Store

MOST_TRIES = 3
Told = Callable[[str, int], object]
"""Called with what is done now (rendering, exposing, sample) and how many samples that completes."""
Make = Callable[[Store, PlannedView, Callable[[str], object]], Iterator[PlannedSample]]


Full: TypeAlias = tuple[str, int | None, str]
"""Path, bytes and reason of what the disk does not take."""


@dataclass(frozen=True)
class Outcome:
    """What became of a view, or of some of its samples.

    first : number of the first of them.  samples : that were made.  seconds : that it took.
    failed : why it is in quarantine, or nothing.  full : where the disk takes no more.
    """

    view: str
    first: int
    samples: int = 0
    seconds: float = 0.0
    failed: str = ""
    full: Full | None = None


def log_path(store: Store, task_key: str) -> Path:
    """Where the log of a task is while it is made."""
    return store.folder / "quarantine" / f"{task_key}.log"


def usual_make(
    store: Store, view: PlannedView, told: Callable[[str], object]
) -> Iterator[PlannedSample]:
    """:func:`.make.make_view`. Its module and Mitsuba are loaded here, before a sample is asked for."""
    from .make import load_renderer, make_view

    load_renderer()
    return make_view(store, view, told)


@dataclass(frozen=True)
class TaskLimits:
    """timeout_s : for the render and for each sample; the process ends when it is over, with the stack in its log.
    capture : whether what is printed on stderr goes into the log.  make : yields the samples of a view as they are
    made; what it needs is loaded when it is called, which has no time limit and is no view's death."""

    timeout_s: float | None = None
    capture: bool = True
    make: Make = usual_make


@dataclass
class _Timed:
    """Ends the process where what it does takes too long.  log : open file for the stack."""

    timeout_s: float | None
    told: Told
    log: int = 2

    def begin(self, what: str) -> None:
        """Begin to do something, and tell of it."""
        if self.timeout_s is not None:
            faulthandler.dump_traceback_later(self.timeout_s, exit=True, file=self.log)
        self.told(what, 0)


def run_task(
    folder: str, view: PlannedView, told: Told, limits: TaskLimits = TaskLimits()
) -> Outcome:
    """Make what is missing of a view; whatever goes wrong becomes an outcome."""
    store, started, made = Store(Path(folder)), time.monotonic(), 0
    path, task = log_path(store, view.task_key), (view.key, view.first)
    timed = _Timed(limits.timeout_s, told)
    try:
        samples = limits.make(store, view, timed.begin)
        with logged(path, limits.capture) as timed.log:
            for _ in samples:
                made += 1
                told("sample", 1)
    except DiskFull as error:
        full = str(error.path), error.size, error.why
        return Outcome(*task, made, time.monotonic() - started, full=full)
    except InputError as error:
        refused = quarantine(store, view, str(error))
        seconds = time.monotonic() - started
        return Outcome(*task, made, seconds, failed=str(error), full=refused)
    except Exception as error:  # a bug costs one view and not the night
        why = f"{type(error).__name__}: {error}"
        refused = quarantine(store, view, why, traceback.format_exc())
        return Outcome(*task, made, time.monotonic() - started, failed=why, full=refused)
    finally:
        if limits.timeout_s is not None:
            faulthandler.cancel_dump_traceback_later()
    return Outcome(*task, made, time.monotonic() - started)


def quarantine(store: Store, view: PlannedView, why: str, log: str = "") -> Full | None:
    """Note that a view cannot be made, with its log; later runs leave it out. Returns what the disk does not take."""
    path = log_path(store, view.task_key)
    values = view.samples[0].values
    about = {
        "view": view.key,
        "scene": view.scene,
        "samples": len(view.samples),
        "first": dict(values),
        "why": why,
    }
    try:
        store.quarantine(view.key, {**about, "log": log or log_of(path)})
    except DiskFull as error:
        return str(error.path), error.size, error.why
    except InputError as error:
        cause = error.__cause__
        return (
            str(path.with_suffix(".json")),
            None,
            getattr(cause, "strerror", "") or str(error),
        )
    forget(path)
    return None


def note_death_of(store: Store, view: PlannedView) -> int:
    """Note that the process that made a view has died; how many have so far, of those that had begun it."""
    with whole_step:  # not if this process is being stopped, and the other one with it
        note_death(log_path(store, view.task_key))
    return deaths_of(store, view)


def deaths_of(store: Store, view: PlannedView) -> int:
    """How many processes have died of a view."""
    return fatal_tries(log_path(store, view.task_key))


def quarantined_by_tries(store: Store, view: PlannedView) -> Outcome | None:
    """The outcome of a view of which three processes have died, which is put into quarantine; else None."""
    tries = deaths_of(store, view)
    if tries < MOST_TRIES:
        return None
    said = last_said(log_path(store, view.task_key))
    reason = said or "nothing was printed: a signal, or too little memory"
    why = f"its process died {tries} times ({reason}); its log is in quarantine/{view.key}.json"
    full = quarantine(store, view, why)
    return Outcome(view.key, view.first, failed=why, full=full)
