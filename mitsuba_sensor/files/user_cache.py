"""Arrays in the user's cache folder, kept from one run of the program to the next.

They can be recreated at any time, so an unwritable folder or a user without a home is not an error, and an unreadable
file is treated as missing.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..core import InputError
from .durable import make_lasting
from .npz import read_arrays, write_fpn_maps

FOLDER = "mitsuba-sensor"


def cache_folder() -> Path:
    """Return ``$XDG_CACHE_HOME/mitsuba-sensor``, or ``~/.cache/mitsuba-sensor`` if the variable is no absolute path.

    Raises RuntimeError for a user without a home.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not base.is_absolute():
        base = Path.home() / ".cache"
    return base / FOLDER


def kept_file(name: str) -> Path:
    """Return the file of a name in the cache."""
    return cache_folder() / f"{name}.npz"


def read_kept(name: str) -> dict[str, np.ndarray] | None:
    """Return the arrays that were kept under a name, or None."""
    try:
        return read_arrays(kept_file(name))
    except (OSError, RuntimeError, ValueError, InputError):
        return None


def keep(name: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Keep arrays under a name, if the folder is writable."""
    with suppress(OSError, RuntimeError, InputError):
        file = kept_file(name)
        make_lasting(file.parent)
        write_fpn_maps(file, arrays)
