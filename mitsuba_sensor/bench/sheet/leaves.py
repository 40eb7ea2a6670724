"""Dead leaves on the sheet: modulation transfer of texture, discs of random sizes that hide each other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from ...camera.camera import Camera
from ...core import InputError
from ...core.types import Float64Array
from ...files.raw_files import read_raw
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.measure.image_quality.dead_leaves import SECTIONS, dead_leaves
from ..datasheet import Said
from .bitmap import (
    Layout,
    picture_of_bitmap,
    scenes_of_bitmap,
    shown,
    take_bitmap,
    theory_of_bitmap,
)
from .black import frames_and_black
from .chart import Lights, Measured, Taken, Theory
from .light import ChartScene
from .modulation import draw_modulation, figures, said_of
from .setting import Setting
from .transfer import Transfer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE_PX = 160
"""Of the chart, behind each place of the mosaic."""
SMALLEST_PX, LARGEST_PX = 1.0, 32.0
"""Radii of the discs, in distances of pixels behind one place of the mosaic; their density falls as 1/r³."""
LAYERS = 8.0
"""Area of all discs over that of the chart: one of 3000 points shows none."""
DARKEST, BRIGHTEST = 0.25, 1.0
"""Of the discs; their brightness is even between."""
MEAN = 0.45
"""Light on average over saturation, behind the filter that sees most."""
COUNTS = 4, 0, 4
"""Of frames of the chart, of even light, and of dark ones."""
SEED = 1
"""Of the discs: the chart is the same for everybody."""


class LeavesChart(NamedTuple):
    """Discs of all sizes that lie on each other."""

    name: str = "leaves"
    kind: str = "leaves"
    title: str = "Dead leaves: modulation transfer of texture"

    def suits(self, camera: Camera) -> bool:
        """Every camera."""
        return True

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """The discs, for each lamp."""
        layout = Layout.of(camera, SIDE_PX)
        return scenes_of_bitmap(self.name, bitmap_of_leaves(layout), layout, camera)

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the chart and dark ones."""
        bench = take_bitmap(setting, lights, self.name, MEAN, COUNTS)
        chart = chart_of_leaves(Layout.of(setting.camera, SIDE_PX))
        return Taken(bench, {"chart": chart})

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """What the same instrument finds in the closed form of the picture."""
        layout = Layout.of(setting.camera, SIDE_PX)
        return theory_of_bitmap(setting.camera, layout, _figures_of_theory)

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """The modulation of theory at the frequencies of the sheet."""
        draw_modulation(said, ax)

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The modulation transfer behind each place of the mosaic."""
        chart, method = _facts_of_leaves(taken.facts)
        stack = taken.bench.stacks[0]
        tile = stack.tile or (("",),)
        layout = Layout(
            stack.shape, (len(tile), len(tile[0])), chart.shape[0] // stack.shape[0]
        )
        planes = taken.bench.of_filters().items()
        return [
            _measure_plane(name, bench, shifted(chart, place, layout), method, layout.step[0])
            for (name, bench), place in zip(planes, np.ndindex(layout.step), strict=True)
        ]


@lru_cache(maxsize=2)
def bitmap_of_leaves(layout: Layout) -> Float64Array:
    """Brightness at the points of the chart, discs on discs; beyond its ends it repeats."""
    generator = np.random.default_rng(SEED)
    points = np.array(layout.shape) * layout.dense
    unit = max(layout.step) * layout.dense
    bitmap = np.full(points, (DARKEST + BRIGHTEST) / 2)
    covered = 0.0
    while covered < LAYERS * bitmap.size:
        radius = unit * _radius(generator.uniform())
        middle = generator.uniform(0, points)
        rows, columns = (
            np.arange(math.floor(place - radius), math.ceil(place + radius) + 1)
            for place in middle
        )
        inside = np.hypot(rows[:, None] - middle[0], columns - middle[1]) < radius
        row, column = np.nonzero(inside)
        own = rows[row] % points[0], columns[column] % points[1]
        bitmap[own] = generator.uniform(DARKEST, BRIGHTEST)
        covered += len(row)
    return bitmap


def _radius(uniform: float) -> float:
    """A radius of the law 1/r³ between the smallest and the largest, of a uniform number from 0 to 1."""
    ends = SMALLEST_PX**-2, LARGEST_PX**-2
    return float((ends[0] + uniform * (ends[1] - ends[0])) ** -0.5)


@lru_cache(maxsize=2)
def chart_of_leaves(layout: Layout) -> Float64Array:
    """What the lamp shows at the points of the bitmap."""
    return shown(bitmap_of_leaves(layout), layout.dense)


@lru_cache(maxsize=256)
def _figures_of_theory(
    transfer: Transfer, layout: Layout, place: tuple[int, int]
) -> dict[str, Said]:
    """What the instrument finds in a chart without noise behind one place of the mosaic."""
    picture = picture_of_bitmap(transfer, bitmap_of_leaves(layout), layout.dense)
    chart = shifted(chart_of_leaves(layout), place, layout)
    try:
        found = dead_leaves(layout.plane(picture, place), chart, sample_px=layout.step[0])
    except InputError:  # frames of so few pixels are refused, too
        return {}
    return said_of(found.modulation)


def shifted(chart: Float64Array, place: tuple[int, int], layout: Layout) -> Float64Array:
    """The chart as the pixels behind one place of the mosaic have it in their middle, not that of the whole tile."""
    shift = [
        ((step - 1) / 2 - first) * layout.dense
        for step, first in zip(layout.step, place, strict=True)
    ]
    if not any(shift):
        return chart
    spectrum = scipy.ndimage.fourier_shift(scipy.fft.fft2(chart), shift)
    return np.asarray(scipy.fft.ifft2(spectrum).real)


def _measure_plane(
    name: str, bench: Bench, chart: Float64Array, method: str, sample_px: int
) -> Measured:
    """The instrument on the pixels behind one filter; what it refuses is said.  sample_px : their distance."""
    try:
        stack, black = frames_and_black(bench.scenes, bench)
        found = dead_leaves(stack.frames - black, chart, method=method, sample_px=sample_px)
    except InputError as error:
        return Measured(name, (), refused=(str(error),))
    return Measured(name, figures(found.modulation), {"Modulation transfer": found.plot})


def _facts_of_leaves(facts: Facts) -> tuple[Float64Array, str]:
    """The chart, and the method. Raises InputError where ``chart.toml`` does not name them."""
    chart, method = facts.get("chart"), facts.get("method", "cross")
    if isinstance(chart, Path):
        chart = np.asarray(read_raw(chart).frames[0], np.float64)
    if isinstance(chart, np.ndarray) and isinstance(method, str) and method in SECTIONS:
        return chart, method
    raise InputError(
        'chart.toml of dead leaves has chart = "../leaves.npy", a file of the brightness of the chart on the pixels of '
        f"the frames or on points k times as dense, and method, one of {', '.join(SECTIONS)}, "
        '"cross" where it is left out.'
    )
