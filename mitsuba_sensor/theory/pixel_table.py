"""Codes of many pixels from a table over mean count and offset, where the pixels differ in nothing else.

A sum over counts costs as much for a node of the table as for a pixel. Shot noise smooths the codes over mean counts,
and the noise behind the count smooths them over offsets, so a spline of degree 5 through few nodes is enough: near the
full well of Table 1 means are within 0.001 DN of the sums, and variances within 1e-4 of themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from ..core.types import Float64Array
from ..stages.stage import Line, PixelNoise, converter_of
from .pixel_counts import CountLaws

if TYPE_CHECKING:
    from .pixel_codes import PixelCodes
    from .pixel_swing import Codes, Part

DEGREE = 5
"""Of the spline."""

STEP = 0.4
"""Between the nodes: of 2√mean, in which shot noise has σ = 1, and of an offset over the σ of the noise behind it."""

BEYOND = 2
"""Nodes beyond each end: between the last ones a spline is less exact."""

ALIKE = 1e-9
"""Gains and variances that differ by a smaller share are the same."""

PAYS = 1.5
"""Pixels for each node from which on the table is cheaper than the sums."""


class TableNodes(NamedTuple):
    """Nodes of a table: 2√mean count, and offset of the code [DN]."""

    root_means: Float64Array
    offsets_dn: Float64Array


def tabulated(pixels: PixelCodes, find: Callable[[PixelCodes], Codes]) -> Codes | None:
    """Mean [DN] and variance [DN²] of the codes of these pixels, (P,), by a table of what ``find`` says of its nodes.

    None where the pixels differ in more than mean count and offset, or are too few for a table.
    """
    if not _differ_in_mean_and_offset_only(pixels):
        return None
    root_means = 2 * np.sqrt(pixels.law.mean)
    offsets_dn, noise_dn2 = (x[0] for x in pixels.of_counts(np.zeros((1, root_means.size))))
    step_dn = max(STEP * float(np.sqrt(noise_dn2.min())), 1e-9)
    same = float(np.ptp(offsets_dn)) <= ALIKE * step_dn
    count = np.ptp(root_means) / STEP + 2 * BEYOND + 2
    if not same:
        count *= np.ptp(offsets_dn) / step_dn + 2 * BEYOND + 2
    if not PAYS * count <= root_means.size:
        return None
    if same:
        offset_nodes = offsets_dn[:1]
    else:
        offset_nodes = _spaced_nodes(offsets_dn, step_dn)
    nodes = TableNodes(_spaced_nodes(root_means, STEP), offset_nodes)
    at_nodes = find(_pixels_at(nodes, pixels, float(offsets_dn[0])))
    if same:
        lines = (
            scipy.interpolate.InterpolatedUnivariateSpline(nodes.root_means, x, k=DEGREE)
            for x in at_nodes
        )
        mean, variance = (np.asarray(line(root_means)) for line in lines)
    else:
        shape = nodes.root_means.size, nodes.offsets_dn.size
        planes = (
            scipy.interpolate.RectBivariateSpline(
                *nodes, x.reshape(shape), kx=DEGREE, ky=DEGREE
            )
            for x in at_nodes
        )
        mean, variance = (np.asarray(plane.ev(root_means, offsets_dn)) for plane in planes)
    return mean, np.maximum(variance, 0.0)


def _differ_in_mean_and_offset_only(pixels: PixelCodes) -> bool:
    """Whether gains and noise behind the count are the same, and offsets too where a curve follows them."""
    mean, variance = pixels.law
    straight = not any(stage.curved for stage in pixels.stages)
    same = [variance / np.maximum(mean, 1e-300)]
    for number, part in enumerate(pixels.parts):
        if isinstance(part, Line):
            same += (
                [part.gain, part.variance]
                if straight
                else [part.gain, part.variance, part.offset]
            )
        elif isinstance(part, PixelNoise):
            offset, noise = pixels.noise[number]
            same += [noise] if straight else [noise, offset]
    return all(float(np.ptp(x)) <= ALIKE * float(np.abs(x).max()) for x in same)


def _spaced_nodes(values: Float64Array, step: float) -> Float64Array:
    """Evenly spaced nodes from below the smallest of these values to above the largest."""
    low, high = float(values.min()) - BEYOND * step, float(values.max()) + BEYOND * step
    return np.linspace(low, high, max(int(np.ceil((high - low) / step)) + 1, DEGREE + 1))


def _pixels_at(nodes: TableNodes, pixels: PixelCodes, first_offset_dn: float) -> PixelCodes:
    """A pixel at each node, but for mean count and offset like the first of these, whose offset is given."""
    root_mean, offset_dn = (x.ravel() for x in np.meshgrid(*nodes, indexing="ij"))
    count, first, law = root_mean.size, pixels.numbers[0], pixels.law
    mean = 0.25 * root_mean**2  # nodes below zero mirror those above
    parts: list[Part] = []
    for part in pixels.parts:
        if isinstance(part, Line):
            part = Line(*(np.full(count, x[first]) for x in part))
        parts.append(part)
    shift_v = (offset_dn - first_offset_dn) / converter_of(pixels.stages).gain_dn_per_v
    return replace(
        pixels,
        parts=[*parts, Line(np.ones(count), shift_v, np.zeros(count))],
        numbers=np.arange(count),
        law=CountLaws(mean, mean * float(law.variance[0] / law.mean[0])),
        chance=np.ones(count),
        noise={
            number: (np.full(count, offset[first]), np.full(count, noise[first]))
            for number, (offset, noise) in pixels.noise.items()
        },
    )
