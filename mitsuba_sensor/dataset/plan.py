"""The plan of a dataset file: tasks in the order of the file, each one light and the samples exposed to it.

Tasks are yielded one after another and not kept. The key of a sample is the hash of everything that decides its pixels.
The key of a task is the hash of its light and of its samples.
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
from .splits import DRAWN_SERIAL, SplitOf
from .store import Record
from .sweep import SENSOR, Combination, Light, SceneSweep, most_frames, of_kind

VIEW_OUTPUTS = ("aovs", "irradiance")  # shared by the samples of one light
SHARD_BYTES = 3e8
"""Approximate size of a shard."""
TASK_SAMPLES_MIN, TASK_SAMPLES_MAX = 16, 1000
"""Samples of a light in one task: each task renders the light again."""
PIXEL_BYTES = {"raw": 2, "dng": 2, "companded": 2, "readouts": 6, "electrons": 8}
"""Bytes per pixel of outputs that are not float32, for each frame."""
Pair = tuple[int, int]
"""Number of a row, number of a camera."""


class Place(NamedTuple):
    """The tasks of a light in a plan: numbers of scene and light, and of its first sample and task."""

    scene: int
    light: int
    sample: int = 0
    task: int = 0


class Shared(NamedTuple):
    """Rows and cameras that share each light of a scene.  lead, exposure : the light is rendered for these."""

    pairs: list[Pair]
    lead: Pair
    exposure: int


class PlannedSample(NamedTuple):
    """One sample.

    number : of the sample in the order of the file.  key : hash of its configuration.  pixels : hash of everything that
    decides its pixels, whatever its files.  config : what decides them.  values : what varies, for people.
    entry : numbers of its row, camera, exposure and serial number in the plan.
    """

    number: int
    key: str
    pixels: str
    config: Config
    values: Config
    split: str
    entry: tuple[int, int, int, int]


@dataclass(frozen=True)
class Task:
    """One light and the samples exposed to it, in the order of their keys.

    light_key : hash of config, which decides the light, and of the outputs that its samples share.
    place : of its light in the plan.  number : of the task in the plan.  scene_file : path on this machine.
    lead : camera, gain, exposure and outputs of the sample for which the light is rendered: the same for all tasks of
    the light, whatever the order of values in the file.
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
    """All tasks of a dataset file. Raises InputError.

    text : of the file, unchanged.  made_by : versions of the libraries that decide its pixels.
    """

    file: DatasetFile
    folders: Folders
    text: str = ""
    made_by: Config = field(default_factory=lambda: Fixed(made_by()))

    @cached_property
    def lights(self) -> Lights:
        """The light of each sample."""
        return Lights(self.file, self.folders)

    @cached_property
    def cameras(self) -> Cameras:
        """The cameras of the file."""
        return Cameras(self.file, self.folders)

    @cached_property
    def sweeps(self) -> list[SceneSweep]:
        """What varies in each scene."""
        staggered = any(map(is_staggered, self.cameras.as_given))
        staggered |= any(name.startswith("camera.readouts") for name in self.file.varied)
        return [
            SceneSweep(self.file, scene, staggered, self.lights.sensors(scene))
            for scene in range(len(self.file.scenes))
        ]

    @cached_property
    def splits(self) -> SplitOf:
        """The split of each scene and sensor unit."""
        return SplitOf(self.file, self.cameras.models, self.sweeps)

    @cached_property
    def pairs(self) -> list[Pair]:
        """All rows with all cameras."""
        return [*product(range(len(self.file.list) or 1), range(len(self.file.cameras)))]

    @property
    def combinations(self) -> int:
        """Number of samples if no split left any out."""
        units = len(self.file.grid.get("serial", ())) or 1
        if self.file.splits and "serial" not in self.file.varied:
            units = self.file.splits.chips or 1
        of_scenes = (x.lights // x.groups * x.draws * x.cells_of_exposure for x in self.sweeps)
        return sum(of_scenes) * len(self.pairs) * units

    def record(self, samples: int) -> Record:
        """Return the record of a dataset of this plan.  samples : in the whole dataset."""
        return Record(made_by=dict(self.made_by), samples=samples, text=self.text)

    def tasks(self) -> Iterator[Task]:
        """Yield all tasks, in the order of the file."""
        sample = number = 0
        for scene, sweep in enumerate(self.sweeps):
            for light in range(sweep.lights):
                for task in self.tasks_at(Place(scene, light, sample, number)):
                    yield task
                    sample, number = sample + len(task.samples), number + 1

    def tasks_at(self, place: Place) -> Iterator[Task]:
        """Yield the tasks of a light; if rows or cameras need several lights, the tasks of each."""
        sweep, numbers, task = self.sweeps[place.scene], count(place.sample), place.task
        light = sweep.light(place.light)
        for shared in self._shared[place.scene]:
            lead = sweep.combination(light, *shared.lead, shared.exposure)
            config = self._light_of(lead)
            light_key = key_of(config)
            left = self._samples(sweep, light, shared.pairs, light_key, numbers)
            while samples := [*islice(left, self._samples_of_task)]:
                yield self._task(lead, config, light_key, samples, place, task)
                task += 1

    @cached_property
    def _shared(self) -> list[list[Shared]]:
        """Rows and cameras by the light that they share: in every light of a scene as in the first one.

        A light is rendered for the sample of its first draw with the shortest exposure. Among equal exposures the first
        values and camera in the alphabet count, whatever the order of the file.
        """
        shared = []
        for sweep in self.sweeps:
            light, groups = sweep.light(0), dict[str, list[Pair]]()
            for pair in self.pairs:
                key = key_of(self._light_of(sweep.combination(light, *pair, 0)))
                groups.setdefault(key, []).append(pair)

            def order(choice: tuple[Pair, int]) -> tuple[float, str, str]:
                sample = sweep.combination(light, *choice[0], choice[1])  # noqa: B023, called in this turn
                time_s = sample.values.get("exposure_s")
                seconds = time_s if isinstance(time_s, int | float) else math.inf
                return seconds, canonical(sample.values), self.cameras.name(sample.camera)

            exposures = range(sweep.cells_of_exposure)
            shared.append(
                [Shared(x, *min(product(x, exposures), key=order)) for x in groups.values()]
            )
        return shared

    @cached_property
    def _samples_of_task(self) -> int:
        """Number of samples whose files fill a shard. Keys depend on it, so it follows from the dataset file alone: a
        scene with its own film size may have larger or smaller files."""
        sensors = [camera.sensor for camera in self.cameras.as_given]
        columns, rows = (max(getattr(x, name) for x in sensors) for name in ("columns", "rows"))
        share = min(self.file.render.get("width", columns) / columns, 1.0)
        pixel = sum(PIXEL_BYTES.get(name, 4) for name in self.file.outputs)
        pixel += 2 * (most_frames(self.file) - 1)
        size = rows * columns * share**2 * pixel
        return int(min(max(SHARD_BYTES / size, TASK_SAMPLES_MIN), TASK_SAMPLES_MAX))

    def _light_of(self, sample: Combination) -> Facts:
        """Return what decides the light of a sample."""
        exposure = exposure_asked(sample.values)
        return self.lights.described(sample, self.cameras.of(sample), exposure)

    def _samples(
        self,
        sweep: SceneSweep,
        light: Light,
        pairs: Sequence[Pair],
        light_key: str,
        numbers: Iterator[int],
    ) -> Iterator[PlannedSample]:
        """Yield the samples of a light."""
        split = self.splits.of(sweep, light, pairs[0][0])
        for row, entry in pairs:
            serials = self.splits.serials(split, sweep.rows[row], entry)
            for exposure in range(sweep.exposures(light) if serials else 0):
                sample = sweep.combination(light, row, entry, exposure)
                camera, values = self.cameras.of(sample), sample.values
                config = {
                    "format": FORMAT,
                    "view": light_key,
                    "camera": camera.datasheet,
                    "gain": camera.gain,
                    "exposure": exposure_asked(values),
                    "frames": values.get("frames", 1),
                    "repetition": values.get("repetition", 0),
                    "draw": sample.draw,
                    "dataset_seed": self.file.seed,
                }
                if lights := of_kind("lights", values):
                    config["lights"] = lights
                shown = {
                    "scene": sweep.entry.name,
                    "camera": self.cameras.name(entry),
                    **values,
                }
                of_pose: Facts = {}
                if sample.pose is not None:
                    time_s, pose = sample.pose.time_s, sample.pose.pose
                    of_pose = {"view": sample.view, "time_s": time_s, "pose": pose}
                    of_pose = {name: x for name, x in of_pose.items() if x is not None}
                text = canonical({**config, "camera": camera.key, "serial": None})
                before, after = text.split('"serial":null')
                for number, serial in enumerate(serials):
                    serial = values["serial"] if serial == DRAWN_SERIAL else serial
                    chip = serial
                    if SENSOR in values:
                        chip = self.lights.rig(sample).chip(serial, values[SENSOR])
                    pixels = key_of_text(f'{before}"serial":{chip}{after}')
                    yield PlannedSample(
                        next(numbers),
                        self._key("sample", self._outputs, pixels),
                        pixels,
                        {**config, "serial": chip, "outputs": self._outputs},
                        {**shown, "serial": serial, **of_pose},
                        split,
                        (row, entry, exposure, number),
                    )

    @cached_property
    def _outputs(self) -> list[str]:
        """Outputs of each sample."""
        return [name for name in self.file.outputs if name not in VIEW_OUTPUTS]

    @cached_property
    def _view_outputs(self) -> tuple[str, ...]:
        """Outputs that the samples of a light share."""
        return tuple(name for name in VIEW_OUTPUTS if name in self.file.outputs)

    def _key(self, name: str, outputs: Sequence[str], key: str) -> str:
        """Return the key of a sample or view with its outputs.  key : of what decides it."""
        return key_of({"made_by": self.made_by, "outputs": outputs, name: key})

    def _task(
        self,
        lead: Combination,
        config: Facts,
        light_key: str,
        samples: Sequence[PlannedSample],
        place: Place,
        number: int,
    ) -> Task:
        camera = self.cameras.of(lead)
        asked = {"gain": camera.gain, "exposure": exposure_asked(lead.values)}
        ordered = tuple(sorted(samples, key=lambda sample: sample.key))
        view_key = self._key("view", self._view_outputs, light_key)
        rows = [[sample.key, sample.split, sample.values] for sample in ordered]
        return Task(
            key_of_text(json.dumps([view_key, camera.key, asked, rows], sort_keys=True)),
            view_key,
            config,
            self._view_outputs,
            self.file.scenes[lead.scene].name,
            str(self.lights.places[lead.scene]),
            {**asked, "camera": camera.datasheet, "outputs": self._outputs},
            ordered,
            place,
            number,
        )


def load_plan(
    path: str | Path, roots: Sequence[str | Path] = (), untrusted: bool = False
) -> DatasetPlan:
    """Return the plan of a dataset file. Raises InputError.

    roots : folders with its files, searched after its own folder.  untrusted : read no other files, whatever the file
        and its scenes name, because somebody else wrote them.
    """
    text, folders = text_of_dataset(path), [Path(path).parent, *roots]
    for root in folders:
        refuse_empty(root, "roots=", "give the name of a folder")
        if not Path(root).is_dir():
            raise InputError(
                f"roots= {root} is not a folder; give a folder that holds scenes or cameras."
            )
    file = read_dataset_text(text, f"dataset file {str(path)!r}")
    plan = DatasetPlan(file, Folders([*map(Path, folders)], untrusted), text)
    plan.splits  # noqa: B018, raises what is wrong with files and splits
    return plan
