"""Writes what people read of a dataset, README.md, contact_sheet.png and samples.csv, at the end of a run."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

from ...core import InputError
from ...files import durable
from ...files.texts import text_of_file
from ..exports.card import CardFacts, write_card
from ..exports.summary import summary
from ..index.index import Index
from ..plan.planned import DatasetPlan
from ..read.samples_table import MOST_ROWS, known_of_table, write_samples_table
from ..store.record import CARD, INDEX, SHEET, TABLE
from ..store.store import Store

MOST_READ = 200
"""Samples that are read for the card of a dataset, however many it has."""
AGAIN = (
    f"`{INDEX}/*.parquet` lists all samples, and so does `{TABLE}`, of up to {MOST_ROWS} samples. `mitsuba-sensor "
    "dataset run` writes them, this page and the contact sheet again when the dataset changes: keep notes of your own "
    "in another file."
)


class Overview(NamedTuple):
    """What a run says of it at its end.  render_noise : the sentence of the card, where it was written.  remarks : on
    light that is too bright, and on what could not be written."""

    render_noise: str = ""
    remarks: tuple[str, ...] = ()


def write_overview(plan: DatasetPlan, store: Store, index: Index) -> Overview:
    """Write all three where the index is another one than theirs."""
    try:
        card = _card_text(store)
        table_is_known = _is_in_card(store, TABLE, card)
        table_is_whole = table_is_known or len(index) > MOST_ROWS
        sheet_is_there = f"({SHEET})" not in card or (store.folder / SHEET).is_file()
        if table_is_whole and sheet_is_there and index.digest in card:
            return Overview()
        known = {}
        if table_is_known:
            known = known_of_table(store)
        write_samples_table(store, index, known)
        facts = card_facts(plan, store, index)
        write_card(store.folder, facts)
    except Exception as error:  # all samples are there: the run has not failed
        what = f"{CARD}, {SHEET} or {TABLE} in {store.folder}"
        return Overview(remarks=(f"{what} was not written: {error}",))
    return Overview(facts.render_noise, facts.remarks)


def _card_text(store: Store) -> str:
    """The card that is there, which is written last; an empty text where there is none."""
    with suppress(InputError):
        return text_of_file(store.folder / CARD, "a run writes it again")
    return ""


def _is_in_card(store: Store, name: str, card: str) -> bool:
    """Whether a file is there and the card has its hash."""
    path = store.folder / name
    return path.is_file() and durable.sha256_of(path) in card


def card_facts(plan: DatasetPlan, store: Store, index: Index) -> CardFacts:
    """What the card of a dataset says in its own folder. Raises InputError."""
    facts = summary(store.folder, index, plan.file, most=MOST_READ)
    notes = [*facts.notes, AGAIN]
    if missing := plan.samples - len(index):
        views = len(store.quarantined())
        why = ""
        if views:
            why = f", and {views} views are in quarantine"
        notes = [f"{missing} of {plan.samples} samples are not there{why}.", *notes]
    hashes = {**facts.hashes, f"the names in `{INDEX}/`, a line each": index.digest}
    if (store.folder / TABLE).is_file():
        hashes[f"`{TABLE}`"] = durable.sha256_of(store.folder / TABLE)
    return replace(facts, notes=notes, hashes=hashes)
