"""Calibration of a camera as other programs have it: pinhole, Brown-Conrady distortion, pose in their axes.

All numbers here are in OpenCV's convention: x right, y down, z forward, the middle of the upper left pixel is (0, 0).
COLMAP and nerfstudio have (0.5, 0.5) there; their files say what is added.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ...core import Float64Array, InputError
from ...optics.distortion import Distortion

HALF_PIXEL = 0.5  # where the middle of the upper left pixel is in COLMAP and nerfstudio
TO_OPENCV, TO_OPENGL = (-1.0, -1.0, 1.0), (-1.0, 1.0, -1.0)  # from left, up, forward
FIT_POINTS = 200  # image heights of a table or a prescription that coefficients are fitted to
SCALE_TOLERANCE = 1e-4  # accepts a matrix that is printed with five digits


@dataclass(frozen=True)
class Calibration:
    """Pinhole and distortion of one camera [pixels].

    focal, principal : fx, fy and cx, cy.  distortion : k1, k2, p1, p2, k3.
    misfit_px : how far a point of the image is from where these coefficients have it, at most; above 0 where the lens
        is a table of distortion or a prescription, to which they are fitted.
    """

    columns: int
    rows: int
    focal: tuple[float, float]
    principal: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    misfit_px: float = 0.0

    @property
    def matrix(self) -> Float64Array:
        """K, 3 × 3."""
        (fx, fy), (cx, cy) = self.focal, self.principal
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class PosedImage:
    """A picture, the camera that made it and from where.

    name : of its file, relative to the folder of the export.
    pose : 4 × 4, camera to world [m]; the columns are left, up, forward and the position.
    """

    name: str
    calibration: Calibration
    pose: Float64Array


def calibration_of(intrinsics: Mapping[str, Any], pitch_um: float) -> Calibration:
    """The calibration that :func:`mitsuba_sensor.optics.intrinsics.intrinsics` and metadata of frames describe.

    pitch_um : of the pixels along a row, for image heights. Raises InputError for an orthographic sensor, which has no
    focal length.
    """
    matrix, (columns, rows) = intrinsics["matrix"], intrinsics["image_size"]
    if matrix is None:
        raise InputError(
            "the scene's sensor is orthographic, which has no focal length, and no calibration can say so; take a "
            "perspective or thinlens sensor."
        )
    focal, principal = (matrix[0][0], matrix[1][1]), (matrix[0][2], matrix[1][2])
    if intrinsics["heights_mm"] is None:
        return Calibration(columns, rows, focal, principal, tuple(intrinsics["distortion"]))
    heights = {
        name: np.asarray(values) / (focal[0] * pitch_um * 1e-3) for name, values in intrinsics["heights_mm"].items()
    }
    sides = [max(c, n - 1 - c) / f for c, n, f in zip(principal, (columns, rows), focal, strict=True)]
    radial, misfit = _fitted(heights["ideal"], heights["real"], float(np.hypot(*sides)))
    k1, k2, k3 = radial
    return Calibration(columns, rows, focal, principal, (k1, k2, 0.0, 0.0, k3), misfit * max(focal))


def _fitted(ideal: Float64Array, real: Float64Array, corner: float) -> tuple[list[float], float]:
    """k1, k2, k3 of least squares for heights up to ``corner``, and the largest distance; all as tangents."""
    growth = np.divide(real, ideal, out=np.ones_like(real), where=ideal > 0) - 1
    curve = Distortion(growth=scipy.interpolate.PchipInterpolator(ideal, growth), table_end=float(ideal[-1]))
    radius = np.linspace(0.0, min(2 * corner, float(ideal[-1])), FIT_POINTS)
    found = curve.real(radius, np.zeros_like(radius))[0]
    inside = found <= corner
    radius, found = radius[inside], found[inside]
    powers = radius[:, None] ** np.array([3, 5, 7])
    radial = np.linalg.lstsq(powers, found - radius, rcond=None)[0]
    return radial.tolist(), float(np.abs(powers @ radial + radius - found).max())


def rigid_pose(to_world: ArrayLike) -> Float64Array:
    """A pose without its scale. Raises InputError for shear and mirroring, which no other program has in a pose."""
    pose = np.array(to_world, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise InputError(f"the pose of the camera has shape {pose.shape}; pass 4 × 4 finite numbers, camera to world.")
    pose[:3, :3] /= np.maximum(np.linalg.norm(pose[:3, :3], axis=0), 1e-300)
    turn = pose[:3, :3]
    if not np.allclose(turn.T @ turn, np.eye(3), atol=SCALE_TOLERANCE) or np.linalg.det(turn) < 0:
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
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
