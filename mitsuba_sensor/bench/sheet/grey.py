"""An even grey surface on the sheet: relative illumination and colour shading of the whole field.

It shines at the wavelengths where the colour filters see most, as the edges do. Frames show the field of the whole
sensor with fewer pixels, each in the light at its place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.colour_and_geometry.flat_field import FlatField, flat_field
from ...lab.quantity import Quantity
from ..datasheet import SIGMAS, Said
from .chart import Lights, Measured, Taken, Theory
from .colours import planes_of_filters
from .lamps import bands_of_lamps, lamps_nm, photons_of_shapes
from .light import ChartScene
from .scene_text import surrounded_scene
from .setting import Setting, take

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIELD_DEG = 40.0
"""Field of view across the sensor; a lens prescription has its own."""
WIDTH_PX = 256
BRIGHTEST = 0.8
"""Of saturation in the middle, behind the filter that sees most."""
SAMPLES, FRAMES, DARKS = 128, 16, 16
CHIPS = 32
"""Chips whose columns say how far the figures of one may be from those of the lens."""


class GreyChart(NamedTuple):
    """An even surface all around the camera."""

    name: str = "grey"
    kind: str = "grey"
    title: str = "Grey: relative illumination and colour shading"

    def suits(self, camera: Camera) -> bool:
        """Every camera."""
        return True

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """One for each lamp, seen by the whole sensor; without dispersion the light of all lamps has one shape."""
        shape, lamps = _shape(camera), lamps_nm(camera)
        text, pixels = surrounded_scene(shape, FIELD_DEG), camera.sensor.columns / shape[1]
        if not camera.lens.dispersion:
            lamps = lamps[:1]
        return [
            ChartScene(f"{self.name}-{lamp_nm:g}", text, SAMPLES, lamp_nm, pixels=pixels)
            for lamp_nm in lamps
        ]

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the surface and dark ones."""
        bands = bands_of_lamps(setting.camera)
        shapes = [light.data / np.quantile(light.data, 0.99) for light in lights]
        photons = photons_of_shapes(setting.camera, shapes, BRIGHTEST)
        scene = take(setting, photons, bands, FRAMES, self.name)
        dark = take(setting, 0 * photons, bands, DARKS, f"{self.name} dark")
        return Taken(Bench((), (dark,), (), (scene,)))

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """What the instrument finds in cos⁴, or in the measured illumination of the lens, without noise."""
        camera = setting.camera
        illumination = _illumination(camera)
        if illumination is None:
            return {}
        values = {one.symbol: one.value for one in _flat_field(camera, illumination).quantities}
        spread = _spread_of_columns(camera, illumination)
        return {
            "": {
                symbol: Said(value, value - spread[symbol], value + spread[symbol])
                for symbol, value in values.items()
            }
        }

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """The illumination of the corners."""
        corners = [one.value for symbol, one in said.items() if symbol.startswith("RI_")]
        ax.plot([1.0] * len(corners), corners, "kx", markersize=6, label="theory")

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The planes of all colour filters together."""
        try:
            planes = planes_of_filters(taken.bench)
            field = flat_field(np.stack(list(planes.values()), axis=2))
        except InputError as error:
            return [Measured("", (), refused=(str(error),))]
        figures = [_named(one, list(planes)) for one in field.quantities]
        return [Measured("", figures, {"Relative illumination": field.plot})]


def _named(figure: Quantity, filters: Sequence[str]) -> Quantity:
    """The figure, with the name of the filter in its note."""
    number = int(figure.symbol.rpartition("_")[2])
    if len(filters) == 1:
        return figure
    return figure.noted(f"channel {number} is {filters[number]}")


def _shape(camera: Camera) -> tuple[int, int]:
    """Rows and columns of the frames, whole tiles and of the proportions of the sensor."""
    sensor, tile = camera.sensor, (len(camera.tile), len(camera.tile[0]))
    columns = min(WIDTH_PX, sensor.columns) // tile[1] * tile[1]
    rows = round(sensor.rows * columns / sensor.columns)
    return max(rows // tile[0], 1) * tile[0], columns


def _illumination(camera: Camera) -> Float64Array | None:
    """Relative illumination at the middles of the pixels (H, W) in closed form; None for lenses that have none."""
    lens = camera.lens
    unknown = (
        lens.prescription,
        lens.half_pupil,
        lens.distortion,
        lens.distortion_percent,
        camera.pixel.angular_response,
    )
    if lens.veiling_glare or any(one is not None for one in unknown):
        return None
    rows, columns = _shape(camera)
    y, x = (np.arange(count) + 0.5 - count / 2 for count in (rows, columns))
    half_widths = np.hypot(x, y[:, None]) / (columns / 2)
    if lens.relative_illumination is not None:
        half_mm = camera.sensor.columns * camera.pixel.pitch_x_um * 1e-3 / 2
        heights_mm = lens.relative_illumination_heights_mm or ()
        return np.asarray(
            np.interp(half_widths * half_mm, heights_mm, lens.relative_illumination)
        )
    tangents = half_widths * math.tan(math.radians(FIELD_DEG / 2))
    return np.asarray((1 + tangents**2) ** -2)


def _flat_field(camera: Camera, light: Float64Array) -> FlatField:
    """What the instrument finds in light without noise, in the planes of the filters."""
    step = len(camera.tile), len(camera.tile[0])
    planes: dict[int, list[Float64Array]] = {}
    for row, column in np.ndindex(step):
        plane = light[row :: step[0], column :: step[1]]
        planes.setdefault(camera.tile[row][column], []).append(plane)
    return flat_field(np.stack([np.mean(own, axis=0) for own in planes.values()], axis=2))


def _spread_of_columns(camera: Camera, light: Float64Array) -> dict[str, float]:
    """How far the figures of one chip may be from those of the lens, because of the PRNU of its columns."""
    generator = np.random.default_rng(1)
    chips = []
    for _ in range(CHIPS):
        gains = 1 + camera.readout.prnu_col * generator.normal(size=light.shape[1])
        quantities = _flat_field(camera, light * gains).quantities
        chips.append({one.symbol: one.value for one in quantities})
        if not camera.readout.prnu_col:
            break
    return {
        symbol: SIGMAS * float(np.std([chip[symbol] for chip in chips])) for symbol in chips[0]
    }
