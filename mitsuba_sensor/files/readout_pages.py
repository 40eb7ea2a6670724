"""The pages of readouts.tiff: every read-out of every frame, and what they were combined to, each with its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .tiff import read_named_pages

READOUTS = "readouts.tiff"
BOTH_HALVES = "left and right"
"""The page of a frame of dual pixels."""
COMBINED = ("combined", "companded", BOTH_HALVES)
"""Pages that are no read-out."""


def page_name(frame: int, readout: str) -> str:
    """Of the page of one read-out, or of what they were combined to."""
    return f"frame {frame}, {readout}"


def read_readouts(path: Path) -> dict[str, np.ndarray]:
    """The pages of each name, (N, H, W). Raises InputError for what cannot be read."""
    found = dict[str, list[np.ndarray]]()
    for name, page in read_named_pages(path):
        found.setdefault(name.partition(", ")[2], []).append(page)
    return {name: np.stack(pages) for name, pages in found.items()}
