"""The scene's own pinhole or thin lens behind a distortion that was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..optics.distortion import Distortion

if TYPE_CHECKING:
    from ..optics.f_number_law import View

TOLERANCE_PX = 0.005  # of the table that rays are looked up in
COARSEST, FINEST = 32, 1024  # its cells along a side


class DistortedProjection:
    """Rays of the ideal place for every real one, looked up in a table over the whole film."""

    def __init__(self, mi: Any, distortion: Distortion, view: View) -> None:
        self._size = view.size
        self._cells, moves = _table(distortion, view)
        self._moves = mi.Texture2f(mi.TensorXf(moves), use_accel=False)

    def sample(self, sensor: Any, samples: tuple[Any, Any, Any, Any], active: Any) -> tuple[Any, Any]:
        """The scene's own ray for where the place would be without distortion."""
        time, wavelength, place, aperture = samples
        scale = self._cells / (self._cells + 1)
        at = [p / n * scale + (0.5 / (self._cells + 1)) for p, n in zip(place, self._size, strict=True)]
        moves = self._moves.eval(type(place)(*at), active)
        ideal = type(place)(place.x + moves[0], place.y + moves[1])
        return sensor.inner.sample_ray(time, wavelength, sensor.to_crop(ideal), aperture, active)


def _table(distortion: Distortion, view: View) -> tuple[int, NDArray[np.float32]]:
    """Cells along a side, and how far the ideal place lies from the real one, (cells + 1, cells + 1, 2) [pixels].

    As fine as it takes for the middle of every cell to be right to TOLERANCE_PX when its corners are averaged.
    """
    cells = COARSEST
    moves = _moves(distortion, view, 2 * cells)
    while cells < FINEST:
        corners = moves[::2, ::2]
        middle = (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4
        if np.abs(middle - moves[1::2, 1::2]).max() <= TOLERANCE_PX:
            break
        cells *= 2
        moves = _moves(distortion, view, 2 * cells)
    return cells, moves[::2, ::2].astype(np.float32)


def _moves(distortion: Distortion, view: View, cells: int) -> NDArray[np.float64]:
    """The same on a grid from the first to the last edge of the film, rows first."""
    (width, height), (axis_x, axis_y) = view.size, view.axis
    at = np.linspace(0.0, 1.0, cells + 1)
    x, y = np.meshgrid(width * at - axis_x, height * at - axis_y)
    u, v, _ = distortion.ideal(view.step * x, view.step * y)
    return np.stack([u / view.step - x, v / view.step - y], axis=-1)
