"""Distorted projection: the rays of the scene's own pinhole or thin lens, displaced by a measured distortion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.types import Array, Float64Array
from ..optics.distortion import Distortion
from .variants import MitsubaObject, mitsuba

if TYPE_CHECKING:
    from ..optics.view import View

TOLERANCE_PX = 0.005  # of the interpolated displacement
COARSEST, FINEST = 32, 1024  # cells of the table along a side


class DistortedProjection:
    """For each real position on the film, the ray of its ideal position, from a table over the whole film."""

    def __init__(self, distortion: Distortion, view: View) -> None:
        mi = mitsuba()
        self._size = view.size
        self._cells, table = _displacement_table(distortion, view)
        self._displacement = mi.Texture2f(mi.TensorXf(table), use_accel=False)

    def sample(
        self, sensor: MitsubaObject, samples: tuple[Array, Array, Array, Array], active: Array
    ) -> tuple[MitsubaObject, Array]:
        """The scene's own ray, and its weight, for the position without distortion.

        samples : time, wavelength sample, position on the film [pixels], and aperture sample.
        """
        time, wavelength, position, aperture = samples
        scale = self._cells / (self._cells + 1)
        at = [p / n * scale + (0.5 / (self._cells + 1)) for p, n in zip(position, self._size, strict=True)]
        dx, dy = self._displacement.eval(type(position)(*at), active)
        ideal = type(position)(position.x + dx, position.y + dy)
        ray, weight = sensor.inner.sample_ray(time, wavelength, sensor.to_crop(ideal), aperture, active)
        return ray, weight


def _displacement_table(distortion: Distortion, view: View) -> tuple[int, NDArray[np.float32]]:
    """Cells along a side, and ideal minus real position, (cells + 1, cells + 1, 2) [pixels].

    The table is as fine as needed for bilinear interpolation to be within TOLERANCE_PX at the centre of every cell.
    """
    cells = COARSEST
    table = _displacement(distortion, view, 2 * cells)
    while cells < FINEST:
        corners = table[::2, ::2]
        middle = (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4
        if np.abs(middle - table[1::2, 1::2]).max() <= TOLERANCE_PX:
            break
        cells *= 2
        table = _displacement(distortion, view, 2 * cells)
    return cells, table[::2, ::2].astype(np.float32)


def _displacement(distortion: Distortion, view: View, cells: int) -> Float64Array:
    """Ideal minus real position on a grid over the whole film, (cells + 1, cells + 1, 2) [pixels]."""
    (width, height), (axis_x, axis_y), scale = view.size, view.axis, view.tangent_per_pixel
    at = np.linspace(0.0, 1.0, cells + 1)
    x, y = np.meshgrid(width * at - axis_x, height * at - axis_y)
    u, v, _ = distortion.ideal(scale * x, scale * y)
    return np.stack([u / scale - x, v / scale - y], axis=-1)
