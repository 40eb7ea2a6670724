"""A step chart on the sheet: response, ISO speeds, noise and dynamic range of grey patches in daylight.

The patches are rendered small. Each is even, so that its mean is the light of a larger patch: the render noise is in
the levels, whose exposure is known, and none is in the noise of the pixels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import QUANTISATION_DN2, emva_figures, saturation_e
from ...core import InputError
from ...core.types import Float64Array
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.frames.manifest import is_number
from ...lab.measure.image_quality.patches import Region
from ...lab.measure.image_quality.step_chart import (
    NOISE_CONSTANT,
    SATURATION_CONSTANT,
    step_chart,
)
from ...optics.spectra import luminous
from ...stages.stage import converter_of
from ..datasheet import Said, expected
from .chart import Lights, Measured, Taken, Theory
from .light import ChartLight, ChartScene
from .scene_text import DAYLIGHT, emitter_rectangle, telecentric_scene
from .setting import Setting, chart_shape, levels_of_filters, take

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GRID = 4
"""Patches are in so many rows and columns."""
RENDERED_PX, MARGIN_PX = 12, 3
"""Side of a patch in the render, and what of it on each side the lens may have blurred."""
PATCH_PX = 40
"""Side of a patch in the frames, behind each place of the mosaic."""
REFLECTANCES = np.concatenate([[0.0], np.geomspace(0.002, 1.0, GRID * GRID - 1)])
BRIGHTEST = 0.9
"""Of saturation, behind the filter that sees most."""
SAMPLES, FRAMES = 64, 8
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
        half, reach = RENDERED_PX / 2, GRID * RENDERED_PX / 2
        patches = []
        for number, reflectance in enumerate(REFLECTANCES):
            row, column = divmod(number, GRID)
            middle = (
                column * RENDERED_PX + half - reach,
                reach - row * RENDERED_PX - half,
            )
            if reflectance > 0:
                patches.append(
                    emitter_rectangle(middle, (half, half), 0.0, reflectance, DAYLIGHT)
                )
        side = GRID * RENDERED_PX
        return [ChartScene(self.name, telecentric_scene((side, side), patches), SAMPLES)]

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the chart and dark ones."""
        camera, (light,) = setting.camera, lights
        side = _patch_side(camera)
        levels = _levels(setting, light).reshape(GRID, GRID, -1)
        photons = levels.repeat(side[0], axis=0).repeat(side[1], axis=1)
        scene = take(setting, photons, light.bands, FRAMES, self.name)
        dark = take(setting, 0 * photons, light.bands, FRAMES, f"{self.name} dark")
        regions = [
            [row * side[0], column * side[1], *side] for row, column in np.ndindex(GRID, GRID)
        ]
        facts = {"patches": regions, "exposure_lxs": _exposures_lxs(setting, light).tolist()}
        return Taken(Bench((), (dark,), (), (scene,)), facts)

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


class Patches(NamedTuple):
    """Where the patches are (first row, first column, rows, columns), and the exposure of each [lx s]."""

    regions: Sequence[Region]
    exposures_lxs: Sequence[float]


def patches_of(facts: Facts) -> Patches:
    """The patches that ``chart.toml`` names. Raises InputError where it does not, and for wrong values."""
    regions, exposures = (facts.get(name) for name in ("patches", "exposure_lxs"))
    are_regions = isinstance(regions, list) and all(map(_is_region, regions))
    are_exposures = isinstance(exposures, list) and all(map(is_number, exposures))
    if not (are_regions and are_exposures and len(regions or ()) == len(exposures or ())):
        raise InputError(
            "chart.toml of a step chart has patches = [[first row, first column, rows, columns], …] and exposure_lxs = "
            "[…], the illuminance at the focal plane times the exposure time of each patch; docs/sheet.md shows one."
        )
    return Patches([tuple(region) for region in regions or ()], exposures or ())


def _is_region(value: object) -> bool:
    """Whether a value is four whole numbers of at least 0."""
    if not isinstance(value, list) or len(value) != 4:
        return False
    return all(type(number) is int and number >= 0 for number in value)


def measure_plane(name: str, bench: Bench, patches: Patches, step: tuple[int, int]) -> Measured:
    """The instrument on the pixels behind one filter.  step : distance of these, down and across."""
    try:
        regions = [
            (top // step[0], left // step[1], rows // step[0], columns // step[1])
            for top, left, rows, columns in patches.regions
        ]
        if not bench.scenes or not bench.darks:
            raise InputError(
                f"{len(bench.scenes)} pictures of the chart and {len(bench.darks)} stacks of dark frames; take both, "
                "with names that begin with scene and dark."
            )
        chart = step_chart(
            bench.scenes[0],
            regions,
            patches.exposures_lxs,
            black_dn=bench.darks[0].mean,
        )
    except InputError as error:
        return Measured(name, (), refused=(str(error),))
    drawings = {"Response (OECF)": chart.plot, "Signal-to-noise ratio": chart.plot_snr}
    return Measured(name, chart.quantities, drawings)


def _patch_side(camera: Camera) -> tuple[int, int]:
    """Rows and columns of a patch in the frames, whole tiles."""
    rows, columns = chart_shape(camera, GRID * PATCH_PX, GRID * PATCH_PX)
    tile = len(camera.tile), len(camera.tile[0])
    return rows // GRID // tile[0] * tile[0], columns // GRID // tile[1] * tile[1]


def _patch_means(light: ChartLight) -> Float64Array:
    """Irradiance of every patch without its margin, (P, B) [W m⁻² nm⁻¹].

    All have the spectrum of the lamp, the mean of theirs; the render noise is in their levels.
    """
    bands = light.data.shape[-1]
    patches = light.data.reshape(GRID, RENDERED_PX, GRID, RENDERED_PX, bands)
    inside = slice(MARGIN_PX, -MARGIN_PX)
    means = patches[:, inside, :, inside].mean(axis=(1, 3)).reshape(-1, bands)
    levels = means @ light.bands.bandwidths_nm
    return np.asarray(levels[:, None] * means.sum(axis=0) / levels.sum())


def _levels(setting: Setting, light: ChartLight) -> Float64Array:
    """Mean photons per pixel of every patch, (P, B), the brightest near saturation behind the filter that sees most."""
    camera = setting.camera
    photons = light.photons(camera, setting.exposure, _patch_means(light))
    most_e = levels_of_filters(camera, photons[-1], light.bands).max()
    return np.asarray(photons * (BRIGHTEST * saturation_e(camera) / most_e))


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
    columns = _patch_side(camera)[1] // len(camera.tile[0])
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
    columns = camera.readout.prnu_col / math.sqrt(PATCH_PX)
    share = SIGMAS * math.hypot(columns, camera.pixel.prnu / PATCH_PX)
    return Said(value, value * (1 - share), value * (1 + share))
