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
from itertools import count, islice, product
from pathlib import Path
from typing import NamedTuple

from ..core import InputError
from ..files.appearing import refuse_empty
from .cameras import Cameras, Folders, is_staggered
from .file import DatasetFile, read_dataset_text, text_of_dataset
from .keys import Config, Facts, Fixed, canonical, key_of, key_of_text, made_by
from .light import FORMAT, Lights, exposure_asked
from .splits import AS_DRAWN, SplitOf
from .store import Record
from .sweep import SENSOR, Combination, Light, SceneSweep, of_kind, whole_values

OF_VIEW = ("aovs", "irradiance")  # outputs that samples of one light share
SHARD_BYTES, FEWEST, MOST = 3e8, 16, 1000
"""Of a shard, about; and how many samples of a light one task has: each task renders it again."""
BYTES_OF_PIXEL = {"raw": 2, "dng": 2, "companded": 2, "readouts": 6, "electrons": 8}
"""Of outputs that are not float32; those of a frame for each frame."""
Pair = tuple[int, int]
"""Number of a row, number of a camera."""


class Place(NamedTuple):
    """Where the tasks of a light are in a plan: numbers of scene and light, and of its first sample and task."""

    scene: int
    light: int
    sample: int = 0
    task: int = 0


class Shared(NamedTuple):
    """Rows and cameras that share each light of a scene.  lead, exposure : for which it is rendered."""

    pairs: list[Pair]
    lead: Pair
    exposure: int


class PlannedSample(NamedTuple):
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
    place : of its light in the plan.  number : of the task in the plan.
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
    place: Place
    number: int


@dataclass(frozen=True, eq=False)
class DatasetPlan:
    """All tasks of a dataset file.  Raises InputError.

    text : of the file, as it was written.  made_by : versions of what its pixels depend on.
    """

    file: DatasetFile
    folders: Folders
    text: str = ""
    made_by: Config = field(default_factory=lambda: Fixed(made_by()))

    @cached_property
    def lights(self) -> Lights:
        """What the scenes of the file are rendered from."""
        return Lights(self.file, self.folders)

    @cached_property
    def cameras(self) -> Cameras:
        """The cameras of the file."""
        return Cameras(self.file, self.folders)

    @cached_property
    def sweeps(self) -> list[SceneSweep]:
        """What varies in each scene."""
        later = any(map(is_staggered, self.cameras.as_given))
        later |= any(name.startswith("camera.readouts") for name in self.file.varied)
        return [
            SceneSweep(self.file, scene, later, self.lights.sensors(scene))
            for scene in range(len(self.file.scenes))
        ]

    @cached_property
    def splits(self) -> SplitOf:
        """Which split a scene belongs to."""
        return SplitOf(self.file, self.cameras.models, self.sweeps)

    @cached_property
    def pairs(self) -> list[Pair]:
        """All rows with all cameras."""
        return [*product(range(len(self.file.list) or 1), range(len(self.file.cameras)))]

    def record(self, samples: int) -> Record:
        """What a dataset of this plan says that it is made from.  samples : that it has."""
        return Record(made_by=dict(self.made_by), samples=samples, text=self.text)

    def tasks(self) -> Iterator[Task]:
        """All tasks, in the order of the file."""
        sample = number = 0
        for scene, sweep in enumerate(self.sweeps):
            for light in range(sweep.lights):
                for task in self.tasks_at(Place(scene, light, sample, number)):
                    yield task
                    sample, number = sample + len(task.samples), number + 1

    def tasks_at(self, place: Place) -> Iterator[Task]:
        """The tasks of a light; of several that rows or cameras need, of each."""
        sweep, numbers, task = self.sweeps[place.scene], count(place.sample), place.task
        light = sweep.light(place.light)
        for shared in self._shared[place.scene]:
            lead = sweep.combination(light, *shared.lead, shared.exposure)
            config = self._light_of(lead)
            light_key = key_of(config)
            samples = self._samples(sweep, light, shared.pairs, light_key, numbers)
            while some := [*islice(samples, self._samples_of_task)]:
                yield self._task(lead, config, light_key, some, place, task)
                task += 1

    @cached_property
    def _shared(self) -> list[list[Shared]]:
        """Rows and cameras by the light that they share, which is so for each light of a scene as for the first one.

        A light is rendered for the sample of its first draw with the shortest exposure; of equal ones that whose values
        and camera come first in the alphabet, whatever the order of the file.
        """
        found = []
        for sweep in self.sweeps:
            light, groups = sweep.light(0), dict[str, list[Pair]]()
            for pair in self.pairs:
                one = sweep.combination(light, *pair, 0)
                groups.setdefault(key_of(self._light_of(one)), []).append(pair)

            def order(choice: tuple[Pair, int]) -> tuple[float, str, str]:
                one = sweep.combination(light, *choice[0], choice[1])  # noqa: B023, called in this turn
                time_s = one.values.get("exposure_s")
                seconds = time_s if isinstance(time_s, int | float) else math.inf
                return seconds, canonical(one.values), self.cameras.name(one.camera)

            exposures = range(sweep.cells_of_exposure)
            found.append(
                [Shared(x, *min(product(x, exposures), key=order)) for x in groups.values()]
            )
        return found

    @cached_property
    def _samples_of_task(self) -> int:
        """Samples whose files are about as large as a shard should be. Of the dataset file alone, as keys depend on
        it: a scene with a film of its own size may have larger or smaller ones."""
        sensors = [camera.sensor for camera in self.cameras.as_given]
        columns, rows = (max(getattr(x, name) for x in sensors) for name in ("columns", "rows"))
        share = min(self.file.render.get("width", columns) / columns, 1.0)
        frames = max([1, *whole_values(self.file, "frames")])
        pixel = sum(BYTES_OF_PIXEL.get(name, 4) for name in self.file.outputs)
        pixel += 2 * (frames - 1)
        size = rows * columns * share**2 * pixel
        return int(min(max(SHARD_BYTES / size, FEWEST), MOST))

    def _light_of(self, one: Combination) -> Facts:
        """What decides the light of a sample."""
        return self.lights.described(one, self.cameras.of(one), exposure_asked(one.values))

    def _samples(
        self,
        sweep: SceneSweep,
        light: Light,
        pairs: Sequence[Pair],
        light_key: str,
        numbers: Iterator[int],
    ) -> Iterator[PlannedSample]:
        """The samples of a light."""
        split, scene = self.splits.of(sweep, light, pairs[0][0]), sweep.entry.name
        for row, entry in pairs:
            serials = self.splits.serials(split, sweep.rows[row], entry)
            for exposure in range(sweep.exposures(light) if serials else 0):
                one = sweep.combination(light, row, entry, exposure)
                camera, values = self.cameras.of(one), one.values
                config = {
                    "format": FORMAT,
                    "view": light_key,
                    "camera": camera.datasheet,
                    "gain": camera.gain,
                    "exposure": exposure_asked(values),
                    "frames": values.get("frames", 1),
                    "repetition": values.get("repetition", 0),
                    "draw": one.draw,
                    "dataset_seed": self.file.seed,
                }
                if lights := of_kind("lights", values):
                    config["lights"] = lights
                said = {"scene": scene, "camera": self.cameras.name(entry), **values}
                of_pose: Facts = {}
                if one.pose is not None:
                    of_pose = {
                        "view": one.view,
                        "time_s": one.pose.time_s,
                        "pose": one.pose.pose,
                    }
                    of_pose = {name: x for name, x in of_pose.items() if x is not None}
                text = canonical({**config, "camera": camera.key, "serial": None})
                before, after = text.split('"serial":null')
                for serial in serials:
                    serial = values["serial"] if serial == AS_DRAWN else serial
                    chip = serial
                    if SENSOR in values:
                        chip = self.lights.rig(one).chip(serial, values[SENSOR])
                    pixels = key_of_text(f'{before}"serial":{chip}{after}')
                    key = key_of_text(self._before_pixels + pixels + '"}')
                    whole = {**config, "serial": chip, "outputs": self._outputs}
                    told = {**said, "serial": serial, **of_pose}
                    yield PlannedSample(next(numbers), key, pixels, whole, told, split)

    @cached_property
    def _outputs(self) -> list[str]:
        """Outputs that each sample has."""
        return [name for name in self.file.outputs if name not in OF_VIEW]

    @cached_property
    def _before_pixels(self) -> str:
        """The text of which a sample's key is the hash, up to the key of its pixels, which is the last in it."""
        text = canonical({"made_by": self.made_by, "outputs": self._outputs, "sample": ""})
        return text.removesuffix('"}')

    @cached_property
    def _before_view(self) -> str:
        """The same of the key of a light and of the outputs that its samples share."""
        outputs = [name for name in OF_VIEW if name in self.file.outputs]
        text = canonical({"made_by": self.made_by, "outputs": outputs, "view": ""})
        return text.removesuffix('"}')

    def _task(
        self,
        lead: Combination,
        config: Facts,
        light_key: str,
        samples: Sequence[PlannedSample],
        place: Place,
        number: int,
    ) -> Task:
        outputs = tuple(name for name in OF_VIEW if name in self.file.outputs)
        own = key_of_text(self._before_view + light_key + '"}')
        camera = self.cameras.of(lead)
        asked = {"gain": camera.gain, "exposure": exposure_asked(lead.values)}
        ordered = tuple(sorted(samples, key=lambda sample: sample.key))
        rows = [[sample.key, sample.split, sample.values] for sample in ordered]
        key = key_of_text(json.dumps([own, camera.key, asked, rows], sort_keys=True))
        scene, file = self.file.scenes[lead.scene].name, str(self.lights.places[lead.scene])
        whole = {**asked, "camera": camera.datasheet, "outputs": self._outputs}
        return Task(key, own, config, outputs, scene, file, whole, ordered, place, number)


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
