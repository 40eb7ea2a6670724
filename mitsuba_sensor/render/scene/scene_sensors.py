"""The sensors of a scene file by name: by their id, or by their number from 0 where they have none."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ...core import Float64Array, InputError, nearest
from ...files.sensor_names import ALL_SENSORS, sensor_name
from ..motion.motion import Motion, read_motion, rigid
from .scene_file import ChosenSensor, SceneFile


def sensors_of(scene: SceneFile) -> dict[str, ChosenSensor]:
    """All sensors of a parsed scene by name, in its order. Raises InputError where there is none."""
    scene.sensor()
    found = dict[str, ChosenSensor]()
    for number, (key, node) in enumerate(scene.children(scene.root, "Sensor")):
        name = sensor_name(str(node.props.id()), number)
        found[name] = ChosenSensor(key, name, number)
    return found


def sensor_taken(scene: SceneFile) -> ChosenSensor:
    """The sensor that was asked for, or the first one."""
    return scene.chosen or next(iter(sensors_of(scene).values()))


def each_sensor(scene: SceneFile) -> dict[str, SceneFile]:
    """The scene once for each of its sensors, by name."""
    return {name: replace(scene, chosen=one) for name, one in sensors_of(scene).items()}


def with_sensor(scene: SceneFile, asked: str | None) -> SceneFile:
    """The scene with the sensor that is asked for by id or number. Raises InputError."""
    if asked is None:
        return scene
    sensors = sensors_of(scene)
    for one in sensors.values():
        if asked in (one.name, str(one.number)):
            return replace(scene, chosen=one)
    known = ", ".join(sensors)
    if asked == ALL_SENSORS:
        raise InputError(
            f"sensor is {asked!r}, which is for frames of a scene (`mitsuba-sensor render`, capture); give one of "
            f"{known}."
        )
    raise InputError(
        f"scene {scene.name!r} has no sensor {asked!r}; its sensors are {known}.{nearest(asked, sensors)}"
    )


def pose_in_file_m(scene: SceneFile, unit_m: float) -> Float64Array:
    """4 × 4 from the sensor to the world, as its file has it, without scale and mirroring; lengths in metres.

    unit_m : metres per scene unit.
    """
    sensor, pose = scene.sensor().props, np.eye(4)
    if "to_world" in sensor:
        pose = rigid(np.array(sensor["to_world"].matrix, dtype=float).reshape(4, 4))
    pose[:3, 3] *= unit_m
    return pose


def refuse_one_place(
    names: Collection[str],
    look_at: object,
    motion: str | os.PathLike[str] | Mapping[str, Any] | Motion | None,
) -> None:
    """Raise InputError for poses in the world that would put all sensors of a scene into one place.

    names : of the sensors.  look_at, motion : options of the render.
    """
    if len(names) < 2:
        return
    camera = read_motion(motion).camera
    in_world = camera is not None and any(key.pose is not None for key in camera.keys)
    for what, given, remedy in (
        ("look_at", look_at is not None, "move them in the scene file"),
        ("the motion", in_world, "give its keys move_m and turn_deg"),
    ):
        if given:
            raise InputError(
                f"{what} has a pose of the camera in the world, where all {len(names)} sensors would be in one "
                f"place; {remedy}, or take one sensor ({', '.join(names)})."
            )
