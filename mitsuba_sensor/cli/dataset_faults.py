"""What `dataset verify` says: a table of what is not as it was written, and what to do about each kind of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Group as Lines
from rich.console import RenderableType
from rich.text import Text

from ..dataset.index.origin import RESTORE
from ..dataset.index.repair import verify
from ..dataset.index.verify_objects import verify_objects
from ..dataset.store.faults import Fault
from ..dataset.store.record import INDEX
from ..files.objects import Objects, is_address
from .tables import ResultTable

MOST_SHOWN = 50
"""Faults in the table."""
MOST_NAMED = 3
"""Files in a sentence."""
Chosen = Callable[[Fault], bool]


def faults_of(
    folder: str, show: Callable[[int, int], object], roots: Sequence[str] | None
) -> list[Fault]:
    """What is not as it was written of a dataset in a folder, or in an object store.

    show : called with how much is verified, of how much.  Raises InputError.
    """
    if is_address(folder):
        return [*verify_objects(Objects(folder), show, roots)]
    return [*verify(Path(folder), show, roots)]


def fault_sheet(folder: str, faults: Sequence[Fault]) -> RenderableType:
    """What is not as it was written, file by file, and sentences on what to do."""
    lines = list[RenderableType]()
    if not any(fault.is_damage for fault in faults):
        lines.append(Text(f"{folder}: every file is as it was written", style="green"))
    listed = [fault for fault in faults if not _is_not_here(fault)]
    listed.sort(key=lambda fault: not fault.is_damage)
    if listed:
        lines.append(_table(listed[:MOST_SHOWN]))
    if len(listed) > MOST_SHOWN:
        lines.append(Text(f"and {len(listed) - MOST_SHOWN} more (--json lists all)"))
    remedies = _REMEDIES
    if is_address(folder):
        remedies = ((_is_made_again, _PUSHED_AGAIN), *_REMEDIES[1:])
    for is_of_kind, sentence in remedies:
        files = [fault.file for fault in faults if is_of_kind(fault)]
        if files:
            named = ", ".join(files[:MOST_NAMED])
            if len(files) > MOST_NAMED:
                named += f" and {len(files) - MOST_NAMED} more"
            restore = RESTORE.format(folder)
            lines.append(Text(sentence.format(folder=folder, files=named, restore=restore)))
    return Lines(*lines)


def _table(faults: Sequence[Fault]) -> ResultTable:
    table = ResultTable(("what", "of", "folder", "file"))
    for one in faults:
        table.add_row(one.what, one.kind, Text(one.name), Text(one.file))
    return table


def _is_not_here(fault: Fault) -> bool:
    return fault.kind == "source" and fault.what == "missing"


def _is_made_again(fault: Fault) -> bool:
    """Whether a repair makes it again."""
    if fault.what == "stray" or not fault.is_damage or fault.kind == "source":
        return False
    return fault.kind != "dataset" or fault.file.startswith(f"{INDEX}/")


def _says_what_it_is(fault: Fault) -> bool:
    """Whether it is the record of the dataset, or its file."""
    return fault.kind == "dataset" and fault.is_damage and "/" not in fault.file


_PUSHED_AGAIN = (
    "Remove these objects from the store, where they are there, and put them there again: `mitsuba-sensor dataset push "
    "DIR {folder}`, which passes over what has the right name and size."
)
_REMEDIES: tuple[tuple[Chosen, str], ...] = (
    (_is_made_again, "`mitsuba-sensor dataset repair {folder}` makes them again."),
    (
        lambda fault: _says_what_it_is(fault) and fault.what != "stray",
        "What says what the samples are was changed; {restore}.",
    ),
    (
        lambda fault: fault.kind == "source" and fault.is_damage,
        "The samples were made from another {files}: they show another scene or camera than the files that are here "
        "now. Restore these before `run` and `repair`, or make a dataset of them in a new folder: `mitsuba-sensor "
        "dataset run FILE.toml -o NEW`.",
    ),
    (
        _is_not_here,
        "Not compared, as they are not here: {files}. Samples are read without them; `run` and `repair` "
        "need them: name their folder with --root.",
    ),
    (
        lambda fault: fault.kind == "library",
        "Made by {files}, and another version is installed here: samples are read all the same, and `run` and "
        "`repair` make none with it.",
    ),
    (
        lambda fault: fault.what == "stray",
        "No run wrote {files}: programs that read all files of a folder take it for data. Move it away; nothing but "
        "you removes it.",
    ),
    (
        lambda fault: fault.what == "not of the dataset",
        "No run wrote {files}, and no reader of the samples looks at it: it stays where it is.",
    ),
    (
        lambda fault: fault.what == "unfinished",
        "Unfinished: {files}, of a program that still runs, or was killed; no damage. An hour after its last byte "
        "the next `mitsuba-sensor dataset repair {folder}` or `run` removes it.",
    ),
)
"""Which faults → what to do about them."""
