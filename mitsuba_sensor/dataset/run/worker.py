"""A process that makes views for another one: told to end, or left alone, it undoes what is unfinished."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from contextlib import suppress
from multiprocessing import connection
from multiprocessing.connection import Connection

from ...stopping import undo_when_terminated
from .task import Outcome, TaskLimits, run_task


def serve(pipe: Connection, folder: str, limits: TaskLimits) -> None:
    """Make each view that the pipe brings, and send back what is told meanwhile and its outcome; never returns.

    The views are made by a thread, because a signal waits for the main thread, which a render would hold up.
    """
    undo_when_terminated()
    threading.Thread(target=_make_views, args=(pipe, folder, limits), daemon=True).start()
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    _end()


def _make_views(pipe: Connection, folder: str, limits: TaskLimits) -> None:
    def tell(what: str, done: int) -> None:
        with suppress(OSError):  # whom it is told is gone, which is no fault of the view
            pipe.send((what, done))

    try:
        while True:
            outcome: Outcome = run_task(folder, pipe.recv(), tell, limits)
            pipe.send(outcome)
    finally:  # whoever sends the views is gone, or what came is none: it sees this process end
        os.kill(os.getpid(), signal.SIGTERM)


def _end() -> None:
    signal.raise_signal(signal.SIGTERM)
    os._exit(1)  # where that is ignored
