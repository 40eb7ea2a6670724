"""Animated transforms: puts the camera and the objects of a loaded scene at their poses of any time.

Mitsuba 3.9.1 has no animated transforms and nothing reads the time of its rays, so the transforms and vertices of the
scene are set for each instant, and restored afterwards. One compiled kernel serves all poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, nearest
from ..core.types import Float64Array
from .motion import Motion, RigidMotion
from .rays import camera_to_world, matrix4
from .scene import Scene
from .variants import MitsubaObject, mitsuba

AT_REST = RigidMotion(velocity_m_per_s=(0.0, 0.0, 0.0))


class AnimatedTransforms:
    """Sets camera and objects of a scene to their poses of a time; leaving the ``with`` block restores them.

    unit_m : metres per scene unit. All poses and points here are in scene units.
    Raises InputError for an object that the scene does not have or that cannot be moved.
    """

    def __init__(self, scene: Scene, motion: Motion, unit_m: float = 1.0) -> None:
        mi = mitsuba()
        self.motion, self._camera = motion, mi.traverse(scene.sensor)
        self._unit_m = unit_m
        self.rest_pose = camera_to_world(scene.sensor)
        self.names = [shape.id() for shape in scene.mitsuba_scene.shapes()]
        for name in motion.objects:
            if name not in self.names:
                known = sorted(name for name in self.names if name)
                has = f"the ids of its shapes are {', '.join(known)}" if known else "no shape of it has an id"
                raise InputError(
                    f"the motion names {name!r}, which is no shape of the scene; {has}.{nearest(name, known)}"
                )
        self._shapes = mi.traverse(scene.mitsuba_scene)
        self._at_rest = {name: _movable_parameters(self._shapes, name) for name in motion.objects}
        self._shapes.keep([key for parameters in self._at_rest.values() for key in parameters])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._set(self.rest_pose, {name: np.eye(4) for name in self._at_rest})

    def set_time(self, time_s: float) -> None:
        """Set everything to its pose at this time."""
        moved = {name: self._displacement(motion, time_s) for name, motion in self.motion.objects.items()}
        self._set(self.camera_at(time_s), moved)

    def camera_at(self, time_s: float) -> Float64Array:
        """Pose of the camera, 4×4 to world space."""
        return self._displacement(self.motion.camera or AT_REST, time_s) @ self.rest_pose

    def carried(self, points: Float64Array, shapes: NDArray[np.intp], from_s: float, to_s: float) -> Float64Array:
        """Homogeneous world points (N, 4) on the shapes of these indices, moved with them from one time to another."""
        moved = points.copy()
        for name, motion in self.motion.objects.items():
            mine = shapes == self.names.index(name)
            change = self._displacement(motion, to_s) @ np.linalg.inv(self._displacement(motion, from_s))
            moved[mine] = points[mine] @ change.T
        return moved

    def _displacement(self, motion: RigidMotion, time_s: float) -> Float64Array:
        """4×4 in scene units; the pivot of a camera is its own position."""
        metres = self.rest_pose.copy()
        metres[:3, 3] *= self._unit_m
        moved = motion.displacement(time_s, metres)
        moved[:3, 3] /= self._unit_m
        return moved

    def _set(self, camera: Float64Array, objects: Mapping[str, Float64Array]) -> None:
        if self.motion.camera is not None:
            self._camera["to_world"] = type(self._camera["to_world"])(camera)
            self._camera.update()
        for name, displacement in objects.items():
            for key, value in self._at_rest[name].items():
                self._shapes[key] = _displaced(type(self._shapes[key]), key, value, displacement)
        if objects:
            self._shapes.update()


def _movable_parameters(parameters: MitsubaObject, name: str) -> dict[str, Float64Array]:
    """What changes when a shape moves, at its pose in the scene file: its transform, or the vertices of a mesh."""
    transform = f"{name}.to_world"
    if transform in parameters:
        return {transform: matrix4(parameters[transform])}
    keys = [f"{name}.vertex_positions", f"{name}.vertex_normals"]
    if keys[0] not in parameters:
        raise InputError(f"the shape {name!r} cannot be moved: it has neither a transform nor vertices; use a mesh.")
    return {key: np.array(parameters[key], dtype=np.float64).reshape(-1, 3) for key in keys if len(parameters[key])}


def _displaced(kind: MitsubaObject, key: str, rest: Float64Array, displacement: Float64Array) -> MitsubaObject:
    """The value of one parameter, of type ``kind``, after a 4×4 displacement.

    Made from an array it is data of the kernel; from a list it would be literals, and every pose another kernel.
    """
    if key.endswith(".to_world"):
        return kind(displacement @ rest)
    shift = displacement[:3, 3] if key.endswith("positions") else 0.0
    return kind((rest @ displacement[:3, :3].T + shift).ravel().astype(np.float32))
