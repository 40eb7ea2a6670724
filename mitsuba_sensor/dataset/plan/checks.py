"""Checks a plan before anything is made, and finds which rows and cameras of it share a light.

Its samples are not counted one by one: each scene is looked at with the first of its lights, and each value once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...core import Exposure, InputError
from ..store.keys import Config, canonical
from .cameras import VariedCamera
from .configured import ConfiguredSamples
from .file import DatasetFile, Distribution
from .scene_entry import Value
from .sweep import (
    SENSOR,
    Combination,
    Poses,
    SceneSweep,
    cells,
    ends,
    possible_values,
    values_of_cell,
)
from .values import SAME, check_value, text_of

MOST_CAMERAS = 2000
"""Combinations of values that change a camera, of which a camera is made for a check: evenly chosen where more are."""
POSES_AT_ONCE, POSE_BYTES = 4096, 80
SMALLEST_SINE = 1e-9
"""Of the angle between up and where a camera looks, as of a motion's key."""
Pair = tuple[int, int]
"""Number of a row, number of a camera."""


class SharedLight(NamedTuple):
    """Rows and cameras that share each light of a scene.  start, end : the numbers that their samples of the first
    light may have, among those of the scene."""

    pairs: tuple[Pair, ...]
    start: int
    end: int


@dataclass(frozen=True)
class PlannedScene:
    """The samples of one scene.  first : number that its first sample has.  shared : for each of its lights."""

    sweep: SceneSweep
    first: int
    shared: tuple[SharedLight, ...]

    @property
    def numbers_of_light(self) -> int:
        """How many numbers each light takes."""
        return self.shared[-1].end

    @property
    def end(self) -> int:
        """The number after the last one that a sample of this scene may have."""
        return self.first + self.sweep.lights * self.numbers_of_light


def checked_scenes(plan: ConfiguredSamples) -> list[PlannedScene]:
    """The scenes of a plan. Raises InputError for values that cannot be, and for samples that are there twice."""
    for name, law in random_laws(plan.file).items():
        for value in ends(law, plan.file.random.draws if plan.file.random else 1):
            check_value(name, value)
    _check_exposures(plan.file)
    for sweep in plan.sweeps:
        _check_path(sweep)
        _refuse_equal_poses(sweep)
    for name, values in plan.file.grid.items():
        _refuse_equal_values(plan, name, values)
    _check_cameras(plan)
    _refuse_equal_rows(plan)
    scenes, first = list[PlannedScene](), 0
    for sweep in plan.sweeps:
        scenes.append(PlannedScene(sweep, first, _shared_lights(plan, sweep)))
        first = scenes[-1].end
    return scenes


def _check_exposures(file: DatasetFile) -> None:
    """Raise InputError where an exposure time is too long with the stops on top."""
    for row in file.list or ({},):
        times = [one for one in _values_of(file, row, "exposure_s") if not isinstance(one, str)]
        stops = _values_of(file, row, "exposure_ev")
        if not times or not stops:
            continue
        time_s, most = max(map(_float, times)), max(map(_float, stops))
        try:
            Exposure(time_s * 2.0**most)
        except InputError as error:
            raise InputError(
                f"exposure_s is {time_s:g} with exposure_ev {most:g} on top: {error}"
            ) from None


def _values_of(file: DatasetFile, row: Config, name: str) -> Sequence[Value]:
    """The smallest and the largest value, or all, that something has in the samples of a row."""
    if name in row:
        return [row[name]]
    if name in (laws := random_laws(file)):
        return ends(laws[name], file.random.draws if file.random else 1)
    return file.grid.get(name, ())


def _check_path(sweep: SceneSweep) -> None:
    """Raise InputError where a camera on a path is at its target, or looks along its up direction."""
    if sweep.poses.path is None or not sweep.poses.path.has_poses:
        return
    for numbers in _some_at_once(len(sweep.poses)):
        vectors = sweep.poses.vectors(numbers)
        forward, up = vectors[:, 1] - vectors[:, 0], vectors[:, 2]
        left = np.linalg.norm(np.cross(up, forward), axis=1)
        size = np.linalg.norm(up, axis=1) * np.linalg.norm(forward, axis=1)
        if (wrong := np.flatnonzero((left < SMALLEST_SINE * size) | (left == 0))).size:
            origin, target, _ = vectors[wrong[0]].tolist()
            raise InputError(
                f"view {numbers[wrong[0]]} on the path of scene {sweep.entry.name!r} is at {origin} and looks at "
                f"{target}: that is one point, or straight along up; move a key, or give it another up."
            )


def _some_at_once(count: int) -> Iterator[range]:
    """The numbers of poses, some at a time."""
    for first in range(0, count, POSES_AT_ONCE):
        yield range(first, min(first + POSES_AT_ONCE, count))


def _float(value: Value) -> float:
    """A number that was checked to be one."""
    assert isinstance(value, int | float)
    return float(value)


def random_laws(file: DatasetFile) -> dict[str, Distribution]:
    """Name of what is drawn at random → how."""
    return dict(file.random.values) if file.random else {}


def first_combination(sweep: SceneSweep, row: int, camera: int) -> Combination:
    """The first sample of a row and a camera in a scene."""
    return sweep.combination(sweep.light(0), row, camera, 0)


def first_pairs(plan: ConfiguredSamples) -> Iterator[Pair]:
    """All rows with all cameras."""
    for row in range(len(plan.file.list) or 1):
        for camera in range(len(plan.file.cameras)):
            yield row, camera


def telling_combinations(plan: ConfiguredSamples) -> Iterator[Combination]:
    """Samples whose keys depend on all files that the dataset is made from: the first one of each scene, row and
    camera, and one with each text that something may be, which may name a file."""
    for sweep in plan.sweeps:
        for pair in first_pairs(plan):
            yield first_combination(sweep, *pair)
        one = first_combination(sweep, 0, 0)
        for name in plan.file.varied:
            texts = (x for x in possible_values(plan.file, name) if isinstance(x, str))
            yield from (one._replace(values={**one.values, name: text}) for text in texts)


def _shared_lights(plan: ConfiguredSamples, sweep: SceneSweep) -> tuple[SharedLight, ...]:
    """Rows and cameras by the light that they share, which is so for each light of a scene as for the first one."""
    pairs: dict[str, list[Pair]] = {}
    for pair in first_pairs(plan):
        one = first_combination(sweep, *pair)
        pairs.setdefault(plan.light_key(one, plan.cameras.of(one))[1], []).append(pair)
    shared, start = list[SharedLight](), 0
    for group in pairs.values():
        end = start
        for row, camera in group:
            rows, names = sweep.rows, plan.splits.names
            chips = max(len(plan.splits.serials(name, rows[row], camera)) for name in names)
            end += sweep.most_exposures * chips
        shared.append(SharedLight(tuple(group), start, end))
        start = end
    return tuple(shared)


def _refuse_equal_values(plan: ConfiguredSamples, name: str, values: Sequence[Value]) -> None:
    """Raise InputError where two values of an axis of the grid are the same; 1 and 1.0 are."""
    one = first_combination(plan.sweeps[0], 0, 0)
    known = dict[str, Value]()
    for value in values:
        other = one._replace(values={**one.values, name: value})
        text = _normal(name, value, plan.cameras.of(other))
        if text in known:
            _refuse({name: value})
        known[text] = value


def _normal(name: str, value: Value, camera: VariedCamera) -> str:
    """A text that equal values have in common.  camera : with the value."""
    if SAME.get(name, name).startswith("camera."):
        return camera.key
    if name == "gain":
        return str(camera.gain)
    if name.startswith("parameters."):
        return text_of(value)
    return canonical({"value": value})


def _check_cameras(plan: ConfiguredSamples) -> None:
    """Raise InputError for a camera that cannot be, of those that grid, rows and draws make."""
    given = {**plan.file.grid}
    given |= {name: (*ends(law, 1),) for name, law in random_laws(plan.file).items()}
    axes = {
        n: x for n, x in given.items() if n == "gain" or SAME.get(n, n).startswith("camera.")
    }
    several = cells(axes)
    for row, camera in first_pairs(plan):
        one = first_combination(plan.sweeps[0], row, camera)
        for cell in np.unique(
            np.linspace(0, several - 1, min(several, MOST_CAMERAS), dtype=int)
        ):
            values = {**one.values, **values_of_cell(axes, int(cell))}
            plan.cameras.of(one._replace(values=values))


def _refuse_equal_rows(plan: ConfiguredSamples) -> None:
    """Raise InputError where scenes, rows and cameras make the same sample; scenes may differ by their poses alone."""
    known: dict[str, list[SceneSweep]] = {}
    choices = {name: law.choice or law.integer for name, law in random_laws(plan.file).items()}
    alike = {name: some[0] for name, some in choices.items() if some}  # any may be drawn
    for sweep in plan.sweeps:
        for pair in first_pairs(plan):
            one = first_combination(sweep, *pair)
            for other_sensor in _with_each_sensor(sweep, one._replace(pose=None)):
                values = {**other_sensor.values, **alike}
                sample = plan.first_sample(other_sensor._replace(values=values))
                others = known.setdefault(sample.key, [])
                for other in others:
                    if other is sweep or _share_poses(sweep.poses, other.poses):
                        _refuse(sample.values)
                others.append(sweep)


def _with_each_sensor(sweep: SceneSweep, one: Combination) -> Iterator[Combination]:
    """The combination with each of the sensors that are named; itself where none is."""
    if SENSOR not in sweep.of_light:
        yield one
    for sensor in sweep.of_light.get(SENSOR, ()):
        yield one._replace(values={**one.values, SENSOR: sensor})


def _refuse_equal_poses(sweep: SceneSweep) -> None:
    """Raise InputError where a scene has a pose twice."""
    codes = _codes_of(sweep.poses)
    if len(np.unique(codes)) < len(codes):
        ordered, first = np.argsort(codes, kind="stable"), codes[np.argsort(codes)]
        again = int(ordered[1:][first[1:] == first[:-1]].min())
        _refuse({"scene": sweep.entry.name, "view": again})


def _share_poses(one: Poses, other: Poses) -> bool:
    return bool(np.intersect1d(_codes_of(one), _codes_of(other)).size)


def _codes_of(poses: Poses) -> np.ndarray:
    """A number of 64 bits for each view: equal for those with equal pose and time."""
    return np.concatenate([_codes(poses, numbers) for numbers in _some_at_once(len(poses))])


def _codes(poses: Poses, numbers: Sequence[int]) -> np.ndarray:
    """The same of some of the views."""
    vectors = poses.vectors(numbers).reshape(len(numbers), -1)
    data = np.column_stack([poses.times_s(numbers), vectors]).tobytes()
    views = (data[start : start + POSE_BYTES] for start in range(0, len(data), POSE_BYTES))
    digests = [hashlib.blake2b(view, digest_size=8).digest() for view in views]
    return np.frombuffer(b"".join(digests), np.uint64)


def _refuse(values: Config) -> None:
    said = ", ".join(f"{name} {value}" for name, value in values.items() if name != "pose")
    raise InputError(
        f"two scenes, poses, cameras, rows or values are the same ({said}); leave one of them out, give views "
        "another time_s, or vary repetition for another sample of the same settings."
    )
