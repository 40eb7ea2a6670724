"""How much memory is free, before arrays are made that have no place in it, and how much a process has."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CONTAINER = Path("/sys/fs/cgroup")
"""Linux: what a container may have and has."""
LOOKS_EVERY_S = 0.2
"""Between two looks at how much memory a process takes."""
TOO_MUCH_MEMORY = 86
"""Exit code of a process that ends itself because it takes more than it may."""


def free_memory_bytes() -> float:
    """Memory that can be had without taking it from anybody, of the machine or of its container [byte]."""
    import psutil

    free = float(psutil.virtual_memory().available)
    most = _text("memory.max").strip()
    if not most.isdecimal():
        return free
    taken = float(_text("memory.current").strip() or 0)
    statistics = (line.split() for line in _text("memory.stat").splitlines())
    cache = next((float(value) for name, value in statistics if name == "inactive_file"), 0.0)
    return min(free, max(int(most) - (taken - cache), 0.0))


def whole_memory_bytes() -> float:
    """Memory that this machine, or its container, has in all [byte]."""
    import psutil

    whole = float(psutil.virtual_memory().total)
    most = _text("memory.max").strip()
    if not most.isdecimal():
        return whole
    return min(whole, int(most))


@contextmanager
def memory_limit(most_gb: float | None) -> Iterator[None]:
    """End this process, with a line on stderr, where it takes more memory meanwhile."""
    if most_gb is None:
        yield
        return
    import psutil

    process, ended = psutil.Process(), threading.Event()

    def watch() -> None:
        while not ended.wait(LOOKS_EVERY_S):
            if process.memory_info().rss > most_gb * 1e9:
                os.write(2, f"it took more than {most_gb:g} GB of memory\n".encode())
                os._exit(TOO_MUCH_MEMORY)

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        ended.set()


def _text(name: str) -> str:
    """A file of the container; nothing where there is none."""
    try:
        return (CONTAINER / name).read_text("ascii")
    except (OSError, UnicodeDecodeError):
        return ""
