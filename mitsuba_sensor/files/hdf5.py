"""New HDF5 files by h5py."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from .disk_errors import disk_sentences

if TYPE_CHECKING:
    import h5py


@contextmanager
def new_hdf5(path: Path) -> Iterator[h5py.File]:
    """Yield a new file. Raises DiskFull."""
    import h5py

    with disk_sentences(path), path.open("w+b") as target, h5py.File(target, "w") as file:
        yield file
