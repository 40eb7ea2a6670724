"""The index of a dataset: a sequence of lines in parts, of which few are in memory at a time."""

from __future__ import annotations

import hashlib
import math
import operator
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import accumulate, compress
from typing import TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from ...core import InputError, nearest
from ...files.objects import Place
from .part import Line, OpenPart, Part, splits_of

MOST_KEPT = 8
"""Parts of which rows are kept in memory."""
MOST_SAID = 20  # values, in the sentence on one that no sample has
MOST_KNOWN = 1000
"""Values that are looked through for that sentence."""
Asked: TypeAlias = tuple[tuple[str, object], ...]
"""Names and values that samples must have."""
opened = lru_cache(MOST_KEPT)(OpenPart)


class Index(Sequence[Line]):
    """Lines of the index, in the order of the dataset. No more than a few parts are in memory.

    folder : of the dataset.  asked : names and values that its lines have.
    Raises InputError for a part that was changed, when it is read.
    """

    def __init__(self, folder: Place, parts: Iterable[Part], asked: Asked = ()) -> None:
        self.folder, self.parts, self.asked = folder, list(parts), asked
        self._kept: dict[int, NDArray[np.int64]] = {}
        self._ends = list(accumulate(map(self._count, self.parts), initial=0))

    def __len__(self) -> int:
        return self._ends[-1]

    @overload
    def __getitem__(self, number: int) -> Line: ...

    @overload
    def __getitem__(self, number: slice) -> list[Line]: ...

    def __getitem__(self, number: int | slice) -> Line | list[Line]:
        places = range(len(self))
        if isinstance(number, slice):
            return [self[place] for place in places[number]]
        place = places[operator.index(number)]
        which = bisect_right(self._ends, place) - 1
        part, row = self.parts[which], place - self._ends[which]
        if self.asked:
            row = int(self._chosen(part)[row])
        return opened(self.folder, part).line(row)

    def __iter__(self) -> Iterator[Line]:
        for part in self.parts:
            lines, chosen = OpenPart(self.folder, part).lines(), np.zeros(part.rows, bool)
            chosen[self._chosen(part)] = True
            yield from compress(lines, chosen.tolist())

    @property
    def digest(self) -> str:
        """SHA-256 of the names of its files, which hold the hashes of their contents."""
        names = "".join(f"{part.name}\n" for part in self.parts)
        return hashlib.sha256(names.encode()).hexdigest()

    def where(self, name: str, value: object) -> Index:
        """The lines that have this value. Raises InputError, with what there is, where there are none."""
        found = Index(self.folder, self.parts, (*self.asked, (name, value)))
        if not len(found):
            _require_known(name, value, Index(self.folder, self.parts))
        return found

    def names(self) -> list[str]:
        """Names of what has values, split included."""
        return [name for part in self.parts[:1] for name in opened(self.folder, part).names()]

    def counts(self, name: str, most: float = math.inf) -> dict[str, int]:
        """Each value of a name → how many lines have it.  most : values after which no more parts are read."""
        found = Counter[str]()
        for part in self.parts:
            found += Counter(self._counts_in(part, name))
            if len(found) > most:
                break
        return dict(found)

    def _counts_in(self, part: Part, name: str) -> dict[str, int]:
        """The same of one part."""
        if name == "split" and not self.asked:
            return splits_of(self.folder, part)
        found = dict[str, int]()
        for values, numbers in opened(self.folder, part).values(name):
            chosen = numbers[self._chosen(part)]
            each = np.bincount(chosen[chosen >= 0], minlength=len(values)).tolist()
            for value, count in zip(values, each, strict=True):
                found[str(value)] = found.get(str(value), 0) + count
        return found

    def _count(self, part: Part) -> int:
        """How many lines of a part have what is asked for."""
        match self.asked:
            case ():
                return part.rows
            case (("split", split),):
                splits = splits_of(self.folder, part)
                return sum(count for own, count in splits.items() if is_equal(own, split))
            case _:
                return len(self._chosen(part))

    def _chosen(self, part: Part) -> NDArray[np.int64]:
        """Numbers of the rows of a part that have what is asked for."""
        if part.number not in self._kept:
            if len(self._kept) == MOST_KEPT:
                self._kept.clear()
            self._kept[part.number] = _rows_with(self.folder, part, self.asked)
        return self._kept[part.number]


def _rows_with(folder: Place, part: Part, asked: Asked) -> NDArray[np.int64]:
    chosen = np.ones(part.rows, bool)
    for name, value in asked:
        here = np.zeros(part.rows, bool)
        for values, numbers in opened(folder, part).values(name):
            equal = [is_equal(own, value) for own in values]
            here |= np.array([*equal, False])[numbers]
        chosen &= here
    return np.flatnonzero(chosen)


def is_equal(own: object, value: object) -> bool:
    """Whether a value of a sample is the one that is asked for; numbers are equal to nine digits."""
    if own is None:
        return False
    if isinstance(value, float) and isinstance(own, int | float):
        return math.isclose(value, own, rel_tol=1e-9)
    if isinstance(value, tuple):
        value = [*value]
    return bool(own == value)


def _require_known(name: str, value: object, index: Index) -> None:
    """Raise InputError, with what there is, for a name or a value that no line has."""
    if name not in (names := index.names()):
        raise InputError(
            f"no sample has {name!r}; what they have: {', '.join(names)}.{nearest(name, names)}"
        )
    if len(Index(index.folder, index.parts, ((name, value),))):
        return
    known = [text or "none" for text in index.counts(name, MOST_KNOWN)]
    shown = known[:MOST_SAID]
    if len(known) > MOST_SAID:
        shown.append(f"… ({len(known)} values)")
    raise InputError(
        f"{name} is {value!r}; the samples have {', '.join(shown)}.{nearest(str(value), known)}"
    )
