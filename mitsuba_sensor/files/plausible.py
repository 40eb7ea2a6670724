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
    require_plausible_ratio(str(path), path.stat().st_size, unpacked_bytes)


def require_plausible_ratio(place: str, stored_bytes: int, unpacked_bytes: int) -> None:
    """Raise InputError where they cannot be in so many bytes.  place : what has them, for the message."""
    if unpacked_bytes > max(ALWAYS_BYTES, MOST_RATIO * stored_bytes):
        raise InputError(
            f"{place} has {stored_bytes} bytes and says that {unpacked_bytes} come out of them, {MOST_RATIO} times "
            "as many at most are read; it is damaged, or made to fill the memory: write it again, uncompressed if it "
            "is right."
        )
