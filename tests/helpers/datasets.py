"""Small datasets for tests."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from mitsuba_sensor.dataset.index import origin, repair
from mitsuba_sensor.dataset.index import part as index_part
from mitsuba_sensor.dataset.index import writer as index_writer
from mitsuba_sensor.dataset.index.part import Line, all_parts, kinds_of, part_of
from mitsuba_sensor.dataset.index.writer import IndexWriter
from mitsuba_sensor.dataset.plan.configured import PlannedSample
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.store.record import FILE, INDEX
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files.parquet import Kind
from mitsuba_sensor.files.shipped_scenes import scenes_folder

SCENES = scenes_folder()
"""Of the package: a scene of a checkout beside an installed package would be the user's own."""
TABLES: dict[str, Any] = {
    "name": "small",
    "render": {"spp": 16, "width": 16},
    "scenes": [{"name": "flat", "file": "flat_field.xml"}],
    "cameras": [{"camera": "konnik_table1"}],
}


def write_index(
    folder: Path, lines: Sequence[Line], kinds: Mapping[str, Kind] | None = None
) -> None:
    """Replace the index of a small dataset by one with these lines, as somebody could who knows how names are made."""
    (old,) = all_parts(folder)
    known = kinds or kinds_of(read_dataset(folder / FILE))
    (folder / INDEX / old.name).unlink()
    part, content = part_of(old.origin, 0, lines, len(lines), known)
    (folder / INDEX / part.name).write_bytes(content)


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the folder in which a module has ``made`` a dataset, which is the current folder."""
    copy = Path(shutil.copytree(made, tmp_path / "copy"))
    monkeypatch.chdir(copy)
    return copy


def make_parts_small(monkeypatch: pytest.MonkeyPatch, numbers: int) -> None:
    """From now on a part of an index is of so many numbers."""
    for module in (index_part, index_writer, origin, repair):
        monkeypatch.setattr(module, "NUMBERS", numbers)


def plan_of(**tables: Any) -> DatasetPlan:
    """The small dataset with these tables."""
    return DatasetPlan(read_dataset({**TABLES, **tables}), [SCENES], f"# {tables!r}")


def commit(store: Store, sample: PlannedSample) -> None:
    """A sample of one small file."""
    store.commit(sample.entry, lambda folder: (folder / "a.txt").write_text("a"))


def follow(writer: IndexWriter, lost: frozenset[int] = frozenset()) -> None:
    """Make all tasks of a run but for the samples with these numbers."""
    for view in writer.tasks():
        numbers = range(view.first, view.first + len(view.samples))
        for number, sample in zip(numbers, view.samples, strict=True):
            if number not in lost:
                commit(writer.store, sample)
        writer.ended(view.first, lost.isdisjoint(numbers))


def whole(plan: DatasetPlan, store: Store) -> IndexWriter:
    """The writer of a run of all samples."""
    return IndexWriter(plan, store, range(plan.numbers))
