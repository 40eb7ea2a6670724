"""A sinusoidal Siemens star on the sheet: modulation transfer in all directions together, beside pixel × lens."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import InputError
from ...core.types import Float64Array
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.frames.manifest import is_number
from ...lab.measure.image_quality.siemens_star import siemens_star
from ..datasheet import Said
from .bitmap import (
    WIDEST,
    Layout,
    picture_of_bitmap,
    scenes_of_bitmap,
    take_bitmap,
    theory_of_bitmap,
)
from .black import without_black
from .chart import Lights, Measured, Taken, Theory
from .light import ChartScene
from .modulation import draw_modulation, figures, flat_of, said_of
from .setting import Setting
from .transfer import Transfer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE_PX, CYCLES = 208, 80
"""Of the star, behind each place of the mosaic: 0.12 cycles per distance of these at the rim, 0.5 in the middle."""
CENTRE_PX = 0.37, 0.21
"""Of the star, down and across from the middle of the picture: around the corner of a pixel all quarters would show
pixels at the same places."""
CONTRAST = 0.8
MEAN = 0.4
"""Light on average over saturation, behind the filter that sees most."""
HIGHEST = 1.0
"""Cycles per pixel; nearer to the middle, where the instrument does not look, the chart is even."""
COUNTS = 4, 4, 4
"""Of frames of the star, of even light, and of dark ones."""


class StarChart(NamedTuple):
    """A star whose brightness is a sine of the angle."""

    name: str = "star"
    kind: str = "star"
    title: str = "Siemens star: modulation transfer in all directions"

    def suits(self, camera: Camera) -> bool:
        """Every camera."""
        return True

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """The star, for each lamp."""
        layout = Layout.of(camera, SIDE_PX)
        return scenes_of_bitmap(self.name, bitmap_of_star(layout), layout, camera)

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the star, of even light and dark ones."""
        bench = take_bitmap(setting, lights, self.name, MEAN, COUNTS)
        cycles = cycles_of(Layout.of(setting.camera, SIDE_PX))
        return Taken(bench, {"cycles": cycles, "contrast": CONTRAST})

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """What the same instrument finds in the closed form of the picture."""
        layout = Layout.of(setting.camera, SIDE_PX)
        return theory_of_bitmap(setting.camera, layout, _figures_of_theory)

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """The modulation of theory at the frequencies of the sheet."""
        draw_modulation(said, ax)

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The modulation transfer behind each place of the mosaic."""
        cycles, contrast = _facts_of_star(taken.facts)
        sample_px = len(taken.bench.stacks[0].tile) or 1
        return [
            _measure_plane(name, bench, (cycles, contrast), sample_px)
            for name, bench in taken.bench.of_filters().items()
        ]


def cycles_of(layout: Layout) -> int:
    """Cycles of the star: equally many per pixel at its rim for every mosaic."""
    return CYCLES * min(layout.step[0], WIDEST)


@lru_cache(maxsize=2)
def bitmap_of_star(layout: Layout) -> Float64Array:
    """Points of the star, 1 on average. What linear interpolation between them takes away is added."""
    dense = layout.dense
    y, x = (
        (np.arange(count * dense) + 0.5) / dense - count / 2 - centre
        for count, centre in zip(layout.shape, CENTRE_PX, strict=True)
    )
    radius, angle = np.hypot(x, y[:, None]), np.arctan2(y[:, None], x)
    frequency = cycles_of(layout) / (2 * math.pi * radius)
    inside = (frequency < HIGHEST) & (radius < min(layout.shape) / 2)
    kept = np.sinc(frequency * np.sin(angle) / dense) * np.sinc(
        frequency * np.cos(angle) / dense
    )
    waves = np.cos(cycles_of(layout) * angle) / np.where(inside, kept, 1.0) ** 2
    return np.asarray(1 + CONTRAST * np.where(inside, waves, 0.0))


@lru_cache(maxsize=256)
def _figures_of_theory(
    transfer: Transfer, layout: Layout, place: tuple[int, int]
) -> dict[str, Said]:
    """What the instrument finds in a star without noise behind one place of the mosaic."""
    picture = picture_of_bitmap(transfer, bitmap_of_star(layout), layout.dense)
    plane, cycles = layout.plane(picture, place), cycles_of(layout)
    try:
        star = siemens_star(plane, cycles, contrast=CONTRAST, sample_px=layout.step[0])
    except InputError:  # frames of so few pixels are refused, too
        return {}
    return said_of(star.modulation)


def _measure_plane(
    name: str, bench: Bench, star: tuple[int, float], sample_px: int
) -> Measured:
    """The instrument on the pixels behind one filter; what it refuses is said.

    star : its cycles and its contrast.  sample_px : distance of the pixels.
    """
    try:
        found = siemens_star(
            without_black(bench.scenes, bench),
            star[0],
            contrast=star[1],
            flat=flat_of(bench),
            sample_px=sample_px,
        )
    except InputError as error:
        return Measured(name, (), refused=(str(error),))
    return Measured(name, figures(found.modulation), {"Modulation transfer": found.plot})


def _facts_of_star(facts: Facts) -> tuple[int, float]:
    """Cycles and contrast that ``chart.toml`` names. Raises InputError where it does not."""
    cycles, contrast = facts.get("cycles"), facts.get("contrast", 1.0)
    if type(cycles) is int and is_number(contrast):
        return cycles, float(contrast)
    raise InputError(
        "chart.toml of a star has cycles = 144, how often it becomes dark around its centre, and contrast = 0.9, its "
        "(bright − dark)/(bright + dark), 1 where it is left out."
    )
