"""What decides the light of a sample: scene, pose, options of the render, and some fields of the camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core import Float64Array, InputError
from ..core.options import used
from ..files.scene_references import files_digest, references_of
from ..files.sensor_names import ALL_SENSORS
from ..files.shipped_scenes import (
    MOTION,
    NAME,
    SCENE,
    names_of_scenes,
    scenes_folder,
    shipped_file,
)
from ..render.options import RenderOptions
from ..render.scene.motion import KeyPose, Motion, read_motion
from ..render.scene.parse_scene import parse_sensors, pose_in_file_m, refuse_one_place
from ..render.scene.parsed_scene import ParsedScene
from ..render.variants import fastest_variant, restores_variant
from .cameras import Folders, VariedCamera
from .file import DatasetFile, SceneEntry
from .keys import Config, Facts, Fixed, seed_of
from .sweep import SENSOR, Combination, of_kind
from .values import OF_SCENE, text_of

FORMAT = 4  # of configurations; another number gives other keys and seeds
SAMPLES = ("spp", "noise_ratio", "max_spp")  # options that set the samples of a render
SPP = 128  # of a render without these options
NOT_LIGHT = ("gain", "luminance")  # options of a render that its light does not depend on
RIGS_KEPT = 4096
POSE_DIGITS = 9
"""Decimals of a computed pose: 1 nm, or 1e-9 of a direction."""


class Lights:
    """Describes the light of samples. Raises InputError."""

    def __init__(self, file: DatasetFile, folders: Folders) -> None:
        self.file, self.folders = file, folders
        self.places = [self._place(scene) for scene in file.scenes]
        self._motions = [self._motion(scene) for scene in file.scenes]
        self._motion_facts = [Fixed(x.model_dump(mode="json")) for x in self._motions]
        self._digests: list[dict[tuple[str, ...], dict[object, str]]] = [
            {} for _ in file.scenes
        ]
        self._rigs = lru_cache(RIGS_KEPT)(self._rig_of)
        self.options = self._options()

    def _options(self) -> Fixed:
        """Return the options of every render that decide its light."""
        render = dict(self.file.render)
        if render.keys().isdisjoint(SAMPLES):
            render["spp"] = SPP
        options = used(RenderOptions, render).items()
        of_light = {x: y for x, y in options if x not in (*OF_SCENE, *NOT_LIGHT)}
        if of_light.get("start_s") == 0:
            del of_light["start_s"]
        return Fixed(of_light)

    def sensors(self, scene: int) -> tuple[str, ...]:
        """Return the names of the sensors of a scene that take images; none if only the first one does."""
        if self.file.scenes[scene].sensors is None:
            return ()
        return (*self._rig(scene, {}).poses_m,)

    def rig(self, sample: Combination) -> Rig:
        """Return the sensors of the scene of a sample."""
        return self._rig(sample.scene, sample.values)

    def described(self, sample: Combination, camera: VariedCamera, exposure: Config) -> Facts:
        """Return everything that decides the light of a sample, ready for JSON."""
        scene, pose = sample.scene, sample.pose
        entry, parameters = self.file.scenes[scene], self._parameters(scene, sample.values)
        light: Facts = {
            "format": FORMAT,
            "scene": self._digest(scene, parameters),
            "parameters": parameters,
            "traverse": {**entry.traverse, **of_kind("traverse", sample.values)},
            "look_at": None if pose is None else pose.pose,
            "render": self.options,
            "lens": camera.light,
            "dataset_seed": self.file.seed,
        }
        for name in ("scene_unit", "integrator", "ignore_polarization"):
            light[name] = getattr(entry, name)
        if pose is not None and pose.time_s is not None:
            light["start_s"] = pose.time_s
        if (sensor := sample.values.get(SENSOR)) is not None:
            light[SENSOR] = sensor
            if light["look_at"] is not None:
                light["look_at"] = self.rig(sample).pose_of(sensor, light["look_at"])
        is_moving = self._motions[scene] != Motion()
        if is_moving:
            light |= {"motion": self._motion_facts[scene], "exposure": exposure}
        is_of_camera = exposure["time_s"] in ("auto", None) or camera.is_staggered  # metered
        if self.options["noise_ratio"] or (is_moving and is_of_camera):
            light |= {"camera": camera.datasheet, "gain": camera.gain, "exposure": exposure}
        return light

    def _parameters(self, scene: int, values: Config) -> dict[str, str]:
        """Return the values of the <default> names of a scene."""
        given = {**self.file.scenes[scene].parameters, **of_kind("parameters", values)}
        return {name: text_of(value) for name, value in given.items()}

    def _rig(self, scene: int, values: Config) -> Rig:
        return self._rigs(scene, tuple(self._parameters(scene, values).items()))

    def _rig_of(self, scene: int, parameters: tuple[tuple[str, str], ...]) -> Rig:
        entry, motion = self.file.scenes[scene], self._motions[scene]
        return rig_of(entry, self.places[scene], dict(parameters), motion)

    def _digest(self, scene: int, parameters: Mapping[str, str]) -> str:
        """Return the SHA-256 of all files of a scene. Only parameters in names of files can change it."""
        for names, digests in self._digests[scene].items():
            if digest := digests.get((*map(parameters.get, names),)):
                return digest
        place, roots = self.places[scene], self.folders.roots
        if shipped_file(self.file.scenes[scene].file, SCENE, roots):
            roots = [scenes_folder(), *roots]
        is_untrusted = self.folders.untrusted
        files, used = references_of(place, parameters, roots if is_untrusted else None)
        digest = files_digest(files, roots, None if is_untrusted else place.parent)
        names = (*sorted(used),)
        self._digests[scene].setdefault(names, {})[(*map(parameters.get, names),)] = digest
        return digest

    def _place(self, entry: SceneEntry) -> Path:
        try:
            return self._find(entry.file, SCENE, f"the file of scene {entry.name}")
        except InputError as error:
            if not NAME.fullmatch(entry.file):
                raise
            shipped = names_of_scenes(entry.file)
            raise InputError(f"{str(error).removesuffix('.')}; or give {shipped}") from None

    def _motion(self, entry: SceneEntry) -> Motion:
        if isinstance(entry.motion, str):
            what = f"the motion of scene {entry.name}"
            return read_motion(self._find(entry.motion, MOTION, what))
        return read_motion(entry.motion)

    def _find(self, name: str, end: str, what: str) -> Path:
        """Return the path of a file below the roots, else of a file included with the package."""
        return shipped_file(name, end, self.folders.roots) or self.folders.find(name, what, end)


def exposure_asked(values: Config) -> Facts:
    """Return the time [s], "auto", or None for the scene's own; compensation [stops]; temperature [K] or None."""
    time_s, stops, kelvin = map(values.get, ("exposure_s", "exposure_ev", "temperature_k"))
    return {"time_s": time_s, "ev": stops or 0, "temperature_k": kelvin}


class Rig(NamedTuple):
    """Sensors of a scene.

    poses_m : name of each sensor that takes images → pose in the world as the file has it, shape (4, 4), without scale
    [m].  numbers : name of each sensor of the file → its number.
    """

    poses_m: Mapping[str, Float64Array]
    numbers: Mapping[str, int]

    def pose_of(self, sensor: str, first: Facts) -> Facts:
        """Return origin, target and up of a sensor.  first : of the first sensor of the rig."""
        first_sensor = next(iter(self.poses_m))
        if sensor == first_sensor:
            return first
        start = KeyPose(time_s=0, **first).pose
        assert start is not None
        pose = start @ np.linalg.inv(self.poses_m[first_sensor]) @ self.poses_m[sensor]
        origin, up, forward = pose[:3, 3], pose[:3, 1], pose[:3, 2]
        vectors = {"origin_m": origin, "target_m": origin + forward, "up": up}
        return {
            name: [*(np.round(x, POSE_DIGITS) + 0.0).tolist()] for name, x in vectors.items()
        }

    def chip(self, serial: int, sensor: str) -> int:
        """Return the serial number of the sensor unit of a sensor: unchanged for the first sensor of the file; for each
        other one a number that follows from both, because it is another unit."""
        if number := self.numbers[sensor]:
            return seed_of(f"serial {serial} sensor {number}")
        return serial


@restores_variant
def rig_of(
    entry: SceneEntry, place: Path, parameters: Mapping[str, str], motion: Motion
) -> Rig:
    """Return the sensors that an entry requests.  place : of the scene file.  Raises InputError."""
    try:
        options = {"parameters": parameters, "variant": fastest_variant("llvm").name}
        scenes = parse_sensors(str(place), options)
        poses_m = dict[str, Float64Array]()
        for name in _sensors_asked(entry, scenes):
            unit_m = scenes[name].settings.metres(entry.scene_unit) or 1.0
            poses_m[name] = pose_in_file_m(scenes[name], unit_m)
        refuse_one_place(poses_m, None, motion)
    except InputError as error:
        raise InputError(f"scene {entry.name!r} of the dataset: {error}") from None
    return Rig(poses_m, {name: number for number, name in enumerate(scenes)})


def _sensors_asked(entry: SceneEntry, scenes: Mapping[str, ParsedScene]) -> Sequence[str]:
    """Return the names of the sensors requested by name or number, in this order. Raises InputError.

    scenes : by the name of each sensor of the file.
    """
    if entry.sensors == ALL_SENSORS:
        return [*scenes]
    given = (entry.sensors,) if isinstance(entry.sensors, str) else entry.sensors or ()
    scene, names = next(iter(scenes.values())), list[str]()
    for sensor in given:
        name = scene.with_sensor(sensor).sensor_taken().name
        if name in names:
            raise InputError(f"sensors names {name!r} twice; give each once.")
        names.append(name)
    return names
