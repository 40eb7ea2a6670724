"""Charts that are bitmaps: a lamp that shines as a picture says, its frames, and the closed form of what is seen.

The bitmap repeats beyond its ends, and between its points the renderer interpolates linearly. So pixels and lens
multiply its spectrum, and the picture that a camera without noise sees is known exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from ...camera.camera import Camera
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ..datasheet import Said
from .chart import Lights, Theory
from .lamps import (
    bands_of_lamps,
    even_photons,
    photons_of_shapes,
    rendered_nm,
    transfers_of_filters,
)
from .light import ChartScene
from .scene_text import bitmap_lamp, telecentric_scene
from .setting import Setting, chart_shape, take
from .transfer import Transfer

POINTS, FEWEST_POINTS = 8, 4
"""Of the bitmap, along the distance of two pixels behind one place of the mosaic, and along a pixel at least."""
WIDEST = 2
"""Of a bitmap in front of a mosaic, over that in front of a monochrome sensor."""
SAMPLES = 64


class Layout(NamedTuple):
    """How large a bitmap is in front of a camera.

    shape : rows and columns of pixels.  step : rows and columns of the colour mosaic.
    dense : points of the bitmap along each side of a pixel.
    """

    shape: tuple[int, int]
    step: tuple[int, int]
    dense: int

    @classmethod
    def of(cls, camera: Camera, side_px: int) -> Layout:
        """That of a square with so many pixels along each side behind each place of the mosaic.

        Of mosaics of more than 2 × 2 places fewer: the square is at most twice as wide.
        """
        step = len(camera.tile), len(camera.tile[0])
        side_px = min(side_px, WIDEST * side_px // max(step))
        dense = max(POINTS // max(step), FEWEST_POINTS)
        return cls(chart_shape(camera, side_px, side_px), step, dense)

    def plane(self, picture: Float64Array, place: tuple[int, int]) -> Float64Array:
        """The pixels of a picture behind one place of the mosaic."""
        return picture[place[0] :: self.step[0], place[1] :: self.step[1]]


def first_places(camera: Camera) -> dict[str, tuple[int, int]]:
    """The first place of each colour filter in the mosaic; its name is empty where there is one only."""
    tile, names = np.array(camera.tile), camera.filter_names
    if len(names) == 1:
        names = ("",)
    places = {}
    for number, name in enumerate(names):
        row, column = np.argwhere(tile == number)[0].tolist()
        places[name] = row, column
    return places


def scenes_of_bitmap(
    name: str, bitmap: Float64Array, layout: Layout, camera: Camera
) -> list[ChartScene]:
    """One for the lamp of each colour filter; without diffraction the light of all lamps has one shape."""
    text = telecentric_scene(layout.shape, [bitmap_lamp(layout.shape)])
    return [
        ChartScene(f"{name}-{lamp_nm:g}", text, SAMPLES, lamp_nm, bitmap=bitmap)
        for lamp_nm in rendered_nm(camera)
    ]


def take_bitmap(
    setting: Setting, lights: Lights, name: str, share: float, counts: tuple[int, int, int]
) -> Bench:
    """Frames of a chart, of even light and dark ones.

    share : of the saturation of the filter that sees most, where the chart is as bright as its mean.
    counts : of frames of the chart, of even light (or 0), and of dark ones.
    """
    camera, bands = setting.camera, bands_of_lamps(setting.camera)
    shapes = [light.data / light.data.mean() for light in lights]
    photons = photons_of_shapes(camera, shapes, share)
    scene = take(setting, photons, bands, counts[0], name)
    flats = []
    if counts[1]:
        even = np.broadcast_to(even_photons(camera, share), photons.shape)
        flats.append(take(setting, even, bands, counts[1], f"{name} flat"))
    dark = take(setting, 0 * photons, bands, counts[2], f"{name} dark")
    return Bench((), (dark,), tuple(flats), (scene,))


def theory_of_bitmap(
    camera: Camera,
    layout: Layout,
    figures: Callable[[Transfer, Layout, tuple[int, int]], dict[str, Said]],
) -> Theory:
    """What an instrument finds in a picture without noise, by colour filter.

    figures : of a transfer, behind one place of the mosaic.
    """
    places = first_places(camera)
    return {
        name: figures(transfer, layout, places[name])
        for name, transfer in transfers_of_filters(camera).items()
    }


def shown(bitmap: Float64Array, dense: int) -> Float64Array:
    """What a lamp shows at the points of a bitmap: linear interpolation between them takes some away.

    dense : points along a pixel.
    """
    down, across = _frequencies(bitmap, dense)
    kept = (np.sinc(down[:, None] / dense) * np.sinc(across / dense)) ** 2
    return np.asarray(scipy.fft.irfft2(scipy.fft.rfft2(bitmap) * kept, bitmap.shape))


def picture_of_bitmap(transfer: Transfer, bitmap: Float64Array, dense: int) -> Float64Array:
    """What the pixels see of a bitmap (H, W), without noise.  dense : points along a pixel."""
    down, across = _frequencies(bitmap, dense)
    to_middle = 1j * math.pi * (1 - 1 / dense)  # from its first point to that of a pixel
    spectrum = scipy.fft.rfft2(shown(bitmap, dense)) * transfer.at(across, down[:, None])
    spectrum *= np.exp(to_middle * down)[:, None] * np.exp(to_middle * across)
    picture = scipy.fft.irfft2(spectrum, bitmap.shape)[::dense, ::dense]
    return transfer.with_glare(picture)


def _frequencies(bitmap: Float64Array, dense: int) -> tuple[Float64Array, Float64Array]:
    """Those of a real spectrum, down and across [cycles per pixel]."""
    rows, columns = bitmap.shape
    return scipy.fft.fftfreq(rows, 1 / dense), scipy.fft.rfftfreq(columns, 1 / dense)
