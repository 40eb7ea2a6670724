"""A data set of Hugging Face: data/SPLIT-00000-of-00001.parquet, a row for each sample.

Images are columns of the ``Image`` of its library `datasets`: the bytes of the files of the sample as they are, TIFFs
of raw frames among them, so that every digital number is there.
"""

from __future__ import annotations

import json
import re
from pathlib import PurePath

from ...core import InputError
from ...files.parquet import Kind, Row
from ...files.parquet_shards import ParquetShards
from ...files.tar_shards import npy
from ...files.whole_folder import inside
from ..index.part import FIXED, cell_of, kinds_of
from ..read.previews import PICTURE
from ..read.reader import IMAGES, Sample
from ..store.entry_files import checked, require_file
from .job import Job, checked_array, facts_text_of

HOW = """import numpy as np
from datasets import load_dataset

rows = load_dataset("DIR", split="{split}")  # the folder of this file
for row in rows:
    print(row["key"], np.array(row["{array}"]).shape)  # of several frames row["raw"].seek(1) has the second
"""
UNSPLIT = "train"
"""What Hugging Face calls the only split of a data set."""
MOST_BYTES = 2**31 - 1
"""Of a value: Arrow counts them with 32 bits."""
PREVIEW, FACTS = "preview", "sample_json"


def write_parquet(job: Job) -> str:
    """Write the rows of every split, in the order of the dataset. Returns how to read."""
    splits = names_of_splits(sorted({sample.split for sample in job.samples}))
    arrays = job.arrays_of(job.samples[0])
    kinds: dict[str, Kind] = {"key": "text", "split": "text"}
    for name in arrays:
        kinds[name] = "image" if name in IMAGES else "bytes"
    if "preview" in job.file.outputs:
        kinds[PREVIEW] = "image"
    of_values = {name: kind for name, kind in kinds_of(job.file).items() if name not in FIXED}
    kinds = {**kinds, **of_values, FACTS: "text"}
    images = {name: {"_type": "Image"} for name, kind in kinds.items() if kind == "image"}
    about = {"huggingface": json.dumps({"info": {"features": images}})}
    most_bytes = job.options["shard_mb"] * 10**6
    for split, name in splits.items():
        folder = inside(job.folder, f"data/{name}").parent
        with ParquetShards(folder, name, kinds, about, most_bytes) as shards:
            for sample in job.samples:
                if sample.split == split:
                    shards.add(*_row(sample, kinds))
                    job.step()
    return HOW.format(split=splits[next(iter(splits))], array=arrays[0])


def _row(sample: Sample, kinds: dict[str, Kind]) -> tuple[Row, int]:
    """A sample as a row, and the bytes of its images and arrays."""
    row: Row = {"key": sample.key, "split": sample.split, FACTS: facts_text_of(sample)}
    for name, value in sample.values.items():
        column, cell = cell_of(name, value, kinds)
        row[column] = cell
    size = 0
    for name, kind in kinds.items():
        if kind == "image":
            file = PICTURE if name == PREVIEW else IMAGES[name]
            require_file(sample.files, file, name)
            content = checked(sample.files, file)
            row[name] = {
                "bytes": content,
                "path": f"{sample.key}.{name}{PurePath(file).suffix}",
            }
            size += len(content)
        elif kind == "bytes":
            row[name] = npy(checked_array(sample, name))
            size += len(row[name])
    if size > MOST_BYTES:
        raise InputError(
            f"sample {sample.key} has {size} bytes of images, and a row of Parquet {MOST_BYTES} at most; name fewer "
            "with --array, or export to webdataset or hdf5."
        )
    return row, size


def names_of_splits(splits: list[str]) -> dict[str, str]:
    """Split → what it is called there, without what Hugging Face has in no name. Raises InputError where two are
    called the same."""
    names = {split: re.sub(r"[^\w.]|\.(?!\w)", "_", split) or UNSPLIT for split in splits}
    if len({*names.values()}) < len(names):
        raise InputError(
            f"the splits {', '.join(splits)} are the same for Hugging Face, whose names have letters, digits, _ and "
            "dots only; export each alone, with --split."
        )
    return names
