"""The charts of the sheet: a row of CHARTS has a scene, its frames and an instrument.

The theory of a chart is the same instrument on the noise-free image (optics.py). EMVA 1288 and the step chart have
closed forms instead (closed_forms.py). A new chart is a new row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...camera.camera import Camera
from ...core import InputError, nearest
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.automotive.flicker import flicker
from ...lab.measure.colour_and_geometry.flat_field import flat_field
from ...lab.measure.measurement import measure_bench
from ...lab.quantity import Quantity
from ...optics.shutter import shutter_of
from ...optics.waveform import pwm
from ...pages.drawing import colour_of
from ..virtual_bench import Setup, virtual_bench
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
    planes_of_filters,
    take,
)
from .light import ChartScene, surrounded_scene
from .modulation import MODULATION_CHARTS
from .optics import (
    bands_of_lamps,
    even_photons,
    levels_of_filters,
    photons_of_shapes,
    rendered_nm,
)
from .patches import PATCH_CHARTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CHIPS = 16
"""Single sensor units whose images give the range of a figure about the camera file's value."""
GREY_BRIGHTEST, LED_BRIGHTEST = 0.8, 0.6
"""Light over saturation, under the most sensitive filter."""
GREY_SPP = 128
GREY_DEG, GREY_PX = 40.0, 256
"""Horizontal field of view (a lens prescription has its own), and largest number of columns."""
LED_HZ, LED_DUTY, LED_PX, LED_FRAMES = 90.0, 0.25, 32, 32
"""A car's lamp: pulse frequency, duty cycle, side in each plane of the mosaic, frames."""
LED_STEP = (5**0.5 - 1) / 2
"""Periods between frames: the golden ratio, whose multiples spread evenly."""
EMVA_SIDE = 192
"""Measured side of the sensor: standard deviations are within 0.4 %, and within 0.8 % under one filter."""
EMVA_DRAWN = (
    "Photon transfer, logarithmic",
    "Signal-to-noise ratio, logarithmic",
    "Linearity",
    "Non-uniformity",
    "Dark current",
)
"""Plots on the sheet; `characterize` draws all of them."""


# A uniform grey surface in all directions, and a flickering lamp


def grey_shape(camera: Camera) -> tuple[int, int]:
    """Return the rows and columns of the frames, whole tiles in the sensor's proportions."""
    sensor, tile = camera.sensor, (len(camera.tile), len(camera.tile[0]))
    columns = min(GREY_PX, sensor.columns) // tile[1] * tile[1]
    rows = round(sensor.rows * columns / sensor.columns)
    return max(rows // tile[0], 1) * tile[0], columns


def grey_scenes(camera: Camera) -> list[ChartScene]:
    """Return a scene for each lamp, seen by the whole sensor; without dispersion all lamps have the same shape."""
    shape = grey_shape(camera)
    text, pixels = surrounded_scene(shape, GREY_DEG), camera.sensor.columns / shape[1]
    lamps = rendered_nm(camera, not camera.lens.dispersion)
    return [ChartScene(f"grey-{nm:g}", text, GREY_SPP, nm, pixels=pixels) for nm in lamps]


def grey_frames(setting: Setting, lights: Lights) -> Taken:
    """Take frames of the surface and dark frames. Single sensor units differ by the PRNU of their columns."""
    camera = setting.camera
    shapes = [light.data / np.quantile(light.data, 0.99) for light in lights]
    photons = photons_of_shapes(camera, shapes, GREY_BRIGHTEST)
    bench = bench_of(setting, photons, bands_of_lamps(camera), "grey", (16, 16))
    ideal, chips = _illumination(camera), list[Float64Array]()
    if ideal is not None and camera.readout.prnu_col:
        gains = np.random.default_rng(1).normal(size=(CHIPS, 1, 1, ideal.shape[1]))
        chips = list(ideal * (1 + camera.readout.prnu_col * gains))
    return Taken(bench, ideal=None if ideal is None else ideal[None], chips=chips)


def _illumination(camera: Camera) -> Float64Array | None:
    """Return the relative illumination at the pixel centres, (H, W): cos⁴ or measured; None without a closed form."""
    lens = camera.lens
    unknown = (lens.prescription, lens.half_pupil, lens.distortion, lens.distortion_percent)
    angular = camera.pixel.angular_response
    if lens.veiling_glare or any(one is not None for one in (*unknown, angular)):
        return None
    rows, columns = grey_shape(camera)
    y, x = (np.arange(count) + 0.5 - count / 2 for count in (rows, columns))
    half_widths = np.hypot(x, y[:, None]) / (columns / 2)
    if lens.relative_illumination is not None:
        half_mm = camera.sensor.columns * camera.pixel.pitch_x_um * 1e-3 / 2
        heights_mm = lens.relative_illumination_heights_mm or ()
        return np.asarray(
            np.interp(half_widths * half_mm, heights_mm, lens.relative_illumination)
        )
    tangents = half_widths * math.tan(math.radians(GREY_DEG / 2))
    return np.asarray((1 + tangents**2) ** -2)


def grey_instrument(taken: Taken) -> list[Measured]:
    """Measure relative illumination and colour shading of all filters together."""
    try:
        planes = planes_of_filters(taken.bench)
        names = list(planes) if len(planes) > 1 else ["measured"]
        field = flat_field(np.stack(list(planes.values()), axis=2), names)
    except InputError as error:
        return [Measured("", (), refused=(str(error),))]
    draw = partial(_draw_channels, names, field.plot)
    return [Measured("", field.quantities, {"Relative illumination versus image height": draw})]


def _draw_channels(names: Sequence[str], draw: Draw, ax: Axes) -> None:
    """Draw the curves of channels in the colours of their filters."""
    ax.set_prop_cycle(color=[colour_of(name, n) for n, name in enumerate(names)])
    draw(ax)


def led_frames(setting: Setting, lights: Lights) -> Taken:
    """Take frames of the lamp, whose light is uniform and exactly known, and dark frames.

    Single frames differ by row and column noise.
    """
    camera, lamp = setting.camera, pwm(LED_HZ, LED_DUTY)
    bands, shape = bands_of_lamps(camera), chart_shape(camera, LED_PX, LED_PX)
    begins_s = [number * LED_STEP / LED_HZ for number in range(LED_FRAMES)]
    shutters = [shutter_of(camera, setting.exposure, begin_s) for begin_s in begins_s]
    weights = np.array([lamp.weights(shutter, (0, shape[0])) for shutter in shutters])
    weights = np.broadcast_to((weights / weights.max())[..., None], (LED_FRAMES, *shape))
    full = even_photons(camera, LED_BRIGHTEST)
    pictures = [
        take(setting, one[..., None] * full, bands, 1, f"led {number}")
        for number, one in enumerate(weights)
    ]
    frames = np.concatenate([picture.frames for picture in pictures])
    dark = take(setting, np.zeros((*shape, full.size)), bands, 16, "led dark")
    bench = Bench((), (dark,), (), (replace(pictures[0], frames=frames),))
    levels = levels_of_filters(camera, full, bands)[camera.filter_index(shape)]
    readout, gain = camera.readout, camera.system_gain_dn_per_e
    ideal, normal = gain * weights * levels, np.random.default_rng(1).normal
    chips = list[Float64Array]()
    if readout.row_noise_e or readout.column_noise_e:
        for _ in range(CHIPS):
            rows = readout.row_noise_e * normal(size=(LED_FRAMES, shape[0], 1))
            columns = readout.column_noise_e * normal(size=(LED_FRAMES, 1, shape[1]))
            chips.append(ideal + gain * (rows + columns))
    return Taken(bench, ideal=ideal, chips=chips)


def led_instrument(taken: Taken) -> list[Measured]:
    """Measure flicker modulation and its mitigation."""

    def measure(bench: Bench, _: object) -> tuple[list[Quantity], dict[str, Draw]]:
        lamp, black = frames_and_black(bench.scenes, bench)
        found = flicker(lamp.frames - black)
        return [found.modulation, found.mitigation], {"Flicker": found.plot}

    return each_filter(taken, measure)


# EMVA 1288


def emva_frames(setting: Setting, lights: Lights) -> Taken:
    """Take the frames of ``characterize`` with a smaller part of the sensor."""
    setup = Setup(setting.temperature_k, None, setting.serial, setting.seed, EMVA_SIDE)
    bench = virtual_bench(setting.camera, setup)
    return Taken(
        bench.change(lambda stacks: [replace(one, gain=setting.gain) for one in stacks])
    )


def emva_instrument(taken: Taken) -> list[Measured]:
    """Measure with all instruments of the laboratory."""
    measured = []
    for found in measure_bench(taken.bench):
        refused = [f"{title}: {sentence}" for title, sentence in found.refused.items()]
        drawings = {one: found.drawings[one] for one in EMVA_DRAWN if one in found.drawings}
        figures = tuple(found.figures.values())
        measured.append(Measured(found.filter_name, figures, drawings, refused))
    return measured


def _no_scene(camera: Camera) -> list[ChartScene]:
    """Return no scene: uniform light needs no render."""
    return []


CHARTS = (
    Chart(
        "emva",
        "emva",
        "EMVA 1288: noise, sensitivity, non-uniformity, dark current",
        _no_scene,
        emva_frames,
        emva_instrument,
        closed_form=True,
    ),
    *MODULATION_CHARTS,
    *PATCH_CHARTS,
    Chart(
        "grey",
        "grey",
        "Grey surface: relative illumination and colour shading",
        grey_scenes,
        grey_frames,
        grey_instrument,
    ),
    Chart(
        "led",
        "led",
        "Flickering lamp: flicker modulation and its mitigation",
        _no_scene,
        led_frames,
        led_instrument,
    ),
)
"""In the order of the page."""


def chosen_charts(names: Sequence[str]) -> list[Chart]:
    """Return the charts of these names or kinds; all charts if no name is given. Raises InputError for other names."""
    known = list(dict.fromkeys(name for chart in CHARTS for name in (chart.kind, chart.name)))
    for name in names:
        if name not in known:
            raise InputError(
                f"charts= has {name!r}; the charts are {', '.join(known)}.{nearest(name, known)}"
            )
    return [chart for chart in CHARTS if not names or {chart.kind, chart.name} & set(names)]
