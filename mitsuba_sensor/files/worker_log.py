"""Standard error of a worker process, kept in a file so its parent can report why the worker died."""

from __future__ import annotations

import faulthandler
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .disk_errors import disk_sentences
from .durable import SCRATCH, make_lasting

_OPEN: list[Path] = []
"""Logs that this process is writing."""


def place_of(folder: Path, name: str) -> Path:
    """Return the path of the log of a task in a folder."""
    return folder / f"{SCRATCH}{name}.log"


@contextmanager
def captured(path: Path, capture: bool) -> Iterator[None]:
    """Write stderr to a file during the block, with output of libraries and the stack of a crash, if ``capture``.

    Raises DiskFull and InputError.
    """
    if not capture:
        yield
        return
    with disk_sentences(path):
        make_lasting(path.parent)
        log = path.open("wb", buffering=0)
    _OPEN.append(path)
    kept, traced = os.dup(2), faulthandler.is_enabled()
    sys.stderr.flush()
    os.dup2(log.fileno(), 2)
    faulthandler.enable(log)
    try:
        yield
    finally:
        sys.stderr.flush()
        faulthandler.enable(2) if traced else faulthandler.disable()
        os.dup2(kept, 2)
        os.close(kept)
        log.close()
        _OPEN.remove(path)


def forget_open() -> None:
    """Remove the logs of this process, which is about to end because its parent is gone."""
    for path in _OPEN:
        forget(path)


def end_of(path: Path, most: int) -> str:
    """Return the last ``most`` bytes of a log as text, and remove the log; "" without a log."""
    end = b""
    with suppress(OSError):
        end = path.read_bytes()[-most:]
    forget(path)
    return end.decode("utf-8", "replace")


def forget(path: Path) -> None:
    """Remove a log."""
    with suppress(OSError):
        path.unlink()


def first_line(log: str) -> str:
    """Return the first line of a log that is not blank."""
    return next((line.strip() for line in log.splitlines() if line.strip()), "")
