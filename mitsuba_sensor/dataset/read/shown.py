"""One sample of a dataset for people: found by its number, key or folder, with its settings, noise and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...camera.camera_file import camera_from
from ...camera.figures import figures_if_any
from ...core import InputError
from ..index.index import opened
from ..store.entry_files import EntryFiles, FolderFiles
from ..store.keys import Facts
from ..store.names import PARTS
from .previews import PICTURE
from .reader import Dataset, Sample

FEWEST_DIGITS = 4
"""Of a key, that are looked for."""
VARIANCE = "temporal_variance.tiff"


def sample_called(dataset: Dataset, said: str) -> tuple[int, Sample]:
    """A sample and its place in the dataset.  said : its number from 0, the beginning of its key, or its folder.

    Raises InputError where there is none, or several.
    """
    if said.isdecimal() and int(said) < len(dataset):
        return int(said), dataset[int(said)]
    name = "/".join(Path(said).parts[-PARTS:])
    places = _places(dataset, "name", name)
    if not places and len(said) >= FEWEST_DIGITS:
        places = _places(dataset, "key", said.lower())
    if len(places) == 1:
        return places[0], dataset[places[0]]
    how = f"give a number from 0 to {len(dataset) - 1}, a key, or the folder of a sample"
    if places:
        raise InputError(f"{len(places)} samples have keys that begin with {said!r}; {how}.")
    raise InputError(f"no sample of {dataset.folder} is called {said!r}; {how}.")


def _places(dataset: Dataset, column: str, beginning: str) -> list[int]:
    """Places of all samples of which this column of the index begins so; a name is whole."""
    found, first = list[int](), 0
    for part in dataset.lines.parts:
        values, numbers = opened(dataset.folder, part).rows.coded(column)
        texts = np.array(values, dtype=str)[numbers]
        here = texts == beginning
        if column == "key":
            here = np.char.startswith(texts, beginning)
        found += (first + np.flatnonzero(here)).tolist()
        first += part.rows
    return found


def facts_shown(dataset: Dataset, number: int, sample: Sample) -> Facts:
    """What is said of a sample, ready for JSON. Raises InputError for one that is not as it was written."""
    facts, files = sample.facts, sample.files
    return {
        "number": number,
        "samples": len(dataset),
        "key": sample.key,
        "split": sample.split,
        "folder": files.place("").rstrip("/: "),
        "settings": dict(sample.values),
        "image": facts["image"],
        "noise": _noise(sample),
        "digital_quantiles_dn": facts["digital_quantiles_dn"],
        "electrons_quantiles_e": facts["electrons_quantiles_e"],
        "files": files.sizes(),
        "picture": _picture_path(files),
    }


def _picture_path(files: EntryFiles) -> str | None:
    """The path of the stored picture; None where none is stored, or in a shard."""
    if isinstance(files, FolderFiles) and files.has(PICTURE):
        return files.place(PICTURE)
    return None


def _noise(sample: Sample) -> Facts:
    """Noise of the camera, and of the median pixel of this sample.

    temporal_noise_dn, snr : from frame to frame, where the sample has its variance.
    """
    facts: Facts = sample.facts
    config: Any = facts["config"]
    camera = camera_from(config["camera"], "of the sample").at_gain(config["gain"])
    figures = figures_if_any(camera)
    found: Facts = {"system_gain_dn_per_e": facts["system_gain_dn_per_e"]}
    if figures is not None:
        found["temporal_dark_noise_e"] = figures.temporal_dark_noise_e
        found["saturation_e"] = figures.saturation_e
    if sample.files.has(VARIANCE):
        noise_dn = float(np.median(np.sqrt(sample.read("variance"))))
        signal_dn = float(np.median(sample.read("raw"))) - facts["image"]["black_level_dn"]
        found |= {"temporal_noise_dn": noise_dn, "snr": signal_dn / noise_dn}
    found["render_noise_ratio"] = facts["light"]["noise_ratio_median"]
    return found
