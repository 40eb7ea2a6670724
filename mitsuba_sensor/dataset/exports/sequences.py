"""Sequences of a dataset: the poses of a scene in the order of time, seen by all cameras at the same settings.

A dataset renders the first sensor of a scene; its cameras are at one place. What is written here holds for rigs, too:
the place of each camera beside the first one comes from their poses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias

import numpy as np

from ...core import Float64Array
from ..plan.sweep import Poses
from ..read.reader import Sample
from ..store.keys import Config, Facts, canonical
from .job import Job, PosedSample
from .poses import TO_OPENCV, camera_to_world

OF_FRAME = ("view", "pose", "camera")
"""Values that differ within a sequence."""
DECIMALS = 12
"""Of the place of a camera beside the first one: cameras at one place are not 1e-17 m apart."""
Group: TypeAlias = dict[str, dict[int, PosedSample]]
"""Camera → number of the view → sample."""
PERIOD_S = 0.1
"""Between frames of a scene without a path, whose poses have no time: that of KITTI's cameras."""


@dataclass(frozen=True)
class SequenceCamera:
    """One camera of a sequence.  name : of its entry in the dataset file.  frames : one for each time."""

    name: str
    frames: Sequence[PosedSample]

    @property
    def to_world(self) -> Float64Array:
        """4 × 4, from this camera to the world, when the first frame is taken; right, down, forward [m]."""
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
        frames = self.cameras[0].frames
        return [camera_to_world(frame.image.pose, TO_OPENCV) for frame in frames]

    def beside_first(self, camera: SequenceCamera) -> Float64Array:
        """4 × 4, from a camera to the first one."""
        move = np.linalg.inv(self.cameras[0].to_world) @ camera.to_world
        return np.asarray(np.round(move, DECIMALS) + 0.0)  # no −0

    def facts(self) -> Facts:
        """What no file of other programs holds: values, and key and split of each frame of each camera."""
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


def _about(sample: Sample) -> dict[str, str]:
    return {"key": sample.key, "split": sample.split}


def sequences(job: Job) -> list[ImageSequence]:
    """All sequences of a dataset. Times that not every camera of a sequence has are left out, and samples that no
    calibration can describe; remarks say which. Raises InputError where none remains."""
    found = list[ImageSequence]()
    for world, samples in job.worlds().items():
        for group in chain.from_iterable(map(_with_common_views, _groups(samples))):
            cameras, views = _at_common_views(job, group)
            first = cameras[0].frames[0].sample
            values = {name: x for name, x in first.values.items() if name not in OF_FRAME}
            times_s = _times_s(job, str(first.values.get("scene")), views)
            found.append(ImageSequence(len(found), world, values, times_s, cameras))
    return found


def _groups(samples: Iterable[PosedSample]) -> Iterator[Group]:
    """Samples with equal values but for pose and camera, by camera and view. Those that have even these in common,
    random draws for example, are in groups of their own."""
    groups: dict[tuple[str, int], Group] = {}
    for posed in samples:
        values = posed.sample.values
        settings = canonical({name: x for name, x in values.items() if name not in OF_FRAME})
        camera, view, number = str(values.get("camera")), values.get("view", 0), 0
        while view in groups.get((settings, number), {}).get(camera, {}):
            number += 1
        group = groups.setdefault((settings, number), {})
        group.setdefault(camera, {})[view] = posed
    yield from groups.values()


def _with_common_views(group: Group) -> list[Group]:
    """The group; each camera alone where there is no view that all have."""
    if _common_views(group):
        return [group]
    return [{camera: frames} for camera, frames in group.items()]


def _common_views(group: Group) -> list[int]:
    """Numbers of the views that all cameras have."""
    return sorted(set[int].intersection(*map(set, group.values())))


def _at_common_views(job: Job, group: Group) -> tuple[list[SequenceCamera], list[int]]:
    """The cameras of a group with their frames at the views that all have, and the numbers of these views."""
    views = _common_views(group)
    rest = list[Sample]()
    for frames in group.values():
        rest += [frames[view].sample for view in frames.keys() - views]
    if rest:
        scene = f"scene {rest[0].values.get('scene')}"
        job.leave_out(rest, scene, "not every camera has these views")
    frames_of = {name: [frames[view] for view in views] for name, frames in group.items()}
    return [SequenceCamera(*named) for named in frames_of.items()], views


def _times_s(job: Job, scene: str, views: Sequence[int]) -> Float64Array:
    """Times of these views of a scene [s]: from the first key of its path on, or evenly spaced."""
    for entry in job.file.scenes:
        if entry.name == scene and entry.path is not None:
            return np.asarray(Poses(entry).times_s(views) - entry.path.keys[0].time_s)
    if len(views) > 1:
        remark = f"scene {scene} has no path, whose keys have times: its frames are {PERIOD_S:g} s apart"
        if remark not in job.remarks:
            job.remarks.append(remark)
    return np.asarray(views) * PERIOD_S
