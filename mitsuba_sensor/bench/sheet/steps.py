"""A step chart on the sheet: response, ISO speeds, noise and dynamic range of grey patches in daylight.

The exposure of each patch is that of its light in the render, with the render noise of that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import QUANTISATION_DN2, emva_figures
from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.image_quality.step_chart import (
    NOISE_CONSTANT,
    SATURATION_CONSTANT,
    step_chart,
)
from ...optics.spectra import luminous
from ...stages.stage import converter_of
from ..datasheet import Said, expected
from .black import frames_and_black
from .chart import Lights, Measured, Taken, Theory
from .light import ChartLight, ChartScene
from .patches import Patches, PatchGrid, patches_of, scaled_to_saturation
from .scene_text import DAYLIGHT, emitter_rectangle, telecentric_scene
from .setting import Setting, levels_of_filters

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GRID = PatchGrid(rows=4, columns=4, rendered_px=12, margin_px=3, patch_px=40)
REFLECTANCES = np.concatenate([[0.0], np.geomspace(0.002, 1.0, GRID.rows * GRID.columns - 1)])
BRIGHTEST = 0.9
"""Of saturation, behind the filter that sees most."""
SAMPLES = 64
COUNTS = 8, 8
"""Of frames, and of dark ones."""
SIGMAS = 4.0
"""As far as the spread of few columns may be from the camera's."""


class StepsChart(NamedTuple):
    """Sixteen grey patches in daylight (CIE D65), from darkness to near saturation."""

    name: str = "steps"
    kind: str = "steps"
    title: str = "Step chart: response, speed, noise, dynamic range"

    def suits(self, camera: Camera) -> bool:
        """Every camera."""
        return True

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """The patches, in rows from the darkest to the brightest."""
        side = GRID.rendered_px
        half, reach = side / 2, GRID.rows * side / 2
        patches = []
        for number, reflectance in enumerate(REFLECTANCES):
            row, column = divmod(number, GRID.columns)
            middle = (
                column * side + half - reach,
                reach - row * side - half,
            )
            if reflectance > 0:
                patches.append(
                    emitter_rectangle(middle, (half, half), 0.0, reflectance, DAYLIGHT)
                )
        shape = GRID.rows * side, GRID.columns * side
        return [ChartScene(self.name, telecentric_scene(shape, patches), SAMPLES)]

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the chart and dark ones."""
        (light,) = lights
        bench = GRID.take(setting, _levels(setting, light), light.bands, self.name, COUNTS)
        exposures = _exposures_lxs(setting, light).tolist()
        return Taken(
            bench, {"patches": GRID.regions(setting.camera), "exposure_lxs": exposures}
        )

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """Closed forms of a linear camera, by filter."""
        camera, (light,) = setting.camera, lights
        brightest = levels_of_filters(camera, _levels(setting, light)[-1], light.bands)
        per_lxs = brightest / _exposures_lxs(setting, light)[-1]
        theory = {}
        for name, electrons in zip(camera.filter_names, per_lxs, strict=True):
            theory[name if len(camera.filter_names) > 1 else ""] = figures_of_linear(
                setting, float(electrons)
            )
        return theory

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """Nothing: theory stands in the table."""

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The patches behind each place of the mosaic."""
        patches = patches_of(taken.facts)
        tile = taken.bench.stacks[0].tile or (("",),)
        step = len(tile), len(tile[0])
        return [
            measure_plane(name, bench, patches, step)
            for name, bench in taken.bench.of_filters().items()
        ]


def measure_plane(name: str, bench: Bench, patches: Patches, step: tuple[int, int]) -> Measured:
    """The instrument on the pixels behind one filter.  step : distance of these, down and across."""
    try:
        frames, black = frames_and_black(bench.scenes, bench)
        regions = patches.behind_one_filter(step)
        chart = step_chart(frames, regions, patches.exposures_lxs, black_dn=black)
    except InputError as error:
        return Measured(name, (), refused=(str(error),))
    drawings = {"Response (OECF)": chart.plot, "Signal-to-noise ratio": chart.plot_snr}
    return Measured(name, chart.quantities, drawings)


def _patch_means(light: ChartLight) -> Float64Array:
    """Irradiance of every patch without its margin, (P, B) [W m⁻² nm⁻¹].

    All have the spectrum of the lamp, the mean of theirs; the render noise is in their levels.
    """
    means = GRID.irradiance(light)
    levels = means @ light.bands.bandwidths_nm
    return np.asarray(levels[:, None] * means.sum(axis=0) / levels.sum())


def _levels(setting: Setting, light: ChartLight) -> Float64Array:
    """Mean photons per pixel of every patch, (P, B), the brightest near saturation behind the filter that sees most."""
    camera = setting.camera
    photons = light.photons(camera, setting.exposure, _patch_means(light))
    return scaled_to_saturation(camera, photons, light.bands, BRIGHTEST)


def _exposures_lxs(setting: Setting, light: ChartLight) -> Float64Array:
    """Illuminance of every patch at the focal plane times the exposure time, (P,) [lx s]."""
    irradiance = _patch_means(light)
    photons = light.photons(setting.camera, setting.exposure, irradiance)
    scale = _levels(setting, light)[-1].sum() / photons[-1].sum()
    lux = [luminous(light.bands.wavelengths_nm, spectrum) for spectrum in irradiance]
    return np.asarray(np.array(lux) * scale * setting.exposure.time_s)


def figures_of_linear(setting: Setting, electrons_per_lxs: float) -> dict[str, Said]:
    """What a step chart shows of a camera whose response is a line, behind one filter."""
    camera, exposure = setting.camera, setting.exposure
    known = emva_figures(camera, exposure)
    gain, converter = known.system_gain_dn_per_e, converter_of(camera.stages)
    response = gain * electrons_per_lxs
    largest_dn = converter.highest - converter.black_level_dn
    temporal_dn2 = (gain * known.temporal_dark_noise_e) ** 2 + QUANTISATION_DN2
    decibel = 20 * math.log10(largest_dn / _signal(1.0, temporal_dn2, gain, 0.0))
    said = {
        "s": _of_chip(response, camera),
        "S_sat": _of_chip(SATURATION_CONSTANT * response / largest_dn, camera),
        "DR": Said(decibel, decibel, decibel),
    }
    for ratio in (40, 10):
        signals_dn = [
            _signal(float(ratio), temporal_dn2 + dark_dn2, gain, prnu2)
            for dark_dn2, prnu2 in _fixed_patterns(setting, gain)
        ]
        if max(signals_dn) < largest_dn:
            speeds = [NOISE_CONSTANT * response / signal_dn for signal_dn in signals_dn]
            said[f"S_noise{ratio}"] = Said(speeds[0], min(speeds), max(speeds))
    return said


def _fixed_patterns(setting: Setting, gain: float) -> list[tuple[float, float]]:
    """Variance of DSNU [DN²] and square of PRNU in a patch: the camera's, and the least and the most that
    so few columns may have."""
    camera = setting.camera
    columns = GRID.side(camera)[1] // len(camera.tile[0])
    patterns = expected(camera, setting.exposure, None, 1)
    pixel, column, row = (
        patterns.get(f"DSNU1288_{name}", Said(0.0, 0.0, 0.0)).value
        for name in ("pixel", "col", "row")
    )
    variances = []
    for sigmas in (0.0, -SIGMAS, SIGMAS):
        share = max(1 + sigmas * math.sqrt(2 / columns), 0.0)
        dark_e2 = pixel**2 + share * (column**2 + row**2)
        prnu2 = camera.pixel.prnu**2 + share * camera.readout.prnu_col**2
        variances.append((gain**2 * dark_e2, prnu2))
    return variances


def _signal(ratio: float, dark_dn2: float, gain: float, prnu2: float) -> float:
    """The signal y [DN] whose ratio to the noise √(dark + K·y + PRNU²·y²) is this one; infinite where none is."""
    rest = 1 - ratio**2 * prnu2
    if rest <= 0:
        return math.inf
    linear = ratio**2 * gain
    return (linear + math.sqrt(linear**2 + 4 * rest * ratio**2 * dark_dn2)) / (2 * rest)


def _of_chip(value: float, camera: Camera) -> Said:
    """A figure that is proportional to the response: that of the brightest patch, whose columns have their PRNU."""
    columns = camera.readout.prnu_col / math.sqrt(GRID.patch_px)
    share = SIGMAS * math.hypot(columns, camera.pixel.prnu / GRID.patch_px)
    return Said(value, value * (1 - share), value * (1 + share))
