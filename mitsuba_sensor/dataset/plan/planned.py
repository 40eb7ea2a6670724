"""The samples of a dataset, each a function of its number, in groups that share a light; with their keys."""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import TypeVar

import numpy as np

from ...core import InputError
from ...files.appearing import refuse_empty
from ...files.texts import text_of_file
from ..store.keys import Config, key_of
from ..store.names import name_of_view
from ..store.record import Entry
from ..store.shard_size import shard_samples
from ..store.shards import Block
from .checks import Pair, PlannedScene, checked_scenes, telling_combinations
from .configured import OF_VIEW, ConfiguredSamples, PlannedSample
from .file import MOST_SAMPLES, read_dataset
from .sources import Source, sources_of
from .splits import AS_DRAWN
from .sweep import Combination, Light, SceneSweep

MOST_OF_VIEW = 1000
"""Samples of a view that are one task: a view with more is made by several, from one light."""
NO_PIXELS = {"description", "licence", "store"}
"""Of a dataset file, what decides neither which samples there are nor their order."""
Thing = TypeVar("Thing")


@dataclass(frozen=True)
class PlannedView:
    """One render and samples that are exposed to it: all, or some of many.

    name : of its folder.  key : hash of what decides its light, config, and of its outputs.
    samples : in the order of the dataset.
    scene_file : where the scene is on this machine.  lead : configuration of the first of all samples of the light.
    first : number of the first sample.  light_numbers : of all samples of the light.
    block : of the shard that has them; None where each has a folder.  leads : whether the first of them has the files
    of the view there.
    """

    name: str
    key: str
    config: Config
    outputs: tuple[str, ...]
    scene: str
    scene_file: str
    samples: tuple[PlannedSample, ...]
    lead: Config
    first: int
    light_numbers: range
    block: Block | None = None
    leads: bool = False

    @property
    def entry(self) -> Entry:
        """What it is in the store."""
        return Entry("views", self.name, self.key)

    @property
    def is_whole(self) -> bool:
        """Whether it has all samples of its light."""
        return len(self.samples) == len(self.light_numbers)

    @property
    def task_key(self) -> str:
        """The key of these samples of the light."""
        if self.is_whole:
            return self.key
        return key_of({"view": self.key, "first": self.first, "samples": len(self.samples)})

    @property
    def light_entry(self) -> Entry:
        """What its light is in the store, where several tasks need it.

        Another order of cameras in the dataset file has another lead, for which the same view is rendered otherwise.
        """
        key = key_of({"view": self.key, "lead": self.lead})
        return Entry("lights", f"{self.name.rpartition('/')[0]}/{key}", key)


@dataclass(frozen=True, eq=False)
class DatasetPlan(ConfiguredSamples):
    """All samples of a dataset file, each found by its number; nothing is kept of them.  Raises InputError.

    roots : folders below which its files may be read.  text : of the file, as it was written.
    made_by : versions of what its pixels depend on.
    """

    def __post_init__(self) -> None:
        self.splits  # noqa: B018, raises what is wrong with files and splits
        if self.samples > MOST_SAMPLES:
            raise InputError(
                f"the dataset has {self.samples} samples; one has at most {MOST_SAMPLES}: make several, or draw "
                "values at random in place of every combination."
            )

    @cached_property
    def samples(self) -> int:
        """How many samples there are."""
        return sum(
            dealt.samples * len(self.splits.serials(dealt.split, sweep.rows[row], camera))
            for sweep in self.sweeps
            for dealt in self.splits.dealt(sweep)
            for row in dealt.rows
            for camera in range(len(self.file.cameras))
        )

    @cached_property
    def scenes(self) -> Sequence[PlannedScene]:
        """The samples of each scene, checked."""
        return checked_scenes(self)

    @cached_property
    def shard_samples(self) -> int:
        """Numbers of samples that are one shard; 0 where each sample is a folder."""
        return shard_samples(self.file.store.shard_samples, self.samples)

    @property
    def numbers(self) -> int:
        """How many numbers the samples take. Where splits leave combinations out, some numbers have no sample."""
        return self.scenes[-1].end

    @cached_property
    def digest(self) -> str:
        """SHA-256 that is another one for other keys of samples, or another order of them."""
        file = self.file.model_dump_json(exclude=NO_PIXELS, warnings=False)
        keys = (self.first_sample(one).key for one in telling_combinations(self))
        return hashlib.sha256("\n".join([file, *keys]).encode()).hexdigest()

    def files(self) -> Iterator[tuple[Path, str]]:
        """All files that the samples are made from, some several times, and what each is of."""
        for one in telling_combinations(self):
            yield from self.lights.files(one)
            yield from self.cameras.files(one)

    @cached_property
    def sources(self) -> dict[str, Source]:
        """The same by their names, with their digests."""
        return sources_of(self)

    def views(self, first: int = 0, end: int | None = None) -> Iterator[PlannedView]:
        """The samples with numbers from ``first`` to before ``end``, in their order, by their light."""
        end = self.numbers if end is None else min(end, self.numbers)
        for scene in self.scenes:
            number = max(first, scene.first)
            while number < min(end, scene.end):
                view, number = self._view(scene, number, end)
                if view is not None:
                    yield view

    def block(self, number: int) -> tuple[Block, list[PlannedView]]:
        """The samples of a shard, by their light."""
        first, digest, planned = number * self.shard_samples, hashlib.sha256(), 0
        views = [*self.views(first, first + self.shard_samples)]
        for view in views:
            for place, sample in enumerate(view.samples, view.first):
                digest.update(f"{place} {sample.key} {sample.name}\n".encode())
            planned += len(view.samples)
        block, before, led = Block(number, digest.hexdigest()[:12], planned), "", []
        for view in views:
            led.append(replace(view, block=block, leads=view.key != before))
            before = view.key
        return block, led

    def first_views(self, scene: PlannedScene, lights: Iterable[int]) -> Iterator[PlannedView]:
        """The first sample of some lights of a scene, by the numbers of the lights."""
        for light in lights:
            for shared in scene.shared:
                first = scene.first + light * scene.numbers_of_light + shared.start
                yield from self.views(first, first + 1)

    def _view(
        self, scene: PlannedScene, number: int, end: int
    ) -> tuple[PlannedView | None, int]:
        """Samples of one light from a number on; and the number from which on other tasks have them."""
        light_number, place = divmod(number - scene.first, scene.numbers_of_light)
        starts = [shared.start for shared in scene.shared]
        shared = scene.shared[bisect_right(starts, place) - 1]
        start = scene.first + light_number * scene.numbers_of_light + shared.start
        light = scene.sweep.light(light_number)
        exposed = _Exposed(self, scene.sweep, light, shared.pairs)
        next_task = (number // MOST_OF_VIEW + 1) * MOST_OF_VIEW
        stop = min(end, next_task, start + shared.end - shared.start)
        chosen = range(number - start, min(stop - start, exposed.count))
        if not chosen:
            return None, stop
        one, _ = exposed.at(0)
        config, key = self.light_key(one, self.cameras.of(one))
        samples = [self._sample_of(exposed, place, key) for place in (0, *chosen)]
        outputs = tuple(name for name in OF_VIEW if name in self.file.outputs)
        own = key_of({"view": key, "outputs": outputs, "made_by": self.made_by})
        where = self.file.scenes[one.scene].name, str(self.lights.places[one.scene])
        light_numbers = range(start, start + exposed.count)
        lead, *rest = samples
        name = name_of_view(lead.values, own)
        return PlannedView(
            name, own, config, outputs, *where, tuple(rest), lead.config, number, light_numbers
        ), stop

    def _sample_of(self, exposed: _Exposed, place: int, light_key: str) -> PlannedSample:
        one, serial = exposed.at(place)
        return self.sample(one, self.cameras.of(one), light_key, serial, exposed.split)


class _Exposed:
    """The samples of one light, found by their place among them."""

    def __init__(
        self, plan: DatasetPlan, sweep: SceneSweep, light: Light, pairs: Sequence[Pair]
    ) -> None:
        self.sweep, self.light, self.pairs = sweep, light, pairs
        self.split = plan.splits.of(sweep, light, pairs[0][0])
        rows = sweep.rows
        self.serials = [plan.splits.serials(self.split, rows[r], c) for r, c in pairs]
        exposures = sweep.exposures(light)
        self.ends = list(accumulate(exposures * len(serials) for serials in self.serials))
        self.count = self.ends[-1]

    def at(self, place: int) -> tuple[Combination, int]:
        """What a sample is made of, and its serial number."""
        number = bisect_right(self.ends, place)
        if number:
            place -= self.ends[number - 1]
        serials = self.serials[number]
        exposure, chip = divmod(place, len(serials))
        one = self.sweep.combination(self.light, *self.pairs[number], exposure)
        serial = serials[chip]
        if serial == AS_DRAWN:
            serial = int(one.values["serial"])
        return one, serial


def evenly_chosen(things: Sequence[Thing], most: int) -> list[Thing]:
    """At most so many of them, evenly chosen, in their order."""
    places = np.linspace(0, len(things) - 1, min(most, len(things)))
    return [things[place] for place in np.unique(places.astype(int)).tolist()]


def load_plan(path: str | Path, roots: Sequence[str | Path] = ()) -> DatasetPlan:
    """The plan of a dataset file; its files may be read below its own folder and the roots. Raises InputError."""
    file, folders = read_dataset(path), [Path(path).parent, *roots]
    for root in folders:
        refuse_empty(root, "--root", "give the name of a folder")
        if not Path(root).is_dir():
            raise InputError(
                f"--root {root} is no folder; give one that holds scenes or cameras."
            )
    return DatasetPlan(
        file, [*map(Path, folders)], text_of_file(Path(path), "give a dataset file")
    )
