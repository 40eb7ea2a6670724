"""Charts of modulation transfer: slanted edges, a sinusoidal Siemens star, dead leaves."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from ...camera.camera import Camera
from ...core import InputError
from ...core.types import Float64Array
from ...files.raw_files import read_raw
from ...lab.frames.bench import Bench
from ...lab.frames.manifest import is_number
from ...lab.measure.image_quality.dead_leaves import SECTIONS, dead_leaves
from ...lab.measure.image_quality.modulation import Modulation
from ...lab.measure.image_quality.siemens_star import siemens_star
from ...lab.measure.image_quality.slanted_edge import slanted_edge
from ...lab.quantity import Quantity
from .chart import (
    Chart,
    Draw,
    Lights,
    Measured,
    Setting,
    Taken,
    bench_of,
    chart_shape,
    each_filter,
    frames_and_black,
    one_ideal,
    step_of,
    without_black,
)
from .light import ChartScene, bitmap_lamp, emitter_rectangle, telecentric_scene
from .optics import (
    bands_of_lamps,
    even_photons,
    photons_of_shapes,
    picture_of,
    picture_of_bitmap,
    picture_of_edge,
    rendered_nm,
    shown,
)

FREQUENCIES = 0.125, 0.25, 0.5
"""At which the modulation is on the sheet [cycles per pixel]."""
EDGE_DEG, EDGE_PX = 5.0, (128, 64)
"""Angle of an edge from the columns or rows, and its size along and across, behind each place of the mosaic."""
EDGE_DARK, EDGE_BRIGHT, EDGE_SPP = 0.1, 0.5, 512
"""Light of the dark side over the bright one, and of the bright one over saturation; samples of the render."""
BITMAP_SPP, POINTS, POINTS_MIN = 64, 8, 4
"""Samples, and points of a bitmap along the distance of two pixels of a plane, and along a pixel at least."""
STAR_PX, STAR_CYCLES, STAR_CONTRAST, STAR_MEAN = 208, 80, 0.8, 0.4
"""Side behind each place of the mosaic, cycles around, (bright − dark)/(bright + dark), mean light over saturation."""
STAR_CENTRE_PX = 0.37, 0.21
"""Down and across from the middle: around the corner of a pixel all quarters would show pixels at the same places."""
LEAVES_PX, LEAVES_MEAN, LEAVES_RADII_PX, LEAVES_LAYERS = 160, 0.45, (1.0, 32.0), 8.0
"""Side, mean light over saturation, radii whose density falls as 1/r³, and area of all discs over the chart's."""
LEAVES_LIGHT, LEAVES_SEED = (0.25, 1.0), 1
"""Darkest and brightest disc, uniform between; the chart is the same for all."""


def of_modulation(found: Modulation) -> tuple[list[Quantity], dict[str, Draw]]:
    """MTF50 and the modulation at those frequencies of the sheet to which the curve goes, and the curve."""
    at = [found.at(frequency) for frequency in FREQUENCIES]
    figures = [found.mtf50, *(one for one in at if math.isfinite(one.value))]
    return figures, {"MTF versus spatial frequency": found.plot}


def flat_of(bench: Bench) -> Float64Array | None:
    """The flat field of a chart, if it was taken."""
    return without_black(bench.flats, bench) if bench.flats else None


# Slanted edges


def edge_shape(camera: Camera, along_rows: bool) -> tuple[int, int]:
    """Rows and columns of the picture of an edge."""
    return chart_shape(camera, *(EDGE_PX[::-1] if along_rows else EDGE_PX))


def edge_scenes(name: str, normal_deg: float, camera: Camera) -> list[ChartScene]:
    """One for the lamp of each colour filter; without diffraction the light of all lamps has one shape."""
    shape, far = edge_shape(camera, normal_deg > 45), 1e5
    sides = [
        emitter_rectangle((sign * far, 0), (far, far), normal_deg, light)
        for sign, light in ((1, 1.0), (-1, EDGE_DARK))
    ]
    text = telecentric_scene(shape, sides)
    lamps = rendered_nm(camera, not camera.lens.diffraction)
    return [ChartScene(f"{name}-{nm:g}", text, EDGE_SPP, nm) for nm in lamps]


def edge_frames(name: str, normal_deg: float, setting: Setting, lights: Lights) -> Taken:
    """Pictures of the edge, of the bright side alone, and dark frames."""
    camera, bands = setting.camera, bands_of_lamps(setting.camera)
    photons = photons_of_shapes(
        camera, [light.data / _bright_side(light.data) for light in lights], EDGE_BRIGHT
    )
    bench = bench_of(setting, photons, bands, name, (4, 16), (_bright_side(photons), 16))
    shape = edge_shape(camera, normal_deg > 45)
    ideal = picture_of(
        camera,
        lambda one: EDGE_DARK + (1 - EDGE_DARK) * picture_of_edge(one, shape, normal_deg),
    )
    return Taken(bench, ideal=one_ideal(ideal))


def _bright_side(light: Float64Array) -> Float64Array:
    """Light of the bright side, (B,), without the few pixels that render noise makes brighter."""
    return np.asarray(np.quantile(light, 0.75, axis=(0, 1)))


def edge_instrument(taken: Taken) -> list[Measured]:
    """The modulation transfer of the edge."""
    sample_px = step_of(taken.bench)[1]

    def measure(bench: Bench, _: object) -> tuple[list[Quantity], dict[str, Draw]]:
        picture = without_black(bench.scenes, bench)
        return of_modulation(
            slanted_edge(picture, flat=flat_of(bench), sample_px=sample_px).modulation
        )

    return each_filter(taken, measure)


# Bitmaps: a star and dead leaves. A bitmap repeats beyond its ends, so pixels and lens multiply its spectrum.


class Layout(NamedTuple):
    """How large a bitmap is: rows and columns of pixels, those of the mosaic, points along a pixel."""

    shape: tuple[int, int]
    step: tuple[int, int]
    dense: int

    @classmethod
    def of(cls, camera: Camera, side_px: int) -> Layout:
        """A square with so many pixels along each side behind each place of the mosaic, at most twice as wide."""
        step = len(camera.tile), len(camera.tile[0])
        side_px = min(side_px, 2 * side_px // max(step))
        dense = max(POINTS // max(step), POINTS_MIN)
        return cls(chart_shape(camera, side_px, side_px), step, dense)


def bitmap_scenes(
    name: str, side_px: int, bitmap: Callable[[Layout], Float64Array], camera: Camera
) -> list[ChartScene]:
    """One for the lamp of each colour filter."""
    layout = Layout.of(camera, side_px)
    text = telecentric_scene(layout.shape, [bitmap_lamp(layout.shape)])
    return [
        ChartScene(f"{name}-{nm:g}", text, BITMAP_SPP, nm, bitmap=bitmap(layout))
        for nm in rendered_nm(camera, not camera.lens.diffraction)
    ]


def bitmap_frames(
    name: str,
    side_px: int,
    bitmap: Callable[[Layout], Float64Array],
    share: float,
    setting: Setting,
    lights: Lights,
) -> Taken:
    """Frames of a chart, of even light for a star, and dark ones.  share : of saturation, at its mean."""
    camera, bands = setting.camera, bands_of_lamps(setting.camera)
    layout = Layout.of(camera, side_px)
    photons = photons_of_shapes(camera, [one.data / one.data.mean() for one in lights], share)
    flat, facts = None, dict[str, object]({"chart": shown(bitmap(layout), layout.dense)})
    if name == "star":
        flat = even_photons(camera, share), 4
        facts = {"cycles": cycles_of(layout), "contrast": STAR_CONTRAST}
    bench = bench_of(setting, photons, bands, name, (4, 4), flat)
    ideal = picture_of(camera, lambda one: picture_of_bitmap(one, bitmap(layout), layout.dense))
    return Taken(bench, facts, one_ideal(ideal))


def cycles_of(layout: Layout) -> int:
    """Cycles of the star: equally many per pixel at its rim for every mosaic."""
    return STAR_CYCLES * min(layout.step[0], 2)


@lru_cache(maxsize=2)
def bitmap_of_star(layout: Layout) -> Float64Array:
    """Points of the star, 1 on average. What linear interpolation between them takes away is added."""
    dense = layout.dense
    y, x = (
        (np.arange(count * dense) + 0.5) / dense - count / 2 - centre
        for count, centre in zip(layout.shape, STAR_CENTRE_PX, strict=True)
    )
    radius, angle = np.hypot(x, y[:, None]), np.arctan2(y[:, None], x)
    frequency = cycles_of(layout) / (2 * math.pi * radius)
    inside = (frequency < 1.0) & (
        radius < min(layout.shape) / 2
    )  # even where nothing is measured
    kept = np.sinc(frequency * np.sin(angle) / dense) * np.sinc(
        frequency * np.cos(angle) / dense
    )
    waves = np.cos(cycles_of(layout) * angle) / np.where(inside, kept, 1.0) ** 2
    return np.asarray(1 + STAR_CONTRAST * np.where(inside, waves, 0.0))


def star_instrument(taken: Taken) -> list[Measured]:
    """The modulation transfer in all directions together."""
    cycles, contrast = taken.facts.get("cycles"), taken.facts.get("contrast", 1.0)
    if type(cycles) is not int or not is_number(contrast):
        raise InputError(
            "chart.toml of a star has cycles = 144, how often it becomes dark around its centre, and contrast = 0.9, "
            "its (bright − dark)/(bright + dark); 1 if omitted."
        )
    sample_px = step_of(taken.bench)[1]

    def measure(bench: Bench, _: object) -> tuple[list[Quantity], dict[str, Draw]]:
        picture, flat = without_black(bench.scenes, bench), flat_of(bench)
        found = siemens_star(
            picture, cycles, contrast=float(contrast), flat=flat, sample_px=sample_px
        )
        return of_modulation(found.modulation)

    return each_filter(taken, measure)


@lru_cache(maxsize=2)
def bitmap_of_leaves(layout: Layout) -> Float64Array:
    """Brightness at the points of the chart, discs on discs; beyond its ends it repeats."""
    generator = np.random.default_rng(LEAVES_SEED)
    points = np.array(layout.shape) * layout.dense
    unit = max(layout.step) * layout.dense
    ends = [radius**-2.0 for radius in LEAVES_RADII_PX]
    bitmap, covered = np.full(points, sum(LEAVES_LIGHT) / 2), 0.0
    while covered < LEAVES_LAYERS * bitmap.size:
        radius = unit * float((ends[0] + generator.uniform() * (ends[1] - ends[0])) ** -0.5)
        middle = generator.uniform(0, points)
        rows, columns = (
            np.arange(math.floor(place - radius), math.ceil(place + radius) + 1)
            for place in middle
        )
        inside = np.hypot(rows[:, None] - middle[0], columns - middle[1]) < radius
        row, column = np.nonzero(inside)
        own = rows[row] % points[0], columns[column] % points[1]
        bitmap[own] = generator.uniform(*LEAVES_LIGHT)
        covered += len(row)
    return bitmap


def leaves_instrument(taken: Taken) -> list[Measured]:
    """The modulation transfer of texture."""
    chart, method = taken.facts.get("chart"), taken.facts.get("method", "cross")
    if isinstance(chart, Path):
        chart = np.asarray(read_raw(chart).frames[0], np.float64)
    if (
        not isinstance(chart, np.ndarray)
        or not isinstance(method, str)
        or method not in SECTIONS
    ):
        raise InputError(
            'chart.toml of dead leaves has chart = "../leaves.npy", a file of the brightness of the chart on the '
            f"pixels of the frames or on points k times as dense, and method, one of {', '.join(SECTIONS)}; "
            '"cross" if omitted.'
        )
    step, rows = step_of(taken.bench), taken.bench.stacks[0].shape[0]
    dense = chart.shape[0] // rows

    def measure(bench: Bench, place: tuple[int, int]) -> tuple[list[Quantity], dict[str, Draw]]:
        stack, black = frames_and_black(bench.scenes, bench)
        own = shifted(chart, place, step, dense)
        found = dead_leaves(stack.frames - black, own, method=method, sample_px=step[1])
        return of_modulation(found.modulation)

    return each_filter(taken, measure)


def shifted(
    chart: Float64Array, place: tuple[int, int], step: tuple[int, int], dense: int
) -> Float64Array:
    """The chart as the pixels behind one place of the mosaic have it in their middle, not that of the whole tile."""
    shift = [((one - 1) / 2 - first) * dense for one, first in zip(step, place, strict=True)]
    if not any(shift):
        return chart
    spectrum = scipy.ndimage.fourier_shift(scipy.fft.fft2(chart), shift)
    return np.asarray(scipy.fft.ifft2(spectrum).real)


def _edge(name: str, title: str, normal_deg: float) -> Chart:
    scenes, frames = (
        partial(edge_scenes, name, normal_deg),
        partial(edge_frames, name, normal_deg),
    )
    return Chart(name, "edge", title, scenes, frames, edge_instrument)


def _bitmap(
    name: str,
    title: str,
    size: tuple[int, float],
    bitmap: Callable[[Layout], Float64Array],
    instrument: Callable[[Taken], list[Measured]],
) -> Chart:
    scenes = partial(bitmap_scenes, name, size[0], bitmap)
    frames = partial(bitmap_frames, name, size[0], bitmap, size[1])
    return Chart(name, name, title, scenes, frames, instrument)


STAR, LEAVES = (STAR_PX, STAR_MEAN), (LEAVES_PX, LEAVES_MEAN)
MODULATION_CHARTS = (
    _edge("edge_columns", "Slanted edge along the columns: MTF across", EDGE_DEG),
    _edge("edge_rows", "Slanted edge along the rows: MTF down", 90 + EDGE_DEG),
    _bitmap(
        "star", "Siemens star: MTF in all directions", STAR, bitmap_of_star, star_instrument
    ),
    _bitmap(
        "leaves", "Dead leaves: MTF of texture", LEAVES, bitmap_of_leaves, leaves_instrument
    ),
)
