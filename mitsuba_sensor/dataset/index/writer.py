"""Writes the index of a dataset while that is made: each part when the last of its samples is there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain

from ...files import durable
from ...files.disk_errors import disk_sentences
from ..plan.planned import DatasetPlan, PlannedView
from ..store.record import INDEX, Entry
from ..store.shard_size import NUMBERS
from ..store.shards import Block
from ..store.store import Store
from .index import Index
from .origin import origin_of
from .part import InShard, Line, Part, all_parts, kinds_of, part_of, parts_of


@dataclass
class _Begun:
    """A part while it is made.

    lines : number of the first sample of a task → what the index says of its samples.  under_way : tasks that have not
    ended.  doubtful : those of which something may be missing.  blocks : its shards.  lights : key of a view that
    several tasks have samples of → where its light is stored, and the numbers of its samples.  is_planned : whether all
    its tasks are known.
    """

    lines: dict[int, list[Line]] = field(default_factory=dict)
    under_way: set[int] = field(default_factory=set)
    doubtful: set[int] = field(default_factory=set)
    blocks: dict[int, Block] = field(default_factory=dict)
    lights: dict[str, tuple[Entry, range]] = field(default_factory=dict)
    is_planned: bool = False


class IndexWriter:
    """Follows the tasks of a run.

    numbers : of the samples that the run makes.  A part that other runs make too is written by whoever is the last; all
    write the same bytes.  Raises DiskFull and InputError.
    """

    def __init__(self, plan: DatasetPlan, store: Store, numbers: range) -> None:
        self.plan, self.store, self.numbers = plan, store, numbers
        self._kinds = kinds_of(plan.file, bool(plan.shard_samples))
        self._digest = origin_of(plan).digest
        self._parts = parts_of(self._digest, all_parts(store.folder))
        self._begun: dict[int, _Begun] = {}

    @property
    def is_whole(self) -> bool:
        """Whether nothing is left to do."""
        return not any(True for _ in self._left())

    @property
    def there(self) -> int:
        """How many samples of the run are in parts that are whole."""
        left, found = {*self._left()}, 0.0
        for number, part in self._parts.items():
            numbers = self._numbers_of(number)
            if number not in left and len(numbers):
                found += part.rows * len(self._own(numbers)) / len(numbers)
        return round(found)

    def tasks(self) -> Iterator[PlannedView]:
        """The tasks of all parts that are not whole; :meth:`ended` must be called for each."""
        for number in self._left():
            part = self._begun[number] = _Begun()
            own = self._own(self._numbers_of(number))
            for view in self._views(own, part):
                part.lines[view.first] = lines_of(view)
                part.under_way.add(view.first)
                if not view.is_whole and view.key not in part.lights:
                    part.lights[view.key] = view.light_entry, view.light_numbers
                yield view
            part.is_planned = True
            self._write_if_ended(number)

    def ended(self, first: int, is_there: bool) -> None:
        """A task has ended.  first : number of its first sample.  is_there : whether all of it is on the disk."""
        part = self._begun[first // NUMBERS]
        part.under_way.discard(first)
        if not is_there:
            part.doubtful.add(first)
        self._write_if_ended(first // NUMBERS)

    def index(self) -> Index:
        """All that is written; what other parts replace is removed."""
        self._remove_replaced(found := all_parts(self.store.folder))
        return Index(self.store.folder, parts_of(self._digest, found).values())

    def _left(self) -> Iterator[int]:
        """Numbers of the parts of this run that are not whole."""
        for number in range(self.numbers.start // NUMBERS, -(-self.numbers.stop // NUMBERS)):
            part = self._parts.get(number)
            if (part is None or not part.is_whole) and len(self._own(self._numbers_of(number))):
                yield number

    def _numbers_of(self, part: int) -> range:
        return range(part * NUMBERS, min((part + 1) * NUMBERS, self.plan.numbers))

    def _own(self, numbers: range) -> range:
        """Those of the numbers that are of this run."""
        return range(
            max(numbers.start, self.numbers.start), min(numbers.stop, self.numbers.stop)
        )

    def _write_if_ended(self, number: int) -> None:
        begun = self._begun[number]
        if not begun.is_planned or begun.under_way:
            return
        del self._begun[number]
        numbers = self._numbers_of(number)
        own = self._own(numbers)
        others = (range(numbers.start, own.start), range(own.stop, numbers.stop))
        for view in chain.from_iterable(self._views(x, begun) for x in others if x):
            begun.lines[view.first] = lines_of(view)
            begun.doubtful.add(view.first)
        planned, found = sum(map(len, begun.lines.values())), self._lines_there(begun)
        part, content = part_of(self._digest, number, found, planned, self._kinds)
        place = self.store.folder / INDEX / part.name
        with disk_sentences(place.parent, durable.FOLDER_BYTES):
            durable.make_folder(place.parent, self.store.folder.parent)
        durable.write_lasting(place, content)
        parts = all_parts(self.store.folder)
        self._remove_replaced([other for other in parts if other.number == number])
        self._remove_lights(number, begun.lights, found)

    def _remove_lights(
        self, number: int, lights: Mapping[str, tuple[Entry, range]], found: Sequence[Line]
    ) -> None:
        """Remove the stored lights of which the index has all samples.  found : lines of the part that was written."""
        parts = parts_of(self._digest, all_parts(self.store.folder))
        whole = {other for other, part in parts.items() if part.is_whole}
        there = Counter(line.view for line in found)
        for view_key, (entry, numbers) in lights.items():
            of_part = self._numbers_of(number)
            own = len(range(max(numbers.start, of_part.start), min(numbers.stop, of_part.stop)))
            others = {*range(numbers.start // NUMBERS, -(-numbers.stop // NUMBERS))} - {number}
            if there[view_key] == own and others <= whole:
                self.store.remove_lights([entry.name])

    def _as_it_is(self, line: Line, is_doubtful: bool) -> Line | None:
        """The line with the folder in which its sample is; None where something of it is missing."""
        view = Entry("views", line.view_name, line.view)
        if is_doubtful and line.view_files and not self.store.exists(view):
            return None
        record = self.store.find(Entry("samples", line.name, line.key))
        if record is None:
            return None
        return line._replace(name=record.name)

    def _views(self, numbers: range, part: _Begun) -> Iterator[PlannedView]:
        """The samples with these numbers, by their light; their shards are noted."""
        size = self.plan.shard_samples
        if not size:
            yield from self.plan.views(numbers.start, numbers.stop)
            return
        for number in range(numbers.start // size, -(-numbers.stop // size)):
            part.blocks[number], views = self.plan.block(number)
            keys = {line.number: line.key for view in views for line in lines_of(view)}
            self.store.shards.rescue(part.blocks[number], keys)
            for view in views:
                yield from within(view, numbers)

    def _lines_there(self, begun: _Begun) -> list[Line]:
        """The lines of all samples that are there."""
        if self.plan.shard_samples:
            places: dict[int, InShard] = {}
            for block in begun.blocks.values():
                places |= self._places(block)
            planned = chain.from_iterable(lines for _, lines in sorted(begun.lines.items()))
            return _placed(planned, places)
        found = list[Line]()
        for first, lines in sorted(begun.lines.items()):
            there = [self._as_it_is(line, first in begun.doubtful) for line in lines]
            found += [line for line in there if line is not None]
        return found

    def _places(self, block: Block) -> dict[int, InShard]:
        """Where the samples of a block are, by their number; its pieces are joined before."""
        shard = self.store.shards.join(block)
        if shard is None:
            return {}
        found = dict[int, InShard]()
        for group in self.store.shards.groups(shard):
            start, end = group.start, group.end
            own = start if "view.json" in group.files else None
            found[group.number] = InShard(shard.name, start, end - start, own)
        return found

    def _remove_replaced(self, parts: Sequence[Part]) -> None:
        """Remove those of these parts that are of another plan, or have fewer samples than another one."""
        kept = parts_of(self._digest, parts).values()
        for part in {*parts} - {*kept}:
            with suppress(OSError):
                durable.remove_folder(self.store.folder / INDEX / part.name)


def within(view: PlannedView, numbers: range) -> Iterator[PlannedView]:
    """The samples of a task that have these numbers, as one task, or none."""
    first = max(view.first, numbers.start)
    samples = view.samples[first - view.first : max(numbers.stop - view.first, 0)]
    if len(samples) == len(view.samples):
        yield view
    elif samples:
        leads = view.leads and first == view.first
        yield replace(view, samples=samples, first=first, leads=leads)


def _placed(lines: Iterable[Line], places: Mapping[int, InShard]) -> list[Line]:
    """The lines of the samples that have a place, with it.

    places : by number; only those samples have a view_offset that have the files of a view.
    """
    found, leading, view_offset = list[Line](), ("", ""), None
    for line in lines:
        if (place := places.get(line.number)) is None:
            continue
        if place.view_offset is not None or leading != (place.shard, line.view):
            leading, view_offset = (place.shard, line.view), place.view_offset
        found.append(line._replace(place=place._replace(view_offset=view_offset)))
    return found


def lines_of(view: PlannedView) -> list[Line]:
    """What the index says of the samples of a task."""
    of_view = view.key, bool(view.outputs)
    numbered = enumerate(view.samples, start=view.first)
    return [Line(k, one.key, one.name, one.split, *of_view, one.values) for k, one in numbered]
