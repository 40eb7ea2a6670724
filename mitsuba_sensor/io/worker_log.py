"""The log of one view while it is made: who began it and when, and what its process printed; gone when it is done.

A process that dies leaves it behind: so many tries were fatal, and this is what each printed last.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

BEGUN = "# begun by "
MOST_BYTES = 16_000  # that are read of a log, from its end


@contextmanager
def logged(path: Path, capture: bool) -> Iterator[None]:
    """Note that this process begins; the note goes when the block ends, however it ends, unless the process dies.

    capture : what is printed on stderr goes into the log, also what libraries and a dying process print.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab", buffering=0) as log:
        log.write(f"{BEGUN}{socket.gethostname()} {os.getpid()} {time.time():.0f}\n".encode())
        kept = os.dup(2) if capture else None
        try:
            if kept is not None:
                sys.stderr.flush()
                os.dup2(log.fileno(), 2)
            yield
        finally:
            if kept is not None:
                sys.stderr.flush()
                os.dup2(kept, 2)
                os.close(kept)
            forget(path)


def forget(path: Path) -> None:
    """Remove a log."""
    with suppress(OSError):
        path.unlink()


def log_of(path: Path) -> str:
    """The end of a log, empty where there is none."""
    with suppress(OSError):
        return path.read_bytes()[-MOST_BYTES:].decode("utf-8", "replace")
    return ""


def fatal_tries(path: Path) -> int:
    """How many processes began it and are dead; one of another machine counts when an hour has passed."""
    return sum(not _lives(line) for line in _beginnings(path))


def is_begun(path: Path) -> bool:
    """Whether a process that still runs has begun it."""
    return any(_lives(line) for line in _beginnings(path))


def last_said(path: Path) -> str:
    """The first line that the last process printed, an empty text where it printed nothing."""
    said = log_of(path).rpartition(BEGUN)[2].splitlines()[1:]
    return next((line.strip() for line in said if line.strip()), "")


def _beginnings(path: Path) -> list[str]:
    try:
        with path.open("rb") as log:
            return [line.decode("utf-8", "replace") for line in log if line.startswith(BEGUN.encode())]
    except OSError:
        return []


def _lives(line: str) -> bool:
    try:
        host, pid, seconds = line.removeprefix(BEGUN).split()
        if host != socket.gethostname():
            return time.time() - float(seconds) < 3600
        os.kill(int(pid), 0)
        state = Path(f"/proc/{int(pid)}/stat")
        return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"  # dead
    except PermissionError:
        return True
    except (ValueError, OSError):
        return False
