"""A flickering lamp on the sheet: flicker modulation (IEEE 2020), beside what exposure and shutter leave of it.

The lamp is a light-emitting diode with pulse-width modulation: even light, exactly known, where the colour filters
see most. Frames begin at phases all over its period.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.automotive.flicker import flicker
from ...optics.shutter import shutter_of
from ...optics.waveform import pwm
from ..datasheet import SIGMAS, Said
from .black import frames_and_black
from .chart import Lights, Measured, Taken, Theory
from .lamps import bands_of_lamps, photons_of_shapes
from .light import ChartScene
from .setting import Setting, chart_shape, levels_of_filters, take

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FREQUENCY_HZ, DUTY = 90.0, 0.25
"""Of the lamp: as slow as lamps of cars are, and bright for a quarter of the time."""
SIDE_PX = 32
"""Of the lamp in the frames, behind each place of the mosaic."""
FRAMES, DARKS = 32, 16
STEP_PERIODS = (5**0.5 - 1) / 2
"""From a frame to the next: the golden ratio, whose multiples lie nowhere close together."""
BRIGHTEST = 0.6
"""Of saturation in the brightest frame, behind the filter that sees most."""
TOLERANCE = 0.1
"""Share of the mean within which a frame is as bright as on average."""


class LedChart(NamedTuple):
    """A lamp of pulses of 90 Hz, without other light."""

    name: str = "led"
    kind: str = "led"
    title: str = "Flickering lamp: flicker modulation and its mitigation"

    def suits(self, camera: Camera) -> bool:
        """Every camera."""
        return True

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """None: even light needs no render."""
        return []

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the lamp and dark ones, one after the other."""
        camera, lamp = setting.camera, pwm(FREQUENCY_HZ, DUTY)
        bands, shape = bands_of_lamps(camera), chart_shape(camera, SIDE_PX, SIDE_PX)
        begins_s = [number * STEP_PERIODS / FREQUENCY_HZ for number in range(FRAMES)]
        shutters = [shutter_of(camera, setting.exposure, begin_s) for begin_s in begins_s]
        weights = np.array([lamp.weights(shutter, (0, shape[0])) for shutter in shutters])
        pictures = []
        for number, rows in enumerate(weights / weights.max()):
            light = np.broadcast_to(rows[:, None, None], (*shape, 1))
            photons = photons_of_shapes(camera, [light], BRIGHTEST)
            pictures.append(take(setting, photons, bands, 1, f"{self.name} {number}"))
        frames = np.concatenate([picture.frames for picture in pictures])
        dark = take(setting, 0 * photons, bands, DARKS, f"{self.name} dark")
        return Taken(Bench((), (dark,), (), (replace(pictures[0], frames=frames),)))

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """Modulation of the same exposures of ideal pulses, and the share of them that are close to their mean."""
        camera = setting.camera
        shape = chart_shape(camera, SIDE_PX, SIDE_PX)
        row_periods = shutter_of(camera, setting.exposure).row_time_s * FREQUENCY_HZ
        rows = np.arange(shape[0]) * row_periods
        begins = np.arange(FRAMES)[:, None] * STEP_PERIODS + rows
        light = lit_periods(begins, setting.exposure.time_s * FREQUENCY_HZ).mean(axis=1)
        steady = float((np.abs(light / light.mean() - 1) < TOLERANCE).mean())
        noises = _noise_of_means(camera, shape)
        theory = {}
        for name, noise in zip(camera.filter_names, noises.tolist(), strict=True):
            modulation = _modulation(light / light.max(), noise)
            said = {"FMI": modulation, "MMP": Said(*3 * (steady,))}
            theory[name if len(camera.filter_names) > 1 else ""] = said
        return theory

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """Nothing: theory stands in the table."""

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The instrument behind each place of the mosaic."""
        return [_measure(name, bench) for name, bench in taken.bench.of_filters().items()]


def lit_periods(begin_periods: Float64Array, open_periods: float) -> Float64Array:
    """How long the lamp is lit in an exposure [periods]: whole pulses, and parts of the first and of the last."""

    def lit_until(periods: Float64Array) -> Float64Array:
        whole = np.floor(periods)
        return np.asarray(DUTY * whole + np.minimum(periods - whole, DUTY))

    return lit_until(begin_periods + open_periods) - lit_until(begin_periods)


def _modulation(light: Float64Array, noise: float) -> Said:
    """Flicker modulation index, and how far noise of the means of frames may take it.

    light : of the frames, over the brightest.  noise : standard deviation, in the same unit.
    """
    ends = float(light.min()), float(light.max())
    value = (ends[1] - ends[0]) / sum(ends)
    reach = SIGMAS * noise * 2 * math.hypot(*ends) / sum(ends) ** 2
    return Said(value, value - reach, value + reach)


def _noise_of_means(camera: Camera, shape: tuple[int, int]) -> Float64Array:
    """Noise of rows and columns in the mean of a frame behind each colour filter, (F,), over its brightest light."""
    rows, columns = (count // step for count, step in zip(shape, _tile(camera), strict=True))
    readout = camera.readout
    noise_e2 = readout.row_noise_e**2 / rows + readout.column_noise_e**2 / columns
    photons = photons_of_shapes(camera, [np.ones((1, 1, 1))], BRIGHTEST)
    electrons = levels_of_filters(camera, photons[0, 0], bands_of_lamps(camera))
    return np.asarray(math.sqrt(noise_e2) / electrons)


def _tile(camera: Camera) -> tuple[int, int]:
    return len(camera.tile), len(camera.tile[0])


def _measure(name: str, bench: Bench) -> Measured:
    """The instrument on the pixels behind one filter; what it refuses is said."""
    try:
        lamp, black = frames_and_black(bench.scenes, bench)
        found = flicker(lamp.frames - black, tolerance=TOLERANCE)
    except InputError as error:
        return Measured(name, (), refused=(str(error),))
    return Measured(name, (found.modulation, found.mitigation), {"Flicker": found.plot})
