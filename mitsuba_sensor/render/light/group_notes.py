"""Notes of light groups: each once, with the names of the groups that have it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping


def notes_of_groups(notes: Mapping[str, Iterable[str]]) -> list[str]:
    """The notes of all groups; with the names of the groups that have one, where these are not all.

    notes : by the name of the group.
    """
    groups = _groups_by_note(notes)
    return [_with_names(note, names, len(notes)) for note, names in groups.items()]


def without_unlit(
    of_sum: Iterable[str], notes: Mapping[str, Iterable[str]], lit: Collection[str]
) -> tuple[str, ...]:
    """The notes of the sum of the groups without those that only groups have which are off.

    of_sum : with those of :func:`notes_of_groups`.  notes : by the name of the group.  lit : groups that are on.
    """
    left = dict[str, str]()
    for note, names in _groups_by_note(notes).items():
        if len(names) == len(notes):
            continue
        on = [name for name in names if name in lit]
        whole = _with_names(note, names, len(notes))
        left[note] = left[whole] = ""
        if on:
            left[note], left[whole] = note, _with_names(note, on, len(notes))
    return tuple(line for note in of_sum if (line := left.get(note, note)))


def _groups_by_note(notes: Mapping[str, Iterable[str]]) -> dict[str, list[str]]:
    """The names of the groups that have a note."""
    groups = dict[str, list[str]]()
    for name, of_group in notes.items():
        for note in dict.fromkeys(of_group):
            groups.setdefault(note, []).append(name)
    return groups


def _with_names(note: str, names: Collection[str], count: int) -> str:
    """A note with the names of its groups in front, where these are not all.  count : of all groups."""
    if len(names) == count:
        return note
    return f"{', '.join(names)}: {note}"
