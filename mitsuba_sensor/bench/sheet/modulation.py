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
    step_of,
    without_black,
)
from .light import ChartScene, bitmap_lamp, emitter_rectangle, telecentric_scene
from .optics import (
    bands_of_lamps,
    even_photons,
    is_alike,
    photons_of_shapes,
    picture_of,
    picture_of_bitmap,
    picture_of_edge,
    rendered_nm,
    shown,
)

FREQUENCIES = 0.125, 0.25, 0.5
"""Frequencies of the MTF on the sheet [cycles per pixel]."""
EDGE_DEG, EDGE_PX = 5.0, (96, 64)
"""Angle of an edge from the columns or rows, and its size along and across, in each plane of the mosaic."""
EDGE_DARK, EDGE_BRIGHT, EDGE_SPP = 0.1, 0.5, 128
"""Light of the dark side over the bright side, bright side over saturation, and samples of the render."""
BITMAP_SPP, POINTS, POINTS_MIN = 32, 8, 4
"""Samples, points of a bitmap along two pixels of a plane, and fewest points along a pixel."""
STAR_PX, STAR_CYCLES, STAR_CONTRAST, STAR_MEAN = 208, 80, 0.8, 0.4
"""Side in each plane of the mosaic, cycles around, (bright − dark)/(bright + dark), mean light over saturation."""
STAR_CENTRE_PX = 0.37, 0.21
"""Centre, down and across from the middle: around a pixel's corner all quarters would sample equal places."""
LEAVES_PX, LEAVES_MEAN, LEAVES_RADII_PX, LEAVES_LAYERS = 160, 0.45, (1.0, 32.0), 8.0
"""Side, mean light over saturation, radii with a density of 1/r³, and area of all discs over the chart's area."""
LEAVES_LIGHT, LEAVES_SEED = (0.25, 1.0), 1
"""Darkest and brightest disc, uniform between; every sheet has the same chart."""


def of_modulation(curve: Modulation) -> tuple[list[Quantity], dict[str, Draw]]:
    """Return MTF50, the MTF at the frequencies of the sheet that the curve reaches, and a drawing of the curve."""
    at = [curve.at(frequency) for frequency in FREQUENCIES]
    figures = [curve.mtf50, *(figure for figure in at if math.isfinite(figure.value))]
    return figures, {"MTF versus spatial frequency": curve.plot}


def flat_of(bench: Bench) -> Float64Array | None:
    """Return the flat field of a chart, or None."""
    return without_black(bench.flats, bench) if bench.flats else None


# Slanted edges


def edge_shape(camera: Camera, along_rows: bool) -> tuple[int, int]:
    """Return the rows and columns of an edge's image."""
    return chart_shape(camera, *(EDGE_PX[::-1] if along_rows else EDGE_PX))


def edge_scenes(name: str, normal_deg: float, camera: Camera) -> list[ChartScene]:
    """Return a scene for each lamp; without diffraction the light of all lamps has the same shape."""
    shape, far = edge_shape(camera, normal_deg > 45), 1e5
    sides = [
        emitter_rectangle((sign * far, 0), (far, far), normal_deg, light)
        for sign, light in ((1, 1.0), (-1, EDGE_DARK))
    ]
    text = telecentric_scene(shape, sides)
    lamps = rendered_nm(camera, not camera.lens.diffraction)
    return [ChartScene(f"{name}-{nm:g}", text, EDGE_SPP, nm) for nm in lamps]


def edge_frames(name: str, normal_deg: float, setting: Setting, lights: Lights) -> Taken:
    """Take images of the edge, flat fields as bright as its bright side, and dark frames."""
    camera, bands = setting.camera, bands_of_lamps(setting.camera)
    shapes = [light.data / _bright_side(light.data) for light in lights]
    photons = photons_of_shapes(camera, shapes, EDGE_BRIGHT)
    bench = bench_of(setting, photons, bands, name, (4, 16), (_bright_side(photons), 16))
    shape = edge_shape(camera, normal_deg > 45)
    ideal = picture_of(
        camera,
        lambda one: EDGE_DARK + (1 - EDGE_DARK) * picture_of_edge(one, shape, normal_deg),
    )
    return Taken(bench, ideal=ideal, is_alike=is_alike(camera))


def _bright_side(light: Float64Array) -> Float64Array:
    """Light of the bright side, (B,), without the few pixels that render noise brightens."""
    return np.asarray(np.quantile(light, 0.75, axis=(0, 1)))


def edge_instrument(taken: Taken) -> list[Measured]:
    """Measure the MTF of the edge."""
    sample_px = step_of(taken.bench)[1]

    def measure(bench: Bench, _: object) -> tuple[list[Quantity], dict[str, Draw]]:
        picture = without_black(bench.scenes, bench)
        edge = slanted_edge(picture, flat=flat_of(bench), sample_px=sample_px)
        return of_modulation(edge.modulation)

    return each_filter(taken, measure)


# Bitmaps: a star and dead leaves. A bitmap repeats beyond its ends, so pixels and lens multiply its spectrum.


class Layout(NamedTuple):
    """Size of a bitmap: rows and columns of pixels, pitch of a plane of the mosaic, points along a pixel."""

    shape: tuple[int, int]
    step: tuple[int, int]
    dense: int

    @classmethod
    def of(cls, camera: Camera, side_px: int) -> Layout:
        """Return a square with this many pixels along each side of a plane of the mosaic, at most twice as wide."""
        step = len(camera.tile), len(camera.tile[0])
        side_px = min(side_px, 2 * side_px // max(step))
        dense = max(POINTS // max(step), POINTS_MIN)
        return cls(chart_shape(camera, side_px, side_px), step, dense)


Bitmap = Callable[[Layout], Float64Array]


def bitmap_scenes(name: str, side_px: int, bitmap: Bitmap, camera: Camera) -> list[ChartScene]:
    """Return a scene for each lamp."""
    layout = Layout.of(camera, side_px)
    text = telecentric_scene(layout.shape, [bitmap_lamp(layout.shape)])
    return [
        ChartScene(f"{name}-{nm:g}", text, BITMAP_SPP, nm, bitmap=bitmap(layout))
        for nm in rendered_nm(camera, not camera.lens.diffraction)
    ]


def bitmap_frames(
    name: str, side_px: int, bitmap: Bitmap, share: float, setting: Setting, lights: Lights
) -> Taken:
    """Take frames of a chart, of uniform light for a star, and dark frames.  share : mean light over saturation."""
    camera, bands = setting.camera, bands_of_lamps(setting.camera)
    layout = Layout.of(camera, side_px)
    photons = photons_of_shapes(camera, [one.data / one.data.mean() for one in lights], share)
    flat, facts = None, dict[str, object]()
    if name == "star":
        flat = even_photons(camera, share), 4
        facts = {"cycles": cycles_of(layout), "contrast": STAR_CONTRAST}
    else:
        facts = {"chart": shown(bitmap(layout), layout.dense)}
    bench = bench_of(setting, photons, bands, name, (4, 4), flat)
    ideal = picture_of(camera, lambda one: picture_of_bitmap(one, bitmap(layout), layout.dense))
    return Taken(bench, facts, ideal, is_alike=is_alike(camera))


def cycles_of(layout: Layout) -> int:
    """Return the cycles of the star: as many per pixel at its rim for every mosaic."""
    return STAR_CYCLES * min(layout.step[0], 2)


@lru_cache(maxsize=1)
def bitmap_of_star(layout: Layout) -> Float64Array:
    """Return the star, 1 on average, sharpened against the linear interpolation between its points."""
    dense = layout.dense
    y, x = (
        (np.arange(count * dense) + 0.5) / dense - count / 2 - centre
        for count, centre in zip(layout.shape, STAR_CENTRE_PX, strict=True)
    )
    radius, angle = np.hypot(x, y[:, None]), np.arctan2(y[:, None], x)
    frequency = cycles_of(layout) / (2 * math.pi * radius)
    is_measured = (frequency < 1.0) & (radius < min(layout.shape) / 2)  # uniform elsewhere
    across, down = frequency * np.sin(angle) / dense, frequency * np.cos(angle) / dense
    kept = np.where(is_measured, np.sinc(across) * np.sinc(down), 1.0)
    waves = np.cos(cycles_of(layout) * angle) / kept**2
    return np.asarray(1 + STAR_CONTRAST * np.where(is_measured, waves, 0.0))


def star_instrument(taken: Taken) -> list[Measured]:
    """Measure the mean MTF over all directions."""
    cycles, contrast = taken.facts.get("cycles"), taken.facts.get("contrast", 1.0)
    if type(cycles) is not int or not is_number(contrast):
        raise InputError(
            "chart.toml of a star needs cycles = 144, the number of dark spokes; contrast = 0.9, its (bright − "
            "dark)/(bright + dark), is optional and 1 by default."
        )
    sample_px = step_of(taken.bench)[1]

    def measure(bench: Bench, _: object) -> tuple[list[Quantity], dict[str, Draw]]:
        picture, known = without_black(bench.scenes, bench), {"contrast": float(contrast)}
        star = siemens_star(picture, cycles, flat=flat_of(bench), sample_px=sample_px, **known)
        return of_modulation(star.modulation)

    return each_filter(taken, measure)


@lru_cache(maxsize=1)
def bitmap_of_leaves(layout: Layout) -> Float64Array:
    """Return the brightness of the chart, discs on discs; beyond its ends it repeats."""
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
        disc = rows[row] % points[0], columns[column] % points[1]
        bitmap[disc] = generator.uniform(*LEAVES_LIGHT)
        covered += len(row)
    return bitmap


def leaves_instrument(taken: Taken) -> list[Measured]:
    """Measure the MTF of texture."""
    chart, method = taken.facts.get("chart"), taken.facts.get("method", "cross")
    if isinstance(chart, Path):
        chart = np.asarray(read_raw(chart).frames[0], np.float64)
    is_method = isinstance(method, str) and method in SECTIONS
    if not isinstance(chart, np.ndarray) or not is_method:
        raise InputError(
            'chart.toml of dead leaves needs chart = "../leaves.npy", a file of the chart\'s brightness with 1, 2, … '
            f'points per pixel; method, one of {", ".join(SECTIONS)}, is optional and "cross" by default.'
        )
    step, rows = step_of(taken.bench), taken.bench.stacks[0].shape[0]
    dense = chart.shape[0] // rows

    def measure(bench: Bench, place: tuple[int, int]) -> tuple[list[Quantity], dict[str, Draw]]:
        stack, black = frames_and_black(bench.scenes, bench)
        seen = shifted(chart, place, step, dense)
        leaves = dead_leaves(stack.frames - black, seen, method=method, sample_px=step[1])
        return of_modulation(leaves.modulation)

    return each_filter(taken, measure)


def shifted(
    chart: Float64Array, place: tuple[int, int], step: tuple[int, int], dense: int
) -> Float64Array:
    """Return the chart centred on the pixels of one plane of the mosaic instead of on the tile."""
    shift = [((one - 1) / 2 - first) * dense for one, first in zip(step, place, strict=True)]
    if not any(shift):
        return chart
    spectrum = scipy.ndimage.fourier_shift(scipy.fft.fft2(chart), shift)
    return np.asarray(scipy.fft.ifft2(spectrum).real)


def _edge(name: str, title: str, normal_deg: float) -> Chart:
    scenes = partial(edge_scenes, name, normal_deg)
    frames = partial(edge_frames, name, normal_deg)
    return Chart(name, "edge", title, scenes, frames, edge_instrument)


def _bitmap(
    name: str,
    title: str,
    size: tuple[int, float],
    bitmap: Bitmap,
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
