"""What people read of a dataset first, written at the end of a run: README.md, contact_sheet.png and samples.csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping

from ..core import InputError
from ..files import durable
from ..files.texts import write_page
from .card import CARD, SHEET, CardNotes, write_card
from .file import DatasetFile
from .keys import Config
from .store import Store
from .table import EXPOSED, Table

TABLE = "samples.csv"
ROWS_MAX = 100_000
"""Rows of which spreadsheets are made."""
COLUMNS = ("key", "split", "shard", "scene", "view", "camera", "serial", *EXPOSED)
"""First columns of samples.csv; then all others that vary."""
AGAIN = (
    f"`index.parquet` lists all samples, and so does `{TABLE}`, of up to {ROWS_MAX} samples. `mitsuba-sensor dataset "
    "run` writes them, this page and the contact sheet again when the dataset changes: keep notes of your own in "
    "another file."
)


def write_overview(
    store: Store, file: DatasetFile, table: Table, planned: int, failed: int
) -> CardNotes:
    """Write all three where the card is of other samples. What cannot be written is a remark.

    planned : samples in all.  failed : tasks that could not be made.
    """
    mark = f"<!-- {table.digest} of {planned}, {failed} failed -->"
    names = [CARD] + [TABLE] * (len(table) <= ROWS_MAX)
    card = durable.read_small(store.folder / CARD, 2**24).decode("utf-8", "replace")
    names += [SHEET] * (f"({SHEET})" in card)
    if mark in card and all((store.folder / name).is_file() for name in names):
        return CardNotes()
    notes = [AGAIN]
    if planned > len(table):
        why = f", and {failed} tasks have failed" if failed else ""
        notes = [f"{planned - len(table)} of {planned} samples are not there{why}.", AGAIN]
    try:
        if len(table) <= ROWS_MAX:
            write_page(store.folder / TABLE, samples_csv(table))
        else:
            durable.remove_file(store.folder / TABLE)
        return write_card(store.folder, store, table, file, file.licence, "", [*notes, mark])
    except (InputError, OSError) as error:  # all samples are there: the run has not failed
        what = f"{CARD}, {SHEET} or {TABLE} in {store.folder}"
        return CardNotes(remarks=(f"{what} was not written: {error}",))


def samples_csv(table: Table) -> str:
    """A row for each sample, for spreadsheets; the parts of a pose have columns of their own."""
    names, text = dict.fromkeys(COLUMNS), io.StringIO()
    for line in table:
        names.update(dict.fromkeys(_cells(line.values)))
    writer = csv.DictWriter(text, [*names], restval="", lineterminator="\n")
    writer.writeheader()
    for line in table:
        places = {"key": line.key, "split": line.split, "shard": line.shard}
        writer.writerow({**places, **_cells(line.values), **line.exposed})
    return text.getvalue()


def _cells(values: Config) -> dict[str, str]:
    cells: dict[str, str] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            cells |= _cells({f"{name}.{part}": one for part, one in value.items()})
        elif isinstance(value, list | tuple):
            cells[name] = " ".join(map(str, value))
        else:
            cells[name] = str(value)
    return cells
