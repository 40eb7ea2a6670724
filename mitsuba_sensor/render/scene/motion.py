"""Rigid motions of the camera and the objects of a scene, read from a TOML file.

Lengths are metres in world space; time 0 is when the first row of the film opens. Camera and objects have either
constant velocities or key poses, relative to their pose in the scene file::

    [camera]
    velocity_m_per_s = [0.5, 0, 0]     # constant
    rotate_deg_per_s = 20              # right-handed about axis, through pivot_m (by default the camera's position)
    axis = [0, 1, 0]

    [objects.fan]                      # the id of a shape or of a spot light in the scene file
    rotate_deg_per_s = 720
    axis = [0, 0, 1]
    pivot_m = [0, 0.2, -1]             # required for an object that rotates

    [[objects.ball.keys]]              # linear, and by the shorter arc, between keys; constant before and after
    time_s = 0
    [[objects.ball.keys]]
    time_s = 0.02
    move_m = [0.1, 0, 0]
    turn_deg = 30                      # about axis, through the object's pivot_m
    axis = [0, 0, 1]

A key of the camera may instead give its pose in the world: ``origin_m`` and ``target_m`` (``up`` is [0, 1, 0] by
default), or ``to_world``, four rows of four numbers.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from ...camera.datasheet_errors import sentence
from ...core import Float64Array, InputError
from ...core.small_files import require_small, toml_tables
from ...files.shipped_scenes import MOTION, shipped_file
from ...stages.datasheet import FileTable

NUMBER_MAX = 1e30  # its square is finite
Number = Annotated[
    float,
    BeforeValidator(lambda x: x.tolist() if hasattr(x, "tolist") else x),
    Field(strict=True, ge=-NUMBER_MAX, le=NUMBER_MAX),
]
Vector = Annotated[tuple[Number, ...], Field(min_length=3, max_length=3)]
Matrix = Annotated[
    tuple[Annotated[tuple[Number, ...], Field(min_length=4, max_length=4)], ...],
    Field(min_length=4, max_length=4),
]
ZERO = (0.0, 0.0, 0.0)
AXIS = Field(None, description="direction of the axis of rotation", examples=[[0, 1, 0]])
ROTATION_TOLERANCE = 1e-4  # accepts a matrix that is printed with five digits


class KeyPose(FileTable):
    """A pose at one time: relative to the scene file, or in the world (camera only)."""

    time_s: Number = Field(
        ge=-1e9,
        le=1e9,
        description="seconds from time 0 of the motion",
        examples=[0.01],
    )
    move_m: Vector = Field(
        ZERO, description="movement from the pose in the scene file [m]", examples=[[0.1, 0, 0]]
    )
    turn_deg: Number | None = Field(
        None, description="rotation about axis [degrees]", examples=[30]
    )
    axis: Vector | None = AXIS
    origin_m: Vector | None = Field(
        None, description="position of the camera in the world [m]", examples=[[0, 1, 4]]
    )
    target_m: Vector | None = Field(
        None, description="a point that it looks at [m]", examples=[[0, 1, 0]]
    )
    up: Vector = Field(
        (0.0, 1.0, 0.0), description="direction that is up in the image", examples=[[0, 1, 0]]
    )
    to_world: Matrix | None = Field(
        None,
        description="pose of the camera, four rows of four numbers",
        examples=[np.eye(4, dtype=int).tolist()],
    )

    @model_validator(mode="after")
    def _one_pose(self) -> Self:
        world = self.model_fields_set & {"origin_m", "target_m", "up", "to_world"}
        relative = self.model_fields_set & {"move_m", "turn_deg", "axis"}
        if world and (
            relative or (world - {"up"} != {"origin_m", "target_m"} and world != {"to_world"})
        ):
            raise ValueError(
                "must have one of move_m and turn_deg, origin_m and target_m, or to_world"
            )
        _rotation(self.turn_deg, self.axis, "turn_deg")
        _ = self.pose  # raises ValueError for a wrong pose
        return self

    @property
    def pose(self) -> Float64Array | None:
        """The pose in the world, shape (4, 4), from to_world or from origin and target (axes: left, up, forward); None
        if relative."""
        if self.to_world is not None:
            matrix = np.array(self.to_world)
            turn = matrix[:3, :3]
            is_orthogonal = np.allclose(turn @ turn.T, np.eye(3), atol=ROTATION_TOLERANCE)
            if not is_orthogonal or np.linalg.det(turn) <= 0 or matrix[3, 3] != 1:
                raise ValueError(
                    "to_world is not a rotation and a translation; remove scale, shear and mirroring"
                )
            return matrix
        if self.origin_m is None:
            return None
        vectors = self.origin_m, self.target_m, self.up
        origin, target, up = (np.array(vector) for vector in vectors)
        forward = target - origin
        left = np.cross(up, forward)
        axes = left, np.cross(forward, left), forward
        lengths = [np.linalg.norm(axis) for axis in axes]
        if lengths[0] <= 1e-9 * np.linalg.norm(up) * lengths[2]:
            raise ValueError(
                "target_m is at origin_m, or up is along the view; change target_m or up"
            )
        pose = np.eye(4)
        unit_axes = [axis / length for axis, length in zip(axes, lengths, strict=True)]
        pose[:3] = np.column_stack([*unit_axes, origin])
        return pose

    def relative(
        self, start: Float64Array, pivot: Float64Array
    ) -> tuple[Float64Array, scipy.spatial.transform.Rotation]:
        """Return the translation of the pivot, and the rotation, from the pose ``start`` of the scene file."""
        if self.pose is None:
            return np.array(self.move_m), _rotation(self.turn_deg, self.axis, "turn_deg")
        whole = self.pose @ np.linalg.inv(rigid(start))
        turn = scipy.spatial.transform.Rotation.from_matrix(whole[:3, :3])
        return whole[:3, 3] + turn.as_matrix() @ pivot - pivot, turn


class RigidMotion(FileTable):
    """The motion of the camera.  pivot_m : fixed point of its rotation; default: the position of the camera."""

    velocity_m_per_s: Vector = Field(
        ZERO, description="constant velocity [m/s]", examples=[[0.5, 0, 0]]
    )
    rotate_deg_per_s: Number | None = Field(
        None, description="constant rotation about axis [degree/s]", examples=[20]
    )
    axis: Vector | None = AXIS
    pivot_m: Vector | None = Field(
        None, description="fixed point of the rotation [m]", examples=[[0, 0, 0]]
    )
    keys: tuple[KeyPose, ...] = Field(
        (), description="a list of tables with time_s", examples=[[{"time_s": 0}]]
    )

    @model_validator(mode="after")
    def _one_motion(self) -> Self:
        steady = {"velocity_m_per_s", "rotate_deg_per_s", "axis"}
        if bool(self.model_fields_set & steady) == bool(self.keys):
            raise ValueError(
                "must have either velocity_m_per_s or rotate_deg_per_s, or keys, and not both"
            )
        for before, after in pairwise(key.time_s for key in self.keys):
            if after <= before:
                raise ValueError(
                    f"keys has time_s {after:g} after {before:g}; the times must increase"
                )
        _rotation(self.rotate_deg_per_s, self.axis, "rotate_deg_per_s")
        return self

    def displacement(self, time_s: float, base: ArrayLike | None = None) -> Float64Array:
        """Return the displacement at ``time_s``, shape (4, 4): x → pivot + move + R·(x − pivot).

        base : pose of the camera in the scene file, shape (4, 4); its position is the default pivot.
        """
        start = np.eye(4) if base is None else np.asarray(base, float)
        pivot = start[:3, 3] if self.pivot_m is None else np.array(self.pivot_m)
        if self.keys:
            move, turn = self._between_keys(time_s, start, pivot)
        else:
            move = time_s * np.array(self.velocity_m_per_s)
            turn = _rotation(self.rotate_deg_per_s, self.axis, "rotate_deg_per_s", time_s)
        result = np.eye(4)
        result[:3, :3] = turn.as_matrix()
        result[:3, 3] = pivot + move - result[:3, :3] @ pivot
        return result

    def _between_keys(
        self, time_s: float, start: Float64Array, pivot: Float64Array
    ) -> tuple[Float64Array, scipy.spatial.transform.Rotation]:
        """Interpolate the pivot linearly and the rotation by slerp; constant outside the keys."""
        poses = [key.relative(start, pivot) for key in self.keys]
        if len(poses) == 1:
            return poses[0]
        times = [key.time_s for key in self.keys]
        at = float(np.clip(time_s, times[0], times[-1]))
        moves = np.array([move for move, _ in poses])
        move = np.array([np.interp(at, times, axis) for axis in moves.T])
        return move, scipy.spatial.transform.Slerp(
            times, scipy.spatial.transform.Rotation.concatenate([turn for _, turn in poses])
        )(at)


class ObjectMotion(RigidMotion):
    """The motion of one object; a rotation needs pivot_m."""

    @model_validator(mode="after")
    def _of_an_object(self) -> Self:
        for key in self.keys:
            if world := sorted(
                key.model_fields_set & {"origin_m", "target_m", "up", "to_world"}
            ):
                raise ValueError(
                    f"keys has {world[0]}, which belongs to the camera; an object has move_m and turn_deg"
                )
        if self.pivot_m is None and (
            self.rotate_deg_per_s or any(key.turn_deg for key in self.keys)
        ):
            raise ValueError(
                "rotates and has no pivot_m; give its fixed point, e.g. pivot_m = [0, 0, 0]"
            )
        return self


class Motion(FileTable):
    """Motion during an exposure.  objects : by the id of a shape, or of an emitter with a transform."""

    camera: RigidMotion | None = Field(
        None, description="a table [camera]", examples=[{"velocity_m_per_s": [1, 0, 0]}]
    )
    objects: dict[str, ObjectMotion] = Field(
        {}, description="tables [objects.ID]", examples=[{"fan": {}}]
    )


def read_motion(source: str | os.PathLike[str] | Mapping[str, Any] | Motion | None) -> Motion:
    """Return the motion of a TOML file, or of a mapping of its fields; None means no motion. Raises InputError."""
    if source is None or isinstance(source, Motion):
        return source or Motion()
    where, data = "the motion", source
    if not isinstance(source, Mapping):
        if not isinstance(source, str | os.PathLike):
            raise InputError(
                f"motion is {source!r}; pass a TOML file, a mapping of its fields, or a Motion."
            )
        where = f"motion file {os.fspath(source)!r}"
        file = Path(shipped_file(source, MOTION) or source)
        try:
            require_small(file, "motion file")
            data = toml_tables(file.read_text(encoding="utf-8"))
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{where} is not valid TOML: {error}.") from None
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or "it is not text"
            raise InputError(
                f"{where} cannot be read: {why}; give the path of a motion file, or rolling_fan, which is included."
            ) from None
    try:
        motion = Motion.model_validate(data)
    except ValidationError as error:
        raise InputError(sentence(error, Motion, where, "motion")) from None
    if motion == Motion():
        raise InputError(f"{where} moves nothing; give it a table [camera] or [objects.ID].")
    return motion


def rigid(to_world: Float64Array) -> Float64Array:
    """Return a pose, shape (4, 4), without scale and mirroring, which an orthographic zoom has."""
    pose = to_world.copy()
    pose[:3, :3] /= np.linalg.norm(to_world[:3, :3], axis=0)
    pose[:3, 0] *= np.sign(np.linalg.det(to_world[:3, :3]))
    return pose


def _rotation(
    angle_deg: float | None, axis: tuple[float, ...] | None, name: str, factor: float = 1.0
) -> scipy.spatial.transform.Rotation:
    """Return the rotation by a multiple of an angle about an axis; both are given, or neither."""
    if angle_deg is None and axis is None:
        return scipy.spatial.transform.Rotation.identity()
    if angle_deg is None or axis is None:
        missing, given = (name, "axis") if angle_deg is None else ("axis", name)
        raise ValueError(
            f"has {given} and no {missing}; a rotation needs both, e.g. axis = [0, 1, 0]"
        )
    length = np.linalg.norm(axis)
    if length < 1 / NUMBER_MAX:
        given = ", ".join(f"{x:g}" for x in axis)
        raise ValueError(f"axis is [{given}]; give a direction, e.g. [0, 1, 0]")
    vector = np.radians(angle_deg) * np.array(axis) / length
    return scipy.spatial.transform.Rotation.from_rotvec(factor * vector)
