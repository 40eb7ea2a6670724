"""What of a dataset is not as it was written: every byte of it is read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from ..files import durable
from ..files.parquet import ParquetRows
from .store import INDEX, RECORD, SHARDS, Store, record_of
from .table import table_bytes

What = Literal["changed", "missing", "no shard"]


class Fault(NamedTuple):
    """A file of the folder.  what : no shard is a file among shards that no run wrote."""

    file: str
    what: What

    @property
    def is_damage(self) -> bool:
        """Whether samples are lost, or said to be what they are not."""
        return self.what != "no shard"


def verify(
    store: Store, now: Callable[[int, int], object] = lambda done, total: None
) -> list[Fault]:
    """What is not as it was written.  now : told how many shards are read, of how many.

    Raises InputError where there is no dataset, or one of another format.
    """
    store.require_record()
    shards, faults = store.finished(), list[Fault]()
    content = durable.read_small(store.folder / RECORD, 2**26)
    if record_of(content) is None:
        faults.append(Fault(RECORD, "changed" if content else "missing"))
    known = {shard.name for shard in shards.values()}
    for name in durable.names_of(store.shards):
        if name not in known and not name.startswith(durable.SCRATCH):
            faults.append(Fault(f"{SHARDS}/{name}", "no shard"))
    for number, shard in enumerate(shards.values()):
        now(number, len(shards))
        if not store.is_sound(shard):
            faults.append(Fault(f"{SHARDS}/{shard.name}", "changed"))
    if not any(fault.is_damage for fault in faults):
        faults += _faults_of_table(store)
    return faults


def _faults_of_table(store: Store) -> list[Fault]:
    """Of the table, which can be made from the shards again; one that is older is no fault."""
    path = store.folder / INDEX
    if not path.is_file():
        return [Fault(INDEX, "missing")]
    try:
        found, wanted = ParquetRows(path), ParquetRows(table_bytes(store))
        if found.about != wanted.about:
            return []
        same = found.types == wanted.types and found.rows == wanted.rows
        pairs = zip(found.all_rows(), wanted.all_rows(), strict=True)
        same = same and all(one == other for one, other in pairs)
    except (ValueError, OSError):
        same = False
    return [] if same else [Fault(INDEX, "changed")]


def remove_faults(store: Store, faults: list[Fault]) -> None:
    """Remove the shards and the table that are not as they were written, and write the record again."""
    record = store.record()
    for fault in faults:
        if fault.is_damage and fault.file != RECORD:
            durable.remove_file(store.folder / fault.file)
    if record is not None:
        store.write_record(record)
