"""How much memory is free, before arrays are made that have no place in it."""

from __future__ import annotations

import math
from pathlib import Path

MEMORY = Path("/proc/meminfo")
CONTAINER = Path("/sys/fs/cgroup")
"""Linux: what the machine has, and what a container may have and has."""


def free_memory_bytes() -> float:
    """Memory that can be had without taking it from anybody [byte]; infinite where the system does not say it."""
    free = 1024.0 * _number(_text(MEMORY), "MemAvailable:")
    most = _text(CONTAINER / "memory.max").strip()
    if most.isdecimal():
        taken = float(_text(CONTAINER / "memory.current").strip() or 0)
        cache = _number(_text(CONTAINER / "memory.stat"), "inactive_file", 0.0)
        free = min(free, max(int(most) - (taken - cache), 0.0))
    return free


def _number(text: str, name: str, default: float = math.inf) -> float:
    """The number behind a name at the beginning of a line."""
    for line in text.splitlines():
        if line.split()[:1] == [name]:
            return float(line.split()[1])
    return default


def _text(path: Path) -> str:
    """A file of the system; nothing where there is none."""
    try:
        return path.read_text("ascii")
    except (OSError, UnicodeDecodeError):
        return ""
