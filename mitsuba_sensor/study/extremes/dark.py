"""Dark current from 0 to 600 K against 50 decimal digits, and fixed patterns from no width to ten times their mean."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.exposure import Exposure
from ...core.moments import Moments
from ...core.signals import Electrons
from ...core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C
from ...sensor.dark_current_models import Doubling, FigureOfMerit, Measured, Mpp
from ...sensor.electrons import DarkCurrent, Prnu
from ...sensor.fpn_distributions import (
    Autoregressive,
    FpnDistribution,
    Gamma,
    Gaussian,
    Logistic,
    LogNormal,
    Rectified,
    Wald,
)
from .case import SIGMAS, Case, Engine, Got, largest, once, relative, shown, together

DIGITS = 50
AREA_CM2 = 5.7e-4**2
"""Table 1's pixel."""

KELVINS = (0.0, 5e-324, 4.0, 77.0, 133.0, 300.0, 400.0, 600.0)

ROUNDED = 1e-12
"""Exponents reach 1700 at 4 K, and an exponential loses that many unit roundoffs: 4e-13."""


def gap_over_kt(kelvin: Decimal) -> Decimal:
    """E_g(T)/(kT) with E_g(T) = 1.1557 − 7.021e-4·T²/(1108 + T) eV (paper eq. 3)."""
    gap_ev = Decimal("1.1557") - Decimal("7.021e-4") * kelvin**2 / (1108 + kelvin)
    return gap_ev * Decimal(ELEMENTARY_CHARGE_C) / (Decimal(BOLTZMANN_J_PER_K) * kelvin)


def activation(kelvin: Decimal, power: str, divisor: int) -> Decimal:
    """What a dark current is at T over what it is at 300 K (paper eq. 1 and 2); 0 at 0 K."""
    if not kelvin:
        return Decimal(0)
    fall = (gap_over_kt(Decimal(300)) - gap_over_kt(kelvin)) / divisor
    return (kelvin / 300) ** Decimal(power) * fall.exp()


def depletion(kelvin: Decimal) -> Decimal:
    """Eq. 1."""
    return activation(kelvin, "1.5", 2)


RATE_E_PER_S = Decimal("1e-9") * Decimal(AREA_CM2) / Decimal(ELEMENTARY_CHARGE_C)
"""1 nA/cm² on that pixel."""

LAWS: dict[str, tuple[Any, Callable[[Decimal], Decimal]]] = {
    "figure of merit, 1 nA/cm²": (FigureOfMerit(1.0, AREA_CM2), lambda t: RATE_E_PER_S * depletion(t)),
    "MPP, 0.1 and 1 nA/cm²": (
        Mpp(0.1, 1.0, AREA_CM2),
        lambda t: RATE_E_PER_S * (Decimal("0.1") * activation(t, "3", 1) + depletion(t)),
    ),
    "5 e-/s at 298.15 K": (Measured(5.0, 298.15), lambda t: 5 * depletion(t) / depletion(Decimal("298.15"))),
    "5 e-/s at 298.15 K, doubling in 7 K": (
        Doubling(5.0, 298.15, 7.0),
        lambda t: 5 * Decimal(2) ** ((t - Decimal("298.15")) / 7),
    ),
}


def rate(law: str, kelvin: float) -> tuple[float, float]:
    """Ours and that of 50 digits, below the smallest float64 taken for 0 [e-/s]."""
    ours, exact = LAWS[law]
    with localcontext() as context:
        context.prec, context.Emin = DIGITS, -(10**17)
        return ours.rate_e_per_s(kelvin), float(exact(Decimal(kelvin)))


def rated(law: str, kelvin: float) -> Got:
    """The rate at one temperature."""
    return relative(*rate(law, kelvin), ROUNDED, " e-/s")


FAMILIES: dict[str, Callable[[float], FpnDistribution]] = {
    "normal, cut at 0": Gaussian,
    "log-normal": LogNormal,
    "gamma": Gamma,
    "inverse Gaussian": Wald,
    "logistic, cut at 0": Logistic,
    "normal, neighbours coupled by 0.25": lambda cv: Autoregressive(cv, 0.25),
    "PRNU": Rectified,
}
WIDTHS = (0.0, 0.01, 0.4, 1.0, 10.0)
SLIGHT = (5e-324, 1e-150, 1e-9)
FARTHEST = 25.0
"""Standard deviations of the last word of the widest tail, the logistic law's: ln(2³³)·√3/π = 12.6, and as many more
for a pattern of coupled neighbours."""
HEAVY = ("log-normal", "gamma", "inverse Gaussian")
"""At a width of 10 a few pixels carry all of the mean, which does not converge: shares of pixels are looked at."""
SHARES = np.arange(1, 10) / 10
SHAPE = (256, 256)
COUPLED = (1 - 4 * 0.25**2) ** 0.75 / (1 - 2 * 0.25)
"""By this much, squared and for each axis, the mean of a coupled map varies more: its spectrum at frequency 0."""
SMALLEST_COMPARED = 1e-25
"""float32 engines hold e^(−69) at least; what is below is next to nothing anyway."""


def map_of(engine: Engine, pattern: FpnDistribution) -> NDArray[np.float64]:
    """The camera's map, (H, W)."""
    frame = engine.frame(SHAPE, Exposure(0.1))
    return engine.give([pattern.map_of(frame.window, "dark_fpn")], frame)[0]


def quantile_law(family: str, cv: float) -> Any:
    """SciPy's distribution of mean 1."""
    from scipy import stats

    if family == "log-normal":
        return stats.lognorm(math.sqrt(math.log1p(cv**2)), scale=(1 + cv**2) ** -0.5)
    return stats.gamma(cv**-2, scale=cv**2) if family == "gamma" else stats.invgauss(cv**2, scale=cv**-2)


def spread(engine: Engine, family: str, cv: float) -> tuple[str, float]:
    """What a map shows, and by how many standard errors it is off; NaN for a negative or non-finite pixel."""
    pattern = FAMILIES[family](cv)
    x = map_of(engine, pattern)
    if not (np.isfinite(x).all() and x.min() >= 0):
        return f"{x.min():g} … {x.max():g}", math.nan
    if family in HEAVY and cv > 1:
        law = quantile_law(family, cv)
        points = [(law.ppf(p), p) for p in SHARES if law.ppf(p) > SMALLEST_COMPARED]
        off = [abs(np.mean(x <= q) - p) / math.sqrt(p * (1 - p) / x.size) for q, p in points]
        return f"{len(points)} deciles", float(max(off))
    error = math.sqrt(pattern.variance / x.size) * (COUPLED**2 if "coupled" in family else 1.0)
    beyond = max(abs(float(x.mean()) - pattern.mean) - 2 * engine.unit, 0.0)
    return f"mean {x.mean():.5g}", beyond / error if error else (math.inf if beyond else 0.0)


def kept(engine: Engine, family: str) -> Got:
    """Mean 1 (or that of what is cut) at every width, and nothing negative."""
    found = [spread(engine, family, cv) for cv in WIDTHS]
    worst = max((off for _, off in found), key=lambda off: math.inf if math.isnan(off) else off)
    words = ", ".join(f"{shown(cv)}: {words}" for cv, (words, _) in zip(WIDTHS, found, strict=True))
    return Got(f"{words}; off by {worst:.1f} standard errors at most", worst <= SIGMAS)


def next_to_none(engine: Engine, family: str) -> Got:
    """Shapes are cv⁻² and would overflow; variances are differences and would cancel."""
    answers = []
    for cv in SLIGHT:
        pattern = FAMILIES[family](cv)
        theory = math.isclose(pattern.variance, cv * cv, rel_tol=ROUNDED)
        answers.append(
            largest(float(np.abs(map_of(engine, pattern) - 1).max()), FARTHEST * cv + 2 * engine.unit, f"{shown(cv)}:")
            if theory
            else Got(f"variance {pattern.variance:g}", False)
        )
    return together(answers)


def mixed_moments(engine: Engine, cv: float) -> Got:
    """PRNU and dark pattern on 1e4 e- each: the variance of their sum. A narrow log-normal has an excess of 16·cv²."""
    frame = engine.frame(SHAPE, Exposure(1.0, 300.0))
    light = engine.take(np.full(SHAPE, 1e4), frame)
    stages = (Prnu(Rectified(cv)), DarkCurrent(Measured(1e4, 300.0), LogNormal(cv)))
    signal, theory = Electrons(light), Moments(1e4, 0.0, 0.0, frame)
    for stage in stages:
        signal, theory = stage(signal, frame), stage.moments(theory)
    (total,) = engine.give([signal.total], frame)
    error = math.sqrt((2 + 16 * cv**2) / total.size)
    rounded = (2e4 * 2 * engine.unit) ** 2
    return Got(
        f"σ {total.std():.6g} e-, theory {math.sqrt(theory.spatial):.6g} e-",
        abs(float(total.var()) - theory.spatial) <= SIGMAS * error * theory.spatial + rounded,
    )


def cases() -> list[Case]:
    """Rates, then patterns."""
    exact = "closed form with 50 digits to 1e-12, exactly 0 where that underflows"
    width = "coefficients of variation 0, 0.01, 0.4, 1, 10"
    mean = "mean kept within 5 standard errors of 65 536 pixels (of a heavy tail at 10 its deciles), no pixel below 0"
    slight = "no pixel farther from 1 than 25 times that, or than roundings; theory has its variance"
    stages = {family: "prnu" if family == "PRNU" else "dark current" for family in FAMILIES}
    return [
        *(once("dark current", "dark current", f"{shown(kelvin)} K; {law}", exact, partial(rated, law, kelvin))
          for law in LAWS for kelvin in KELVINS),
        *(Case("fixed patterns", stage, f"{family}; {width}", mean, partial(kept, family=family))
          for family, stage in stages.items()),
        *(Case("fixed patterns", stage, f"{family}; {', '.join(shown(cv) for cv in SLIGHT)}", slight,
               partial(next_to_none, family=family)) for family, stage in stages.items()),
        *(Case("fixed patterns", "prnu, dark current", f"{shown(cv)} on 1e4 e- each",
               "σ as in theory, to its standard error", partial(mixed_moments, cv=cv))
          for cv in (1e-200, 1e-6, 0.005, 0.1)),
    ]  # fmt: skip
