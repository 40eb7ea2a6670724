"""What people read of a dataset: samples.csv in its folder, made at the end of each run."""

from __future__ import annotations

from .reader import Index
from .record import TABLE
from .samples_table import write_samples_table
from .store import Store


def write_overview(store: Store, index: Index) -> list[str]:
    """Write it; remarks on what could not be written."""
    try:
        write_samples_table(store, index.lines)
    except Exception as error:  # all samples are there: the run has not failed
        return [f"{store.folder / TABLE} was not written: {error}"]
    return []
