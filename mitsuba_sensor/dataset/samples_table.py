"""The table samples.csv of a dataset: a row for each sample, for spreadsheets and pandas."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..files.texts import read_json, text_of_file, write_page
from .keys import Config, Facts
from .reader import CHANGED
from .record import TABLE
from .store import Store
from .values import text_of

NOTHING: Mapping[str, str] = {}
COLUMNS = ("key", "folder", "split", "scene", "view", "camera", "serial", "exposure_s")
"""Of every table; then all others that vary, in the order in which the samples have them."""


def write_samples_table(
    store: Store, lines: Sequence[Facts], known_s: Mapping[str, str] = NOTHING
) -> None:
    """Write samples.csv.

    lines : of the index.  known_s : key → exposure time of samples that an earlier table had, which are not read.
    Raises InputError for a sample that is not as it was written.
    """
    names = dict.fromkeys(COLUMNS)
    for line in lines:
        names.update(dict.fromkeys(_cells(line["values"])))
    text = io.StringIO()
    writer = csv.DictWriter(text, [*names], restval="", lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow(_row(store, line, known_s))
    write_page(store.folder / TABLE, text.getvalue())


def exposures_of_table(store: Store) -> dict[str, str]:
    """Key → exposure time in samples.csv. Raises InputError where it cannot be read."""
    text = text_of_file(store.folder / TABLE, "a run writes it again")
    return {row["key"]: row["exposure_s"] for row in csv.DictReader(io.StringIO(text))}


def _row(store: Store, line: Config, known_s: Mapping[str, str]) -> dict[str, str]:
    """Column → text of one sample."""
    folder, values = store.folder_of("samples", line["key"]), line["values"]
    return {
        "key": line["key"],
        "folder": folder.relative_to(store.folder).as_posix(),
        "split": line["split"],
        **_cells(values),
        "exposure_s": known_s.get(line["key"]) or repr(_exposed_s(folder, values)),
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


def _exposed_s(folder: Path, values: Config) -> float:
    """Time for which a sample was exposed, stops included [s]: one that was metered stands in sample.json."""
    asked_s = values.get("exposure_s")
    if isinstance(asked_s, int | float):
        return float(asked_s * 2.0 ** values.get("exposure_ev", 0))
    return float(read_json(folder / "sample.json", CHANGED)["image"]["exposure_s"])
