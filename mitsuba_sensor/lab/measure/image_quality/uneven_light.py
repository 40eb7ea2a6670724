"""Uneven light of a picture with an edge: a polynomial of the place that both sides of the edge share.

Far from the edge the picture is level·(1 + polynomial) on each side. Light that a lens spreads goes as 1/d with the
distance from the edge, up on one side and down on the other; it is fitted too and stays in the picture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....core.types import Float64Array

FAR_PX = 8.0
"""Distance from the edge from which on a picture shows the light of its side."""
STEPS = 4


class UnevenLight(NamedTuple):
    """gain : of every pixel.  shapes : (N, k), the powers of the place.  influence : (N, k), what the noise of every
    pixel changed in each coefficient."""

    gain: Float64Array
    shapes: Float64Array
    influence: Float64Array


def fit_uneven_light(
    values: Float64Array,
    distance: Float64Array,
    place: tuple[Float64Array, Float64Array],
    order: int,
) -> UnevenLight:
    """Fit a polynomial of this order, 0 for none.  place : x and y of every pixel, from −½ to ½."""
    shapes = _powers(*place, order)
    influence = np.zeros_like(shapes)
    if not order:
        return UnevenLight(np.ones_like(values), shapes, influence)
    far = np.abs(distance) > FAR_PX
    right = distance[far] > 0
    sides = np.column_stack([right, ~right]).astype(float)
    levels = np.linalg.lstsq(sides, values[far], rcond=None)[0]
    coefficients = np.zeros(shapes.shape[1])
    for _ in range(STEPS):  # of Gauss and Newton: the model is a product
        level, gain = sides @ levels, 1 + shapes[far] @ coefficients
        design = np.column_stack(
            [sides * gain[:, None], 1 / distance[far], level[:, None] * shapes[far]]
        )
        known = level * (gain - 1)
        solution = np.linalg.lstsq(design, values[far] + known, rcond=None)[0]
        residual = values[far] + known - design @ solution
        levels, coefficients = solution[:2], solution[3:]
    inverse = np.linalg.pinv(design)[3:]
    influence[far] = (inverse * residual).T
    return UnevenLight(1 + shapes @ coefficients, shapes, influence)


def _powers(x: Float64Array, y: Float64Array, order: int) -> Float64Array:
    """(N, k), the products of powers up to an order, without the constant."""
    columns = [
        x**power * y ** (total - power)
        for total in range(1, order + 1)
        for power in range(total, -1, -1)
    ]
    return np.array(columns).reshape(-1, x.size).T
