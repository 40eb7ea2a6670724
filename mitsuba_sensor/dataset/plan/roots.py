"""Files that a dataset may read: below the folders that the user names, and nowhere else."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path, PurePath

from ...core import InputError
from ...files.scene_references import folder_names


def find_below(name: str, roots: Sequence[Path], what: str) -> Path:
    """The file of this name in the first root that has it.

    Raises InputError for an absolute name, for one with ``..``, for a link that leads out of the root, and where no
    root has the file.  what : the file is, for messages.
    """
    folders = folder_names(roots)
    remedy = f"name its folder with --root and write its path from there (the folders now: {folders})"
    if os.path.isabs(name) or ".." in PurePath(name).parts or "\0" in name:
        raise InputError(
            f"{what} is {name!r}, which may lead out of the folders that may be read; {remedy}."
        )
    for root in roots:
        if os.path.isfile(root / name):  # False also for names that are too long
            if not (root / name).resolve().is_relative_to(root.resolve()):
                raise InputError(
                    f"{what} is {name!r}, a link that leads out of {root}; {remedy}."
                )
            return root / name
    raise InputError(f"{what} is {name[:200]!r}, and there is no such file; {remedy}.")
