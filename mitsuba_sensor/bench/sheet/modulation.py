"""What charts of modulation transfer have in common: the pictures that are measured, the figures, and their theory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.image_quality.modulation import Modulation
from ...lab.quantity import Quantity
from ..datasheet import Said
from .black import without_black

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FREQUENCIES = 0.125, 0.25, 0.5
"""At which the modulation is on the sheet [cycles per pixel]."""


def flat_of(bench: Bench) -> Float64Array | None:
    """The flat field of a chart, if it was taken, with every pixel above 0."""
    if not bench.flats:
        return None
    return without_black(bench.flats, bench)


def figures(modulation: Modulation) -> list[Quantity]:
    """MTF50, and the modulation at those frequencies of the sheet to which the curve goes."""
    at_frequencies = [modulation.at(frequency) for frequency in FREQUENCIES]
    return [modulation.mtf50, *(one for one in at_frequencies if math.isfinite(one.value))]


def said_of(modulation: Modulation) -> dict[str, Said]:
    """The figures of theory."""
    known = [one for one in figures(modulation) if math.isfinite(one.value)]
    return {one.symbol: Said(*3 * (one.value,)) for one in known}


def draw_modulation(said: Mapping[str, Said], ax: Axes) -> None:
    """The modulation of theory at the frequencies of the sheet."""
    points = [(f, said[f"MTF({f:g})"].value) for f in FREQUENCIES if f"MTF({f:g})" in said]
    if points:
        ax.plot(*zip(*points, strict=True), "kx", markersize=6, label="theory")
