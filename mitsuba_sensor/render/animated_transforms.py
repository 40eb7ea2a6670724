"""Animated transforms: camera and objects of a loaded scene at their poses of any time; optical flow and image speed.

Mitsuba 3.9.1 has no animated transforms and nothing reads the time of its rays, so the transforms and vertices of the
scene are set for each instant, and restored afterwards. One compiled kernel serves all poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..core import Float64Array, InputError, nearest
from .motion import Motion, RigidMotion
from .rays import SurfaceHits, camera_to_world, intersect, matrix4, pixel_rays, project
from .scene import Scene
from .variants import MitsubaObject, mitsuba

AT_REST = RigidMotion(velocity_m_per_s=(0.0, 0.0, 0.0))
PROBES = 32  # rays along each side of the image that look for the largest speed
INSTANTS = np.linspace(0, 1, 5)  # when they look, as fractions of the time from first row open to last row closed
DIFFERENCE = 1 / 256  # of that time: speeds are differences over it, with 0.03 px of rounding in all


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


def max_image_speed(scene: Scene, transforms: AnimatedTransforms, span_s: tuple[float, float]) -> float:
    """The largest speed of anything in the image [px/s], at five instants from end to end of ``span_s``.

    Of all that a grid of rays meets, and of the corners of the bounding boxes of the moved shapes, where they are in
    view.
    """
    length = span_s[1] - span_s[0]
    if length == 0:
        return 0.0
    times = [span_s[0] + fraction * length for fraction in INSTANTS]
    return max(_image_speed(scene, transforms, time_s, length * DIFFERENCE) for time_s in times)


def _image_speed(scene: Scene, transforms: AnimatedTransforms, at_s: float, difference_s: float) -> float:
    transforms.set_time(at_s)
    (width, height), (left, top) = scene.view.crop_size, scene.view.crop_offset
    x, y = (np.unique(np.linspace(0, n - 1, PROBES).round()) + 0.5 for n in (width, height))
    grid: Float64Array = np.stack(np.meshgrid(left + x, top + y), axis=-1).reshape(-1, 2)
    points, hits = first_hits(scene, transforms.camera_at(at_s), *pixel_rays(scene, grid))
    shapes = hits.shape
    for name in transforms.motion.objects:
        index = transforms.names.index(name)
        box = scene.mitsuba_scene.shapes()[index].bbox()
        corners = np.array([[*np.ravel(box.corner(k)), 1.0] for k in range(8)])
        points, grid = np.concatenate([points, corners]), np.concatenate([grid, np.tile(np.mean(grid, axis=0), (8, 1))])
        shapes = np.concatenate([shapes, np.full(8, index)])
    before = reproject(scene, transforms, points, shapes, grid, (at_s, at_s))
    after = reproject(scene, transforms, points, shapes, before, (at_s, at_s + difference_s))
    inside = (np.abs(before - (left + width / 2, top + height / 2)) <= (width / 2, height / 2)).all(axis=1)
    moved = np.hypot(*(after - before)[inside].T)
    return float(np.nanmax(moved, initial=0.0)) / difference_s


def first_hits(
    scene: Scene, camera: Float64Array, origins: Float64Array, directions: Float64Array, albedo: bool = False
) -> tuple[Float64Array, SurfaceHits]:
    """First surfaces along rays of the camera's frame, also as homogeneous world points (N, 4).

    Without a surface the point is the direction, with a last component of 0.  camera : 4×4 to world space.
    """
    world = directions @ camera[:3, :3].T
    unit = world / np.linalg.norm(world, axis=1, keepdims=True)
    hits = intersect(scene, origins @ camera[:3, :3].T + camera[:3, 3], unit, albedo)
    points = np.where(hits.found[:, None], hits.position, world)
    return np.column_stack([points, hits.found]), hits


def reproject(
    scene: Scene,
    transforms: AnimatedTransforms,
    points: Float64Array,
    shapes: NDArray[np.intp],
    guess: Float64Array,
    times_s: tuple[float, float],
) -> Float64Array:
    """Positions on the film (N, 2) [pixels] at the second time, of points (N, 4) on these shapes at the first time."""
    moved = transforms.carried(points, shapes, *times_s)
    return project(scene, moved @ np.linalg.inv(transforms.camera_at(times_s[1])).T, guess)
