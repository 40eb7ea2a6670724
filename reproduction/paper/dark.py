"""Fig. 8 to 11: histograms of averaged dark frames with fits."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from mitsuba_sensor import Camera
from mitsuba_sensor.lab.measure.dark_signal import DarkSignal, Fit, dark_signal
from mitsuba_sensor.lab.quantity import Quantity, normal_interval
from mitsuba_sensor.pages.page import Drawing, Part, Section, Table, table

from .camera import (
    GAIN,
    KELVIN,
    NO_COLUMNS,
    READ_E,
    Size,
    stack_of,
    table1,
)
from .check import Check, all_hold, check_table, within_interval
from .pattern import ROUNDING_E2
from .published import DARK_SIGNALS, NORMAL_AT_1_MS, PublishedSignal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WEIGHT = 0.01  # of each superimposed component: not printed
NAMES = {"normal": ("µ", "σ"), "log-normal": ("µ", "σ"), "gamma": ("a", "b")}
"""Distributions of the paper and symbols of their parameters."""
KS_LIMIT = 2.69
"""Largest distance of the distribution functions times √n; chance exceeds it once in a million."""
IN_CAMERA = {
    "log-normal": "lognormal",
    "gamma": "gamma",
}  # names of the laboratory → of a camera file


def moments(law: PublishedSignal) -> tuple[float, float]:
    """Mean and σ of the main component [DN]."""
    first, second = law.parameters
    if law.family == "gamma":
        return first * second, math.sqrt(first) * second
    mean = math.exp(first + second**2 / 2)
    return mean, mean * math.sqrt(math.expm1(second**2))


def remainder_dn(signal_dn: float, frames: int) -> float:
    """σ of what averaging leaves of the temporal noise of a dark signal [DN]."""
    return GAIN * math.sqrt((signal_dn / GAIN + READ_E**2 + ROUNDING_E2) / frames)


def camera_of(law: PublishedSignal, frames: int) -> Camera:
    """Table 1's with the published dark signal in its exposure time; no column offsets, no black level.

    The published σ is that of averaged frames, so the camera's own is smaller by what averaging leaves.
    """
    mean, sigma = moments(law)
    own = math.sqrt(sigma**2 - remainder_dn(mean, frames) ** 2)
    same: dict[str, Any] = {"weight": WEIGHT, "unit": "dn", "at_temperature_k": KELVIN}
    parts = []
    if law.uniform:
        parts.append(
            {**same, "family": "uniform", "low": law.uniform[0], "high": law.uniform[1]}
        )
    if law.normal:
        parts.append(
            {**same, "family": "normal", "mean": law.normal[0], "sigma": law.normal[1]}
        )
    changed: dict[str, Any] = {
        **NO_COLUMNS,
        "adc.black_level_dn": 0.0,
        "dark_current.fom_na_per_cm2": None,
        "dark_current.rate_e_per_s": mean / GAIN / law.time_s,
        "dark_current.at_temperature_k": KELVIN,
        "dark_current.cv": own / mean,
        "dark_current.distribution": IN_CAMERA[law.family],
        "dark_current.components": tuple(parts),
    }
    return table1(**changed)


def measure(law: PublishedSignal, size: Size) -> DarkSignal:
    """The mean of the dark frames and the distributions fitted to it."""
    dark = stack_of(
        camera_of(law, size.dark_frames),
        law.time_s,
        0.0,
        size,
        frames=size.dark_frames,
        seed=500,
    )
    return dark_signal(dark)


class Mixture:
    """The published distribution with our weights."""

    def __init__(self, law: PublishedSignal) -> None:
        stats, (first, second) = scipy.stats, law.parameters
        main = stats.gamma(first, scale=second)
        if law.family == "log-normal":
            main = stats.lognorm(second, scale=math.exp(first))
        parts = []
        if law.uniform:
            low, high = law.uniform
            parts.append((WEIGHT, stats.uniform(low, high - low)))
        if law.normal:
            parts.append((WEIGHT, stats.norm(*law.normal)))
        self.parts = [(1 - WEIGHT * len(parts), main), *parts]

    def pdf(self, x: Any) -> Any:
        """Density [1/DN]."""
        return sum(weight * law.pdf(x) for weight, law in self.parts)

    def cdf(self, x: Any) -> Any:
        """Share of the values up to x."""
        return sum(weight * law.cdf(x) for weight, law in self.parts)


def fit_of(found: DarkSignal, family: str) -> Fit:
    """The fit of a family."""
    return next(fit for fit in found.fits if fit.name == family)


def parameters(found: DarkSignal, family: str) -> list[Quantity]:
    """Parameters of the fit of a family, with intervals by Fisher's information."""
    values, count = fit_of(found, family).parameters, len(found.values)
    if family == "gamma":
        a, _, b = values
        trigamma = float(scipy.special.polygamma(1, a))
        information = count * (a * trigamma - 1)
        errors = ((a, math.sqrt(a / information)), (b, b * math.sqrt(trigamma / information)))
    else:
        mean, sigma = values[0], values[-1]
        if family == "log-normal":
            sigma, mean = values[0], math.log(values[2])
        errors = ((mean, sigma / math.sqrt(count)), (sigma, sigma / math.sqrt(2 * count)))
    units = {"normal": ("DN", "DN"), "log-normal": ("", ""), "gamma": ("", "DN")}[family]
    return [
        Quantity(
            symbol, family, *normal_interval(float(value), float(error)), unit, "Fig. 8 to 11"
        )
        for symbol, unit, (value, error) in zip(NAMES[family], units, errors, strict=True)
    ]


def distance(law: PublishedSignal, found: DarkSignal) -> float:
    """Largest distance of the distribution functions, measured and published."""
    return float(scipy.stats.ks_1samp(found.values, Mixture(law).cdf).statistic)


def checks_of(law: PublishedSignal, found: DarkSignal) -> list[Check]:
    """Every parameter of a published distribution, and of one with superimposed parts its distribution function."""
    label = f"{law.figure}, {law.time_s:g} s"
    if len(law.parts) > 1:
        limit = KS_LIMIT / math.sqrt(len(found.values))
        name = f"{label}: largest distance of the distribution functions"
        return [Check(name, "1", 0.0, distance(law, found), limit)]
    pairs = zip(parameters(found, law.family), law.parameters, strict=True)
    return [within_interval(f"{label}: {q.symbol}", value, q) for q, value in pairs]


def section(found: dict[PublishedSignal, DarkSignal], size: Size) -> Section:
    """Histograms, and published parameters beside ours."""
    checks = [check for law, one in found.items() for check in checks_of(law, one)]
    last = DARK_SIGNALS[-1]
    held = sum(check.holds for check in checks)
    findings = (
        f"Dark signal: {held} of {len(checks)} published parameters and distributions that were simulated come back; "
        f"at {last.time_s:g} s {found[last].best.name} fits best of the distributions with one part.",
    )
    pictures = [picture for law, one in found.items() for picture in _pictures(law, one, size)]
    tables = (
        _fits(found),
        check_table("Fig. 8 to 11: what was simulated", checks),
    )
    return Section(findings, all_hold(checks), (*pictures, *tables))


def _pictures(law: PublishedSignal, found: DarkSignal, size: Size) -> list[Part]:
    weights = (
        f" Superimposed components: {100 * WEIGHT:g} % of the pixels each, not printed."
        if len(law.parts) > 1
        else ""
    )
    note = f"Average of {size.dark_frames} dark frames. Dashed: the published distribution.{weights}"
    title = f"{law.figure}: dark signal after {law.time_s:g} s"
    scales = {"": False} | ({", logarithmic": True} if len(law.parts) > 1 else {})
    return [
        Drawing(title + name, partial(_draw, law, found, log), note)
        for name, log in scales.items()
    ]


def _draw(law: PublishedSignal, found: DarkSignal, log_counts: bool, axes: Axes) -> None:
    found.plot(axes, log_counts)
    low, high = axes.get_xlim()
    x = np.linspace(max(low, 0.1), high, 2000)
    axes.plot(
        x,
        Mixture(law).pdf(x),
        "--",
        color="black",
        lw=1,
        label="published" if len(law.parts) == 1 else "published, weights 1 %",
    )


def _fits(found: dict[PublishedSignal, DarkSignal]) -> Table:
    rows = []
    for law, one in found.items():
        known = {law.family: law.parameters}
        if law == DARK_SIGNALS[0]:
            known["normal"] = NORMAL_AT_1_MS
        for family in NAMES:
            fit, values = fit_of(one, family), known.get(family, (None, None))
            for q, published in zip(parameters(one, family), values, strict=True):
                cells = (q.symbol, q.unit or "1", published, q.value, q.low, q.high, fit.ks)
                mark = "best" if fit is one.best else ""
                rows.append((mark, (law.figure, f"{law.time_s:g} s", family, *cells)))
    return table(
        "Fig. 8 to 11: fits to averaged dark frames",
        "figure | time | distribution | parameter | unit | published | ours | from | to | largest distance of the "
        "distribution functions",
        rows,  # type: ignore[arg-type]
        "By maximum likelihood, with 95 % intervals; the best by BIC is marked. Superimposed parts are not fitted: the "
        "checks compare the whole distribution function. Their weights are not printed, ours are 1 %.",
    )
