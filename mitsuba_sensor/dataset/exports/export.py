"""Exports a dataset to the files of another program, in a new folder with a card that says what is in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Unpack

from ...core import InputError, nearest
from ...core.options import complete, documents
from ...files.whole_folder import appearing_folder
from ..index.part import Line
from ..options import ExportOptions
from ..plan.file import read_dataset
from ..read.reader import Dataset
from ..store.keys import Facts
from ..store.record import FILE
from .card import write_card
from .coco import write_coco
from .colmap import write_colmap
from .euroc import write_euroc
from .hdf5 import write_hdf5
from .job import Job
from .kitti import write_kitti
from .missing import missing_samples
from .nerfstudio import write_nerfstudio
from .opencv import write_opencv
from .parquet import write_parquet
from .ros import write_ros
from .summary import summary
from .webdataset import refuse_own_shards, write_shards


class Exported(NamedTuple):
    """What became of an export.  samples : that it has.  remarks : what it does not have, and why."""

    samples: int
    remarks: list[str]


def write_nothing(job: Job) -> str:
    """No files beside the card, which says how to read the dataset itself."""
    for _ in job.samples:
        job.step()
    return ""


WRITERS: Mapping[str, Callable[[Job], str]] = {
    "parquet": write_parquet,
    "webdataset": write_shards,
    "hdf5": write_hdf5,
    "coco": write_coco,
    "nerfstudio": write_nerfstudio,
    "colmap": write_colmap,
    "kitti": write_kitti,
    "euroc": write_euroc,
    "opencv": write_opencv,
    "ros": write_ros,
    "card": write_nothing,
}
OF_ARRAYS = ("parquet", "webdataset", "hdf5")
SHARD_MB = {"parquet": 256, "webdataset": 1000}
"""Format with shards → their largest size [MB]."""
OF_PICTURES = {
    "coco": "preview",
    "nerfstudio": "preview",
    "colmap": "preview",
    "kitti": "raw",
    "euroc": "raw",
}
"""Format with pictures → which."""
REFUSED_INCOMPLETE = (
    "{folder} is not complete: {missing}; `mitsuba-sensor dataset run FILE.toml -o {folder}` makes them, `dataset "
    "status {folder}` says which could not be made, and --incomplete exports the others."
)
TAKEN_BY = {"arrays": OF_ARRAYS, "shard_mb": SHARD_MB, "images": OF_PICTURES}
"""Option → the formats that take it."""


@documents(ExportOptions)
def export(
    folder: str | os.PathLike[str],
    format: str,
    out: str | os.PathLike[str],
    *,
    progress: Callable[[int, int], object] = lambda done, total: None,
    **options: Unpack[ExportOptions],
) -> Exported:
    """Write a dataset to ``out``, all of it or nothing, with README.md.

    folder : that `dataset run` made.  format : one of WRITERS.  progress : called with (steps done, steps in all).
    Raises InputError; DiskFull where the disk takes no more.
    """
    if format not in WRITERS:
        raise InputError(
            f"format is {format!r}; it must be one of {', '.join(WRITERS)}.{nearest(format, WRITERS)}"
        )
    chosen = _options_of(format, options)
    dataset = Dataset(folder, chosen["split"])
    if not len(dataset):
        raise InputError(
            f"{dataset.folder} has no samples; make them with `mitsuba-sensor dataset run`."
        )
    if not isinstance(dataset.folder, Path):
        raise InputError(
            f"{dataset.folder} is in an object store; an export reads a folder of this machine: copy it first."
        )
    if format == "webdataset":
        refuse_own_shards(dataset, options)
    if Path(out).absolute().is_relative_to(dataset.folder.absolute()):
        raise InputError(f"{out} is in the dataset itself; give a folder elsewhere.")
    missing = missing_samples(dataset.folder)
    if missing and not chosen["incomplete"]:
        raise InputError(REFUSED_INCOMPLETE.format(folder=dataset.folder, missing=missing))
    file, done, total = read_dataset(dataset.folder / FILE), 0, 2 * len(dataset)

    def step() -> None:
        nonlocal done
        done += 1
        progress(done, total)

    about = {"dataset": file.name, "format": format}
    with appearing_folder(Path(out), chosen["force"], about) as scratch:
        job = Job(dataset, scratch, chosen, step, file)
        if missing:
            job.remarks.append(missing)
        how = WRITERS[format](job)
        _write_card(job, dataset.folder, dataset.lines, how)
    return Exported(len(dataset) - len(job.left_out), job.remarks)


def _options_of(format: str, given: ExportOptions) -> Facts:
    """All options, with the defaults of this format. Raises InputError for one that it does not take."""
    chosen: Facts = {**complete(ExportOptions, given)}
    for name, formats in TAKEN_BY.items():
        if chosen[name] is not None and format not in formats:
            raise InputError(
                f"{name} is an option of {', '.join(formats)}, and the format is {format}; leave it out."
            )
    chosen["shard_mb"] = chosen["shard_mb"] or SHARD_MB.get(format)
    chosen["images"] = chosen["images"] or OF_PICTURES.get(format)
    return chosen


def _write_card(job: Job, folder: Path, lines: Sequence[Line], how: str) -> None:
    """README.md of the samples that the export has.  folder : of the dataset.  how : code that reads the export."""
    if job.left_out:
        lines = [line for line in lines if line.key not in job.left_out]
    known = summary(folder, lines, job.file, job.step)
    for _ in job.left_out:
        job.step()
    notes = [*known.notes, *(f"{remark[0].upper()}{remark[1:]}." for remark in job.remarks)]
    how_to_read = how or known.how_to_read
    facts = replace(known, licence=job.licence, notes=notes, how_to_read=how_to_read)
    write_card(job.folder, facts)
