"""Notes of the same kind as one sentence: of a hundred stacks that drift, one is named and the others are counted."""

from __future__ import annotations

import re
from collections.abc import Iterable

NUMBER = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")


def merged(notes: Iterable[str]) -> list[str]:
    """Notes without those that differ from an earlier one by numbers and by the stack before the colon alone.

    What is left says how many stacks it is of; it is the first one's.
    """
    groups: dict[str, list[str]] = {}
    for note in dict.fromkeys(notes):
        _, colon, text = note.rpartition(": ")
        kind = NUMBER.sub("#", text if colon else note)
        groups.setdefault(kind, []).append(note)
    sentences: list[str] = []
    for alike in groups.values():
        sentence = alike[0]
        if len(alike) > 1:
            others = len(alike) - 1
            sentence += f" (and {others} more stack{'s' * (others > 1)} alike)"
        sentences.append(sentence)
    return sentences
