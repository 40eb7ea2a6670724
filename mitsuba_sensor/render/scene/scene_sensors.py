"""The sensors of a scene file by name: by their id, or by their number from 0 where they have none."""

from __future__ import annotations

from dataclasses import replace

from ...core import InputError, nearest
from ...files.sensor_names import ALL_SENSORS, sensor_name
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
        f"scene {scene.name!r} has no sensor {asked!r}; it has {known}.{nearest(asked, sensors)}"
    )
