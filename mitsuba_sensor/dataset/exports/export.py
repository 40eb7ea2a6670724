"""Exports a dataset to the files of another program, in a new folder with a card that says what is in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from ...core import InputError, nearest
from ...core.options import complete, documents
from ...files.whole_folder import appearing_folder
from ..file import read_dataset
from ..options import ExportOptions
from ..origin import require_origin
from ..reader import Dataset
from ..record import FILE
from .card import write_card
from .coco import write_coco
from .colmap import write_colmap
from .job import Job
from .nerfstudio import write_nerfstudio
from .opencv import write_opencv
from .ros import write_ros
from .summary import summary
from .webdataset import write_shards


def write_nothing(job: Job) -> str:
    """No files beside the card, which says how to read the dataset itself."""
    for _ in job.samples:
        job.step()
    return ""


WRITERS: Mapping[str, Callable[[Job], str]] = {
    "webdataset": write_shards,
    "coco": write_coco,
    "nerfstudio": write_nerfstudio,
    "colmap": write_colmap,
    "opencv": write_opencv,
    "ros": write_ros,
    "card": write_nothing,
}


@documents(ExportOptions)
def export(
    folder: str | os.PathLike[str],
    format: str,
    out: str | os.PathLike[str],
    *,
    progress: Callable[[int, int], object] = lambda done, total: None,
    **options: Unpack[ExportOptions],
) -> int:
    """Write a dataset to ``out``, all of it or nothing, with README.md; returns the number of samples.

    folder : that `dataset run` made.  format : one of WRITERS.  progress : called with (steps done, steps in all).
    Raises InputError; DiskFull where the disk takes no more.
    """
    chosen = complete(ExportOptions, options)
    if format not in WRITERS:
        raise InputError(
            f"format is {format!r}; it must be one of {', '.join(WRITERS)}.{nearest(format, WRITERS)}"
        )
    dataset = Dataset(folder, chosen["split"])
    if not len(dataset):
        raise InputError(
            f"{dataset.folder} has no samples; make them with `mitsuba-sensor dataset run`."
        )
    if Path(out).absolute().is_relative_to(dataset.folder.absolute()):
        raise InputError(f"{out} is in the dataset itself; give a folder elsewhere.")
    require_origin(dataset.folder)
    file, done, total = read_dataset(dataset.folder / FILE), 0, 2 * len(dataset)

    def step() -> None:
        nonlocal done
        done += 1
        progress(done, total)

    if file.description:
        title = f"{file.name}: {file.description}"
    else:
        title = file.name
    with appearing_folder(
        Path(out), chosen["force"], {"dataset": file.name, "format": format}
    ) as scratch:
        known = summary(dataset.folder, dataset.lines, file, step)
        known = replace(known, licence=chosen["licence"] or known.licence)
        how = WRITERS[format](Job(dataset, scratch, chosen, step, title, known.licence))
        write_card(scratch, replace(known, how_to_read=how or known.how_to_read))
    return len(dataset)
