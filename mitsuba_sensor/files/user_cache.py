"""Arrays that are kept from one run of the program to the next, in the user's cache folder.

What is kept there can be made again at any time: a folder that cannot be written is no error, nor is a user without a
home, and a file that cannot be read counts as missing.
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
    """``$XDG_CACHE_HOME/mitsuba-sensor``, else ``~/.cache/mitsuba-sensor``.

    A relative path counts as none, as XDG says. Raises RuntimeError for a user without a home.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not base.is_absolute():
        base = Path.home() / ".cache"
    return base / FOLDER


def kept_file(name: str) -> Path:
    """The file of what is kept under a name."""
    return cache_folder() / f"{name}.npz"


def read_kept(name: str) -> dict[str, np.ndarray] | None:
    """The arrays that were kept under a name; None where there are none."""
    try:
        return read_arrays(kept_file(name))
    except (OSError, RuntimeError, ValueError, InputError):
        return None


def keep(name: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Keep arrays under a name, where the folder can be written."""
    with suppress(OSError, RuntimeError, InputError):
        file = kept_file(name)
        make_lasting(file.parent)
        write_fpn_maps(file, arrays)
