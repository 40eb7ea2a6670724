"""One task of a run: a view with its samples, made in this process; what became of it."""

from __future__ import annotations

import faulthandler
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..core import DiskFull, InputError
from ..io.worker_log import fatal_tries, forget, last_said, log_of, logged, note_death
from ..stopping import whole_step
from .planned import PlannedView
from .store import Store

MOST_TRIES = 3
Told = Callable[[str, int], object]
"""Called with what is done now (rendering, exposing, sample) and how many samples that completes."""


@dataclass(frozen=True)
class Outcome:
    """What became of a view.

    samples : that were made.  seconds : that it took.  failed : why it is in quarantine, or nothing.
    full : path, bytes and reason where the disk takes no more.
    """

    view: str
    samples: int = 0
    seconds: float = 0.0
    failed: str = ""
    full: tuple[str, int | None, str] | None = None


def log_path(store: Store, key: str) -> Path:
    """Where the log of a view is while it is made."""
    return store.folder / "quarantine" / f"{key}.log"


def run_task(
    folder: str, view: PlannedView, told: Told, timeout_s: float | None = None, capture: bool = True
) -> Outcome:
    """Make what is missing of a view; errors become an outcome.

    timeout_s : for the render and for each sample; this process ends when it is over, with the stack in its log.
    """
    from .make import make_view

    store, started, made = Store(Path(folder)), time.monotonic(), 0
    path = log_path(store, view.key)

    try:
        with logged(path, capture) as log:

            def doing(what: str) -> None:
                if timeout_s is not None:
                    faulthandler.dump_traceback_later(timeout_s, exit=True, file=log)
                told(what, 0)

            for _ in make_view(store, view, doing):
                made += 1
                told("sample", 1)
    except DiskFull as error:
        return Outcome(view.key, made, time.monotonic() - started, full=(str(error.path), error.size, error.why))
    except InputError as error:
        quarantine(store, view, str(error))
        return Outcome(view.key, made, time.monotonic() - started, failed=str(error))
    finally:
        if timeout_s is not None:
            faulthandler.cancel_dump_traceback_later()
    return Outcome(view.key, made, time.monotonic() - started)


def quarantine(store: Store, view: PlannedView, why: str) -> None:
    """Note that a view cannot be made, with its log; later runs leave it out."""
    path = log_path(store, view.key)
    values = view.samples[0].values
    about = {"view": view.key, "scene": view.scene, "samples": len(view.samples), "first": dict(values), "why": why}
    store.quarantine(view.key, {**about, "log": log_of(path)})
    forget(path)


def note_death_of(store: Store, view: PlannedView) -> None:
    """Note that the process that made a view has died."""
    with whole_step:  # not if this process is being stopped, and the other one with it
        note_death(log_path(store, view.key))


def quarantined_by_tries(store: Store, view: PlannedView) -> Outcome | None:
    """The outcome of a view of which three processes have died, which is put into quarantine; else None."""
    tries = fatal_tries(log_path(store, view.key))
    if tries < MOST_TRIES:
        return None
    said = last_said(log_path(store, view.key))
    why = f"its process died {tries} times{f' ({said})' if said else ''}; its log is in quarantine/{view.key}.json"
    quarantine(store, view, why)
    return Outcome(view.key, failed=why)
