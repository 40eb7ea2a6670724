"""How much memory is free, before arrays are made that have no place in it, and how much a process has."""

from __future__ import annotations

from pathlib import Path

CONTAINER = Path("/sys/fs/cgroup")
"""Linux: what a container may have and has."""


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


def resident_memory_bytes(process_id: int) -> int:
    """Memory that a process has; 0 for one that has ended [byte]."""
    import psutil

    try:
        return int(psutil.Process(process_id).memory_info().rss)
    except psutil.Error:
        return 0


def _text(name: str) -> str:
    """A file of the container; nothing where there is none."""
    try:
        return (CONTAINER / name).read_text("ascii")
    except (OSError, UnicodeDecodeError):
        return ""
