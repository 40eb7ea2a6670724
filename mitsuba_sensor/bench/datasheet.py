"""What the datasheet of a camera says of the figures that the laboratory measures."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from ..camera.camera import Camera
from ..camera.figures import QUANTISATION_DN2, emva_figures
from ..core import Exposure
from ..lab.frames.stack import COARSE_DN2
from ..stages.effects.dark_current import dark_current_model, mean_dark_e
from ..stages.stage import place_of_count

SMALL_K = 0.01
"""Half the temperature step of the derivative of the dark current [K]."""

SIGMAS = 4.0
"""As far as a figure of one chip may be from the datasheet's: once in 16 000 figures it is farther by chance."""


class Said(NamedTuple):
    """A figure of the datasheet, and the range in which that of one chip lies, measured as EMVA 1288 does."""

    value: float
    low: float
    high: float


def expected(
    camera: Camera, exposure: Exposure, efficiency: float | None, pixels: int
) -> dict[str, Said]:
    """Figures by symbol, of so many pixels behind one colour filter. What the camera does not have is 0.

    Means over the pixels of one chip differ from the model's by what is left of its fixed patterns, 4 σ/√pixels here.
    Saturation is measured at the maximum of the temporal variance, where the brightest pixels begin to saturate: up to
    4 σ of shot noise and PRNU below the full well.
    exposure : of the flat fields and of the dark frames beside them.
    efficiency : QE of the filter for the light; without it there is none.
    """
    figures, readout, pixel, dark = (
        emva_figures(camera, exposure),
        camera.readout,
        camera.pixel,
        camera.dark_current,
    )
    gain, full_e = figures.system_gain_dn_per_e, figures.saturation_e
    exact = {
        "K": gain,
        "K·σ_d": gain * figures.temporal_dark_noise_e,
        "σ_d": figures.temporal_dark_noise_e,
        "µ_e.min": figures.absolute_sensitivity_e,
        "σ_row": readout.row_noise_e,
        "σ_col": readout.column_noise_e,
        "DSNU1288_row": readout.dsnu_row * pixel.full_well_e,
        "DSNU1288_col": readout.dsnu_col * pixel.full_well_e * readout.dsnu_residual,
        "PRNU1288_row": 0.0,
        "PRNU1288_col": 100 * readout.prnu_col,
        "PRNU1288_pixel": 100 * pixel.prnu,
        "RTS": 100 * dark.rts_fraction,
    }
    found = {symbol: Said(value, value, value) for symbol, value in exact.items()}
    if (gain * figures.temporal_dark_noise_e) ** 2 + QUANTISATION_DN2 >= COARSE_DN2:
        found["K_scene"] = found["K"]  # below, rounding bends the curve of a scene's dark rows
    near_e = SIGMAS * math.hypot(math.sqrt(full_e), pixel.prnu * full_e)
    sat = found["µ_e.sat"] = Said(full_e, full_e - near_e, full_e)
    if place_of_count(camera.stages):
        found["SNR_max"] = Said(*(math.sqrt(max(value, 0.0)) for value in sat))
    found["DR"] = Said(*(value / figures.absolute_sensitivity_e for value in sat))
    prnu = found["PRNU1288_pixel"], found["PRNU1288_col"], found["PRNU1288_row"]
    found["PRNU1288"] = _together(prnu)
    if efficiency is not None:
        found["η"] = _about(efficiency, SIGMAS * pixel.prnu / math.sqrt(pixels))
    if not dark.components and not dark.rts_fraction:
        rate = mean_dark_e(camera, Exposure(1.0, exposure.temperature_k))
        found["µ_I.mean"] = _about(rate, SIGMAS * dark.cv / math.sqrt(pixels))
        spread = math.hypot(
            pixel.dsnu_e * readout.dsnu_residual, mean_dark_e(camera, exposure) * dark.cv
        )
        found["DSNU1288_pixel"] = Said(spread, spread, spread)
        dsnu = found["DSNU1288_pixel"], found["DSNU1288_col"], found["DSNU1288_row"]
        found["DSNU1288"] = _together(dsnu)
        if rate > 0:
            found["T_d"] = _about(_doubling_k(camera, exposure.temperature_k), 0.0)
    return found


def _together(parts: Iterable[Said]) -> Said:
    """The standard deviation of independent patterns of rows, columns and pixels together."""
    total = math.hypot(*(part.value for part in parts))
    return Said(total, total, total)


def _about(value: float, share: float) -> Said:
    return Said(value, value * (1 - share), value * (1 + share))


def _doubling_k(camera: Camera, temperature_k: float) -> float:
    """ln 2 / (d ln D / dT) at this temperature [K]."""
    model = dark_current_model(camera)
    below, above = (model.rate_e_per_s(temperature_k + step) for step in (-SMALL_K, SMALL_K))
    return math.log(2) * 2 * SMALL_K / math.log(above / below)
