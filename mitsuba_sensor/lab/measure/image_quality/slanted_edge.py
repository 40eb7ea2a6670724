"""MTF of a slanted edge (e-SFR, ISO 12233:2023), with its 95 % band."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, require
from ....core.types import Float64Array
from .edge_spread import (
    EdgeSpread,
    Samples,
    UnevenLight,
    find_line,
    fit_edge_spread,
    fit_uneven_light,
    middles,
    upright,
)
from .modulation import Modulation, OfModulation, flat_fielded, modulus, picture_of

SECTION = "ISO 12233:2023 e-SFR"
CLIPPED_SHARE = 0.05
"""Fraction of the pixels with the largest or the smallest value from which on they are clipped."""
FREQUENCIES = 101
"""Number of points of the curve, from 0 to one cycle per sample."""


@dataclass(frozen=True, eq=False)
class SlantedEdge(OfModulation):
    """MTF across an edge.

    modulation : versus frequency across the edge, up to one cycle per sample.
    angle_deg : angle of the edge from the columns or the rows, whichever is nearer; −45 to 45°.
    distance_px, spread : edge spread function, from the dark to the bright side.
    """

    angle_deg: float
    distance_px: Float64Array
    spread: Float64Array


def slanted_edge(
    picture: ArrayLike,
    *,
    flat: ArrayLike | None = None,
    sample_px: float = 1.0,
    edge_order: int = 1,
) -> SlantedEdge:
    """Measure the MTF in an image of one edge in any direction.

    ::

        rows, columns = np.mgrid[:64, :64]
        edge = 100 + 800 * np.clip(columns - 32 - 0.1 * (rows - 32), 0, 1)
        for quantity in ms.lab.slanted_edge(edge).quantities:
            print(quantity)

    picture : linear values of one frame or the mean of several, without the black level, shape (H, W). Uneven light, a
        polynomial of second order, is removed.
    flat : image of a uniformly lit surface, shape (H, W), by which the image is divided.
    sample_px : distance of neighbouring values [px], 2 for one plane of a Bayer mosaic, picture[0::2, 1::2].
    edge_order : order of the polynomial that the edge follows, up to 5 for a lens that distorts.
    Raises InputError for images without an edge, and for edges along rows, columns or diagonals.
    """
    raw = picture_of(picture)
    pixels = flat_fielded(raw, flat)
    sample_px = require(
        "sample_px", sample_px, 0.01, 100.0, "pixels, 2 for a plane of a mosaic"
    )
    order = int(require("edge_order", edge_order, 1, 5, "a whole number, 1 for a line"))
    turned = upright(pixels).picture
    rows, columns = turned.shape
    line = find_line(turned, order)
    x, y = middles((rows, columns))
    values, distance = turned.ravel(), line.distance(x, y)
    light = fit_uneven_light(values, distance, x / columns - 0.5, y / rows)
    spread = fit_edge_spread(Samples(values / light.gain, x, y), line)
    modulation = _modulation(spread, light, values / light.gain, sample_px)
    modulation = replace(modulation, note=_note_clipped(raw))
    fine = np.linspace(-spread.half_width_px, spread.half_width_px, 400)
    return SlantedEdge(modulation, spread.line.angle_deg, fine * sample_px, spread.at(fine))


def _note_clipped(picture: Float64Array) -> str:
    """Return a note on a clipped side of the edge, or an empty text; edges without noise have equal values on both."""
    ends, least = (picture.min(), picture.max()), 1e-9 * np.ptp(picture)
    low, high = (float((np.abs(picture - end) <= least).mean()) for end in ends)
    if max(low, high) < CLIPPED_SHARE or min(low, high) >= CLIPPED_SHARE:
        return ""
    end = "largest" if high > low else "smallest"
    return (
        f"{100 * max(low, high):.2g} % of the values are the {end} value: the edge is clipped, which sharpens it; "
        "expose less, or raise the black level"
    )


def _modulation(
    spread: EdgeSpread, light: UnevenLight, values: Float64Array, sample_px: float
) -> Modulation:
    """Return the transform over its value at 0, with errors from the influence of each pixel.

    values : all pixels, without uneven light.
    """
    frequency = np.linspace(0.0, 1.0, FREQUENCIES)
    transform, weights = spread.transform(frequency)
    influence = np.zeros((len(values), FREQUENCIES), complex)
    influence[spread.inside] = weights * spread.residual[:, None]
    relative = (values / light.gain)[spread.inside, None] * light.shapes[spread.inside]
    influence -= light.influence @ (relative.T @ weights)
    height = transform[0].real
    if not height > 0:
        raise InputError(
            "the edge of picture has no height; pass an image with a dark and a bright side."
        )
    transform = transform / height
    influence = influence / height - np.outer(influence[:, 0].real / height, transform)
    phase = transform / np.maximum(np.abs(transform), 1e-12)
    along = influence * np.conj(phase)
    count = len(spread.residual)
    scale = count / max(count - spread.inverse.shape[1], 1)
    radial = scale * np.square(along.real).sum(axis=0)
    tangential = scale * np.square(along.imag).sum(axis=0)
    value, low, high = modulus(transform, radial, tangential)
    return Modulation(frequency / sample_px, value, low, high, SECTION)
