"""The plan of a dataset file: its tasks in the order of the file, each one light and the samples exposed to it.

Tasks are yielded one after another, and nothing is kept of them. The key of a sample is the hash of everything that
decides its pixels. The key of a task is the hash of its light and of its samples.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice, product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..camera.exposure_times import later_exposures
from ..camera.shipped import SHIPPED
from ..core import Exposure, InputError
from ..files.appearing import refuse_empty
from ..files.scene_references import content_digest
from ..files.shipped_scenes import scenes_folder
from .cameras import Cameras, Folders, VariedCamera, check_outputs
from .file import DatasetFile, read_dataset_text, text_of_dataset
from .keys import Config, Facts, canonical, identity, key_of, key_of_text, made_by
from .light import FORMAT, Lights, exposure_asked
from .scene_entry import Value
from .splits import AS_DRAWN, SplitOf
from .store import Record
from .sweep import (
    SENSOR,
    Combination,
    Light,
    SceneSweep,
    cells,
    ends,
    of_kind,
    possible_values,
)
from .values import check_value

OF_VIEW = ("aovs", "irradiance")  # outputs that samples of one light share
SHARD_BYTES, FEWEST, MOST = 3e8, 16, 1000
"""Of a shard, about; and how many samples of a light one task has: each task renders it again."""
BYTES_OF_PIXEL = {"raw": 2, "dng": 2, "companded": 2, "readouts": 6, "electrons": 8}
"""Of outputs that are not float32; those of a frame for each frame."""
NO_PIXELS = "description", "licence"
"""Of a dataset file, what may be another text without another dataset."""
Pair = tuple[int, int]
"""Number of a row, number of a camera."""
Thing = TypeVar("Thing")


@dataclass(frozen=True)
class PlannedSample:
    """One sample.

    number : of the sample in the order of the file.  key : hash of its configuration.  pixels : hash of everything that
    decides its pixels, whatever files it has.  config : what decides them.  values : what varies, for people.
    """

    number: int
    key: str
    pixels: str
    config: Config
    values: Config
    split: str


@dataclass(frozen=True)
class Task:
    """One light and samples that are exposed to it, in the order of their keys.

    light_key : hash of what decides the light, config, and of the outputs that its samples share.
    scene_file : where the scene is on this machine.  lead : camera, gain, exposure and outputs of the sample for which
    the light is rendered: the same for all tasks of the light, in whatever order the file has its values.
    """

    key: str
    light_key: str
    config: Config
    outputs: tuple[str, ...]
    scene: str
    scene_file: str
    lead: Config
    samples: tuple[PlannedSample, ...]


@dataclass(frozen=True, eq=False)
class DatasetPlan:
    """All tasks of a dataset file.  Raises InputError.

    text : of the file, as it was written.  made_by : versions of what its pixels depend on.
    """

    file: DatasetFile
    folders: Folders
    text: str = ""
    made_by: Config = field(default_factory=made_by)

    @cached_property
    def lights(self) -> Lights:
        """What the scenes of the file are rendered from."""
        return Lights(self.file, self.folders)

    @cached_property
    def cameras(self) -> Cameras:
        """The cameras of the file."""
        cameras = Cameras(self.file.cameras, self.folders)
        check_outputs(self.file.outputs, cameras.as_given)
        return cameras

    @cached_property
    def sweeps(self) -> list[SceneSweep]:
        """What varies in each scene."""
        later = any(later_exposures(one, Exposure(1.0)) for one in self.cameras.as_given)
        later |= any(name.startswith("camera.readouts") for name in self.file.varied)
        return [
            SceneSweep(self.file, scene, later, self.lights.sensors(scene))
            for scene in range(len(self.file.scenes))
        ]

    @cached_property
    def splits(self) -> SplitOf:
        """Which split a scene belongs to."""
        return SplitOf(self.file, self.cameras.models, self.sweeps)

    def record(self, samples: int) -> Record:
        """What a dataset of this plan says that it is made from.  samples : that it has."""
        return Record(
            made_by=dict(self.made_by), samples=samples, text=self.text, sources=self.sources
        )

    @cached_property
    def sources(self) -> dict[str, str]:
        """SHA-256 of each file that samples are made from, by a name that is the same on every machine.

        Files of the first sample of each scene, row and camera, and of one with each text that something may be, which
        may name a file.
        """
        named = dict[str, Path]()
        for sweep in self.sweeps:
            light = sweep.light(0)
            several = [sweep.combination(light, *pair, 0) for pair in self.pairs]
            for name in self.file.varied:
                texts = (x for x in possible_values(self.file, name) if isinstance(x, str))
                several += [
                    one._replace(values={**one.values, name: text})
                    for text in texts
                    for one in several[:1]
                ]
            for one in several:
                paths = [*self.lights.files(one), *self.cameras.files(one)]
                beside = self.lights.places[one.scene].parent
                packaged = [scenes_folder(), Path(str(SHIPPED))]
                inside = self.folders._replace(roots=[*packaged, *self.folders.roots])
                named.update(inside.named([path for path, _ in paths], beside))
        return {name: content_digest(path) for name, path in sorted(named.items())}

    @property
    def pairs(self) -> list[Pair]:
        """All rows with all cameras."""
        return [*product(range(len(self.file.list) or 1), range(len(self.file.cameras)))]

    def tasks(self) -> Iterator[Task]:
        """All tasks, in the order of the file."""
        number = 0
        for sweep in self.sweeps:
            for light in range(sweep.lights):
                for task in self.tasks_of(sweep, light, number):
                    number += len(task.samples)
                    yield task

    def tasks_of(self, sweep: SceneSweep, number: int, first: int = 0) -> Iterator[Task]:
        """The tasks of the light of this number; of several that rows or cameras need, of each.

        first : number of its first sample.
        """
        light = sweep.light(number)
        for pairs in self._shared(sweep):
            lead = self._lead(sweep, light, pairs)
            samples = self._samples(sweep, light, pairs)
            while some := [*islice(samples, self._samples_of_task)]:
                yield self._task(lead, some, first)
                first += len(some)

    def _shared(self, sweep: SceneSweep) -> list[list[Pair]]:
        """Rows and cameras by the light that they share, which is so for each light of a scene as for the first one."""
        if sweep.scene not in self._pairs_known:
            groups: dict[str, list[Pair]] = {}
            for pair in self.pairs:
                one = sweep.combination(sweep.light(0), *pair, 0)
                groups.setdefault(self._light_of(one)[1], []).append(pair)
            self._pairs_known[sweep.scene] = [*groups.values()]
        return self._pairs_known[sweep.scene]

    @cached_property
    def _pairs_known(self) -> dict[int, list[list[Pair]]]:
        return {}

    @cached_property
    def _samples_of_task(self) -> int:
        """Samples whose files are about as large as a shard should be. Of the dataset file alone, as keys depend on
        it: a scene with a film of its own size may have larger or smaller ones."""
        cameras = self.cameras.as_given
        columns = max(camera.sensor.columns for camera in cameras)
        rows = max(camera.sensor.rows for camera in cameras)
        share = min(self.file.render.get("width", columns) / columns, 1.0)
        frames = max(
            [1, *(x for x in possible_values(self.file, "frames") if isinstance(x, int))]
        )
        pixel = sum(BYTES_OF_PIXEL.get(name, 4) for name in self.file.outputs)
        pixel += 2 * (frames - 1)
        size = rows * columns * share**2 * pixel
        return int(min(max(SHARD_BYTES / size, FEWEST), MOST))

    def _light_of(self, one: Combination) -> tuple[Facts, str]:
        """What decides the light of a sample, and the hash of it."""
        light = self.lights.described(one, self.cameras.of(one), exposure_asked(one.values))
        return light, key_of(light)

    def _samples(
        self, sweep: SceneSweep, light: Light, pairs: Sequence[Pair]
    ) -> Iterator[tuple[Combination, int, str]]:
        """What each sample of a light is made of, its serial number and its split."""
        split = self.splits.of(sweep, light, pairs[0][0])
        for row, camera in pairs:
            serials = self.splits.serials(split, sweep.rows[row], camera)
            for exposure in range(sweep.exposures(light) if serials else 0):
                one = sweep.combination(light, row, camera, exposure)
                for serial in serials:
                    yield (
                        one,
                        int(one.values["serial"]) if serial == AS_DRAWN else serial,
                        split,
                    )

    def _lead(self, sweep: SceneSweep, light: Light, pairs: Sequence[Pair]) -> Combination:
        """The sample for which a light is rendered: of its first draw that with the shortest exposure; of equal ones
        that whose values and camera come first in the alphabet, whatever the order of the file."""

        def order(one: Combination) -> tuple[float, str, str]:
            time_s = one.values.get("exposure_s")
            seconds = time_s if isinstance(time_s, int | float) else math.inf
            return seconds, canonical(one.values), self.cameras.name(one.camera)

        exposures = range(cells(sweep.of_exposure))
        several = [sweep.combination(light, *pair, x) for pair in pairs for x in exposures]
        return min(several, key=order) if len(several) > 1 else several[0]

    def _task(
        self, lead: Combination, some: Sequence[tuple[Combination, int, str]], first: int
    ) -> Task:
        config, light_key = self._light_of(lead)
        samples = [
            self._sample(*what, light_key, number) for number, what in enumerate(some, first)
        ]
        outputs = tuple(name for name in OF_VIEW if name in self.file.outputs)
        own = key_of({"view": light_key, "outputs": outputs, "made_by": self.made_by})
        camera = self.cameras.of(lead)
        asked = {"gain": camera.gain, "exposure": exposure_asked(lead.values)}
        ordered = tuple(sorted(samples, key=lambda sample: sample.key))
        rows = [[sample.key, sample.split, sample.values] for sample in ordered]
        key = key_of({"light": own, "lead": [camera.key, asked], "samples": rows})
        scene, file = self.file.scenes[lead.scene].name, str(self.lights.places[lead.scene])
        whole = {**asked, "camera": camera.datasheet, "outputs": samples[0].config["outputs"]}
        return Task(key, own, config, outputs, scene, file, whole, ordered)

    @cached_property
    def _text_before_pixels(self) -> str:
        """The text of which a sample's key is the hash, up to the key of its pixels, which is the last in it."""
        outputs = [name for name in self.file.outputs if name not in OF_VIEW]
        text = canonical({"made_by": self.made_by, "outputs": outputs, "sample": ""})
        return text.removesuffix('"}')

    def _sample(
        self, one: Combination, serial: int, split: str, light_key: str, number: int
    ) -> PlannedSample:
        """A sample, and its key."""
        camera: VariedCamera = self.cameras.of(one)
        values = {**one.values, "serial": serial}
        chip = serial
        if SENSOR in values:
            chip = self.lights.rig(one).chip(serial, values[SENSOR])
        config = {
            "format": FORMAT,
            "view": light_key,
            "camera": camera.datasheet,
            "gain": camera.gain,
            "exposure": exposure_asked(values),
            "serial": chip,
            "frames": values.get("frames", 1),
            "repetition": values.get("repetition", 0),
            "draw": one.draw,
            "dataset_seed": self.file.seed,
        }
        if lights := of_kind("lights", one.values):
            config["lights"] = lights
        outputs = [name for name in self.file.outputs if name not in OF_VIEW]
        pixels = identity(config, camera.key)
        key = key_of_text(self._text_before_pixels + pixels + '"}')
        scene, name = self.file.scenes[one.scene].name, self.cameras.name(one.camera)
        said: dict[str, Any] = {"scene": scene, "camera": name, **values}
        if one.pose is not None:
            times = {"time_s": one.pose.time_s, "pose": one.pose.pose}
            said |= {"view": one.view}
            said |= {name: value for name, value in times.items() if value is not None}
        return PlannedSample(number, key, pixels, {**config, "outputs": outputs}, said, split)


@dataclass
class Counts:
    """How many there are.  by_scene : lights and samples of each scene.  by_split : samples of each split."""

    tasks: int = 0
    samples: int = 0
    by_scene: dict[str, list[int]] = field(default_factory=dict)
    by_split: dict[str, int] = field(default_factory=dict)


def checked_counts(
    plan: DatasetPlan, each: Callable[[int, Task], object] = lambda number, task: None
) -> Counts:
    """All samples counted. Raises InputError for values that cannot be, and for two samples that are one.

    each : called with every task and its number.
    """
    _check_draws(plan.file)
    found, keys = Counts(), array("Q")
    lights: dict[str, set[str]] = {}
    for task in plan.tasks():
        of_scene = found.by_scene.setdefault(task.scene, [0, 0])
        before = lights.setdefault(task.scene, set())
        of_scene[0] += task.light_key not in before
        before.clear()
        before.add(task.light_key)
        of_scene[1] += len(task.samples)
        each(found.tasks, task)
        found.tasks += 1
        found.samples += len(task.samples)
        for sample in task.samples:
            keys.append(int(sample.key[:16], 16))
            found.by_split[sample.split] = found.by_split.get(sample.split, 0) + 1
    ordered = np.sort(np.frombuffer(keys, np.uint64)) if keys else np.zeros(0, np.uint64)
    if (same := ordered[1:][ordered[1:] == ordered[:-1]]).size:
        _refuse_equal(plan, f"{same[0]:016x}")
    return found


def _refuse_equal(plan: DatasetPlan, key: str) -> None:
    """Raise InputError with both places of samples whose keys begin so."""
    samples = (sample for task in plan.tasks() for sample in task.samples)
    first, second = islice((x.values for x in samples if x.key.startswith(key)), 2)
    differ = {name: (first.get(name), second.get(name)) for name in {**first, **second}}
    places = [
        ", ".join(f"{name} {pair[k]}" for name, pair in differ.items() if _tells(name, pair))
        for k in (0, 1)
    ]
    raise InputError(
        f"two samples are the same ({places[0]}; and {places[1]}); leave one of the scenes, poses, cameras, rows or "
        "values out, give views another time_s, or vary repetition for another sample of the same settings."
    )


def _tells(name: str, pair: tuple[object, object]) -> bool:
    """Whether a value tells two samples apart, or what they are of."""
    return (name in ("scene", "camera", "view") and pair != (None, None)) or pair[0] != pair[1]


def _check_draws(file: DatasetFile) -> None:
    """Raise InputError for a value that a law can draw and that cannot be, and for exposures that are too long with the
    stops on top."""
    draws = file.random.draws if file.random else 1
    laws = file.random.values if file.random else {}
    for name, law in laws.items():
        for value in ends(law, draws):
            check_value(name, value)
    for row in file.list or ({},):
        times, stops = (
            [x for x in _values_of(file, row, name) if isinstance(x, int | float)]
            for name in ("exposure_s", "exposure_ev")
        )
        if not times or not stops:
            continue
        try:
            Exposure(max(times) * 2.0 ** max(stops))
        except InputError as error:
            raise InputError(
                f"exposure_s is {max(times):g} with exposure_ev {max(stops):g} on top: {error}"
            ) from None


def _values_of(file: DatasetFile, row: Config, name: str) -> Iterator[Value]:
    """What something can be in the samples of a row."""
    if name in row:
        yield row[name]
    elif file.random and name in file.random.values:
        yield from ends(file.random.values[name], file.random.draws)
    else:
        yield from file.grid.get(name, ())


def growth_refused(old: DatasetFile, new: DatasetFile) -> str:
    """What of a dataset file is not as it was, where that is more than what may grow: scenes, cameras, rows, values of
    the grid and draws may come to those that are there. An empty text where nothing else is."""
    changed = []
    for name in DatasetFile.model_fields:
        before, now = getattr(old, name), getattr(new, name)
        if before == now or name in NO_PIXELS:
            continue
        grows = False
        if name in ("scenes", "cameras", "list"):
            grows = all(one in now for one in before) and bool(before)
        elif name == "grid":
            grows = before.keys() == now.keys()
            grows = grows and all(
                {*map(repr, before[x])} <= {*map(repr, now[x])} for x in before
            )
        elif name == "random" and before and now:
            grows = before.values == now.values and before.draws <= now.draws
        if not grows:
            changed.append(f"[{name}]" if name in ("render", "splits") else name)
    return ", ".join(changed)


def evenly_chosen(things: Sequence[Thing], most: int) -> list[Thing]:
    """At most so many of them, evenly chosen, in their order."""
    places = np.linspace(0, len(things) - 1, min(most, len(things)))
    return [things[place] for place in np.unique(places.astype(int)).tolist()]


def load_plan(
    path: str | Path, roots: Sequence[str | Path] = (), untrusted: bool = False
) -> DatasetPlan:
    """The plan of a dataset file. Raises InputError.

    roots : folders in which its files are looked for, beside its own.  untrusted : read no other ones, whatever it and
    its scenes name, because somebody else has written them.
    """
    text, folders = text_of_dataset(Path(path)), [Path(path).parent, *roots]
    for root in folders:
        refuse_empty(root, "--root", "give the name of a folder")
        if not Path(root).is_dir():
            raise InputError(
                f"--root {root} is no folder; give one that holds scenes or cameras."
            )
    file = read_dataset_text(text, f"dataset file {str(path)!r}")
    plan = DatasetPlan(file, Folders([*map(Path, folders)], untrusted), text)
    plan.splits  # noqa: B018, raises what is wrong with files and splits
    return plan
