"""Fig. 2: radiometric function of the sensor's centre, mean and standard deviation against the exposure time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mitsuba_sensor.lab.frames.series import series
from mitsuba_sensor.lab.measure.radiometric import Radiometric, radiometric
from mitsuba_sensor.pages.page import Line, Plot, Section, line
from mitsuba_sensor.study.kit import Array

from .camera import (
    CURVES,
    DARK_E_PER_S,
    EFFICIENCY,
    FRAME_S,
    FULL_PHOTONS,
    FULL_WELL_E,
    GAIN,
    LINEAR,
    PAIR,
    PRNU,
    RESPONSES,
    Size,
    stack_of,
    table1,
)
from .check import Check, all_hold, check_table, within_interval

TIMES_S = (
    0.001,
    0.002,
    0.005,
    0.01,
    0.02,
    0.03,
    0.04,
    0.05,
    0.06,
    0.07,
    0.08,
    0.09,
    0.1,
    0.11,
    0.12,
)
FRAMES = 2  # of each time; the standard deviation is that of one
BELOW_WELL = 0.95  # share of a full well up to which means are compared


class Sweep(NamedTuple):
    """Of one camera.

    result : the instrument's.  mean, spread : of the first frame at each time, with the black level [DN].
    """

    result: Radiometric
    mean: tuple[float, ...]
    spread: tuple[float, ...]


def measure(name: str, size: Size) -> Sweep:
    """Flat fields that fill the well in 0.1 s, and dark frames, of every exposure time."""
    camera = table1(**CURVES[name])
    darks = [
        stack_of(camera, t, 0.0, size, frames=FRAMES, seed=100 + k)
        for k, t in enumerate(TIMES_S)
    ]
    light = {t: FULL_PHOTONS * t / FRAME_S for t in TIMES_S}
    flats = [
        stack_of(camera, t, light[t], size, frames=FRAMES, seed=200 + k)
        for k, t in enumerate(TIMES_S)
    ]
    first = [flat.frames[0].astype(np.float64) for flat in flats]
    means, spreads = (tuple(float(f(one)) for one in first) for f in (np.mean, np.std))
    return Sweep(radiometric(series(darks, flats)), means, spreads)


def section(sweeps: dict[str, Sweep], size: Size) -> Section:
    """Plots and what must hold."""
    checks = [check for name, sweep in sweeps.items() for check in checks_of(name, sweep, size)]
    r, error = sweeps[LINEAR].result.responsivity, sweeps[LINEAR].result.linearity_error
    finding = (
        f"Radiometric function, linear: {r.value:.5f} DN per photon ({r.low:.5f} to {r.high:.5f}); K·QE is "
        f"{GAIN * EFFICIENCY:.5f}. Linearity error {error.value:.3f} %; with V/V 1.05 and ADC 1.04 "
        f"{sweeps[PAIR].result.linearity_error.value:.2f} %."
    )
    return Section(
        (finding,),
        all_hold(checks),
        (*_plots(sweeps), check_table("Fig. 2: what closed forms say", checks)),
    )


def checks_of(name: str, sweep: Sweep, size: Size) -> list[Check]:
    """The signal of every time below the well, and for the linear camera responsivity and linearity error."""
    expected = _signal(name)
    below = np.array(TIMES_S) < BELOW_WELL * FRAME_S
    off = np.abs(sweep.result.signal - expected)[below].max()
    # 5 standard errors of shot noise and PRNU, of the brightest flat field
    noise = GAIN * np.hypot(np.sqrt(FULL_WELL_E / FRAMES), PRNU * FULL_WELL_E)
    found = [
        Check(
            f"largest distance of the signal from its closed form, {name}",
            "DN",
            0.0,
            float(off),
            float(5 * noise / size.window),
        )
    ]
    if name == LINEAR:
        error = sweep.result.linearity_error
        found.append(
            within_interval(
                "responsivity R", GAIN * EFFICIENCY, sweep.result.responsivity, 2e-5
            )
        )
        found.append(Check("linearity error", "%", 0.0, error.value, 0.05 * 512 / size.window))
    return found


def _signal(name: str) -> Array:
    """Of every time, above darkness [DN]; of light beyond the well that of a full well."""
    times, response = np.array(TIMES_S), RESPONSES[name]
    dark = DARK_E_PER_S * times
    full = np.minimum(FULL_WELL_E * times / FRAME_S + dark, FULL_WELL_E)
    return np.asarray(response.signal(full) - response.signal(dark))


def _plots(sweeps: dict[str, Sweep]) -> tuple[Plot, Plot]:
    means = tuple(Line(f"{name}, mean", TIMES_S, sweep.mean) for name, sweep in sweeps.items())
    spreads = []
    for name, sweep in sweeps.items():
        pairs = [(t, spread) for t, spread in zip(TIMES_S, sweep.spread, strict=True) if spread]
        spreads.append(line(f"{name}, standard deviation", pairs, dashed=True))
    note = (
        "One frame of each time; light that fills the well in 0.1 s. "
        "The hardware's points are not printed as numbers."
    )
    title, label, both = (
        "Fig. 2: radiometric function of the centre",
        "exposure time [s]",
        (*means, *spreads),
    )
    return (
        Plot(title, label, "mean [DN]", means, False, False, note=note),
        Plot(
            f"{title}, logarithmic", label, "mean and standard deviation [DN]", both, note=note
        ),
    )
