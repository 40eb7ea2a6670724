"""The plan of a dataset file: its tasks in the order of the file, each one light and the samples exposed to it.

Tasks are yielded one after another, and nothing is kept of them. The key of a sample is the hash of everything that
decides its pixels. The key of a task is the hash of its light and of its samples.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice, product
from pathlib import Path
from typing import TypeVar

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
from .splits import AS_DRAWN, SplitOf
from .store import Record
from .sweep import (
    SENSOR,
    Combination,
    Light,
    SceneSweep,
    of_kind,
    possible_values,
)

OF_VIEW = ("aovs", "irradiance")  # outputs that samples of one light share
SHARD_BYTES, FEWEST, MOST = 3e8, 16, 1000
"""Of a shard, about; and how many samples of a light one task has: each task renders it again."""
BYTES_OF_PIXEL = {"raw": 2, "dng": 2, "companded": 2, "readouts": 6, "electrons": 8}
"""Of outputs that are not float32; those of a frame for each frame."""
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

        def order(choice: tuple[Pair, int]) -> tuple[float, str, str]:
            one = sweep.combination(light, *choice[0], choice[1])
            time_s = one.values.get("exposure_s")
            seconds = time_s if isinstance(time_s, int | float) else math.inf
            return seconds, canonical(one.values), self.cameras.name(one.camera)

        known = sweep.scene, pairs[0]
        if known not in self._leads:  # what tells choices apart is the same for each light
            self._leads[known] = min(product(pairs, range(sweep.cells_of_exposure)), key=order)
        pair, exposure = self._leads[known]
        return sweep.combination(light, *pair, exposure)

    @cached_property
    def _leads(self) -> dict[tuple[int, Pair], tuple[Pair, int]]:
        return {}

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
        text = json.dumps([own, camera.key, asked, rows], sort_keys=True)
        key = key_of_text(text)
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
        said: Facts = {"scene": scene, "camera": name, **values}
        if one.pose is not None:
            times = {"time_s": one.pose.time_s, "pose": one.pose.pose}
            said |= {"view": one.view}
            said |= {name: value for name, value in times.items() if value is not None}
        return PlannedSample(number, key, pixels, {**config, "outputs": outputs}, said, split)


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
