"""Suggestions for misspelled names; none if no known name is close enough."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Iterable
from functools import wraps
from typing import Any, TypeVar

from .errors import InputError

Class = TypeVar("Class")

TYPOS_MAX, LETTERS_PER_TYPO = 2, 4
"""A name may have one typo, or one per 4 letters if it is longer, but at most 2."""

LETTERS_PER_TYPO_IN_PART = 3
"""A part of a name may have one typo per 3 letters after the first letter."""

NUMBER = re.compile(r"[-+]?[\d.]+(?:e[-+]?\d+)?", re.I)

BEGINNING_MIN = 4
"""Letters after which the beginning of a name is recognised."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return `` Did you mean …?`` with the known name closest to ``name``; empty if no name is close."""
    match = closest(name, known)
    return f" Did you mean {match!r}?" if match else ""


def checks_names(kind: type[Class]) -> type[Class]:
    """Make a class raise InputError for an unknown argument, with the nearest known name."""
    original: Any = kind.__init__
    names = [*inspect.signature(original).parameters][1:]

    @wraps(original)
    def checked(self: Class, *values: object, **named: object) -> None:
        for name in named:
            if name not in names:
                remedy = nearest(name, names) or f" The arguments are {', '.join(names)}."
                raise InputError(f"{name!r} is not an argument of {kind.__name__}.{remedy}")
        original(self, *values, **named)

    kind.__init__ = checked  # type: ignore[assignment, method-assign]
    return kind


def nearest_file(name: str, suffix: str = "", folder: str | os.PathLike[str] = ".") -> str:
    """Return `` Did you mean …?`` with the file beside a missing file whose name is closest; empty if no name is close.

    name : of the missing file, from the folder.  suffix : of the suggested file.
    """
    parent, asked = os.path.split(name)
    try:
        beside = sorted(os.listdir(os.path.join(folder, parent)))
    except (OSError, ValueError):  # ValueError for a NUL in the name
        return ""
    match = closest(asked, [file for file in beside if file.endswith(suffix) and file != asked])
    return f" Did you mean {os.path.join(parent, match)!r}?" if match else ""


def closest(name: str, known: Iterable[str], cutoff: float = 0.5) -> str | None:
    """Return the known name closest to ``name``, or None, also for a number, whose neighbours are no misspellings.

    cutoff : similarity needed, 0 to 1 (rapidfuzz's ratio).
    """
    from rapidfuzz import fuzz, process

    if NUMBER.fullmatch(name.strip()):
        return None
    spellings, asked = {candidate.lower(): candidate for candidate in known}, name.lower()
    similar = process.extract(
        asked, list(spellings), scorer=fuzz.ratio, score_cutoff=100 * cutoff, limit=None
    )
    return next((spellings[text] for text, _, _ in similar if _is_close(asked, text)), None)


def _is_close(name: str, known: str) -> bool:
    """Return True if a name is a misspelling, the beginning or some parts of the other; a swap is one typo."""
    from rapidfuzz.distance import OSA

    typos = min(TYPOS_MAX, max(1, len(known) // LETTERS_PER_TYPO))
    unfinished = len(name) >= BEGINNING_MIN and known.startswith(name)
    if unfinished or OSA.distance(name, known) <= typos:
        return True
    fewer, more = sorted((re.findall(r"[^\W_]+", text) for text in (name, known)), key=len)
    return bool(fewer) and all(
        any(
            OSA.distance(part, other)
            <= (max(len(part), len(other)) - 1) // LETTERS_PER_TYPO_IN_PART
            for other in more
        )
        for part in fewer
    )
