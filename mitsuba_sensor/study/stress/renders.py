"""Renders of a sky whose irradiance has a closed form: radiances to 1e30, a million samples."""

from __future__ import annotations

import math

import numpy as np

import mitsuba_sensor as ms

from .case import CASES, TENTH, Engine, Got, Row, Rows, table1, together, within

LEVEL = 0.07
"""Radiance [W m⁻² sr⁻¹ nm⁻¹]; no multiple of it is exact in float32, so that sums are rounded."""

LARGEST_PASS = 1024
"""Samples per pixel of a pass: it loses 3e-5 at most."""

ROUNDINGS, ROUNDOFF = 4, 2.0**-24
"""Of a float32 irradiance (IEEE 754), beside those of its sum."""


def irradiance(radiance: float = LEVEL) -> float:
    """E = πL/(4N²) [W m⁻² nm⁻¹]."""
    return math.pi * radiance / (4 * table1().lens.f_number ** 2)


def allowed_loss(samples: int) -> float:
    """Relative error of a float32 sum of so many equal values: n·2⁻²⁵, and of four roundings."""
    return samples * ROUNDOFF / 2 + ROUNDINGS * ROUNDOFF


def radiances(engine: Engine) -> Rows:
    """Irradiance by its closed form, and a frame of it."""
    for radiance in CASES["renders"]["radiances"]:
        light = engine.render(parameters={"radiance": radiance, "size": 2}, spp=16)
        exact = irradiance(radiance)
        digital = ms.expose(ms.collect(light, table1(), TENTH), table1(), TENTH).digital
        is_full = radiance >= 1.0
        frame = Got(
            f"up to {digital.max()} DN",
            bool(digital.min() == 4095 if is_full else digital.max() < 4095),
        )
        finite = Got("finite error bars", bool(np.isfinite(light.standard_error).all()))
        got = together(
            within(light.data, exact, allowed_loss(16) * exact, " W/m²/nm"), finite, frame
        )
        expected = "the closed form to float32's roundings; 4095 DN beyond the well"
        yield Row("irradiance, frame", f"{radiance:g} W m⁻² sr⁻¹ nm⁻¹", expected, got)


def samples(engine: Engine) -> Rows:
    """Passes are added up in float64; what is left is what one pass loses."""
    for spp in CASES["renders"]["samples"]:
        if spp > 10_000 and engine.option != "scalar_spectral":
            continue
        light = engine.render(parameters={"radiance": LEVEL, "size": 1}, spp=spp)
        each = light.statistics.samples_per_pixel // light.statistics.passes
        off = float(light.data.ravel()[0]) / irradiance() - 1
        text = f"{off:+.1e}: {light.statistics.passes} passes of {each}"
        got = Got(text, abs(off) <= allowed_loss(min(each, LARGEST_PASS)))
        yield Row(
            "irradiance",
            f"{spp} samples",
            "E = πL/(4N²) to n·2⁻²⁵ for n samples of a pass",
            got,
        )
