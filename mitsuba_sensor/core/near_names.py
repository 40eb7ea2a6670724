"""The known name that was probably meant by one that is not known; none where no name is close enough to mislead."""

from __future__ import annotations

import re
from collections.abc import Iterable

MOST_LETTERS = 2
"""Letters that may be wrong in a whole name, however long it is."""

LETTERS_OF_ONE_WRONG = 4
"""A whole name may have one wrong letter for so many letters, and one in any case."""

LETTERS_OF_ONE_WRONG_IN_PART = 3
"""A part of a name may have one wrong letter for so many letters beyond the first."""

SHORTEST_BEGINNING = 4
"""Letters of an unfinished name."""


def nearest(name: str, known: Iterable[str]) -> str:
    """`` Did you mean …?`` with the known name closest to ``name``, or an empty string if none is close."""
    match = closest(name, known)
    if match:
        return f" Did you mean {match!r}?"
    return ""


def closest(name: str, known: Iterable[str], cutoff: float = 0.5) -> str | None:
    """The known name closest to ``name``, or None.  cutoff : likeness that it needs, 0 … 1 (rapidfuzz's ratio)."""
    from rapidfuzz import fuzz, process

    written = {one.lower(): one for one in known}
    asked = name.lower()
    alike = process.extract(
        asked, list(written), scorer=fuzz.ratio, score_cutoff=100 * cutoff, limit=None
    )
    for candidate, _, _ in alike:
        if _is_close(asked, candidate):
            return written[candidate]
    return None


def _is_close(name: str, known: str) -> bool:
    """Whether one is a misspelling, the beginning or the parts of the other."""
    allowed = min(MOST_LETTERS, max(1, len(known) // LETTERS_OF_ONE_WRONG))
    if wrong_letters(name, known) <= allowed:
        return True
    if len(name) >= SHORTEST_BEGINNING and known.startswith(name):
        return True
    return _share_parts(_parts(name), _parts(known))


def _parts(name: str) -> list[str]:
    return [part for part in re.split(r"[\W_]+", name) if part]


def _share_parts(parts: list[str], others: list[str]) -> bool:
    """Whether each part of the name that has fewer is a part of the other one, or a misspelling of it."""
    fewer, more = sorted((parts, others), key=len)
    for part in fewer:
        match = next((other for other in more if _is_part(part, other)), None)
        if match is None:
            return False
        more = [other for other in more if other is not match]
    return bool(fewer)


def _is_part(part: str, other: str) -> bool:
    longer = max(len(part), len(other))
    return wrong_letters(part, other) <= (longer - 1) // LETTERS_OF_ONE_WRONG_IN_PART


def wrong_letters(name: str, other: str) -> int:
    """Letters to add, leave out, change, or exchange with the next one, to make one name of the other."""
    from rapidfuzz.distance import OSA

    return int(OSA.distance(name, other))
