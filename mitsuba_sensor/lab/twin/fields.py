"""Fields of a camera file from the figures of a gain setting, each with its source."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from ..frames.stack import ROUNDING_DN2
from .evidence import Fitted
from .read_law import NORMAL_TAU4, tukey_shape
from .setting import Setting

ASSUMED_K = 298.15
"""Temperature that is assumed for frames without one [K]."""
WELL_RATIO = 2.0
"""Assumed full well over the largest signal, if the ADC saturates first: so large that it has no effect."""
NORMAL_SHAPE = tukey_shape(NORMAL_TAU4)
"""λ of Tukey's distribution with the τ₄ of a normal distribution: 0.142."""
NO_FLAT = "no flat field near half saturation"
NOT_SHOWN: dict[str, Any] = {
    "pixel.prnu_distribution": "gaussian",
    "pixel.prnu_coupling": 0.0,
    "pixel.full_well_knee_e": 0.0,
    "pixel.dsnu_coupling": 0.0,
    "dark_current.fom_na_per_cm2": None,
    "dark_current.diffusion_fom_na_per_cm2": None,
    "dark_current.components": None,
    "dark_current.rts_at_temperature_k": None,
    "dark_current.coupling": 0.0,
    "dark_current.rts_fraction": 0.0,
    "source_follower.white_nv_per_rthz": None,
    "source_follower.band_hz": None,
    "source_follower.read_noise_cv": 0.0,
    "source_follower.noisy_pixel_fraction": 0.0,
    "source_follower.noisy_pixel_factor": 1.0,
    "source_follower.rtn_uv": 0.0,
    "source_follower.rtn_pixel_fraction": 0.0,
    "readout.em_gain": None,  # the fitted K contains it
    "readout.ktc_residual": None,
    "readout.dsnu_col_coupling": 0.0,
    "readout.dsnu_row_coupling": 0.0,
    "readout.dsnu_residual": 1.0,
    "readout.prnu_col_coupling": 0.0,
    "readout.ve_nonlinearity": 0.0,
    "adc.gamma": None,
    "adc.ile": None,
    "adc.dnl_lsb": None,
}
"""Fields of effects that the fitted figures include or the twin does not have; None unsets a field."""


class Value(NamedTuple):
    """A field of a camera file, ``table.key``; the value None unsets it.  source : origin of the value, or empty."""

    name: str
    value: Any
    source: str = ""


def fields_of(setting: Setting, tails: bool = False) -> Iterator[Value]:
    """Yield the fields that frames show, and those that must not be in the same file.

    tails : True if the read noise of some gain setting has Tukey's distribution.
    """
    for name, value in NOT_SHOWN.items():
        yield Value(name, value)
    yield Value("sensor.rows", setting.shape[0], "fit: the size of the frames")
    yield Value("sensor.columns", setting.shape[1], "fit: the size of the frames")
    electrons, dark, well_e = setting.electrons, setting.dark, full_well(setting).value
    yield _fitted("pixel.prnu", setting.prnu("pixel"), NO_FLAT)
    yield _fitted("readout.prnu_col", setting.prnu("col"), NO_FLAT)
    yield full_well(setting)
    yield _fitted("pixel.dsnu_e", electrons(dark.dsnu("pixel")))
    for part in ("row", "col"):
        dsnu = electrons(dark.dsnu(part))
        share = dsnu.quantity.scaled(1 / well_e, "full wells")
        yield _fitted(f"readout.dsnu_{part}", dsnu.known_as(share))
    yield from _dark_current(setting)
    yield read_noise_e(setting)
    law, shape = setting.law, setting.law.value
    tails = tails or math.isfinite(shape)
    name = "tukey_lambda" if tails else "normal"
    yield Value("source_follower.read_noise_distribution", name, f"fit: {law.note}")
    value = (shape if math.isfinite(shape) else NORMAL_SHAPE) if tails else None
    yield Value("source_follower.read_noise_shape", value, f"fit: {law.note}" if tails else "")
    yield _fitted("readout.row_noise_e", electrons(setting.row))
    yield _fitted("readout.column_noise_e", electrons(setting.column))
    yield _fitted("readout.frame_noise_e", electrons(setting.frame))
    in_read_noise = "fit: all noise of the dark frames is in read_noise_e"
    yield Value("readout.reset", "true_cds", in_read_noise)
    yield _gain_ratio(setting, well_e)
    bits_source = "the metadata"
    if not setting.bits_known:
        bits_source = "assumed: the fewest that hold the largest code"
    yield Value("adc.bits", setting.bits, bits_source)
    yield _fitted("adc.black_level_dn", dark.black)


def full_well(setting: Setting) -> Value:
    """Return the full well of a setting, or a value above the ADC's range if the pixel does not saturate first."""
    brightest = setting.brightest
    end = setting.electrons(brightest.end)
    if brightest.limited_by == "well":
        return Value("pixel.full_well_e", end.quantity.value, end.source)
    where = (
        "the ADC saturates" if brightest.limited_by == "ADC" else "the brightest flat field is"
    )
    end_e = end.quantity.value
    text = f"assumed: {WELL_RATIO:g} times {end_e:.4g} e-, where {where}; {end.frames}"
    return Value("pixel.full_well_e", WELL_RATIO * end_e, text)


def read_noise_e(setting: Setting) -> Value:
    """Return the read noise or, if rounding hides it, the excess of the variance over 1/12 DN² as an assumption."""
    name, read = "source_follower.read_noise_e", setting.electrons(setting.read)
    if read.known:
        return _fitted(name, read)
    variance = setting.dark.quiet.changes.variance
    assumed = math.sqrt(max(variance - ROUNDING_DN2, 0.0)) / setting.gain.quantity.value
    return Value(name, assumed, f"assumed: {read.quantity.note}")


def _dark_current(setting: Setting) -> Iterator[Value]:
    """Yield rate, temperature, doubling, spread and distribution of the dark current."""
    dark = setting.dark
    yield _fitted("dark_current.rate_e_per_s", setting.electrons(dark.rate))
    kelvin, source = dark.quiet.temperature_k, "fit: the temperature of the frames"
    if kelvin is None:
        kelvin, source = ASSUMED_K, "assumed: frames do not state it"
    yield Value("dark_current.at_temperature_k", kelvin, source)
    if setting.doubling is not None:
        doubling = setting.doubling
        yield Value("dark_current.doubling_k", doubling.quantity.value, doubling.source)
    yield _fitted("dark_current.cv", dark.cv)
    family, source = "lognormal", "assumed: frames do not show it"
    if dark.distribution:
        family, source = dark.distribution, f"fit: smallest BIC of four, {dark.rate.frames}"
    yield Value("dark_current.distribution", family, source)


def _gain_ratio(setting: Setting, well_e: float) -> Value:
    """Return γ at the full well from γ at the largest signal."""
    ratio = setting.brightest.ratio
    source = ratio.source
    if ratio.quantity.value == 1:
        source = f"fit: no curvature, {ratio.frames}"
    largest_e = setting.brightest.end.quantity.value / setting.gain.quantity.value
    gamma = 1 + (ratio.quantity.value - 1) * well_e / largest_e
    return Value("source_follower.vv_nonlinearity", gamma, source)


def _fitted(name: str, figure: Fitted, why: str = "") -> Value:
    """Return the fitted value, or 0 with the reason."""
    if figure.known:
        return Value(name, max(figure.quantity.value, 0.0), figure.source)
    reason = figure.quantity.note or why or "frames do not show it"
    return Value(name, 0.0, f"assumed: {reason}")
