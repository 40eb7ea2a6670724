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


def fields_of(one: Setting) -> Iterator[Value]:
    """Everything that frames show, and what must not be in the file beside it."""
    yield from _sensor(one)
    yield from _pixel(one)
    yield from _dark(one)
    yield from _noise(one)
    yield from _converter(one)


def full_well(one: Setting) -> Value:
    """Where the well ends the range, or beyond the ADC's."""
    best = one.brightest
    end = one.electrons(best.end)
    if best.limited_by == "well":
        return Value("pixel.full_well_e", end.quantity.value, end.source)
    where = "the ADC ends" if best.limited_by == "ADC" else "the brightest flat field is"
    text = f"assumed: {BEYOND:g} times {end.quantity.value:.4g} e-, where {where}; {end.frames}"
    return Value("pixel.full_well_e", BEYOND * end.quantity.value, text)


def _sensor(one: Setting) -> Iterator[Value]:
    rows, columns = one.shape
    yield Value("sensor.rows", rows, "fit: the size of the frames")
    yield Value("sensor.columns", columns, "fit: the size of the frames")


def _pixel(one: Setting) -> Iterator[Value]:
    yield _number("pixel.prnu", one.prnu("pixel"), "no flat field near half saturation")
    yield Value("pixel.prnu_distribution", "gaussian")
    yield Value("pixel.prnu_coupling", 0.0)
    yield full_well(one)
    yield _number("pixel.dsnu_e", one.electrons(_offsets(one, "pixel")), "")
    yield Value("pixel.dsnu_coupling", 0.0)


def _offsets(one: Setting, part: str) -> Fitted:
    value, low, high = one.dark.offsets.spread()[part]
    found = Quantity(
        f"DSNU_{part}", "dark signal non-uniformity", value, low, high, "DN", "fit"
    )
    return one.dark.black.known_as(found.noted("not told from 0") if low == 0 else found)


def _dark(one: Setting) -> Iterator[Value]:
    dark, kelvin = one.dark, one.temperature_k
    unset = ("fom_na_per_cm2", "diffusion_fom_na_per_cm2", "components", "rts_at_temperature_k")
    yield from (Value(f"dark_current.{name}", None) for name in unset)
    yield _number("dark_current.rate_e_per_s", one.electrons(dark.rate, "e-/s"), "")
    said = (
        "assumed: frames do not say it"
        if kelvin is None
        else "fit: the temperature of the frames"
    )
    yield Value("dark_current.at_temperature_k", ASSUMED_K if kelvin is None else kelvin, said)
    if one.doubling is not None:
        yield Value("dark_current.doubling_k", one.doubling.quantity.value, one.doubling.source)
    yield _number("dark_current.cv", dark.cv, "")
    family = (
        f"fit: smallest BIC of four, {dark.rate.frames}"
        if dark.family
        else "assumed: frames do not tell it"
    )
    yield Value("dark_current.distribution", dark.family or "lognormal", family)
    yield Value("dark_current.coupling", 0.0)
    traps = one.telegraph
    if traps is None:
        yield Value("dark_current.rts_fraction", 0.0)
        return
    yield _number("dark_current.rts_fraction", traps.share, "")
    yield _number("dark_current.rts_amplitude_e_per_s", one.electrons(traps.step, "e-/s"), "")
    yield _number("dark_current.rts_switching", traps.switching, "")
    yield _number("dark_current.rts_duty", traps.duty, "")


def _noise(one: Setting) -> Iterator[Value]:
    noise, unset = one.noise, ("white_nv_per_rthz", "band_hz")
    yield from (Value(f"source_follower.{name}", None) for name in unset)
    yield _number("source_follower.read_noise_e", one.electrons(noise.read), "")
    yield _number("source_follower.read_noise_cv", noise.cv, "")
    yield Value("source_follower.read_noise_distribution", noise.law.name, noise.law.said)
    shaped = noise.shape.known
    shape = (noise.shape.quantity.value, noise.shape.source) if shaped else (None, "")
    yield Value("source_follower.read_noise_shape", *shape)
    yield Value("source_follower.rtn_uv", 0.0)
    yield Value("source_follower.rtn_pixel_fraction", 0.0)
    yield _number("readout.row_noise_e", one.electrons(noise.row), "")
    yield _number("readout.column_noise_e", one.electrons(noise.column), "")
    yield Value(
        "readout.reset", "true_cds", "fit: all noise of the dark frames is in read_noise_e"
    )
    yield Value("readout.ktc_residual", None)


def _converter(one: Setting) -> Iterator[Value]:
    well = full_well(one).value
    for name in ("col", "row"):
        found = one.electrons(_offsets(one, name))
        found = found.known_as(found.quantity.scaled(1 / well, "full wells"))
        yield _number(f"readout.dsnu_{name}", found, "")
        yield Value(f"readout.dsnu_{name}_coupling", 0.0)
    yield Value("readout.dsnu_residual", 1.0)
    yield _number("readout.prnu_col", one.prnu("column"), "no flat field near half saturation")
    yield Value("readout.prnu_col_coupling", 0.0)
    yield Value("readout.ve_nonlinearity", 0.0)
    ratio = one.brightest.ratio
    curved = ratio.quantity.value != 1
    scaled = _at_full_well(ratio.quantity.value, one, well)
    text = ratio.source if curved else f"fit: no curvature, {ratio.frames}"
    yield Value("source_follower.vv_nonlinearity", scaled, text)
    bits = (
        "the metadata" if one.bits_known else "assumed: the fewest that hold the largest code"
    )
    yield Value("adc.bits", one.bits, bits)
    yield _number("adc.black_level_dn", one.dark.black, "")
    yield from (Value(f"adc.{name}", None) for name in ("gamma", "ile", "dnl_lsb"))


def _at_full_well(ratio: float, one: Setting, well_e: float) -> float:
    """γ is that at the largest signal; the file's is that at the full well."""
    largest = one.brightest.end.quantity.value / one.gain.quantity.value
    return 1 + (ratio - 1) * well_e / largest


def _number(name: str, found: Fitted, why: str) -> Value:
    """The fitted value, or 0 with the reason."""
    if found.known:
        return Value(name, max(found.quantity.value, 0.0), found.source)
    reason = found.quantity.note or why or "frames do not show it"
    return Value(name, 0.0, f"assumed: {reason}")
