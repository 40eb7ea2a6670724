"""Prepares a Dask worker of this machine: told to end, it undoes what is unfinished."""

from __future__ import annotations

import threading

from ..stopping import undo_when_terminated


def dask_setup(worker: object) -> None:
    """Called by Dask when a worker begins."""
    if threading.current_thread() is threading.main_thread():
        undo_when_terminated()
