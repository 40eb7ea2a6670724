"""Reads a dataset that was made: its samples in order, their arrays, and all that is known of them."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from ..core import InputError, nearest
from ..core.argument_names import tells_of_names
from ..core.checks import require_path
from ..files.raw_files import read_raw
from ..files.readout_pages import READOUTS, read_readouts
from ..files.texts import read_json, text_of_file
from ..output.exr import read_aovs_exr
from .keys import Config, Facts
from .record import INDEX, KEY, sealed, unsealed
from .store import Store

CHANGED = "`mitsuba-sensor dataset verify` finds what is missing or was changed"
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
    "irradiance": 'ms.read_irradiance(sample.view_folder / "irradiance.exr")',
    "preview": 'the picture sample.folder / "frame.png"',
    "dng": 'the file sample.folder / "frame.dng"',
}
"""Outputs that are not read as arrays, and what has them."""

MOST_SAID = 20  # values, in the sentence on one that no sample has
AOVS = ("depth_m", "position_m", "normal", "albedo", "shape_index", "flow_px")


@dataclass(frozen=True)
class Sample:
    """One sample.

    key : its name on disk.  split : train, test, …, or an empty text.  values : what varies in the dataset.
    folder, view_folder : where its files are, and those that all samples of its view share.
    """

    key: str
    split: str
    values: Config
    folder: Path
    view_folder: Path

    @cached_property
    def facts(self) -> Facts:
        """sample.json: configuration, camera, seeds, black and white level, quantiles. Raises InputError."""
        return read_json(self.folder / "sample.json", CHANGED)

    @cached_property
    def view(self) -> Facts:
        """view.json: what the files of the view were made of. Raises InputError where it has none."""
        return read_json(self.view_folder / "view.json", CHANGED)

    @cached_property
    def noise_budget(self) -> Facts:
        """noise_budget.json: what each noise source contributes [DN]. Raises InputError where it has none."""
        path = self.existing(self.folder / "noise_budget.json", "noise_budget")
        return read_json(path, CHANGED)

    @cached_property
    def readouts(self) -> dict[str, NDArray[np.unsignedinteger]]:
        """Frames of every read-out by its name, (N, H, W) [DN], with their ``combined`` code and, of a camera that
        compands, their ``companded`` one. Raises InputError where it has none."""
        return read_readouts(self.existing(self.folder / READOUTS, "readouts"))

    def read(self, name: str) -> NDArray[Any]:
        """An array of the sample. Raises InputError where it has none of this name.

        name : ``raw``, ``companded`` (N, H, W) unsigned [DN]; ``clean`` (H, W) float32 [DN], the expectation of the raw
            frame of this chip; ``variance`` (H, W) float32 [DN²], temporal; ``electrons``, ``electrons_error`` (H, W)
            float32 [e-], mean photoelectrons and their standard error by the render; or an AOV, see
            docs/clean-frames-and-aovs.md.
        """
        if name in AOVS:
            return np.asarray(
                getattr(read_aovs_exr(self.existing(self.view_folder / "aovs.exr", name)), name)
            )
        if name in NO_ARRAYS:
            raise InputError(f"{name} of a sample is no array; {NO_ARRAYS[name]} has it.")
        if name not in IMAGES:
            known = (*IMAGES, *AOVS)
            raise InputError(
                f"a sample has no {name!r}; it can have {', '.join(known)}.{nearest(name, known)}"
            )
        pages = read_raw(self.existing(self.folder / IMAGES[name], name)).frames
        return pages if name in PAGES else pages[0]

    def existing(self, path: Path, name: str) -> Path:
        """The path of a file that ``name`` needs. Raises InputError where it is not there."""
        if not path.exists():
            raise InputError(
                f"there is no {path}; name what {name} needs in the outputs of the dataset, and make it again."
            )
        return path


@tells_of_names
class Dataset(Sequence[Sample]):
    """The samples of a dataset folder, in the order of its file.

    ::

        for sample in ms.Dataset("pairs/", split="train"):
            noisy, clean = sample.read("raw")[0], sample.read("clean")

    folder : as ``mitsuba-sensor dataset run`` made it.  split : only those of this split.
    Raises InputError where there is no dataset, or no such split.
    """

    def __init__(self, folder: str | os.PathLike[str], split: str | None = None) -> None:
        self.folder = require_path("folder", folder, "pairs/")
        store, lines = Store(self.folder), read_index(self.folder).lines
        splits = sorted({line["split"] for line in lines})
        if split is not None and split not in splits:
            raise InputError(
                f"split is {split!r}; {self.folder} has {', '.join(filter(None, splits)) or 'none'}."
            )
        self.samples = [
            sample_of(store, line) for line in lines if split in (None, line["split"])
        ]

    def __len__(self) -> int:
        return len(self.samples)

    @overload
    def __getitem__(self, number: int) -> Sample: ...

    @overload
    def __getitem__(self, number: slice) -> list[Sample]: ...

    def __getitem__(self, number: int | slice) -> Sample | list[Sample]:
        return self.samples[number]

    def __iter__(self) -> Iterator[Sample]:
        return iter(self.samples)

    def __repr__(self) -> str:
        splits = {
            split: sum(one.split == split for one in self.samples) for split in self.splits
        }
        parts = ", ".join(f"{split} {number}" for split, number in splits.items() if split)
        return (
            f"<Dataset: {len(self)} samples{f' ({parts})' if parts else ''} in {self.folder}>"
        )

    @property
    def splits(self) -> list[str]:
        """Names of the splits, in alphabetical order."""
        return sorted({one.split for one in self.samples})

    def where(self, **values: object) -> Dataset:
        """The samples that have all of these values, which may be none.

        values : by the names of :attr:`Sample.values`, and split, as ``where(scene="still_life", view=3)``;
            names with dots as ``where(**{"parameters.height": 0.5})``.
        Raises InputError for a name or a value that no sample has.
        """
        chosen = copy(self)
        for name, value in values.items():
            chosen.samples = [one for one in chosen.samples if has_value(one, name, value)]
            if not chosen.samples:
                require_known(name, value, self.samples)
        return chosen


def sample_of(store: Store, line: Config) -> Sample:
    """The sample of a line of the index."""
    return Sample(
        line["key"],
        line["split"],
        line["values"],
        store.folder_of("samples", line["key"]),
        store.folder_of("views", line["view"]),
    )


def has_value(sample: Sample, name: str, value: object) -> bool:
    """Whether a sample has this value; numbers are equal to nine digits."""
    own = sample.split if name == "split" else sample.values.get(name)
    if own is None:
        return False
    if isinstance(value, float) and isinstance(own, int | float):
        return math.isclose(value, own, rel_tol=1e-9)
    if isinstance(value, tuple):
        return bool(own == [*value])
    return bool(own == value)


def require_known(name: str, value: object, samples: Sequence[Sample]) -> None:
    """Raise InputError, with what there is, for a name or a value that none of the samples has."""
    if any(has_value(one, name, value) for one in samples):
        return
    texts: dict[str, dict[str, None]] = {}  # name → its values, each once
    for one in samples:
        for known, own in [*one.values.items(), ("split", one.split or "none")]:
            texts.setdefault(known, {})[str(own)] = None
    if name not in texts:
        raise InputError(
            f"no sample has {name!r}; what they have: {', '.join(texts)}.{nearest(name, texts)}"
        )
    shown = [*texts[name]][:MOST_SAID]
    if len(texts[name]) > MOST_SAID:
        shown.append(f"… ({len(texts[name])} values)")
    remedy = nearest(str(value), texts[name])
    raise InputError(f"{name} is {value!r}; the samples have {', '.join(shown)}.{remedy}")


class Index(NamedTuple):
    """What index.jsonl says.

    lines : key, view, split, values of each sample.  made_from : SHA-256 of the dataset's record when it was written.
    """

    lines: list[Facts]
    made_from: str


def line_text(line: Config) -> str:
    """The line of a sample in index.jsonl."""
    return f"{json.dumps(line, ensure_ascii=False)}\n"


def index_text(index: Index) -> bytes:
    """What index.jsonl holds: a line for each sample, and a last one with the SHA-256 of all before."""
    end = json.dumps({"samples": len(index.lines), "made_from": index.made_from})
    return sealed("".join(map(line_text, index.lines)) + end)


def lines_digest(lines: Iterable[Config]) -> tuple[int, str]:
    """How many lines there are, and the SHA-256 of their text."""
    digest, count = hashlib.sha256(), 0
    for line in lines:
        digest.update(line_text(line).encode())
        count += 1
    return count, digest.hexdigest()


def read_index(folder: Path) -> Index:
    """Its inverse. Raises InputError where there is no index, or not the one that was written."""
    path = folder / INDEX
    if not path.exists():
        raise InputError(
            f"{folder} is no dataset that is complete; make it with `mitsuba-sensor dataset run`."
        )
    remedy = "`mitsuba-sensor dataset run` writes it again"
    index = _index_of(text_of_file(path, remedy, newline="").encode())
    if index is None:
        raise InputError(f"{path} was changed; {remedy}.")
    return index


def _index_of(content: bytes) -> Index | None:
    """The index that :func:`index_text` wrote; None for any other bytes."""
    text = unsealed(content)
    try:
        *lines, last = (json.loads(line) for line in (text or "").split("\n"))
        index = Index(lines, last["made_from"])
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    return index if last.get("samples") == len(lines) and all(map(_is_line, lines)) else None


def _is_line(line: object) -> bool:
    """Whether a line is such as a run writes, whoever wrote it."""
    if not isinstance(line, dict) or not isinstance(line.get("values"), dict):
        return False
    keys = [line.get("key"), line.get("view")]
    named = all(isinstance(key, str) and KEY.fullmatch(key) for key in keys)
    return (
        named
        and isinstance(line.get("split"), str)
        and isinstance(line.get("view_files"), bool)
    )
