"""Calibrations and poses of pictures, samples of one world, and sequences of cameras over time.

A pose has shape (4, 4) and maps from a camera (x right, y down, z forward) to the world [m]; the centre of the upper
left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...core import Float64Array, InputError
from ...optics.calibration import Calibration, calibration_of
from ..keys import Config, Facts, canonical
from ..read import Sample

if TYPE_CHECKING:
    from .export import Job

WORLD_SETTINGS = ("scene", "parameters", "traverse", "motion", "scene_unit")
"""Settings of a render that decide its world."""
FRAME_SETTINGS = ("view", "time_s", "pose", "camera", "sensor")
"""Values that may differ within a sequence."""
SCALE_TOLERANCE = 1e-4
"""Tolerance for a matrix that was printed with five digits."""
FRAME_PERIOD_S = 0.1
"""Time between frames of a scene whose views have no times, as in KITTI."""
RIG_TOLERANCE = 1e-5
"""Largest movement of a camera of a rigid rig relative to the first camera [m, rad]."""
POSE_DECIMALS = 12
"""Rounding, so cameras at one place are not 1e-17 m apart."""


class Posed(NamedTuple):
    """A sample, the calibration of its camera, and its pose."""

    sample: Sample
    calibration: Calibration
    pose: Float64Array


Rig: TypeAlias = Mapping[str, Sequence[Posed]]
"""Camera → its frames; frames at the same place in the lists are simultaneous."""


@dataclass(frozen=True)
class ImageSequence:
    """Simultaneous frames of one or several cameras.

    scene : name of the world of the poses.  values : settings that all frames share.
    """

    scene: str
    values: Config
    times_s: Float64Array
    cameras: Rig

    @property
    def poses(self) -> list[Float64Array]:
        """Pose of each frame of the first camera."""
        return [frame.pose for frame in next(iter(self.cameras.values()))]

    def pose_in_first(self, camera: str) -> Float64Array:
        """Return the pose of a camera in the first camera, shape (4, 4)."""
        relative = np.linalg.inv(self.poses[0]) @ self.cameras[camera][0].pose
        return np.asarray(np.round(relative, POSE_DECIMALS) + 0.0)  # no −0

    def facts(self) -> Facts:
        """Return what other programs do not store: settings, and key, split and time of each frame of each camera."""

        def about(sample: Sample) -> Facts:
            times = {x: y for x, y in sample.values.items() if x == "time_s"}
            return {"key": sample.key, "split": sample.split, **times}

        cameras = [
            {"camera": name, "frames": [about(frame.sample) for frame in frames]}
            for name, frames in self.cameras.items()
        ]
        return {
            "scene": self.scene,
            "values": self.values,
            "world_from_first_camera": self.poses[0].tolist(),
            "cameras": cameras,
        }


def rigid_pose(to_world: ArrayLike) -> Float64Array:
    """Return the pose of a scene's camera (axes left, up, forward) without its scale. Raises InputError for shear and
    mirroring, which poses of other programs cannot have."""
    pose = np.array(to_world, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise InputError(
            f"the pose of the camera has shape {pose.shape}; pass 4 × 4 finite numbers, camera to world."
        )
    pose[:3, :3] /= np.maximum(np.linalg.norm(pose[:3, :3], axis=0), 1e-300)
    turn = pose[:3, :3]
    is_orthogonal = np.allclose(turn.T @ turn, np.eye(3), atol=SCALE_TOLERANCE)
    if not is_orthogonal or np.linalg.det(turn) < 0:
        raise InputError(
            "the to_world of the scene's sensor shears or mirrors the image, which poses of other programs cannot "
            'have; remove <scale x="-1"/>.'
        )
    return pose @ np.diag([-1.0, -1.0, 1.0, 1.0])


def quaternion(rotation: Float64Array) -> list[float]:
    """Return w, x, y, z of a rotation matrix."""
    import scipy

    turn = scipy.spatial.transform.Rotation.from_matrix(rotation)
    x, y, z, w = turn.as_quat(canonical=True).tolist()
    return [w, x, y, z]


def worlds(job: Job) -> dict[str, list[Posed]]:
    """Return posed samples by their world: SCENE, or SCENE/001, … for a scene with variants. Leaves out samples without
    a pose or calibration that other programs can read. Raises InputError if no sample remains."""
    groups: dict[tuple[str, str], list[Posed]] = {}
    unposed: dict[tuple[str, str], list[Sample]] = {}
    for sample in job.samples:
        facts = sample.facts
        scene, config, light = facts["view"]["scene"], facts["view"]["config"], facts["light"]
        try:
            pitch_um = facts["config"]["camera"]["pixel"]["pitch_x_um"]
            calibration = calibration_of(light["intrinsics"], pitch_um)
            posed = Posed(sample, calibration, rigid_pose(light["camera_to_world"]))
        except ValueError as error:  # InputError, or an error of SciPy about a table
            unposed.setdefault((scene, str(error)), []).append(sample)
            continue
        variant = canonical({name: config.get(name) for name in WORLD_SETTINGS})
        groups.setdefault((scene, variant), []).append(posed)
    for (scene, why), samples in unposed.items():
        job.leave_out(samples, f"scene {scene}", why)
    if not groups:
        raise InputError(f"no sample can be exported; {'; '.join(job.remarks)}.")
    variants = [scene for scene, _ in groups]
    named: dict[str, list[Posed]] = {}
    for (scene, _), group in groups.items():
        number = sum(name.startswith(f"{scene}/") for name in named) + 1
        named[scene if variants.count(scene) == 1 else f"{scene}/{number:03d}"] = group
    return named


def sequences(job: Job) -> list[ImageSequence]:
    """Return all sequences of a dataset. Cameras with other views, and cameras that move relative to each other, have
    separate sequences. Leaves out samples without a calibration, with a remark. Raises InputError if no sample
    remains."""
    all_sequences = list[ImageSequence]()
    for world, posed in worlds(job).items():
        for cameras in _same_settings(posed):
            first, *others = (sorted(frames) for frames in cameras.values())
            rigs = [cameras]
            if any(views != first for views in others) or not _is_rigid(cameras):
                rigs = [{name: frames} for name, frames in cameras.items()]
            all_sequences += [_sequence(job, world, rig) for rig in rigs]
    return all_sequences


def _same_settings(samples: Sequence[Posed]) -> list[dict[str, dict[int, Posed]]]:
    """Return samples with equal settings except pose and camera, by camera and view.

    Samples that also share these, e.g. random draws, are in separate groups.
    """
    groups: dict[tuple[str, int], dict[str, dict[int, Posed]]] = {}
    for posed in samples:
        values = posed.sample.values
        settings = canonical({n: x for n, x in values.items() if n not in FRAME_SETTINGS})
        camera = f"{values.get('camera')} {values.get('sensor', '')}".rstrip()
        view, number = values.get("view", 0), 0
        while view in groups.get((settings, number), {}).get(camera, {}):
            number += 1
        groups.setdefault((settings, number), {}).setdefault(camera, {})[view] = posed
    return [*groups.values()]


def _sequence(
    job: Job, world: str, cameras: Mapping[str, Mapping[int, Posed]]
) -> ImageSequence:
    """Return the sequence of cameras with the same views, in the order of time."""
    first = next(iter(cameras.values()))
    views, values = sorted(first), next(iter(first.values())).sample.values
    times = [first[view].sample.values.get("time_s") for view in views]
    if None in times or len({*times}) < len(times):
        times_s = FRAME_PERIOD_S * np.array(views, float)
        if len(views) > 1:
            job.remark(
                f"views of scene {values.get('scene')} have no times: its frames are {FRAME_PERIOD_S:g} s apart"
            )
    else:
        order = np.argsort(np.array(times, float))
        times_s, views = np.array(times, float)[order], [views[place] for place in order]
        times_s -= times_s[0]
    rig = {name: [frames[view] for view in views] for name, frames in cameras.items()}
    common = {name: x for name, x in values.items() if name not in FRAME_SETTINGS}
    return ImageSequence(world, common, times_s, rig)


def _is_rigid(cameras: Mapping[str, Mapping[int, Posed]]) -> bool:
    """Return True if cameras with the same views keep their poses relative to the first camera."""
    poses = np.array([[x[view].pose for view in sorted(x)] for x in cameras.values()])
    relative = np.linalg.inv(poses[0]) @ poses
    return bool(np.abs(relative - relative[:, :1]).max() <= RIG_TOLERANCE)
