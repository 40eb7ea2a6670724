"""The fields of a camera file from the figures of a gain setting, each with its source."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from ..quantity import Quantity
from .evidence import Fitted
from .setting import Setting

ASSUMED_K = 298.15
"""Temperature that frames are taken to have where they do not say."""
BEYOND = 2.0
"""Full well over the largest signal, where the ADC ends first: far enough that it never does."""


class Value(NamedTuple):
    """A field of a camera file, ``table.key``; None unsets it.  source : where it comes from; empty for none."""

    name: str
    value: Any
    source: str = ""


def fields_of(setting: Setting) -> Iterator[Value]:
    """Everything that frames show, and what must not be in the file beside it."""
    yield from _sensor(setting)
    yield from _pixel(setting)
    yield from _dark(setting)
    yield from _noise(setting)
    yield from _converter(setting)


def full_well(setting: Setting) -> Value:
    """Full well of a setting where it ends the range, or a value beyond the ADC's range."""
    brightest = setting.brightest
    end = setting.electrons(brightest.end)
    if brightest.knee is not None:
        well_e = setting.knee_figure("full_well").quantity
        return Value("pixel.full_well_e", well_e.value, setting.knee_figure("full_well").source)
    if brightest.limited_by == "well":
        return Value("pixel.full_well_e", end.quantity.value, end.source)
    where = "the brightest flat field is"
    if brightest.limited_by == "ADC":
        where = "the ADC ends"
    text = f"assumed: {BEYOND:g} times {end.quantity.value:.4g} e-, where {where}; {end.frames}"
    return Value("pixel.full_well_e", BEYOND * end.quantity.value, text)


def _sensor(setting: Setting) -> Iterator[Value]:
    rows, columns = setting.shape
    yield Value("sensor.rows", rows, "fit: the size of the frames")
    yield Value("sensor.columns", columns, "fit: the size of the frames")


def _pixel(setting: Setting) -> Iterator[Value]:
    yield _fitted("pixel.prnu", setting.prnu("pixel"), "no flat field near half saturation")
    yield Value("pixel.prnu_distribution", "gaussian")
    yield Value("pixel.prnu_coupling", 0.0)
    yield full_well(setting)
    yield _fitted(
        "pixel.full_well_knee_e",
        setting.knee_figure("knee"),
        "a clip gives the variances as well",
    )
    yield _fitted("pixel.dsnu_e", setting.electrons(_offsets(setting, "pixel")), "")
    yield Value("pixel.dsnu_coupling", 0.0)


def _offsets(setting: Setting, part: str) -> Fitted:
    """DSNU of the pixels, rows or columns [DN]."""
    value, low, high = setting.dark.offsets.spread()[part]
    dsnu = Quantity(f"DSNU_{part}", "dark signal non-uniformity", value, low, high, "DN", "fit")
    if low == 0:
        dsnu = dsnu.noted("not told from 0")
    return setting.dark.black.known_as(dsnu)


def _dark(setting: Setting) -> Iterator[Value]:
    dark = setting.dark
    for name in ("fom_na_per_cm2", "diffusion_fom_na_per_cm2", "components"):
        yield Value(f"dark_current.{name}", None)
    yield Value("dark_current.rts_at_temperature_k", None)
    yield _fitted("dark_current.rate_e_per_s", setting.electrons(dark.rate, "e-/s"), "")
    if setting.temperature_k is None:
        kelvin, source = ASSUMED_K, "assumed: frames do not say it"
    else:
        kelvin, source = setting.temperature_k, "fit: the temperature of the frames"
    yield Value("dark_current.at_temperature_k", kelvin, source)
    doubling = setting.doubling
    if doubling is not None:
        yield Value("dark_current.doubling_k", doubling.quantity.value, doubling.source)
    yield _fitted("dark_current.cv", dark.cv, "")
    family, source = "lognormal", "assumed: frames do not tell it"
    if dark.family:
        family, source = dark.family, f"fit: smallest BIC of four, {dark.rate.frames}"
    yield Value("dark_current.distribution", family, source)
    yield Value("dark_current.coupling", 0.0)
    yield from _telegraph(setting)


def _telegraph(setting: Setting) -> Iterator[Value]:
    traps = setting.telegraph
    if traps is None:
        yield Value("dark_current.rts_fraction", 0.0)
        return
    yield _fitted("dark_current.rts_fraction", traps.share, "")
    step = setting.electrons(traps.step, "e-/s")
    yield _fitted("dark_current.rts_amplitude_e_per_s", step, "")
    yield _fitted("dark_current.rts_switching", traps.switching, "")
    yield _fitted("dark_current.rts_duty", traps.duty, "")


def _noise(setting: Setting) -> Iterator[Value]:
    noise, shape = setting.noise, setting.noise.shape
    yield Value("source_follower.white_nv_per_rthz", None)
    yield Value("source_follower.band_hz", None)
    yield _fitted("source_follower.read_noise_e", setting.electrons(noise.read), "")
    yield _fitted("source_follower.read_noise_cv", noise.cv, "")
    yield Value("source_follower.read_noise_distribution", noise.law.name, noise.law.said)
    if shape.known:
        yield Value("source_follower.read_noise_shape", shape.quantity.value, shape.source)
    else:
        yield Value("source_follower.read_noise_shape", None)
    yield from _noisy_pixels(setting)
    yield Value("source_follower.rtn_uv", 0.0)
    yield Value("source_follower.rtn_pixel_fraction", 0.0)
    yield _fitted("readout.row_noise_e", setting.electrons(noise.row), "")
    yield _fitted("readout.column_noise_e", setting.electrons(noise.column), "")
    yield _fitted("readout.frame_noise_e", setting.electrons(setting.frame), "")
    yield Value(
        "readout.reset", "true_cds", "fit: all noise of the dark frames is in read_noise_e"
    )
    yield Value("readout.ktc_residual", None)


def _converter(setting: Setting) -> Iterator[Value]:
    well_e = full_well(setting).value
    for name in ("col", "row"):
        offsets = setting.electrons(_offsets(setting, name))
        share = offsets.known_as(offsets.quantity.scaled(1 / well_e, "full wells"))
        yield _fitted(f"readout.dsnu_{name}", share, "")
        yield Value(f"readout.dsnu_{name}_coupling", 0.0)
    yield Value("readout.dsnu_residual", 1.0)
    columns = setting.prnu("column")
    yield _fitted("readout.prnu_col", columns, "no flat field near half saturation")
    yield Value("readout.prnu_col_coupling", 0.0)
    yield Value("readout.ve_nonlinearity", 0.0)
    ratio = setting.brightest.ratio
    source = ratio.source
    if ratio.quantity.value == 1:
        source = f"fit: no curvature, {ratio.frames}"
    gamma = _ratio_at_full_well(ratio.quantity.value, setting, well_e)
    yield Value("source_follower.vv_nonlinearity", gamma, source)
    bits_source = "assumed: the fewest that hold the largest code"
    if setting.bits_known:
        bits_source = "the metadata"
    yield Value("adc.bits", setting.bits, bits_source)
    yield _fitted("adc.black_level_dn", setting.dark.black, "")
    for name in ("gamma", "ile"):
        yield Value(f"adc.{name}", None)
    yield _code_widths(setting)


def _code_widths(setting: Setting) -> Value:
    """Widths of the codes where the response is that of the noise; all alike elsewhere."""
    brightest = setting.brightest
    if brightest.curve is None:
        return Value("adc.dnl_lsb", None)
    widths = brightest.curve.widths(setting.dark.black.quantity.value, setting.bits)
    return Value("adc.dnl_lsb", widths, f"fit: response by the noise, {brightest.gain.frames}")


def _noisy_pixels(setting: Setting) -> Iterator[Value]:
    """Share and factor of the noisy pixels, or none."""
    noise = setting.noise
    yield _fitted("source_follower.noisy_pixel_fraction", noise.noisy, "")
    if noise.factor.known:
        yield Value(
            "source_follower.noisy_pixel_factor",
            noise.factor.quantity.value,
            noise.factor.source,
        )
    else:
        yield Value("source_follower.noisy_pixel_factor", 1.0)


def _ratio_at_full_well(ratio: float, setting: Setting, well_e: float) -> float:
    """γ of the file, which is that at the full well, from γ at the largest signal."""
    largest = setting.brightest.end.quantity.value / setting.gain.quantity.value
    return 1 + (ratio - 1) * well_e / largest


def _fitted(name: str, figure: Fitted, why: str) -> Value:
    """The fitted value, or 0 with the reason."""
    if figure.known:
        return Value(name, max(figure.quantity.value, 0.0), figure.source)
    reason = figure.quantity.note or why or "frames do not show it"
    return Value(name, 0.0, f"assumed: {reason}")
