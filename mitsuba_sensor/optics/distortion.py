"""Measured distortion of a lens: Brown-Conrady coefficients (OpenCV), or a table of image heights.

Points are image heights over the image distance; without distortion, (x, y) are the tangents of the field angle.
x points right and y down, as in OpenCV.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..core import Float64Array, InputError

if TYPE_CHECKING:
    from ..camera.lens_datasheet import LensSection

NEWTON_STEPS = 30  # five suffice for a usual lens; convergence is slow near a fold
TANGENT_TOLERANCE = 1e-9
"""A thousandth of a pixel in an image a hundred thousand pixels wide."""
BLOCK = 2**14  # points at a time, so their arrays fit into the cache


@dataclass(frozen=True, eq=False)
class Distortion:
    """Map from ideal to real image points, and back.

    coefficients : k1, k2, p1, p2, k3.
    growth : real over ideal height minus 1 versus ideal height (a tangent): monotone cubics through the table, with
        linear extrapolation above ``table_end``.
    """

    coefficients: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    growth: scipy.interpolate.PchipInterpolator | None = None
    table_end: float = np.inf

    def real(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, ...]:
        """Return the real point of an ideal point, and the derivatives ∂x′/∂x, ∂x′/∂y = ∂y′/∂x, ∂y′/∂y.

        x′ = x·g + 2·p1·xy + p2·(r² + 2x²), y′ = y·g + p1·(r² + 2y²) + 2·p2·xy, g = 1 + k1·r² + k2·r⁴ + k3·r⁶
        (OpenCV's model), or g from the table.
        """
        k1, k2, p1, p2, k3 = self.coefficients
        square = x * x + y * y
        if self.growth is None:
            g = 1 + square * (k1 + square * (k2 + square * k3))
            slope = k1 + square * (2 * k2 + square * 3 * k3)  # dg/d(r²)
        else:
            radius = np.sqrt(square)
            inside = np.minimum(radius, self.table_end)
            steepness = self.growth(inside, 1)
            g = 1 + self.growth(inside) + steepness * (radius - inside)
            slope = steepness / np.maximum(2 * radius, 1e-12)
        return (
            x * g + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * g + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            g + 2 * slope * x * x + 2 * p1 * y + 6 * p2 * x,
            2 * slope * x * y + 2 * p1 * x + 2 * p2 * y,
            g + 2 * slope * y * y + 6 * p1 * y + 2 * p2 * x,
        )

    def ideal(
        self, x: Float64Array, y: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return the ideal point of a real point, and the local ratio of real to ideal area.

        Raises InputError if the distortion is not invertible, or the table is too short.
        """
        flat = np.array([np.ravel(x), np.ravel(y)], dtype=float)
        blocks = [
            self._invert(*flat[:, start : start + BLOCK])
            for start in range(0, flat.shape[1], BLOCK)
        ]
        inverse = np.hstack(blocks)
        highest = float(np.hypot(inverse[0], inverse[1]).max())
        if highest > self.table_end * (1 + TANGENT_TOLERANCE):
            raise InputError(
                f"the sensor's corner has {highest / self.table_end:.4g} times the last ideal image height in "
                "lens.distortion_heights_mm; extend the table."
            )
        u, v, area = inverse.reshape(3, *np.shape(x))
        return u, v, area

    def _invert(
        self, x: Float64Array, y: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return ideal points and areas of real points (n,), by Newton's method from the real points."""
        u, v = x, y
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                xr, yr, a, b, d = self.real(u, v)
                area, ex, ey = a * d - b * b, xr - x, yr - y
                good = (ex * ex + ey * ey < TANGENT_TOLERANCE**2) & (area > 0)
                if good.all():
                    return u, v, area
                u, v = u - (d * ex - b * ey) / area, v - (a * ey - b * ex) / area
        where = float(np.hypot(x, y)[~good].min())
        raise InputError(
            f"lens.distortion folds the image at {where:.3g} image distances from the axis, but real heights must "
            "increase with ideal heights up to the sensor's corner; check the coefficients, or the field of view."
        )


def distortion_of(lens: LensSection, image_distance_mm: float) -> Distortion | None:
    """Return the distortion of a camera's lens at this image distance, or None.

    Raises InputError for an infinite distance: a telecentric sensor has no field angles.
    """
    if not any(lens.distortion or lens.distortion_percent or ()):
        return None
    if np.isinf(image_distance_mm):
        raise InputError(
            "lens.distortion needs field angles, but the scene's sensor is orthographic; unset it, or use a "
            "perspective or thinlens sensor."
        )
    if lens.distortion is not None:
        return Distortion(coefficients=lens.distortion)
    heights = np.asarray(lens.distortion_heights_mm, dtype=float) / image_distance_mm
    growth = scipy.interpolate.PchipInterpolator(
        heights, np.asarray(lens.distortion_percent, dtype=float) / 100
    )
    return Distortion(growth=growth, table_end=float(heights[-1]))
