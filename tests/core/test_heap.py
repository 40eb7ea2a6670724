"""Freed memory returns to the system."""

from __future__ import annotations

from pathlib import Path

import pytest

from mitsuba_sensor.core import heap

PIECES, BYTES = 1000, 100_000


def resident_bytes() -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if "VmRSS" in line)


@pytest.mark.skipif(heap._glibc() is None, reason="another C library than glibc")
def test_memory_freed_between_live_allocations_is_returned() -> None:
    """Every tenth of a thousand blocks stays, so the heap cannot shrink from its end."""
    pieces = [b"x" * (BYTES + k) for k in range(PIECES)]
    kept = pieces[::10]
    del pieces
    before = resident_bytes()
    heap.trim_heap()
    assert before - resident_bytes() > 0.7 * 0.9 * PIECES * BYTES
    assert all(piece.count(b"x") >= BYTES for piece in kept)
