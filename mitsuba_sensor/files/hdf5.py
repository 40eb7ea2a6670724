"""HDF5 files of groups with attributes, and arrays with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core import InputError
from .disk_errors import disk_sentences

if TYPE_CHECKING:
    import h5py

EXTRA = "pip install 'mitsuba-sensor[hdf5]'"


class Hdf5Writer:
    """Writes groups and arrays by their place, as ``samples/KEY/raw``.  file : of h5py."""

    def __init__(self, file: h5py.File) -> None:
        self._file = file

    def add_group(self, place: str, attributes: Mapping[str, object]) -> None:
        """A group, whose members are read in the order in which they are added.  attributes : plain values; those of
        a table have its name and a dot before theirs, and None has no attribute."""
        group = self._file.create_group(place, track_order=True)
        for name, value in _flat(attributes):
            group.attrs[name] = value

    def add_array(self, place: str, array: np.ndarray, unit: str) -> None:
        """An array, with its unit in the attribute ``units``."""
        self._file.create_dataset(place, data=array).attrs["units"] = unit

    def add_text(self, place: str, text: str) -> None:
        """A text of any length."""
        self._file.create_dataset(place, data=text)

    def add_link(self, place: str, target: str) -> None:
        """Another name of a group."""
        import h5py

        self._file[place] = h5py.SoftLink(f"/{target}")


@contextmanager
def hdf5_writer(path: Path) -> Iterator[Hdf5Writer]:
    """Yield a writer of a new file. Raises InputError where h5py is not installed, DiskFull."""
    try:
        import h5py
    except ImportError:
        raise InputError(f"h5py, which writes HDF5, is not installed; {EXTRA}.") from None
    with disk_sentences(path), path.open("w+b") as target, h5py.File(target, "w") as file:
        yield Hdf5Writer(file)


def _flat(attributes: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, value in attributes.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        elif value is not None:
            yield f"{prefix}{name}", value
