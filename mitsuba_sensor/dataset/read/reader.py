"""Reads a dataset that was made: its samples in order, their arrays, and all that is known of them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from ...core import InputError, nearest
from ...core.checks import require_path
from ...files.objects import Objects, Place, is_address
from ...files.raw_files import read_raw_tiff
from ...files.readout_pages import READOUTS, read_readouts
from ...files.texts import json_object
from ...output.exr import read_aovs_exr
from ..index.origin import index_of
from ..index.part import Line
from ..store.entry_files import CHANGED, EntryFiles, FolderFiles, ShardFiles, require_file
from ..store.keys import Config, Facts
from ..store.record import SHARDS
from ..store.store import Store
from .previews import preview_of_sample

if TYPE_CHECKING:
    from ...render.motion.aovs import Aovs

IMAGES = {
    "raw": "frame.tiff",
    "companded": "companded.tiff",
    "clean": "clean.tiff",
    "variance": "temporal_variance.tiff",
    "electrons": "electrons.tiff",
    "electrons_error": "electrons_error.tiff",
}
PAGES = ("raw", "companded")
"""Images with a page for every frame."""
NO_ARRAYS = {
    "noise_budget": "sample.noise_budget",
    "readouts": "sample.readouts",
    "aovs": "sample.read(name), by the name of one of them, e.g. 'depth_m',",
    "irradiance": 'ms.read_irradiance of the file sample.view_files.opened("irradiance.exr")',
    "dng": 'the file sample.files.content("frame.dng")',
}
"""Outputs that are not read as arrays, and what has them."""
AOVS = ("depth_m", "position_m", "normal", "albedo", "shape_index", "flow_px")


@dataclass(frozen=True)
class Sample:
    """One sample.

    key : the hash of its configuration.  split : train, test, …, or an empty text.  values : what varies in the
    dataset.  files, view_files : its files, and those that all samples of its view share:
    ``files.content("frame.png")`` are the bytes of one, and ``with files.opened("frame.png") as path:`` gives it a
    path.  view_key : of its view.
    """

    key: str
    split: str
    values: Config
    files: EntryFiles
    view_files: EntryFiles
    view_key: str = ""

    @cached_property
    def facts(self) -> Facts:
        """sample.json: configuration, camera, seeds, black and white level, quantiles. Raises InputError."""
        return self._facts(self.files, "sample.json")

    @cached_property
    def view(self) -> Facts:
        """view.json: what the files of the view were made of. Raises InputError where it has none."""
        return self._facts(self.view_files, "view.json")

    @cached_property
    def noise_budget(self) -> Facts:
        """noise_budget.json: what each noise source contributes [DN]. Raises InputError where it has none."""
        require_file(self.files, "noise_budget.json", "noise_budget")
        return self._facts(self.files, "noise_budget.json")

    @cached_property
    def readouts(self) -> dict[str, NDArray[np.unsignedinteger]]:
        """Frames of every read-out by its name, (N, H, W) [DN], with their ``combined`` code and, of a camera that
        compands, their ``companded`` one. Raises InputError where it has none."""
        require_file(self.files, READOUTS, "readouts")
        with self.files.opened(READOUTS) as path:
            return read_readouts(path)

    @property
    def folder(self) -> Path:
        """The folder of its files. Raises InputError where they are in a shard."""
        return self.files.folder

    @property
    def view_folder(self) -> Path:
        """The folder of the files of its view. Raises InputError where they are in a shard."""
        return self.view_files.folder

    def read(self, name: str) -> NDArray[Any]:
        """An array of the sample. Raises InputError where it has none of this name.

        name : ``raw``, ``companded`` (N, H, W) unsigned [DN]; ``clean`` (H, W) float32 [DN], the expectation of the raw
            frame of this chip; ``variance`` (H, W) float32 [DN²], temporal; ``electrons``, ``electrons_error`` (H, W)
            float32 [e-], mean photoelectrons and their standard error by the render; ``preview`` (H, W) or (H, W, 3)
            uint8, of the file or developed from the raw frame; or an AOV, see docs/clean-frames-and-aovs.md.
        """
        if name in AOVS:
            return np.asarray(getattr(self.aovs(name), name))
        if name == "preview":
            return preview_of_sample(self)
        if name in NO_ARRAYS:
            raise InputError(f"{name} of a sample is no array; {NO_ARRAYS[name]} has it.")
        if name not in IMAGES:
            known = (*IMAGES, "preview", *AOVS)
            raise InputError(
                f"a sample has no {name!r}; it can have {', '.join(known)}.{nearest(name, known)}"
            )
        require_file(self.files, IMAGES[name], name)
        file = IMAGES[name]
        pages = read_raw_tiff(self.files.readable(file), self.files.place(file)).frames
        return pages if name in PAGES else pages[0]

    def aovs(self, name: str = "aovs") -> Aovs:
        """All AOVs of its view.  name : what is needed of them. Raises InputError where it has none."""
        require_file(self.view_files, "aovs.exr", name)
        with self.view_files.opened("aovs.exr") as path:
            return read_aovs_exr(path)

    def _facts(self, files: EntryFiles, name: str) -> Facts:
        return json_object(files.content(name), files.place(name), CHANGED)


class Dataset(Sequence[Sample]):
    """The samples of a dataset folder, in the order of its file, each read from the index when it is asked for.

    ::

        for sample in ms.Dataset("pairs/", split="train"):
            noisy, clean = sample.read("raw")[0], sample.read("clean")

    folder : as ``mitsuba-sensor dataset run`` made it, or an address like ``s3://bucket/pairs`` to which
        ``mitsuba-sensor dataset push`` has put it.  split : only those of this split.
    Raises InputError where there is no dataset, or no such split.
    """

    def __init__(self, folder: str | os.PathLike[str], split: str | None = None) -> None:
        self.folder: Place
        self._store: Store | Objects
        if is_address(folder):
            self.folder = self._store = Objects(str(folder))
        else:
            self.folder = require_path("folder", folder, "pairs/")
            self._store = Store(self.folder)
        self.lines = index_of(self.folder)
        if split is not None:
            self.lines = self.lines.where("split", split)

    def __len__(self) -> int:
        return len(self.lines)

    @overload
    def __getitem__(self, number: int) -> Sample: ...

    @overload
    def __getitem__(self, number: slice) -> list[Sample]: ...

    def __getitem__(self, number: int | slice) -> Sample | list[Sample]:
        if isinstance(number, slice):
            return [sample_of(self._store, line) for line in self.lines[number]]
        return sample_of(self._store, self.lines[number])

    def __iter__(self) -> Iterator[Sample]:
        return (sample_of(self._store, line) for line in self.lines)

    def __repr__(self) -> str:
        splits = self.lines.counts("split").items()
        parts = ", ".join(f"{split} {number}" for split, number in sorted(splits) if split)
        return (
            f"<Dataset: {len(self)} samples{f' ({parts})' if parts else ''} in {self.folder}>"
        )

    @property
    def splits(self) -> list[str]:
        """Names of the splits, in alphabetical order."""
        return sorted(self.lines.counts("split"))

    def where(self, **values: object) -> Dataset:
        """The samples that have all of these values, which may be none.

        values : by the names of :attr:`Sample.values`, and split, as ``where(scene="still_life", view=3)``;
            names with dots as ``where(**{"parameters.height": 0.5})``.
        Raises InputError for a name or a value that no sample has.
        """
        chosen = copy(self)
        for name, value in values.items():
            chosen.lines = chosen.lines.where(name, value)
        return chosen


def sample_of(store: Store | Objects, line: Line) -> Sample:
    """The sample of a line of the index."""
    return Sample(line.key, line.split, line.values, *files_of(store, line), line.view)


def files_of(store: Store | Objects, line: Line) -> tuple[EntryFiles, EntryFiles]:
    """The files of a sample, and those of its view."""
    place = line.place
    if isinstance(store, Objects):
        if place is None:
            raise InputError(
                f"{store} is not as `mitsuba-sensor dataset push` wrote it; push it again."
            )
        path: Place = store / SHARDS / place.shard
    elif place is None:
        of_view = store.folder_of("views", line.view_name)
        return FolderFiles(store.folder_of("samples", line.name)), FolderFiles(of_view)
    else:
        path = store.shards.folder / place.shard
    of_sample = ShardFiles(path, place.offset, line.key, place.bytes)
    if place.view_offset == place.offset:
        return of_sample, of_sample
    return of_sample, ShardFiles(path, place.view_offset, None)
