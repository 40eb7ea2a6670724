"""Sequences of a dataset: the poses of a scene in the order of time, seen by all cameras at the same settings.

A camera of a sequence is an entry of the dataset file at a sensor of the scene. The place of each beside the first one
comes from their poses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias

import numpy as np

from ...core import Float64Array
from ..read.reader import Sample
from ..store.keys import Config, Facts, canonical
from .job import Job, PosedSample
from .poses import TO_OPENCV, camera_to_world

OF_FRAME = ("view", "time_s", "pose", "camera", "sensor")
"""Values that differ within a sequence."""
DECIMALS = 12
"""Of the place of a camera beside the first one: cameras at one place are not 1e-17 m apart."""
Group: TypeAlias = dict[str, dict[int, PosedSample]]
"""Camera → number of the view → sample."""
PERIOD_S = 0.1
"""Between frames of a scene whose views have no times: that of KITTI's cameras."""
MOST_MOVED = 1e-5
"""Of a rigid rig: how much a camera may move beside the first one [m, rad]."""


@dataclass(frozen=True)
class SequenceCamera:
    """One camera of a sequence.  name : of its entry in the dataset file, and of its sensor.  frames : one for each
    time."""

    name: str
    frames: Sequence[PosedSample]

    @property
    def poses(self) -> list[Float64Array]:
        """4 × 4 of each frame, from this camera to the world; right, down, forward [m]."""
        return [camera_to_world(frame.image.pose, TO_OPENCV) for frame in self.frames]

    @property
    def to_world(self) -> Float64Array:
        """The first of these."""
        return camera_to_world(self.frames[0].image.pose, TO_OPENCV)


@dataclass(frozen=True)
class ImageSequence:
    """Frames of one or several cameras at the same times.

    number : from 0, over the whole export.  scene : name of the world that the poses are in.
    values : that all frames have in common.  times_s : of the frames.
    """

    number: int
    scene: str
    values: Config
    times_s: Float64Array
    cameras: Sequence[SequenceCamera]

    @property
    def poses(self) -> list[Float64Array]:
        """4 × 4 of each frame, first camera (right, down, forward) to world [m]."""
        return self.cameras[0].poses

    def beside_first(self, camera: SequenceCamera) -> Float64Array:
        """4 × 4, from a camera to the first one."""
        move = np.linalg.inv(self.cameras[0].to_world) @ camera.to_world
        return np.asarray(np.round(move, DECIMALS) + 0.0)  # no −0

    def facts(self) -> Facts:
        """What no file of other programs holds: values, and key, split and time of each frame of each
        camera."""
        return {
            "scene": self.scene,
            "values": dict(self.values),
            "world_from_first_camera": self.cameras[0].to_world.tolist(),
            "cameras": [
                {
                    "camera": camera.name,
                    "frames": [_about(sample) for sample, _ in camera.frames],
                }
                for camera in self.cameras
            ],
        }


def _about(sample: Sample) -> Facts:
    about: Facts = {"key": sample.key, "split": sample.split}
    if "time_s" in sample.values:
        about["time_s"] = sample.values["time_s"]
    return about


def sequences(job: Job) -> list[ImageSequence]:
    """All sequences of a dataset. Times that not every camera of a sequence has are left out, and samples that no
    calibration can describe; remarks say which. Raises InputError where none remains."""
    found = list[ImageSequence]()
    for world, samples in job.worlds().items():
        for group in chain.from_iterable(map(_with_common_views, _groups(samples))):
            cameras, views = _at_common_views(job, group)
            first = cameras[0].frames[0].sample
            values = {name: x for name, x in first.values.items() if name not in OF_FRAME}
            times_s = _times_s(job, cameras[0], views)
            for rig in _rigid_rigs(job, world, cameras):
                found.append(ImageSequence(len(found), world, values, times_s, rig))
    return found


def _rigid_rigs(
    job: Job, world: str, cameras: Sequence[SequenceCamera]
) -> list[Sequence[SequenceCamera]]:
    """The cameras together where they keep their places beside the first one; else each alone."""
    first, *others = (np.array(camera.poses) for camera in cameras)
    for poses in others:
        beside_first = np.linalg.inv(first) @ poses
        if np.abs(beside_first - beside_first[0]).max() > MOST_MOVED:
            remark = f"cameras of {world} do not keep their places beside each other: each has a sequence of its own"
            job.remarks.extend({remark}.difference(job.remarks))
            return [[camera] for camera in cameras]
    return [cameras]


def _groups(samples: Iterable[PosedSample]) -> Iterator[Group]:
    """Samples with equal values but for pose and camera, by camera and view. Those that have even these in common,
    random draws for example, are in groups of their own."""
    groups: dict[tuple[str, int], Group] = {}
    for posed in samples:
        values = posed.sample.values
        settings = canonical({name: x for name, x in values.items() if name not in OF_FRAME})
        camera, view, number = _camera_name(values), values.get("view", 0), 0
        while view in groups.get((settings, number), {}).get(camera, {}):
            number += 1
        group = groups.setdefault((settings, number), {})
        group.setdefault(camera, {})[view] = posed
    yield from groups.values()


def _camera_name(values: Config) -> str:
    """``konnik_table1``, or ``konnik_table1 left`` where the sensor has a name."""
    return f"{values.get('camera')} {values.get('sensor', '')}".rstrip()


def _with_common_views(group: Group) -> list[Group]:
    """The group; each camera alone where there is no view that all have."""
    if _common_views(group):
        return [group]
    return [{camera: frames} for camera, frames in group.items()]


def _common_views(group: Group) -> list[int]:
    """Numbers of the views that all cameras have."""
    return sorted(set[int].intersection(*map(set, group.values())))


def _at_common_views(job: Job, group: Group) -> tuple[list[SequenceCamera], list[int]]:
    """The cameras of a group with their frames at the views that all have, and the numbers of these views: in the order
    of time, else of their numbers."""
    views = _common_views(group)
    first = next(iter(group.values()))
    if times_s := _own_times_s([first[view] for view in views]):
        views = [view for _, view in sorted(zip(times_s, views, strict=True))]
    rest = list[Sample]()
    for frames in group.values():
        rest += [frames[view].sample for view in frames.keys() - views]
    if rest:
        scene = f"scene {rest[0].values.get('scene')}"
        job.leave_out(rest, scene, "not every camera has these views")
    frames_of = {name: [frames[view] for view in views] for name, frames in group.items()}
    return [SequenceCamera(*named) for named in frames_of.items()], views


def _times_s(job: Job, camera: SequenceCamera, views: Sequence[int]) -> Float64Array:
    """Times of these views [s], from the first one on: those of the samples, or evenly spaced."""
    if times_s := _own_times_s(camera.frames):
        return np.asarray(np.array(times_s) - times_s[0])
    if len(views) > 1:
        scene = camera.frames[0].sample.values.get("scene")
        remark = f"views of scene {scene} have no times of their own: its frames are {PERIOD_S:g} s apart"
        job.remarks.extend({remark}.difference(job.remarks))
    return np.asarray(views) * PERIOD_S


def _own_times_s(frames: Sequence[PosedSample]) -> list[float]:
    """Time of each frame [s]; none where one has none, or two have the same."""
    times_s = [x.sample.values["time_s"] for x in frames if "time_s" in x.sample.values]
    if len({*times_s}) < len(frames):
        return []
    return times_s
