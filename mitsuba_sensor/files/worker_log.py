"""The log of one view while it is made: who began it and when, and what its process printed; gone when it is done.

A process that dies leaves it behind, with what it printed last. Deaths are counted of those that died by themselves:
they say so, or the program that watches them does.
"""

from __future__ import annotations

import errno
import faulthandler
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path

from .disk_errors import disk_sentences

BEGUN = b"# begun by "
DIED = b"\n# died\n"
CRASHED = b"Fatal Python error:", b"Timeout ("
"""Beginnings of what a process writes when it dies of a signal of its own, or of its time limit (faulthandler)."""
MOST_BYTES = 16_000  # that are kept of a log, from its end
MOST_BYTES_IN_ALL = 2**24
TRIES = 10
"""To make a log in a folder that other runs remove when it is empty."""


@contextmanager
def logged(path: Path, capture: bool) -> Iterator[int]:
    """Note that this process begins; the note goes when the block ends, however it ends, unless the process dies.

    Yields the open log, into which a process that dies of a signal of its own writes where it was.
    capture : what is printed on stderr goes there too, also what libraries print.
    Raises DiskFull and InputError.
    """
    begun = begun_by_this()
    with ExitStack() as stack:
        with disk_sentences(path, len(begun)):
            log = stack.enter_context(_opened(path))
            stack.callback(forget, path)
            log.write(begun)
        stack.enter_context(_traces_to(log.fileno()))
        if capture:
            stack.enter_context(_stderr_to(log.fileno()))
        yield log.fileno()


def begun_by_this() -> bytes:
    """A line that says which process begins, and when."""
    return b"%s%s %d %d\n" % (BEGUN, socket.gethostname().encode(), os.getpid(), time.time())


def _opened(path: Path) -> FileIO:
    """The log, open at its end; its folder is made again where another run has removed it, empty, meanwhile."""
    for _ in range(TRIES):
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError):
            return path.open("ab", buffering=0)
    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))


@contextmanager
def _traces_to(file: int) -> Iterator[None]:
    enabled = faulthandler.is_enabled()
    faulthandler.enable(file)
    try:
        yield
    finally:
        if enabled:
            faulthandler.enable(2)
        else:
            faulthandler.disable()


@contextmanager
def _stderr_to(file: int) -> Iterator[None]:
    kept = os.dup(2)
    sys.stderr.flush()
    os.dup2(file, 2)
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(kept, 2)
        os.close(kept)


def forget(path: Path) -> None:
    """Remove a log."""
    with suppress(OSError):
        path.unlink()


def log_of(path: Path) -> str:
    """The end of a log, empty where there is none."""
    with suppress(OSError):
        return path.read_bytes()[-MOST_BYTES:].decode("utf-8", "replace")
    return ""


def note_death(path: Path) -> None:
    """Note that the process that began last has died by itself; nothing if it still runs, or none has begun."""
    tries = _tries(path)
    if tries and not _died(tries[-1]) and (_elsewhere(tries[-1]) or not _lives(tries[-1])):
        with suppress(OSError), path.open("ab", buffering=0) as log:
            log.write(DIED)


def fatal_tries(path: Path) -> int:
    """How many processes have died of it: those that say so themselves, and those that :func:`note_death` tells of.

    One that was killed together with the program that watches it was stopped by somebody, and is not counted.
    """
    return sum(_died(one) for one in _tries(path))


def is_begun(path: Path) -> bool:
    """Whether a process that still runs has begun it."""
    return any(_lives(one) and not _died(one) for one in _tries(path))


def last_said(path: Path) -> str:
    """The first line that the last process printed, an empty text where it printed nothing."""
    lines = (
        (_tries(path) or [b""])[-1]
        .replace(DIED, b"")
        .decode("utf-8", "replace")
        .splitlines()[1:]
    )
    return next((line.strip() for line in lines if line.strip()), "")


def _tries(path: Path) -> list[bytes]:
    """What each process wrote, from its beginning on."""
    try:
        with path.open("rb") as log:
            return [BEGUN + one for one in log.read(MOST_BYTES_IN_ALL).split(BEGUN)[1:]]
    except OSError:
        return []


def _died(one: bytes) -> bool:
    return DIED in one or any(line.startswith(CRASHED) for line in one.splitlines())


def _began(one: bytes) -> tuple[str, int, float]:
    """Machine, number and second of a process. Raises ValueError."""
    host, pid, seconds = (
        one.splitlines()[0].removeprefix(BEGUN).decode("utf-8", "replace").split()
    )
    return host, int(pid), float(seconds)


def _elsewhere(one: bytes) -> bool:
    with suppress(ValueError):
        return _began(one)[0] != socket.gethostname()
    return False


def _lives(one: bytes) -> bool:
    try:
        host, pid, seconds = _began(one)
        if host != socket.gethostname():
            return time.time() - seconds < 3600
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat")
        return (
            not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"
        )  # dead
    except PermissionError:
        return True
    except (ValueError, OSError):
        return False
