"""OpenCV calibration of a camera: pinhole and Brown-Conrady distortion, from intrinsics or a distortion table.

x points right, y down, z forward; the centre of the upper left pixel is (0, 0).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ..core import Float64Array, InputError
from .distortion import Distortion

FIT_POINTS = 200  # image heights of the fit of coefficients
HALF_PIXEL = 0.5  # from the corner of a pixel to its centre


@dataclass(frozen=True)
class Calibration:
    """Pinhole and distortion of a camera [pixels].

    focal, principal : fx, fy and cx, cy.  distortion : k1, k2, p1, p2, k3.
    misfit_px : largest error of the coefficients in the image; above 0 if they are fitted to a distortion table or a
        prescription.
    """

    columns: int
    rows: int
    focal: tuple[float, float]
    principal: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    misfit_px: float = 0.0

    @property
    def matrix(self) -> Float64Array:
        """K, shape (3, 3)."""
        (fx, fy), (cx, cy) = self.focal, self.principal
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def corner(self) -> float:
        """Distance of the farthest image corner from the principal point, as a tangent, with distortion."""
        (cx, cy), (fx, fy) = self.principal, self.focal
        half_x = (max(cx, self.columns - 1 - cx) + HALF_PIXEL) / fx
        half_y = (max(cy, self.rows - 1 - cy) + HALF_PIXEL) / fy
        return math.hypot(half_x, half_y)

    @property
    def view(self) -> dict[str, float]:
        """Parameters of a scene's <sensor type="perspective">: fov [degrees, along the rows] and principal point
        offsets [image sides]."""
        cx, cy = self.principal
        return {
            "fov": math.degrees(2 * math.atan(self.columns / 2 / self.focal[0])),
            "principal_point_offset_x": 0.5 - (cx + HALF_PIXEL) / self.columns,
            "principal_point_offset_y": 0.5 - (cy + HALF_PIXEL) / self.rows,
        }


def calibration_of(intrinsics: Mapping[str, Any], pitch_um: float) -> Calibration:
    """Return the calibration of intrinsics from :func:`mitsuba_sensor.optics.intrinsics.intrinsics` or frame metadata.

    pitch_um : pixel pitch along a row. Raises InputError for an orthographic sensor, which has no focal length.
    """
    matrix, (columns, rows) = intrinsics["matrix"], intrinsics["image_size"]
    if matrix is None:
        raise InputError(
            "the scene's sensor is orthographic, so it has no focal length to calibrate; use a perspective or thinlens "
            "sensor."
        )
    focal, principal = (matrix[0][0], matrix[1][1]), (matrix[0][2], matrix[1][2])
    heights_mm = intrinsics["heights_mm"]
    if heights_mm is None:
        return Calibration(columns, rows, focal, principal, tuple(intrinsics["distortion"]))
    distance_mm = focal[0] * pitch_um * 1e-3
    ideal = np.asarray(heights_mm["ideal"]) / distance_mm
    real = np.asarray(heights_mm["real"]) / distance_mm
    growth = np.divide(real, ideal, out=np.ones_like(real), where=ideal > 0) - 1
    end = float(ideal[-1])
    curve = Distortion(growth=scipy.interpolate.PchipInterpolator(ideal, growth), table_end=end)
    corner = Calibration(columns, rows, focal, principal).corner
    radius = np.linspace(0.0, min(2 * corner, end), FIT_POINTS)
    real_radius, *_ = curve.real(radius, np.zeros_like(radius))
    (k1, k2, k3), misfit = radial_fit(radius, real_radius, corner)
    distortion, misfit_px = (k1, k2, 0.0, 0.0, k3), misfit * max(focal)
    return Calibration(columns, rows, focal, principal, distortion, misfit_px)


def radial_fit(
    ideal: Float64Array, real: Float64Array, corner: float
) -> tuple[tuple[float, float, float], float]:
    """Return the least-squares k1, k2, k3 for ideal and real image heights, and the largest residual.

    Heights are tangents; only real heights up to ``corner`` count.
    """
    inside = real <= corner
    ideal, real = ideal[inside], real[inside]
    powers = ideal[:, None] ** np.array([3, 5, 7])
    radial = np.linalg.lstsq(powers, real - ideal, rcond=None)[0]
    k1, k2, k3 = radial.tolist()
    return (k1, k2, k3), float(np.abs(powers @ radial + ideal - real).max())
