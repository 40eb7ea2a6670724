"""The known name that was probably meant by one that is not known; none where no name is close enough to mislead."""

from __future__ import annotations

import re
from collections.abc import Iterable

LETTERS_MAX, LETTERS_PER_WRONG = 2, 4
"""Wrong letters of a whole name: one for so many letters, at least one and at most so many."""

LETTERS_PER_WRONG_IN_PART = 3
"""A part of a name may have one wrong letter for so many letters beyond the first."""

BEGINNING_MIN = 4
"""Letters of an unfinished name."""


def nearest(name: str, known: Iterable[str]) -> str:
    """`` Did you mean …?`` with the known name closest to ``name``, or an empty string if none is close."""
    match = closest(name, known)
    return f" Did you mean {match!r}?" if match else ""


def closest(name: str, known: Iterable[str], cutoff: float = 0.5) -> str | None:
    """The known name closest to ``name``, or None.  cutoff : likeness that it needs, 0 … 1 (rapidfuzz's ratio)."""
    from rapidfuzz import fuzz, process

    written, asked = {one.lower(): one for one in known}, name.lower()
    alike = process.extract(
        asked, list(written), scorer=fuzz.ratio, score_cutoff=100 * cutoff, limit=None
    )
    return next((written[one] for one, _, _ in alike if _is_close(asked, one)), None)


def _is_close(name: str, known: str) -> bool:
    """Whether one is a misspelling, the beginning or the parts of the other; exchanged letters count once."""
    from rapidfuzz.distance import OSA

    allowed = min(LETTERS_MAX, max(1, len(known) // LETTERS_PER_WRONG))
    unfinished = len(name) >= BEGINNING_MIN and known.startswith(name)
    if unfinished or OSA.distance(name, known) <= allowed:
        return True
    fewer, more = sorted((re.findall(r"[^\W_]+", one) for one in (name, known)), key=len)
    return bool(fewer) and all(
        any(
            OSA.distance(part, other)
            <= (max(len(part), len(other)) - 1) // LETTERS_PER_WRONG_IN_PART
            for other in more
        )
        for part in fewer
    )
