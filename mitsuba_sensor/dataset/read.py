"""Reads a dataset: its samples in order, their arrays, and everything known of them."""

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
from .values import PICTURE, preview_gain

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
PAGED = ("raw", "companded")
"""Images with a page for every frame."""
AOVS_FILE, FACTS, BUDGET = "aovs.exr", "sample.json", "noise_budget.json"
AOVS = ("depth_m", "position_m", "normal", "albedo", "shape_index", "flow_px")
SHORT_NAMES = {"depth": "depth_m", "position": "position_m", "flow": "flow_px"}
CONTENTS_KEPT = 4
"""Contents of samples and lights that are kept in memory, the latest ones."""
KEY_DIGITS_MIN, REPR_SETTINGS_MAX = 4, 150
RUN_AGAIN = "run the dataset again"


@lru_cache(CONTENTS_KEPT)
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
        names = (x for x in self.values if x not in ("pose", "scene"))
        parts = [str(self.values.get("scene")), *(f"{x} {self.values[x]}" for x in names)]
        split = f"; {self.split}" if self.split else ""
        return f"<Sample {self.key[:8]}: {', '.join(parts)[:REPR_SETTINGS_MAX]}{split}>"

    def _repr_html_(self) -> str:
        rows, title = (
            {"split": self.split, **self.values, "files": ", ".join(self.files)},
            f"Sample {self.key[:8]}",
        )
        if PICTURE not in self.files:
            return fragment(title, facts(rows))
        png = self.files[PICTURE]
        columns = read_png(io.BytesIO(png), PICTURE).shape[1]
        return fragment(title, picture(png, columns, f"picture of {title}"), facts(rows))

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
        """Name → bytes of each of its files. Raises InputError for an unreadable shard."""
        return _members(self.store, self.line.shard, self.line.offset, self.line.bytes)

    @property
    def view_files(self) -> Mapping[str, bytes]:
        """Name → bytes of each file that the samples of its light share."""
        return _members(
            self.store, self.line.shard, self.line.light_offset, self.line.light_bytes
        )

    def has(self, name: str) -> bool:
        """Return True if the sample or its light has a file of this name."""
        return name in self.files or name in self.view_files

    def content(self, name: str, output: str = "") -> bytes:
        """Return the bytes of a file of the sample or of its light. Raises InputError for a missing file.

        output : of the dataset that writes the file, if there is any.
        """
        for files in (self.files, self.view_files):
            if name in files:
                return files[name]
        if output:
            raise _lacks(output)
        raise InputError(f"there is no {self.place(name)}; {RUN_AGAIN}.")

    def opened(self, name: str) -> AbstractContextManager[Path]:
        """Return the path of a copy of a file, for ``with``. Raises InputError."""
        return temporary_copy(name, self.content(name), self.place(name))

    def place(self, name: str) -> str:
        """Return where a file is, for messages."""
        return f"{self.store.shards / self.line.shard} ({self.key}): {name}"

    @property
    def facts(self) -> Facts:
        """sample.json: configuration, camera, seeds, black and white level, quantiles. Raises InputError."""
        return _facts(self.content(FACTS), self.place(FACTS))

    @cached_property
    def noise_budget(self) -> Facts:
        """noise_budget.json: the contribution of each noise source [DN]. Raises InputError for a missing file."""
        content = self.content(BUDGET, "noise_budget")
        return json_object(content, self.place(BUDGET), RUN_AGAIN)

    @cached_property
    def readouts(self) -> dict[str, NDArray[np.unsignedinteger]]:
        """Frames of every readout by its name, shape (N, H, W) [DN], with the ``combined`` and the ``companded`` code.
        Raises InputError for a missing file."""
        self.content(READOUTS, "readouts")
        with self.opened(READOUTS) as path:
            return read_readouts(path)

    @property
    def camera(self) -> Camera:
        """The camera at its gain, as the dataset sets it."""
        config = self.facts["config"]
        return camera_from(config["camera"], "of the sample").at_gain(config["gain"])

    def read(self, name: str) -> NDArray[Any]:
        """Return an array of the sample. Raises InputError for a missing array.

        name : ``raw``, ``companded`` (N, H, W) unsigned [DN]; ``clean`` (H, W) float32 [DN], the expectation of the raw
            frame of this sensor unit; ``variance`` (H, W) float32 [DN²], temporal; ``electrons``, ``electrons_error``
            (H, W) float32 [e-], mean photoelectrons and their standard error by the render; ``preview`` (H, W) or
            (H, W, 3) uint8, of the file or developed from the raw frame; or an AOV, e.g. ``depth`` (H, W) [m], see
            docs/frames.md.
        """
        asked, name = name, SHORT_NAMES.get(name, name)
        if name in AOVS:
            if not self.has(AOVS_FILE):
                raise _lacks("aovs", asked)
            return np.asarray(getattr(self.aovs(), name))
        if name == "preview":
            return self._preview()
        if name not in IMAGES:
            short = {long: short for short, long in SHORT_NAMES.items()}
            names = (*IMAGES, "preview", *(short.get(x, x) for x in AOVS))
            raise InputError(
                f"a sample has no {name!r}; it can have {', '.join(names)}.{nearest(str(name), names)}"
            )
        content = io.BytesIO(self.content(IMAGES[name], name.removesuffix("_error")))
        frames = read_raw_tiff(content, self.place(IMAGES[name])).frames
        return frames if name in PAGED else frames[0]

    def aovs(self) -> Aovs:
        """Return all AOVs of its view. Raises InputError for a missing file."""
        place = f"{self.store.shards / self.line.shard}: {AOVS_FILE}"
        return _aovs(self.content(AOVS_FILE, "aovs"), place)

    def _preview(self) -> NDArray[np.uint8]:
        """Return the preview, as bright as without a negative ``exposure_ev``; without a file white is daylight, as no
        stored file has the light of the scene."""
        if PICTURE in self.files:
            return read_png(io.BytesIO(self.files[PICTURE]), self.place(PICTURE))
        gain = preview_gain(self.facts["config"]["exposure"]["ev"])
        origin = tuple(self.facts["image"]["origin"])
        return preview(self.read("raw")[0], self.camera, gain, origin)


def _lacks(output: str, array: str = "") -> InputError:
    """Return the error for a sample without an output.  array : that was asked for and needs the output."""
    needing = f", so it has no {array}" if array else ""
    return InputError(
        f"the sample has no {output}{needing}; add {output!r} to outputs in the dataset file and run it again in a new "
        "folder."
    )


@lru_cache(CONTENTS_KEPT)
def _facts(content: bytes, place: str) -> Facts:
    """Return the checked content of a sample.json."""
    sample_facts = json_object(content, place, RUN_AGAIN)
    try:
        SampleFacts.model_validate(sample_facts)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(map(str, fault["loc"]))
        raise InputError(
            f"{place} is not as a run writes it: {where}: {fault['msg']}; {RUN_AGAIN}."
        ) from None
    return sample_facts


@lru_cache(1)
def _aovs(content: bytes, place: str) -> Aovs:
    with temporary_copy(AOVS_FILE, content, place) as path:
        return read_aovs_exr(path)


class Dataset(Sequence[Sample]):
    """The samples of a dataset folder, in the order of its file, each read on demand.

    ::

        for sample in ms.Dataset("pairs/", split="train"):
            noisy, clean = sample.read("raw")[0], sample.read("clean")

    folder : that ``mitsuba-sensor dataset run`` made.  split : only samples of this split.
    Raises InputError without a dataset, or for an unknown split.
    """

    def __init__(self, folder: str | os.PathLike[str], split: str | None = None) -> None:
        self.store = Store(require_path("folder", folder, "pairs/"))
        self.table = Table(self.store)
        if split is not None:
            self.table = self.table.where("split", split)

    @property
    def folder(self) -> Path:
        """Folder of the dataset."""
        return self.store.folder

    def __len__(self) -> int:
        return len(self.table)

    @overload
    def __getitem__(self, number: int) -> Sample: ...

    @overload
    def __getitem__(self, number: slice) -> list[Sample]: ...

    def __getitem__(self, number: int | slice) -> Sample | list[Sample]:
        if isinstance(number, slice):
            return [self[place] for place in range(len(self))[number]]
        return Sample(self.store, self.table[number])

    def __iter__(self) -> Iterator[Sample]:
        return (Sample(self.store, line) for line in self.table)

    def __repr__(self) -> str:
        splits = sorted(self.table.counts("split").items())
        parts = ", ".join(f"{split} {number}" for split, number in splits if split)
        shown = f" ({parts})" if parts else ""
        return f"<Dataset: {len(self)} samples{shown} in {self.folder}>"

    def _repr_html_(self) -> str:
        counts = self.table.counts("split").items()
        rows = sorted((split or "no split", number) for split, number in counts)
        title = f"Dataset of {len(self)} samples in {self.folder}"
        return fragment(title, HtmlTable(("split", "samples"), rows))

    @property
    def splits(self) -> list[str]:
        """Names of the splits, in alphabetical order."""
        return sorted(self.table.counts("split"))

    def where(self, **values: object) -> Dataset:
        """Return the samples that have all of these values, perhaps none.

        values : by the names of :attr:`Sample.values`, split, and the actual ``exposed_s``, ``system_gain_dn_per_e``
            and ``black_level_dn``, as ``where(scene="still_life", view=3)``; names with dots as
            ``where(**{"parameters.height": 0.5})``.
        Raises InputError for a name or a value that no sample has.
        """
        chosen = copy(self)
        for name, value in values.items():
            chosen.table = chosen.table.where(name, value)
        return chosen

    def place_of(self, called: str) -> int:
        """Return the place of a sample. Raises InputError for none or several.

        called : its number from 0, or the beginning of its key.
        """
        if called.isdecimal() and int(called) < len(self):
            return int(called)
        places = self.table.places(called.lower()) if len(called) >= KEY_DIGITS_MIN else []
        if len(places) == 1:
            return places[0]
        remedy = f"give a number from 0 to {len(self) - 1}, or a key"
        if places:
            raise InputError(
                f"{len(places)} samples have keys that start with {called!r}; {remedy}."
            )
        raise InputError(f"no sample of {self.folder} is called {called!r}; {remedy}.")
