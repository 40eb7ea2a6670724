"""Reads a dataset: its samples in order, their arrays, all that is known of them, and batches for training."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from ..camera.camera_file import camera_from
from ..core import InputError, nearest
from ..core.checks import require_path
from ..core.html import Table as HtmlTable
from ..core.html import facts, fragment, picture
from ..files.appearing import temporary_copy
from ..files.png import read_png
from ..files.raw_files import read_raw_tiff
from ..files.texts import json_object
from ..files.tiff import READOUTS, read_readouts
from ..output.exr import read_aovs_exr
from ..output.preview import preview
from .keys import Config, Facts
from .sample_facts import SampleFacts
from .store import Row, Store
from .table import Table
from .values import PICTURE, stops_taken

if TYPE_CHECKING:
    from ..camera.camera import Camera
    from ..render.motion.aovs import Aovs

IMAGES = {
    "raw": "frame.tiff",
    "companded": "companded.tiff",
    "clean": "clean.tiff",
    "variance": "temporal_variance.tiff",
    "electrons": "electrons.tiff",
    "electrons_error": "electrons_error.tiff",
}
"""Array → its file."""
PAGES = ("raw", "companded")
"""Images with a page for every frame."""
AOVS_FILE, FACTS, BUDGET = "aovs.exr", "sample.json", "noise_budget.json"
AOVS = ("depth_m", "position_m", "normal", "albedo", "shape_index", "flow_px")
SHORT_NAMES = {"depth": "depth_m", "position": "position_m", "flow": "flow_px"}
SAMPLES_KEPT = 4
"""Contents of samples and lights that are kept, those read last."""
KEY_DIGITS_MIN = 4


@lru_cache(SAMPLES_KEPT)
def _members(store: Store, shard: str, offset: int, size: int) -> Mapping[str, bytes]:
    return store.members(shard, offset, size) if size else {}


@dataclass(frozen=True, repr=False)
class Sample:
    """One sample: ``sample.read("raw")`` is an array, ``sample.files["frame.png"]`` the bytes of a file.

    store : that holds it.  line : its row of the table.
    """

    store: Store
    line: Row

    def __repr__(self) -> str:
        """``<Sample 0f3a…: flat, sony_imx174, exposure_s 0.01, serial 3; train>``."""
        parts = [
            f"{x} {value}" for x, value in self.values.items() if x not in ("pose", "scene")
        ]
        split = f"; {self.split}" if self.split else ""
        return f"<Sample {self.key[:8]}: {', '.join([str(self.values.get('scene')), *parts])[:150]}{split}>"

    def _repr_html_(self) -> str:
        rows = {"split": self.split, **self.values, "files": ", ".join(self.files)}
        pictures = []
        if png := self.files.get(PICTURE):
            columns = read_png(io.BytesIO(png), PICTURE).shape[1]
            pictures.append(picture(png, columns, f"picture of sample {self.key[:8]}"))
        return fragment(f"Sample {self.key[:8]}", *pictures, facts(rows))

    @property
    def key(self) -> str:
        """The hash of its configuration."""
        return self.line.key

    @property
    def split(self) -> str:
        """Train, test, …, or an empty text."""
        return self.line.split

    @property
    def values(self) -> Config:
        """What varies in the dataset, by name."""
        return self.line.values

    @property
    def task(self) -> str:
        """Key of its light, which the samples of a task share."""
        return self.line.shard.partition("-")[0]

    @property
    def files(self) -> Mapping[str, bytes]:
        """Name → bytes of each of its files. Raises InputError for a shard that cannot be read."""
        return _members(self.store, self.line.shard, self.line.offset, self.line.bytes)

    @property
    def view_files(self) -> Mapping[str, bytes]:
        """Name → bytes of each file that the samples of its light share."""
        return _members(
            self.store, self.line.shard, self.line.light_offset, self.line.light_bytes
        )

    def has(self, name: str) -> bool:
        """Return True if it, or its light, has a file of this name."""
        return name in self.files or name in self.view_files

    def content(self, name: str, output: str = "") -> bytes:
        """The bytes of a file of the sample or of its light.  output : for the message, what needs the file.

        Raises InputError where there is none.
        """
        for files in (self.files, self.view_files):
            if name in files:
                return files[name]
        raise InputError(
            f"there is no {self.place(name)}; name what {output or name} needs in the outputs of the dataset, and "
            "make it again."
        )

    def opened(self, name: str) -> AbstractContextManager[Path]:
        """The path of a copy of a file, for ``with``. Raises InputError."""
        return temporary_copy(name, self.content(name), self.place(name))

    def place(self, name: str) -> str:
        """Where a file is, for messages."""
        return f"{self.store.shards / self.line.shard} ({self.key}): {name}"

    @property
    def facts(self) -> Facts:
        """sample.json: configuration, camera, seeds, black and white level, quantiles. Raises InputError."""
        return _facts(self.content(FACTS), self.place(FACTS))

    @cached_property
    def view(self) -> Facts:
        """view.json: what the files of the light were made of. Raises InputError where it has none."""
        return self._json("view.json")

    @cached_property
    def noise_budget(self) -> Facts:
        """noise_budget.json: what each noise source contributes [DN]. Raises InputError where it has none."""
        return self._json(BUDGET, "noise_budget")

    @cached_property
    def readouts(self) -> dict[str, NDArray[np.unsignedinteger]]:
        """Frames of every readout by its name, (N, H, W) [DN], with their ``combined`` code and, of a camera that
        compands, their ``companded`` one. Raises InputError where it has none."""
        self.content(READOUTS, "readouts")
        with self.opened(READOUTS) as path:
            return read_readouts(path)

    @property
    def camera(self) -> Camera:
        """The camera at its gain, as the dataset sets it."""
        config = self.facts["config"]
        return camera_from(config["camera"], "of the sample").at_gain(config["gain"])

    def read(self, name: str) -> NDArray[Any]:
        """An array of the sample. Raises InputError where it has none of this name.

        name : ``raw``, ``companded`` (N, H, W) unsigned [DN]; ``clean`` (H, W) float32 [DN], the expectation of the raw
            frame of this sensor unit; ``variance`` (H, W) float32 [DN²], temporal; ``electrons``, ``electrons_error``
            (H, W) float32 [e-], mean photoelectrons and their standard error by the render; ``preview`` (H, W) or
            (H, W, 3) uint8, of the file or developed from the raw frame; or an AOV, ``depth`` (H, W) [m] for example,
            see docs/frames.md.
        """
        name = SHORT_NAMES.get(name, name)
        if name in AOVS:
            return np.asarray(getattr(self.aovs(name), name))
        if name == "preview":
            return self._preview()
        if name not in IMAGES:
            known = (*IMAGES, "preview", *AOVS)
            raise InputError(
                f"a sample has no {name!r}; it can have {', '.join(known)}.{nearest(name, known)}"
            )
        content = io.BytesIO(self.content(IMAGES[name], name))
        pages = read_raw_tiff(content, self.place(IMAGES[name])).frames
        return pages if name in PAGES else pages[0]

    def aovs(self, name: str = "aovs") -> Aovs:
        """All AOVs of its view.  name : what is needed of them. Raises InputError where it has none."""
        place = f"{self.store.shards / self.line.shard}: {AOVS_FILE}"
        return _aovs(self.content(AOVS_FILE, name), place)

    def _preview(self) -> NDArray[np.uint8]:
        """As bright as without the stops that ``exposure_ev`` takes away; without a file white is that of daylight, as
        nothing stored says what the light of the scene is."""
        if PICTURE in self.files:
            return read_png(io.BytesIO(self.files[PICTURE]), self.place(PICTURE))
        self.content(IMAGES["raw"], "preview")
        gain, origin = (
            stops_taken(self.facts["config"]["exposure"]["ev"]),
            self.facts["image"]["origin"],
        )
        return preview(self.read("raw")[0], self.camera, gain, tuple(origin))

    def _json(self, name: str, output: str = "") -> Facts:
        return json_object(
            self.content(name, output), str(self.place(name)), "run the dataset again"
        )


@lru_cache(SAMPLES_KEPT)
def _facts(content: bytes, place: str) -> Facts:
    """Contents of a sample.json, which readers need; those read last are kept."""
    found = json_object(content, place, "run the dataset again")
    try:
        SampleFacts.model_validate(found)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(map(str, fault["loc"]))
        raise InputError(
            f"{place} is not as a run writes it: {where}: {fault['msg']}; run the dataset again."
        ) from None
    return found


@lru_cache(1)
def _aovs(content: bytes, place: str) -> Aovs:
    """The AOVs of the light that was read last."""
    with temporary_copy(AOVS_FILE, content, place) as path:
        return read_aovs_exr(path)


class Dataset(Sequence[Sample]):
    """The samples of a dataset folder, in the order of its file, each read when it is asked for.

    ::

        for sample in ms.Dataset("pairs/", split="train"):
            noisy, clean = sample.read("raw")[0], sample.read("clean")

    folder : as ``mitsuba-sensor dataset run`` made it.  split : only samples of this split.
    Raises InputError where there is no dataset, or no such split.
    """

    def __init__(self, folder: str | os.PathLike[str], split: str | None = None) -> None:
        self.store = Store(require_path("folder", folder, "pairs/"))
        self.table = Table(self.store)
        if split is not None:
            self.table = self.table.where("split", split)

    @property
    def folder(self) -> Path:
        """Of the dataset."""
        return self.store.folder

    def __len__(self) -> int:
        return len(self.table)

    @overload
    def __getitem__(self, number: int) -> Sample: ...

    @overload
    def __getitem__(self, number: slice) -> list[Sample]: ...

    def __getitem__(self, number: int | slice) -> Sample | list[Sample]:
        if isinstance(number, slice):
            return [Sample(self.store, line) for line in self.table[number]]
        return Sample(self.store, self.table[number])

    def __iter__(self) -> Iterator[Sample]:
        return (Sample(self.store, line) for line in self.table)

    def __repr__(self) -> str:
        splits = sorted(self.table.counts("split").items())
        parts = ", ".join(f"{split} {number}" for split, number in splits if split)
        return (
            f"<Dataset: {len(self)} samples{f' ({parts})' if parts else ''} in {self.folder}>"
        )

    def _repr_html_(self) -> str:
        counts = [
            (split or "no split", number)
            for split, number in self.table.counts("split").items()
        ]
        title = f"Dataset of {len(self)} samples in {self.folder}"
        return fragment(title, HtmlTable(("split", "samples"), sorted(counts)))

    @property
    def splits(self) -> list[str]:
        """Names of the splits, in alphabetical order."""
        return sorted(self.table.counts("split"))

    def where(self, **values: object) -> Dataset:
        """The samples that have all of these values, which may be none.

        values : by the names of :attr:`Sample.values`, and split, as ``where(scene="still_life", view=3)``;
            names with dots as ``where(**{"parameters.height": 0.5})``.
        Raises InputError for a name or a value that no sample has.
        """
        chosen = copy(self)
        for name, value in values.items():
            chosen.table = chosen.table.where(name, value)
        return chosen

    def place_of(self, called: str) -> int:
        """The place of a sample.  called : its number from 0, or the beginning of its key.

        Raises InputError where there is none, or several.
        """
        if called.isdecimal() and int(called) < len(self):
            return int(called)
        places = list[int]()
        if len(called) >= KEY_DIGITS_MIN:
            places = self.table.places("key", called.lower())
        if len(places) == 1:
            return places[0]
        how = f"give a number from 0 to {len(self) - 1}, or a key"
        if places:
            raise InputError(
                f"{len(places)} samples have keys that begin with {called!r}; {how}."
            )
        raise InputError(f"no sample of {self.folder} is called {called!r}; {how}.")
