"""The EMVA 1288 figures that follow from a camera's datasheet, with the range of single sensor units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..camera.camera import Camera
from ..camera.figures import QUANTISATION_DN2, emva_figures
from ..core import Exposure
from ..lab.frames.stack import COARSE_DN2
from ..stages.effects.dark_current import dark_current_model, mean_dark_e
from ..stages.stage import place_of_count

DERIVATIVE_STEP_K = 0.01
"""Half the temperature step of the derivative of the dark current [K]."""
SIGMAS = 4.0
"""Largest deviation of a single sensor unit from the datasheet: chance exceeds it in one of 16 000 figures."""


class Said(NamedTuple):
    """A figure of the datasheet, and its range among single sensor units, measured as EMVA 1288 requires."""

    value: float
    low: float
    high: float


def expected(
    camera: Camera, exposure: Exposure, efficiency: float | None, pixels: int
) -> dict[str, Said]:
    """Return figures by symbol for this many pixels under one colour filter. Absent effects are 0.

    The mean over the pixels of one unit differs from the model's by what its fixed patterns leave, up to 4 σ/√pixels.
    Saturation is measured at the maximum of the temporal variance, where the brightest pixels begin to saturate: up to
    4 σ of shot noise and PRNU below the full well.
    exposure : of the flat fields and their dark frames.
    efficiency : QE of the filter for the light; None omits η.
    """
    figures, readout, pixel = emva_figures(camera, exposure), camera.readout, camera.pixel
    dark, gain, full_e = camera.dark_current, figures.system_gain_dn_per_e, figures.saturation_e
    row_e, column_e = (
        readout.dsnu_row * pixel.full_well_e,
        readout.dsnu_col * pixel.full_well_e * readout.dsnu_residual,
    )
    column_percent, pixel_percent = 100 * readout.prnu_col, 100 * pixel.prnu
    exact = {
        "K": gain,
        "K·σ_d": gain * figures.temporal_dark_noise_e,
        "σ_d": figures.temporal_dark_noise_e,
        "µ_e.min": figures.absolute_sensitivity_e,
        "σ_row": readout.row_noise_e,
        "σ_col": readout.column_noise_e,
        "DSNU1288_row": row_e,
        "DSNU1288_col": column_e,
        "PRNU1288_row": 0.0,
        "PRNU1288_col": column_percent,
        "PRNU1288_pixel": pixel_percent,
        "PRNU1288": math.hypot(pixel_percent, column_percent),
        "RTS": 100 * dark.rts_fraction,
    }
    if (gain * figures.temporal_dark_noise_e) ** 2 + QUANTISATION_DN2 >= COARSE_DN2:
        exact["K_scene"] = gain  # below, rounding bends the curve of a scene's dark rows
    near_e = SIGMAS * math.hypot(math.sqrt(full_e), pixel.prnu * full_e)
    saturation = Said(full_e, full_e - near_e, full_e)
    said = {"µ_e.sat": saturation}
    if place_of_count(camera.stages):
        said["SNR_max"] = Said(*(math.sqrt(max(value, 0.0)) for value in saturation))
    said["DR"] = Said(*(value / figures.absolute_sensitivity_e for value in saturation))
    if efficiency is not None:
        said["η"] = _about(efficiency, SIGMAS * pixel.prnu / math.sqrt(pixels))
    if not dark.components and not dark.rts_fraction:
        rate = mean_dark_e(camera, Exposure(1.0, exposure.temperature_k))
        said["µ_I.mean"] = _about(rate, SIGMAS * dark.cv / math.sqrt(pixels))
        spread_e = mean_dark_e(camera, exposure) * dark.cv
        exact["DSNU1288_pixel"] = math.hypot(pixel.dsnu_e * readout.dsnu_residual, spread_e)
        exact["DSNU1288"] = math.hypot(exact["DSNU1288_pixel"], column_e, row_e)
        if rate > 0:
            exact["T_d"] = _doubling_k(camera, exposure.temperature_k)
    return {symbol: Said(*3 * (value,)) for symbol, value in exact.items()} | said


Datasheet = Mapping[str, Mapping[str, Said]]
"""Figures by the name of the colour filter (empty for a monochrome camera) and by symbol."""


def filter_keys(camera: Camera) -> tuple[str, ...]:
    """Return the names of the colour filters; one empty name for a monochrome camera."""
    return camera.filter_names if len(camera.filter_names) > 1 else ("",)


def expected_of_filters(
    camera: Camera, exposure: Exposure, efficiency: Sequence[float] | None, pixels: int
) -> Datasheet:
    """Return the figures under each colour filter.  efficiency : QE of each filter for the light, or None."""
    keys = filter_keys(camera)
    each = [None] * len(keys) if efficiency is None else efficiency
    return {
        key: expected(camera, exposure, qe, pixels) for key, qe in zip(keys, each, strict=True)
    }


def of_filter(datasheet: Datasheet, name: str) -> Mapping[str, Said]:
    """Return the figures of one plane of a mosaic; G (2) is the second plane of the filter G."""
    for known in (name, name.partition(" (")[0], ""):
        if known in datasheet:
            return datasheet[known]
    return {}


def _about(value: float, share: float) -> Said:
    return Said(value, value * (1 - share), value * (1 + share))


def _doubling_k(camera: Camera, temperature_k: float) -> float:
    """ln 2 / (d ln D / dT) at this temperature [K]."""
    model, step_k = dark_current_model(camera), DERIVATIVE_STEP_K
    below, above = (model.rate_e_per_s(temperature_k + step) for step in (-step_k, step_k))
    return math.log(2) * 2 * step_k / math.log(above / below)
