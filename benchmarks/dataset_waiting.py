"""Samples that are made by waiting and writing, for benchmarks/dataset_engine.py: its processes import this module."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

from mitsuba_sensor.dataset.planned import PlannedSample, PlannedView
from mitsuba_sensor.dataset.store import Store

FILES = {"frame.tiff": 50_000, "frame.dng": 60_000, "clean.tiff": 100_000, "temporal_variance.tiff": 100_000}
FILES |= {"electrons.tiff": 100_000, "electrons_error.tiff": 100_000, "frame.png": 50_000, "sample.json": 12_000}


def make(store: Store, view: PlannedView, told: Callable[[str], object]) -> Iterator[PlannedSample]:
    """Wait, and write the files of each sample."""
    for sample in view.samples:
        told("exposing")
        time.sleep(sample.config["seconds"])
        store.commit("samples", sample.key, write_of(sample.config["size"]))
        yield sample


def write_of(size: int) -> Callable[[Path], None]:
    """What fills the folder of a sample."""
    names = {"frame.tiff": size} if size else FILES

    def write(folder: Path) -> None:
        for name, length in names.items():
            (folder / name).write_bytes(b"x" * length)

    return write
