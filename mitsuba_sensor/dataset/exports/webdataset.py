"""WebDataset shards: SPLIT-000000.tar with KEY.json, KEY.png and an array KEY.NAME.npy for each that is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core import InputError
from ...files.tar_shards import TarShards, npy
from ..options import ExportOptions
from ..read.previews import PICTURE
from ..read.reader import Dataset, Sample
from ..store.entry_files import checked
from ..store.record import SHARDS
from .job import Job, checked_array

HOW = """import webdataset as wds

samples = wds.WebDataset("{shards}", shardshuffle=False).decode()
for sample in samples:
    print(sample["__key__"], {names}, sample["json"]["values"])
"""
OF_OTHER_SHARDS = ("split", "arrays", "shard_mb")
"""Options that ask for other shards than a dataset in shards has."""


def refuse_own_shards(dataset: Dataset, options: ExportOptions) -> None:
    """Raise InputError for a dataset whose own shards are WebDataset's already, unless options ask for others, or it
    has splits, which are to be apart."""
    asks = any(options.get(name) is not None for name in OF_OTHER_SHARDS)
    if asks or dataset.splits != [""] or dataset.lines[0].place is None:
        return
    raise InputError(
        f"{dataset.folder} is in shards, which are in WebDataset's layout: give its readers "
        f"{dataset.folder}/{SHARDS}/*.tar; --array raw or --shard-mb 500 write others."
    )


def write_shards(job: Job) -> str:
    """Write the shards of every split, samples sorted by key: a random order, the same always. Returns how to read."""
    ends = {}
    for split in sorted({one.split for one in job.samples}):
        name = split or "shard"
        with TarShards(job.folder, name, job.options["shard_mb"] * 10**6) as shards:
            for sample in sorted(
                (one for one in job.samples if one.split == split), key=lambda one: one.key
            ):
                shards.add(sample.key, files_of(sample, job.arrays_of(sample)))
                job.step()
        ends[name] = f"{name}-{{000000..{len(shards.shards) - 1:06d}}}.tar"
    names = ", ".join(f'sample["{name}.npy"].shape' for name in job.arrays_of(job.samples[0]))
    return HOW.format(shards=next(iter(ends.values())), names=names)


def files_of(sample: Sample, arrays: Sequence[str]) -> dict[str, bytes | Path]:
    """The members of one sample, by extension."""
    found: dict[str, bytes | Path] = {
        f"{name}.npy": npy(checked_array(sample, name)) for name in arrays
    }
    if sample.files.has(PICTURE):
        pictures = {"png": checked(sample.files, PICTURE)}
    else:
        pictures = {}
    return {**found, "json": checked(sample.files, "sample.json"), **pictures}
