"""Free memory of the machine or its container, and a memory limit for a process."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CONTAINER = Path("/sys/fs/cgroup")
"""Linux: limits and use of a container."""
CHECK_PERIOD_S = 0.2
"""Time between two checks of the memory of a process."""
TOO_MUCH_MEMORY = 86
"""Exit code of a process that exceeds its memory limit."""


def free_memory_bytes() -> float:
    """Return the free memory of the machine or its container [byte]."""
    import psutil

    free = float(psutil.virtual_memory().available)
    most = _text("memory.max").strip()
    if not most.isdecimal():
        return free
    used = float(_text("memory.current").strip() or 0)
    statistics = (line.split() for line in _text("memory.stat").splitlines())
    cache = next((float(value) for name, value in statistics if name == "inactive_file"), 0.0)
    return min(free, max(int(most) - (used - cache), 0.0))


def whole_memory_bytes() -> float:
    """Return the total memory of this machine or its container [byte]."""
    import psutil

    total = float(psutil.virtual_memory().total)
    most = _text("memory.max").strip()
    return min(total, int(most)) if most.isdecimal() else total


@contextmanager
def memory_limit(most_gb: float | None) -> Iterator[None]:
    """End this process, with a line on stderr, if it takes more memory during the block."""
    if most_gb is None:
        yield
        return
    import psutil

    process, ended = psutil.Process(), threading.Event()

    def watch() -> None:
        while not ended.wait(CHECK_PERIOD_S):
            if process.memory_info().rss > most_gb * 1e9:
                os.write(2, f"it took more than {most_gb:g} GB of memory\n".encode())
                os._exit(TOO_MUCH_MEMORY)

    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        ended.set()


def _text(name: str) -> str:
    """Return the text of a file of the container; "" without such a file."""
    try:
        return (CONTAINER / name).read_text("ascii")
    except (OSError, UnicodeDecodeError):
        return ""
