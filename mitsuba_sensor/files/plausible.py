"""Refuses files that say they unpack to far more than they have, before memory is taken for it."""

from __future__ import annotations

from pathlib import Path

from ..core import InputError

ALWAYS_BYTES = 2**28  # may come out of any file
MOST_RATIO = (
    200  # of unpacked over stored bytes: frames with noise reach 20, deflate ends at 1032
)


def require_plausible(path: Path, unpacked_bytes: int) -> None:
    """Raise InputError where the pixels that a header announces cannot be in the file."""
    stored = path.stat().st_size
    if unpacked_bytes > max(ALWAYS_BYTES, MOST_RATIO * stored):
        raise InputError(
            f"{path} has {stored} bytes and says that {unpacked_bytes} come out of them, {MOST_RATIO} times as many at "
            "most are read; it is damaged, or made to fill the memory: write it again, uncompressed if it is right."
        )
