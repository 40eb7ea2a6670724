"""Closed-form theory of the two charts that measure noise: EMVA 1288 and the step chart."""

from __future__ import annotations

import math

from ...camera.camera import Camera
from ...camera.figures import QUANTISATION_DN2, emva_figures
from ...core import Exposure
from ...lab.frames.bench import Bench
from ...lab.frames.stack import COARSE_DN2, rounding_shift_dn
from ...lab.measure.image_quality.step_chart import NOISE_CONSTANT, SATURATION_CONSTANT
from ...stages.stage import converter_of
from ..datasheet import SIGMAS, Datasheet, Said, expected, expected_of_filters, filter_keys
from ..virtual_bench import bench_shape, best_wavelength_nm, field_at
from .chart import Lights, Setting
from .charts import EMVA_SIDE
from .optics import levels_of_filters
from .patches import STEPS_GRID, steps_light

DEFAULT_TEMPERATURE_K = 298.15
"""Temperature of frames that do not state theirs."""
SMOOTH_DN2 = 2 * COARSE_DN2
"""Smallest variance of codes to which rounding adds 1/12 DN², within 0.001 DN²; below there is no theory of noise."""
ROUNDING_DN = 0.5
"""Largest shift of a mean by rounding."""


def closed_form(name: str, setting: Setting, lights: Lights) -> Datasheet:
    """Return the theory of a chart by its name."""
    camera = setting.camera
    if name == "steps":
        photons, exposures = steps_light(setting, lights[0])
        electrons = levels_of_filters(camera, photons[-1], lights[0].bands) / exposures[-1]
        return {
            name: steps_figures(setting, float(per_lxs), float(exposures.mean()))
            for name, per_lxs in zip(filter_keys(camera), electrons, strict=True)
        }
    rows, columns = bench_shape(camera, EMVA_SIDE)
    pixels = (rows // len(camera.tile)) * (columns // len(camera.tile[0]))
    efficiency = field_at(camera, best_wavelength_nm(camera)).efficiency.tolist()
    return expected_of_filters(camera, setting.exposure, efficiency, pixels)


def theory_of_bench(camera: Camera, bench: Bench) -> Datasheet:
    """Return a datasheet's figures for frames from disk, at the exposure of their flat fields."""
    first = next(iter((*bench.flats, *bench.stacks)))
    kelvin = DEFAULT_TEMPERATURE_K if first.temperature_k is None else first.temperature_k
    exposure = Exposure(min(one.exposure_s for one in bench.flats or (first,)), kelvin)
    pixels = next(iter(first.of_filters().values())).mean.size
    efficiency = None
    if bench.wavelength_nm is not None:
        efficiency = field_at(camera, bench.wavelength_nm).efficiency.tolist()
    return expected_of_filters(camera, exposure, efficiency, pixels)


def steps_figures(
    setting: Setting, electrons_per_lxs: float, mean_lxs: float
) -> dict[str, Said]:
    """Return the figures of a step chart under one filter, for a camera with a linear response.

    mean_lxs : mean exposure of the patches; a black level that rounding shifts changes their slope in proportion.
    """
    camera = setting.camera
    emva, adc = emva_figures(camera, setting.exposure), converter_of(camera.stages)
    gain = emva.system_gain_dn_per_e
    response, largest_dn = gain * electrons_per_lxs, adc.highest - adc.black_level_dn
    temporal_dn2 = (gain * emva.temporal_dark_noise_e) ** 2 + QUANTISATION_DN2
    black_dn = min(SIGMAS * rounding_shift_dn(temporal_dn2), ROUNDING_DN)
    share = _share_of_unit(camera) + black_dn / (response * mean_lxs)
    saturation = SATURATION_CONSTANT * response / largest_dn
    said = {
        symbol: Said(value, value * (1 - share), value * (1 + share))
        for symbol, value in {"s": response, "S_sat": saturation}.items()
    }
    if temporal_dn2 >= SMOOTH_DN2:
        decibel = 20 * math.log10(largest_dn / _signal(1.0, temporal_dn2, gain, 0.0))
        said["DR"] = Said(decibel, decibel, decibel)
    for ratio in (40, 10):
        signals_dn = [
            _signal(float(ratio), temporal_dn2 + dark_dn2, gain, prnu2)
            for dark_dn2, prnu2 in _fixed_patterns(setting, gain)
        ]
        is_smooth = temporal_dn2 + gain * min(signals_dn) >= SMOOTH_DN2
        if is_smooth and max(signals_dn) < largest_dn:
            speeds = [NOISE_CONSTANT * response / signal_dn for signal_dn in signals_dn]
            said[f"S_noise{ratio}"] = Said(speeds[0], min(speeds), max(speeds))
    return said


def _fixed_patterns(setting: Setting, gain: float) -> list[tuple[float, float]]:
    """Return the DSNU variance [DN²] and squared PRNU in a patch: the camera's, the least, and the most that the few
    columns of a patch may have."""
    camera = setting.camera
    columns = STEPS_GRID.side(camera)[1] // len(camera.tile[0])
    patterns = expected(camera, setting.exposure, None, 1)
    nothing = Said(0.0, 0.0, 0.0)
    pixel, column, row = (
        patterns.get(f"DSNU1288_{name}", nothing).value for name in ("pixel", "col", "row")
    )
    variances = []
    for sigmas in (0.0, -SIGMAS, SIGMAS):
        share = max(1 + sigmas * math.sqrt(2 / columns), 0.0)
        dark_e2 = pixel**2 + share * (column**2 + row**2)
        prnu2 = camera.pixel.prnu**2 + share * camera.readout.prnu_col**2
        variances.append((gain**2 * dark_e2, prnu2))
    return variances


def _signal(ratio: float, dark_dn2: float, gain: float, prnu2: float) -> float:
    """Return the signal y [DN] with this ratio to the noise √(dark + K·y + PRNU²·y²); infinite if none has it."""
    rest = 1 - ratio**2 * prnu2
    if rest <= 0:
        return math.inf
    linear = ratio**2 * gain
    return (linear + math.sqrt(linear**2 + 4 * rest * ratio**2 * dark_dn2)) / (2 * rest)


def _share_of_unit(camera: Camera) -> float:
    """Return the largest relative deviation of the brightest patch's response, from the PRNU of its columns."""
    columns = camera.readout.prnu_col / math.sqrt(STEPS_GRID.patch_px)
    return SIGMAS * math.hypot(columns, camera.pixel.prnu / STEPS_GRID.patch_px)
