"""Pictures with the camera that made them and its pose, in the axes of other programs.

COLMAP and nerfstudio have the middle of the upper left pixel at (0.5, 0.5), OpenCV and our intrinsics at (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...core import Float64Array, InputError
from ...optics.calibration import Calibration

TO_OPENCV, TO_OPENGL = (-1.0, -1.0, 1.0), (-1.0, 1.0, -1.0)  # from left, up, forward
SCALE_TOLERANCE = 1e-4  # accepts a matrix that is printed with five digits


@dataclass(frozen=True, eq=False)
class PosedImage:
    """A picture, the camera that made it and from where.

    name : of its file, relative to the folder of the export.
    pose : 4 × 4, camera to world [m]; the columns are left, up, forward and the position.
    """

    name: str
    calibration: Calibration
    pose: Float64Array


def rigid_pose(to_world: ArrayLike) -> Float64Array:
    """A pose without its scale. Raises InputError for shear and mirroring, which no other program has in a pose."""
    pose = np.array(to_world, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise InputError(
            f"the pose of the camera has shape {pose.shape}; pass 4 × 4 finite numbers, camera to world."
        )
    pose[:3, :3] /= np.maximum(np.linalg.norm(pose[:3, :3], axis=0), 1e-300)
    turn = pose[:3, :3]
    if (
        not np.allclose(turn.T @ turn, np.eye(3), atol=SCALE_TOLERANCE)
        or np.linalg.det(turn) < 0
    ):
        raise InputError(
            "the to_world of the scene's sensor shears or mirrors the image, which no pose of other programs can say; "
            'leave out a <scale x="-1"/>.'
        )
    return pose


def camera_to_world(pose: ArrayLike, axes: tuple[float, float, float]) -> Float64Array:
    """4 × 4 from a camera with other axes.  axes : TO_OPENCV (right, down, forward), TO_OPENGL (right, up, back)."""
    return rigid_pose(pose) @ np.diag([*axes, 1.0])


def world_to_camera(pose: ArrayLike) -> tuple[Float64Array, Float64Array]:
    """R (3 × 3) and t (3) of OpenCV and COLMAP: x_camera = R·x_world + t [m]."""
    matrix = camera_to_world(pose, TO_OPENCV)
    turn = matrix[:3, :3].T
    return turn, -turn @ matrix[:3, 3]


def yaml_number(value: float) -> str:
    """A number that every reader of YAML 1.1 takes for one: with a point, also before an exponent."""
    text = repr(float(value))
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text
