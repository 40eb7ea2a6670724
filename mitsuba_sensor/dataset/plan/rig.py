"""The sensors of a scene file that take the pictures of a dataset: a rig, each a camera at a place of its own.

A pose of the dataset is that of the first of them; the others keep their places beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core import Float64Array, InputError
from ...files.sensor_names import ALL_SENSORS
from ...render.motion.motion import KeyPose, Motion
from ...render.scene.parse_scene import parse_sensors, pose_in_file_m, refuse_one_place
from ...render.scene.parsed_scene import ParsedScene
from ...render.variants import fastest_variant, restores_variant
from ..store.keys import Facts, seed_of
from .scene_entry import SceneEntry

DIGITS = 9
"""Of a pose that is computed [m]: what is left away is 1 nm, or 1e-9 of a direction."""


class Rig(NamedTuple):
    """Sensors of a scene.

    poses_m : name of each that takes pictures → 4 × 4 to the world, as the file has it, without scale, in metres.
    numbers : name of each sensor of the file → its number.
    """

    poses_m: Mapping[str, Float64Array]
    numbers: Mapping[str, int]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the sensors that take pictures."""
        return (*self.poses_m,)

    def pose_of(self, sensor: str, first: Facts) -> Facts:
        """Origin, target and up of a sensor.  first : those of the first one of the rig."""
        places_m = [*self.poses_m.values()]
        if sensor == self.names[0]:
            return first
        start = KeyPose(time_s=0, **first).pose
        assert start is not None
        pose = start @ np.linalg.inv(places_m[0]) @ self.poses_m[sensor]
        origin, up, forward = pose[:3, 3], pose[:3, 1], pose[:3, 2]
        vectors = {"origin_m": origin, "target_m": origin + forward, "up": up}
        return {name: [*(np.round(x, DIGITS) + 0.0).tolist()] for name, x in vectors.items()}

    def chip(self, serial: int, sensor: str) -> int:
        """Serial number of the chip behind a sensor: that of the dataset for the first sensor of the file, for each
        other one a number that belongs to both, because it is another chip."""
        if number := self.numbers[sensor]:
            return seed_of(f"serial {serial} sensor {number}")
        return serial


@restores_variant
def rig_of(
    entry: SceneEntry, place: Path, parameters: Mapping[str, str], motion: Motion
) -> Rig:
    """The sensors that an entry asks for.  place : of the scene file.  Raises InputError."""
    try:
        options = {"parameters": parameters, "variant": fastest_variant("llvm").name}
        scenes = parse_sensors(str(place), options)
        poses_m = dict[str, Float64Array]()
        for name in _asked(entry, scenes):
            unit_m = scenes[name].settings.metres(entry.scene_unit) or 1.0
            poses_m[name] = pose_in_file_m(scenes[name], unit_m)
        refuse_one_place(poses_m, None, motion)
    except InputError as error:
        raise InputError(f"scene {entry.name!r} of the dataset: {error}") from None
    return Rig(poses_m, {name: number for number, name in enumerate(scenes)})


def _asked(entry: SceneEntry, scenes: Mapping[str, ParsedScene]) -> Sequence[str]:
    """Names of the sensors that are asked for by name or number, in this order. Raises InputError.

    scenes : by the name of each sensor of the file.
    """
    if entry.sensors == ALL_SENSORS:
        return [*scenes]
    asked = entry.sensors or ()
    if isinstance(asked, str):
        asked = (asked,)
    scene, names = next(iter(scenes.values())), list[str]()
    for one in asked:
        name = scene.with_sensor(one).sensor_taken().name
        if name in names:
            raise InputError(f"sensors names {name!r} twice; give each once.")
        names.append(name)
    return names
