"""Rigid motions of the camera and of the objects of a scene over time, read from a TOML file.

Lengths are metres in world space, time 0 is when the first row of the film opens. Camera and objects have either
constant velocities or key poses, relative to their pose in the scene file::

    [camera]
    velocity_m_per_s = [0.5, 0, 0]     # constant
    rotate_deg_per_s = 20              # right-handed about axis, through pivot_m (by default the camera's position)
    axis = [0, 1, 0]

    [objects.fan]                      # the id of a shape in the scene file
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

A key of the camera may instead give its pose in the world: ``origin_m`` and ``target_m`` (``up`` is [0, 1, 0] if not
given), or ``to_world``, four rows of four numbers.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from ..core.errors import InputError, nearest, require
from ..core.types import Float64Array

Vector = tuple[float, float, float]
Matrix = tuple[tuple[float, float, float, float], ...]
ZERO: Vector = (0.0, 0.0, 0.0)
CONSTANT = ("velocity_m_per_s", "rotate_deg_per_s", "axis")
RELATIVE_POSE = ("move_m", "turn_deg", "axis")
WORLD_POSE = ("origin_m", "target_m", "up", "to_world")
ROTATION_TOLERANCE = 1e-4  # accepts a matrix that is printed with five digits
LONGEST_S = 1e9  # of a key; far beyond any exposure


@dataclass(frozen=True)
class KeyPose:
    """A pose at a time: translation and rotation vector, or a pose in the world (rows of 4×4, camera only)."""

    time_s: float
    move_m: Vector = ZERO
    turn_rad: Vector = ZERO
    to_world: Matrix | None = None


@dataclass(frozen=True)
class RigidMotion:
    """The motion of one object. pivot_m : fixed point of its rotation; None is the camera's own position."""

    velocity_m_per_s: Vector = ZERO
    spin_rad_per_s: Vector = ZERO
    pivot_m: Vector | None = None
    keys: tuple[KeyPose, ...] = ()

    def displacement(self, time_s: float, base: ArrayLike | None = None) -> Float64Array:
        """4×4 from the pose in the scene file to that at ``time_s``: x → pivot + move + R·(x − pivot).

        base : 4×4 pose of the camera in the scene file; its last column is the pivot where none is given.
        """
        start = np.eye(4) if base is None else np.asarray(base, float)
        pivot = start[:3, 3] if self.pivot_m is None else np.array(self.pivot_m)
        if self.keys:
            move, turn = self._between_keys(time_s, start, pivot)
        else:
            move = time_s * np.array(self.velocity_m_per_s)
            turn = Rotation.from_rotvec(time_s * np.array(self.spin_rad_per_s))
        result = np.eye(4)
        result[:3, :3] = turn.as_matrix()
        result[:3, 3] = pivot + move - result[:3, :3] @ pivot
        return result

    def _between_keys(self, time_s: float, start: Float64Array, pivot: Float64Array) -> tuple[Float64Array, Rotation]:
        """Linear interpolation of the pivot, slerp of rotations; constant before the first and after the last key."""
        poses = [_relative(key, start, pivot) for key in self.keys]
        if len(poses) == 1:
            return poses[0]
        times = [key.time_s for key in self.keys]
        at = float(np.clip(time_s, times[0], times[-1]))
        moves = np.array([move for move, _ in poses])
        move = np.array([np.interp(at, times, axis) for axis in moves.T])
        return move, Slerp(times, Rotation.concatenate([turn for _, turn in poses]))(at)


@dataclass(frozen=True)
class Motion:
    """What moves during an exposure. objects : by the id of the shape in the scene file."""

    camera: RigidMotion | None = None
    objects: Mapping[str, RigidMotion] = field(default_factory=dict)


def read_motion(source: str | os.PathLike[str] | Mapping[str, object] | Motion) -> Motion:
    """A motion from a TOML file, or from a mapping of the same fields; a Motion is returned as it is.

    Raises InputError, one sentence.
    """
    if isinstance(source, Motion):
        return source
    if isinstance(source, Mapping):
        return _motion(source, "the motion")
    if not isinstance(source, str | os.PathLike):
        raise InputError(f"motion is {source!r}; pass a TOML file, a mapping of its fields, or a Motion.")
    where = f"motion file {os.fspath(source)!r}"
    try:
        data = tomllib.loads(Path(source).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{where} cannot be read: {getattr(error, 'strerror', None) or 'it is not text'}.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where} is not valid TOML: {error}.") from None
    return _motion(data, where)


def _motion(data: Mapping[str, object], where: str) -> Motion:
    _check_names(data, ("camera", "objects"), where)
    objects = _table(data.get("objects", {}), f"{where}: objects")
    camera = _rigid_motion(data["camera"], f"{where}: camera", True) if "camera" in data else None
    rigid = {name: _rigid_motion(fields, f"{where}: objects.{name}", False) for name, fields in objects.items()}
    if camera is None and not rigid:
        raise InputError(f"{where} moves nothing; give it a table [camera] or [objects.ID].")
    return Motion(camera, rigid)


def _rigid_motion(value: object, where: str, is_camera: bool) -> RigidMotion:
    """The motion of one table, checked."""
    data = _table(value, where)
    _check_names(data, (*CONSTANT, "pivot_m", "keys"), where)
    constant = [name for name in CONSTANT if name in data]
    if bool(constant) == ("keys" in data):
        raise InputError(f"{where} must have either velocity_m_per_s or rotate_deg_per_s, or keys, and not both.")
    pivot = _vector(data["pivot_m"], f"{where}.pivot_m") if "pivot_m" in data else None
    motion = RigidMotion(
        velocity_m_per_s=_vector(data.get("velocity_m_per_s", ZERO), f"{where}.velocity_m_per_s"),
        spin_rad_per_s=_turn(data, "rotate_deg_per_s", where),
        pivot_m=pivot,
        keys=_keys(data["keys"], f"{where}.keys", is_camera) if "keys" in data else (),
    )
    turns = motion.spin_rad_per_s != ZERO or any(key.turn_rad != ZERO for key in motion.keys)
    if turns and pivot is None and not is_camera:
        raise InputError(f"{where} rotates and has no pivot_m; give its fixed point, e.g. pivot_m = [0, 0, 0].")
    return motion


def _keys(data: object, where: str, is_camera: bool) -> tuple[KeyPose, ...]:
    if not isinstance(data, list | tuple) or not data:
        raise InputError(f"{where} is {data!r}; it must be a list of tables with time_s, [[…keys]].")
    keys = tuple(_key(_table(key, f"{where}[{k}]"), f"{where}[{k}]", is_camera) for k, key in enumerate(data))
    for before, after in pairwise(keys):
        if after.time_s <= before.time_s:
            raise InputError(f"{where} has time_s {after.time_s:g} after {before.time_s:g}; the times must increase.")
    return keys


def _key(data: Mapping[str, object], where: str, is_camera: bool) -> KeyPose:
    """One pose: relative to the scene file, or of the camera in the world."""
    _check_names(data, ("time_s", *RELATIVE_POSE, *WORLD_POSE), where)
    if "time_s" not in data:
        raise InputError(f"{where} has no time_s; give the seconds from the start of the exposure, e.g. 0.01.")
    time_s = require(f"{where}.time_s", cast(float, data["time_s"]), -LONGEST_S, LONGEST_S, "seconds, e.g. 0.01")
    world = [name for name in WORLD_POSE if name in data]
    if not world:
        move = _vector(data.get("move_m", ZERO), f"{where}.move_m")
        return KeyPose(time_s, move, _turn(data, "turn_deg", where))
    if not is_camera:
        raise InputError(f"{where} has {world[0]}, which belongs to the camera; an object has move_m and turn_deg.")
    if any(name in data for name in RELATIVE_POSE) or world not in (["to_world"], [*WORLD_POSE[:2]], [*WORLD_POSE[:3]]):
        raise InputError(f"{where} must have one of move_m and turn_deg, origin_m and target_m, or to_world.")
    return KeyPose(time_s, to_world=_pose(data, where))


def _pose(data: Mapping[str, object], where: str) -> Matrix:
    """Rows of the camera's 4×4, from a matrix or from origin and target (axes: left, up, forward)."""
    matrix = np.eye(4)
    if "to_world" in data:
        try:
            matrix = np.array(data["to_world"], dtype=float).reshape(4, 4)
        except (TypeError, ValueError):
            raise InputError(f"{where}.to_world must be four rows of four numbers.") from None
    else:
        origin, target = (np.array(_vector(data[name], f"{where}.{name}")) for name in WORLD_POSE[:2])
        forward, up = target - origin, np.array(_vector(data.get("up", (0, 1, 0)), f"{where}.up"))
        left = np.cross(up, forward)
        if np.linalg.norm(left) < 1e-9 * np.linalg.norm(up) * np.linalg.norm(forward) or not left.any():
            raise InputError(f"{where}: target_m is at origin_m, or up is along the view; change target_m or up.")
        axes = [left, np.cross(forward, left), forward]
        matrix[:3] = np.column_stack([*(axis / np.linalg.norm(axis) for axis in axes), origin])
    turn = matrix[:3, :3]
    if (
        not np.allclose(turn @ turn.T, np.eye(3), atol=ROTATION_TOLERANCE)
        or np.linalg.det(turn) < 0
        or matrix[3, 3] != 1
    ):
        raise InputError(f"{where}.to_world is not a rotation and a translation; remove scale, shear and mirroring.")
    return tuple((x, y, z, w) for x, y, z, w in matrix.tolist())


def _relative(key: KeyPose, start: Float64Array, pivot: Float64Array) -> tuple[Float64Array, Rotation]:
    """Translation of the pivot, and rotation, from ``start`` to the pose of the key."""
    if key.to_world is None:
        return np.array(key.move_m), Rotation.from_rotvec(key.turn_rad)
    whole = np.array(key.to_world) @ np.linalg.inv(_unscaled(start))
    turn = Rotation.from_matrix(whole[:3, :3])
    return whole[:3, 3] + turn.as_matrix() @ pivot - pivot, turn


def _unscaled(pose: Float64Array) -> Float64Array:
    """The rigid part of a scene's camera pose, without its scale or mirroring (an orthographic zoom)."""
    rigid = pose.copy()
    rigid[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    rigid[:3, 0] *= np.sign(np.linalg.det(pose[:3, :3]))
    return rigid


def _turn(data: Mapping[str, object], name: str, where: str) -> Vector:
    """Rotation vector [rad] of an angle about an axis; both are given, or neither."""
    if (name in data) != ("axis" in data):
        missing, other = ("axis", name) if name in data else (name, "axis")
        raise InputError(f"{where} has {other} and no {missing}; a rotation needs both, e.g. axis = [0, 1, 0].")
    if name not in data:
        return ZERO
    angle = math.radians(require(f"{where}.{name}", cast(float, data[name]), -1e9, 1e9, "degrees, e.g. 90"))
    axis = np.array(_vector(data["axis"], f"{where}.axis"))
    if not axis.any():
        raise InputError(f"{where}.axis is [0, 0, 0]; give a direction, e.g. [0, 1, 0].")
    x, y, z = (angle * axis / np.linalg.norm(axis)).tolist()
    return x, y, z


def _vector(value: object, name: str) -> Vector:
    numbers = value if isinstance(value, list | tuple | np.ndarray) and len(value) == 3 else (math.nan,)
    try:
        if not all(math.isfinite(number + 0) for number in numbers):
            raise TypeError
        x, y, z = (float(number) for number in numbers)
    except TypeError:
        raise InputError(f"{name} is {value!r}; it must be three finite numbers, e.g. [0, 0, 1].") from None
    return x, y, z


def _table(value: object, where: str) -> Mapping[str, object]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {value!r}; it must be a table.")
    return value


def _check_names(data: Mapping[str, object], names: Iterable[str], where: str) -> None:
    for name in data:
        if name not in names:
            raise InputError(f"{where} has no {name!r}; it may have {', '.join(names)}.{nearest(str(name), names)}")
