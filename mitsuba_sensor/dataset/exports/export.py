"""Exports a dataset to files for another program, in a new folder with a card that describes it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple, Unpack

from ...core import InputError, nearest
from ...core.options import complete, documents
from ...files.appearing import write_drawing
from ...files.png import png
from ...files.texts import write_json, write_page
from ...files.tiff import tiff_bytes
from ...files.whole_folder import appearing_folder, inside
from ..card import write_card
from ..file import DatasetFile, read_dataset_text
from ..keys import Facts
from ..read import IMAGES, Dataset, Sample
from ..values import PICTURE
from .formats import FORMATS, ExportOptions

PNG_BITS_MAX = 16
MB = 10**6
PYTORCH = " For PyTorch use mitsuba_sensor.dataset.TorchDataset (docs/exports-and-training.md)."
DEFAULT_ARRAYS = ("raw", "clean", "variance")


class Exported(NamedTuple):
    """Result of an export.  samples : number of its samples.  remarks : what it lacks, and why."""

    samples: int
    remarks: list[str]


@dataclass
class Job:
    """One export.

    samples : in the order of the dataset.  folder : empty, and renamed at the end.  options : complete.
    file : of the dataset.  progress : called with the number of samples done, and of all samples.
    left_out : keys of samples that cannot be in the export.  remarks : sentences for people and for the card.
    """

    samples: Dataset
    folder: Path
    options: Facts
    file: DatasetFile
    progress: Callable[[int, int], object]
    left_out: set[str] = field(default_factory=set)
    remarks: list[str] = field(default_factory=list)
    _done: int = 0

    @property
    def title(self) -> str:
        """Name and description of the dataset."""
        return ": ".join(x for x in (self.file.name, self.file.description) if x)

    @property
    def licence(self) -> str:
        """Licence in the options, else in the dataset file."""
        return self.options["licence"] or self.file.licence

    @property
    def shard_bytes(self) -> int:
        """Size limit of a file [bytes]."""
        return int(self.options["shard_mb"]) * MB

    def done(self, samples: int = 1) -> None:
        """Count samples that are written or left out."""
        self._done += samples
        self.progress(self._done, len(self.samples))

    def splits(self) -> dict[str, Dataset]:
        """Return split → its samples."""
        return {split: self.samples.where(split=split) for split in self.samples.splits}

    def remark(self, sentence: str) -> None:
        """Note a sentence, once."""
        if sentence not in self.remarks:
            self.remarks.append(sentence)

    def leave_out(self, samples: Sequence[Sample], what: str, why: str) -> None:
        """Leave samples out, with a remark.  what : they are.  why : they are left out."""
        self.left_out.update(sample.key for sample in samples)
        self.done(len(samples))
        count = "one sample" if len(samples) == 1 else f"{len(samples)} samples"
        self.remark(f"left out: {count} of {what}: {why.removesuffix('.')}")

    def arrays_of(self, sample: Sample, usual: Iterable[str] = DEFAULT_ARRAYS) -> list[str]:
        """Return the names of the requested arrays of a sample, by default the arrays in ``usual`` that it has.
        Raises InputError for none."""
        if self.options["arrays"]:
            return [*dict.fromkeys(self.options["arrays"])]
        names = [name for name in usual if sample.has(IMAGES[name])]
        if not names:
            raise InputError(
                f"the samples have no {', '.join(usual)}; add one to the outputs of the dataset and make it again, or "
                "name the arrays to write, e.g. arrays=depth."
            )
        return names

    def picture(self, sample: Sample, stem: str) -> str:
        """Write the requested picture of a sample, and return its name without folders. Raises InputError if it is
        missing.  stem : of its name in the export, with folders."""
        kind, ending = self.options["images"], "png"
        names = {"preview": PICTURE, "raw": IMAGES["raw"]}
        if not sample.has(names[kind]):
            other = "raw" if kind == "preview" else "preview"
            remedy = f"add {kind} to the outputs of the dataset, and make it again"
            if other in self.file.outputs:
                remedy = f"take images={other}, or {remedy}"
            raise InputError(f"{sample.place(kind)} is missing; {remedy}.")
        if kind == "preview":
            content = sample.content(PICTURE)
        else:
            frame = sample.read("raw")[0]
            if frame.dtype.itemsize * 8 > PNG_BITS_MAX:
                ending, content = "tiff", tiff_bytes(frame)
            else:
                content = png(frame)
        self.bytes(f"{stem}.{ending}", content)
        self.done()
        return f"{stem.rpartition('/')[2]}.{ending}"

    def place(self, name: str) -> Path:
        """Return the path of a file in the export. Raises InputError for a name that leads elsewhere."""
        return inside(self.folder, name)

    def bytes(self, name: str, content: bytes) -> None:
        """Write a file."""
        write_drawing(self.place(name), content)

    def text(self, name: str, *texts: str) -> None:
        """Write a text file."""
        write_page(self.place(name), "".join(texts))

    def json(self, name: str, content: Facts) -> None:
        """Write a JSON file."""
        write_json(self.place(name), content)


@documents(ExportOptions)
def export(
    folder: str | os.PathLike[str],
    format: str,
    out: str | os.PathLike[str],
    *,
    progress: Callable[[int, int], object] = lambda done, total: None,
    **options: Unpack[ExportOptions],
) -> Exported:
    """Write a dataset to ``out`` with README.md, the whole export or nothing.

    folder : that `dataset run` made.  format : a name of FORMATS.  progress : called with (samples done, in all).
    Raises InputError; DiskFull if the disk is full.
    """
    chosen = _options_of(format, options)
    dataset = Dataset(folder, chosen["split"])
    if not len(dataset):
        raise InputError(
            f"{dataset.folder} has no samples; make them with `mitsuba-sensor dataset run`."
        )
    if Path(out).absolute().is_relative_to(dataset.folder.absolute()):
        raise InputError(f"{out} is in the dataset itself; give another folder.")
    missing = _missing(dataset)
    if missing and not chosen["incomplete"]:
        raise InputError(
            f"{dataset.folder} is not complete: {missing}; `mitsuba-sensor dataset run FILE.toml -o {dataset.folder}` "
            f"makes them, `dataset status {dataset.folder}` lists what could not be made, and "
            "incomplete=True exports the other samples."
        )
    for shard in dataset.store.finished().values():
        if not dataset.store.is_sound(shard):
            raise dataset.store.changed(shard.name)
    file = read_dataset_text(dataset.store.require_record().text)
    about = {"dataset": file.name, "format": format}
    with appearing_folder(Path(out), chosen["force"], about) as scratch:
        job = Job(dataset, scratch, chosen, file, progress)
        if missing:
            job.remark(missing)
        how = import_module(f".{format}", __package__).write(job)
        notes = [f"{remark[0].upper()}{remark[1:]}." for remark in job.remarks]
        lines = [line for line in dataset.table if line.key not in job.left_out]
        write_card(scratch, dataset.store, lines, file, job.licence, how, notes)
    return Exported(len(lines), job.remarks)


def _options_of(name: str, given: ExportOptions) -> Facts:
    """Return all options with the defaults of this format. Raises InputError for an option of other formats."""
    formats = {row.name: row for row in FORMATS}
    if name not in formats:
        near = PYTORCH if "torch" in name.lower() else nearest(name, formats)
        raise InputError(f"format is {name!r}; it must be one of {', '.join(formats)}.{near}")
    row = formats[name]
    chosen: Facts = {**complete(ExportOptions, given)}
    for option in ("arrays", "shard_mb", "images"):
        if chosen[option] is not None and option not in row.takes:
            takers = ", ".join(x.name for x in FORMATS if option in x.takes)
            raise InputError(
                f"{option} is an option of {takers}, but the format is {name}; omit it."
            )
    if row.needs and find_spec(row.needs) is None:
        raise InputError(
            f"{name} needs {row.needs}, which is missing; run pip install '.[{name}]' in the checkout."
        )
    defaults = {"shard_mb": row.shard_mb, "images": row.images}
    return chosen | {x: value for x, value in defaults.items() if chosen[x] is None}


def _missing(dataset: Dataset) -> str:
    """Return how many samples of a dataset are missing, as text; empty for a complete dataset."""
    planned, there = dataset.store.require_record().samples, len(Dataset(dataset.folder))
    return f"{planned - there} of {planned} samples are missing" if there < planned else ""
