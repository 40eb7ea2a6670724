"""What a process printed while it made something: kept beside the result for the one that watches it, if it dies."""

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
"""Logs that this process writes."""


def place_of(folder: Path, name: str) -> Path:
    """Where the log of something is while it is made in a folder."""
    return folder / f"{SCRATCH}{name}.log"


@contextmanager
def captured(path: Path, capture: bool) -> Iterator[None]:
    """What is printed on stderr meanwhile goes into a file, also what libraries print, and where the process was if it
    dies of a signal of its own.  capture : whether it does. Raises DiskFull and InputError."""
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
    """Remove the logs of this process, which is about to end because nobody watches it any more."""
    for path in _OPEN:
        forget(path)


def end_of(path: Path, most: int) -> str:
    """The last bytes of a log, which goes; an empty text where there is none."""
    said = b""
    with suppress(OSError):
        said = path.read_bytes()[-most:]
    forget(path)
    return said.decode("utf-8", "replace")


def forget(path: Path) -> None:
    """Remove a log."""
    with suppress(OSError):
        path.unlink()


def first_line(log: str) -> str:
    """The first line of a log that says anything."""
    return next((line.strip() for line in log.splitlines() if line.strip()), "")
