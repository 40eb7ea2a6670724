"""What decides the pixels of a sample: its configuration, and its key, the hash of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from ...camera.exposure_times import later_exposures
from ...core import Exposure
from ..store.keys import Config, Facts, canonical, identity, key_of, key_of_text, made_by
from ..store.names import name_of_sample
from ..store.record import Entry
from .cameras import Cameras, VariedCamera, check_outputs
from .file import DatasetFile
from .light import FORMAT, Lights, exposure_asked
from .splits import SplitOf
from .sweep import SENSOR, Combination, SceneSweep, of_kind

OF_VIEW = ("aovs", "irradiance")  # outputs that samples of one view share


@dataclass(frozen=True)
class PlannedSample:
    """One sample.

    name : of its folder.  key : hash of its configuration.  pixels : hash of what decides its pixels, whatever its
    files.  config : what decides them.  values : what varies, for people.
    """

    name: str
    key: str
    pixels: str
    config: Config
    values: Config
    split: str

    @property
    def entry(self) -> Entry:
        """What it is in the store."""
        return Entry("samples", self.name, self.key)


@dataclass(frozen=True, eq=False)
class ConfiguredSamples:
    """Configurations and keys of the samples of a dataset file.  Raises InputError.

    roots, text, made_by : as of a plan (planned.py).
    """

    file: DatasetFile
    roots: Sequence[Path]
    text: str = ""
    made_by: Config = field(default_factory=made_by)

    @cached_property
    def lights(self) -> Lights:
        """What the scenes of the file are rendered from."""
        return Lights(self.file, self.roots)

    @cached_property
    def cameras(self) -> Cameras:
        """The cameras of the file."""
        cameras = Cameras(self.file.cameras, self.roots)
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

    def first_sample(self, one: Combination) -> PlannedSample:
        """A sample with the first of its serial numbers, whatever its split."""
        serial = int(one.values.get("serial", 1))
        camera = self.cameras.of(one)
        return self.sample(one, camera, self.light_key(one, camera)[1], serial, "")

    def light_key(self, one: Combination, camera: VariedCamera) -> tuple[Facts, str]:
        """What decides the light of a sample, and the hash of it."""
        light = self.lights.described(one, camera, exposure_asked(one.values))
        return light, key_of(light)

    @cached_property
    def _text_before_pixels(self) -> str:
        """The text of which a sample's key is the hash, up to the key of its pixels, which is the last in it."""
        outputs = [name for name in self.file.outputs if name not in OF_VIEW]
        text = canonical({"made_by": self.made_by, "outputs": outputs, "sample": ""})
        return text.removesuffix('"}')

    def sample(
        self, one: Combination, camera: VariedCamera, light_key: str, serial: int, split: str
    ) -> PlannedSample:
        """A sample, and its key.  light_key : of its light."""
        values = {**one.values, "serial": serial}
        if SENSOR in values:
            chip = self.lights.rig(one).chip(serial, values[SENSOR])
        else:
            chip = serial
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
        own = key_of_text(self._text_before_pixels + pixels + '"}')
        said = {
            "scene": self.file.scenes[one.scene].name,
            "camera": self.cameras.name(one.camera),
            **values,
        }
        if one.pose is not None:
            times = {"time_s": one.pose.time_s, "pose": one.pose.pose}
            said |= {"view": one.view}
            said |= {name: value for name, value in times.items() if value is not None}
        entry = self.file.cameras[one.camera]
        name = name_of_sample(said, entry.name or entry.camera, one.draw, own)
        return PlannedSample(name, own, pixels, {**config, "outputs": outputs}, said, split)
