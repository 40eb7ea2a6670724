"""A data set of Hugging Face: data/SPLIT-00000-of-00001.parquet, a row for each sample.

Images are columns of type ``Image`` of the library `datasets`: the unchanged bytes of the files of a sample, including
TIFFs of raw frames, so every digital number is there.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import PurePath

from ...core import InputError
from ...files.parquet import Kind, Row
from ...files.parquet_shards import write_parquet_shards
from ..read import FACTS, IMAGES, Dataset
from ..table import EXPOSED, PLACES, kinds_of, value_cells
from ..values import PICTURE
from .export import Job
from .webdataset import npy

HOW = """import numpy as np
from datasets import load_dataset

rows = load_dataset("DIR", split="{split}")  # the folder of this file
for row in rows:
    print(row["key"], np.array(row["{array}"]).shape)  # of several frames row["raw"].seek(1) has the second
"""
UNSPLIT = "train"
"""Hugging Face's name for the only split of a data set."""
ROW_BYTES_MAX = 2**31 - 1
"""Arrow counts the bytes of a value with 32 bits."""
EXPOSURE = ("exposure_s", "black_level_dn", "white_level_dn")
"""Columns of the entry image of sample.json: the actual exposure, metered or given."""


def write(job: Job) -> str:
    """Write the rows of every split, in the order of the dataset. Returns code that reads them."""
    splits, arrays = names_of_splits(job.samples.splits), job.arrays_of(job.samples[0])
    skipped = (*PLACES, *EXPOSED, *EXPOSURE, "exposure_s (text)")
    kinds: dict[str, Kind] = {"key": "text", "split": "text", "gain": "text"}
    kinds |= dict.fromkeys((*EXPOSURE, "system_gain_dn_per_e"), "number")
    kinds |= {x: kind for x, kind in kinds_of(job.file).items() if x not in skipped}
    files = {name: IMAGES.get(name, "") for name in arrays}
    if "preview" in job.file.outputs:
        files["preview"] = PICTURE
    kinds |= {name: "image" if file else "bytes" for name, file in files.items()}
    kinds["sample_json"] = "text"
    images = {name: {"_type": "Image"} for name, file in files.items() if file}
    about = {"huggingface": json.dumps({"info": {"features": images}})}
    for split, samples in job.splits().items():
        folder, rows = (
            job.place(f"data/{splits[split]}").parent,
            _rows(job, samples, kinds, files),
        )
        write_parquet_shards(folder, splits[split], kinds, about, rows, job.shard_bytes)
    return HOW.format(split=splits[split], array=arrays[0])


def _rows(
    job: Job, samples: Dataset, kinds: Mapping[str, Kind], files: Mapping[str, str]
) -> Iterator[tuple[Row, int]]:
    """Samples as rows, and the bytes of their images and arrays.  files : array → its file, if it has one."""
    for sample in samples:
        facts, size = sample.facts, 0
        varied = {x: value for x, value in sample.values.items() if x not in EXPOSURE}
        row: Row = {"gain": facts["config"]["gain"], **value_cells(varied, kinds)}
        if kinds["gain"] == "text" and row["gain"] is not None:
            row["gain"] = str(row["gain"])
        row |= {name: facts["image"][name] for name in EXPOSURE}
        row |= {"key": sample.key, "split": sample.split}
        row["system_gain_dn_per_e"] = facts["system_gain_dn_per_e"]
        row["sample_json"] = sample.content(FACTS).decode()
        for name, file in files.items():
            content = sample.content(file, name) if file else npy(sample.read(name))
            path = f"{sample.key}.{name}{PurePath(file).suffix}"
            row[name] = {"bytes": content, "path": path} if file else content
            size += len(content)
        if size > ROW_BYTES_MAX:
            raise InputError(
                f"sample {sample.key} has {size} bytes of images, but a row of Parquet takes at most {ROW_BYTES_MAX}; "
                "name fewer with arrays=, or export to webdataset or hdf5."
            )
        yield {name: x for name, x in row.items() if name in kinds}, size
        job.done()


def names_of_splits(splits: list[str]) -> dict[str, str]:
    """Return split → its name without characters that Hugging Face forbids. Raises InputError for two equal names."""
    names = {split: re.sub(r"[^\w.]|\.(?!\w)", "_", split) or UNSPLIT for split in splits}
    if len({*names.values()}) < len(names):
        raise InputError(
            f"the splits {', '.join(splits)} are the same for Hugging Face, whose names have only letters, digits, _ "
            "and dots; export each separately, with split=."
        )
    return names
