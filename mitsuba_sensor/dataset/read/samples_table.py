"""The table samples.csv of a dataset: a row for each sample, for spreadsheets."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from ...files.durable import remove_folder
from ...files.texts import text_of_file, write_page
from ..index.part import Line
from ..plan.values import text_of
from ..store.keys import Config
from ..store.record import SHARDS, TABLE
from ..store.store import Store
from .reader import sample_of

MOST_ROWS = 100_000
"""Of which spreadsheets are made."""
Known: TypeAlias = Mapping[str, Mapping[str, str]]
NOTHING: Known = {}
OF_SAMPLE = ("exposure_s", "system_gain_dn_per_e", "black_level_dn")
"""Columns that stand in sample.json: the time that was exposed, and what makes electrons of digital numbers."""
COLUMNS = ("key", "folder", "split", "scene", "view", "camera", "serial", *OF_SAMPLE)
"""Of every table; then all others that vary, in the order in which the samples have them."""


def write_samples_table(store: Store, lines: Sequence[Line], known: Known = NOTHING) -> None:
    """Write samples.csv; of too many samples there is none.

    lines : of the index.  known : key → what an earlier table had of sample.json, which is not read.
    Raises InputError for a sample that is not as it was written.
    """
    if len(lines) > MOST_ROWS:
        remove_folder(store.folder / TABLE)
        return
    names = dict.fromkeys(COLUMNS)
    for line in lines:
        names.update(dict.fromkeys(_cells(line.values)))
    text = io.StringIO()
    writer = csv.DictWriter(text, [*names], restval="", lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow(_row(store, line, known))
    write_page(store.folder / TABLE, text.getvalue())


def known_of_table(store: Store) -> dict[str, dict[str, str]]:
    """Key → what samples.csv has of sample.json. Raises InputError where it cannot be read."""
    text = text_of_file(store.folder / TABLE, "a run writes it again")
    known = dict[str, dict[str, str]]()
    for row in csv.DictReader(io.StringIO(text)):
        if row.keys() >= set(OF_SAMPLE):
            known[row["key"]] = {name: row[name] for name in OF_SAMPLE}
    return known


def _row(store: Store, line: Line, known: Known) -> dict[str, str]:
    """Column → text of one sample."""
    if line.place is None:
        place = store.folder_of("samples", line.name).relative_to(store.folder).as_posix()
    else:
        place = f"{SHARDS}/{line.place.shard}"
    return {
        "key": line.key,
        "folder": place,
        "split": line.split,
        **_cells(line.values),
        **(known.get(line.key) or _of_sample(sample_of(store, line).facts)),
    }


def _cells(values: Config) -> dict[str, str]:
    """Name → text of each value; the parts of a pose have columns of their own."""
    cells: dict[str, str] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            cells |= _cells({f"{name}.{part}": one for part, one in value.items()})
        elif isinstance(value, list | tuple):
            cells[name] = " ".join(map(text_of, value))
        else:
            cells[name] = text_of(value)
    return cells


def _of_sample(facts: Config) -> dict[str, str]:
    """Column → text, of sample.json."""
    values = (
        facts["image"]["exposure_s"],
        facts["system_gain_dn_per_e"],
        facts["image"]["black_level_dn"],
    )
    texts = [repr(float(value)) for value in values]
    return dict(zip(OF_SAMPLE, texts, strict=True))
