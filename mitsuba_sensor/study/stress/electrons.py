"""Electrons: Poisson means from 0 to 1e30, full wells from 1 to 5e7, dark current from 0 to 600 K, fixed patterns."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import partial
from typing import Any

import numpy as np

from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.signals import Electrons
from ...core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C
from ...sensor.effects.dark_current import mean_dark_e
from ...sensor.expose import expose
from ..statistics import Array
from .case import FLOAT32, ONLY_ONCE, RARE, SIGMAS, Case, Engine, cases_of, stage_of, table1
from .got import Got, agree, holds, refusal, relative, shown, together

MEANS = (1e-6, 0.1, 1.0, 9.99, 10.0, 30.0, 1e3, 1e5, 1e7, 1e12)
"""On both sides of 10, where an expansion takes over from a search, and of 2^24, where float32 no longer counts."""
WELLS = (1.0, 33_000.0, 5e7)
NO_TIME = Exposure(0.0)


def counts(engine: Engine, mean: float, side: int) -> tuple[Array, float]:
    """Poisson counts of a flat light (side, side), and the mean as the engine holds it."""
    frame = engine.frame((side, side))
    light = engine.take(np.full((side, side), mean), frame)
    counted, held = engine.give([frame.poisson("photon_shot", light), light], frame)
    return counted, float(held[0, 0])


def three_moments(engine: Engine, mean: float) -> Got:
    """Their standard errors come from the law's central moments: μ₄ − λ² = λ + 2λ², μ₆ − λ² = λ + 24λ² + 15λ³."""
    counted, held = counts(engine, mean, 512)  # 5 standard errors of a variance are 1.4 %
    off = counted - held
    variances = np.array([held, held + 2 * held**2, held + 24 * held**2 + 15 * held**3])
    allowed = SIGMAS * np.sqrt(variances / off.size) + RARE / off.size
    moments = agree([np.mean(off**power) for power in (1, 2, 3)], [0.0, held, held], allowed)
    whole = (np.floor(counted) == counted).all() and counted.min() >= 0
    return together(moments, holds("whole numbers" if whole else "not whole", whole))


def filled(engine: Engine, mean: float) -> Got:
    """Counts beyond any well: finite, about their mean, and then the full well exactly."""
    frame = engine.frame((64, 64))
    electrons = stage_of("shot noise").sample(Electrons(engine.take(np.full((64, 64), mean), frame)), frame)
    full = stage_of("full well", pixel__full_well_e=33_000.0).sample(electrons, frame)
    counted, total = engine.give([electrons.light, full.total], frame)
    return together(
        relative(counted, min(mean, 1e30), 1e-5, " counted"), agree(total, 33_000.0, unit=" e- in the well")
    )


def clipped(engine: Engine, full_well_e: float) -> Got:
    """A light from 1 % to 100 wells through the whole camera, dark left out."""
    camera = table1(pixel__full_well_e=full_well_e, adc__bits=16)
    light = np.geomspace(full_well_e / 100, full_well_e * 100, 200).reshape(10, 20)
    electrons = expose(light, camera, NO_TIME, keep="electrons", **engine.how).electrons
    assert electrons is not None
    whole, odd = (electrons == np.floor(electrons)).all(), (electrons % 2 == 1).any()
    uncounted = engine.precision == "float32" and full_well_e > 1 / FLOAT32
    text = f"at most {electrons.max():.10g}, odd counts {'too' if odd else 'are left out'}"
    return holds(text, electrons.max() == full_well_e, whole, odd or uncounted)


def overflow(engine: Engine, full_well_e: float) -> Got:
    """min(light + dark, full well), whichever of the two overflows; to the last bit where counts are exact."""
    light = [0.0, 1.0, full_well_e - 1, full_well_e, full_well_e + 1, 1e12, 1e30, 0.0, 5.0]
    dark = [0.0, 1.0, 1.0, 0.0, 3.0, 1e12, 7.0, full_well_e + 5, full_well_e]
    frame = engine.frame((1, len(dark)))
    electrons = Electrons(engine.take([light], frame), engine.take([dark], frame))
    after = stage_of("full well", pixel__full_well_e=full_well_e).sample(electrons, frame)
    total, *parts = engine.give([after.total, after.light, after.dark], frame)
    exact = 0.0 if engine.precision == "float64" or full_well_e < 1 / FLOAT32 else 2 * FLOAT32 * full_well_e
    sums = agree(total, np.minimum(np.add(light, dark), full_well_e)[None], exact, " e-")
    return holds(sums.text, sums.passed, min(part.min() for part in parts) >= 0)


def no_exact_count() -> Got:
    """Beyond 2^24 the precision that nobody chose is float64, and a compiled engine says that it has none."""
    camera = table1(pixel__full_well_e=5e7)
    found = expose(np.ones((2, 2)), camera, NO_TIME, engine="numpy").first.window.backend.precision
    part = "compiled engines are float32: take numpy, or precision float32"
    refused = refusal(lambda: expose(np.ones((2, 2)), camera, NO_TIME, engine="drjit"), part)
    return holds(f"NumPy takes {found}; {refused.text}", found == "float64", refused.passed)


def counted_cases() -> list[Case]:
    """Counts and wells."""
    poisson, well = partial(cases_of, "Poisson means"), partial(cases_of, "full well")
    none = "0 electrons in a million pixels"
    law = "mean λ, variance λ, skewness λ^(−½) within 5 standard errors of 262 144 whole numbers"
    full = "finite, no hang, then 33000 e- exactly"
    least = "that many at most, exactly; whole numbers, and odd ones among them up to 2^24 or in float64"
    exact = "min(light + dark, full well), exactly up to 2^24 or in float64, else to a float32 step"
    unasked = "float64 on NumPy; a compiled engine says that it has none"
    return [
        *poisson("shot noise", "λ = {}", none, lambda e, mean: agree(counts(e, mean, 1024)[0], 0.0), (0.0, 1e-12)),
        *poisson("shot noise", "λ = {}", law, three_moments, MEANS),
        *poisson("shot noise, full well", "λ = {}", full, filled, (1e12, 1e30, math.inf)),
        *well("full well", "{} e-, light from 1 % to 100 wells", least, clipped, WELLS),
        *well("full well", "{} e-, light or dark or both beyond it", exact, overflow, WELLS),
        *well("expose", "5e7 e- without a precision", unasked, no_exact_count, asked=ONLY_ONCE),
    ]


def activation(kelvin: Decimal, power: str = "1.5", divisor: int = 2) -> Decimal:
    """What a dark current is at T over what it is at 300 K (paper eq. 1, by default, and 2); 0 at 0 K."""
    if not kelvin:
        return Decimal(0)
    return (kelvin / 300) ** Decimal(power) * ((gap_over_kt(Decimal(300)) - gap_over_kt(kelvin)) / divisor).exp()


def gap_over_kt(kelvin: Decimal) -> Decimal:
    """E_g(T)/(kT) with E_g(T) = 1.1557 − 7.021e-4·T²/(1108 + T) eV (paper eq. 3)."""
    gap_ev = Decimal("1.1557") - Decimal("7.021e-4") * kelvin**2 / (1108 + kelvin)
    return gap_ev * Decimal(ELEMENTARY_CHARGE_C) / (Decimal(BOLTZMANN_J_PER_K) * kelvin)


KELVINS = (0.0, 5e-324, 4.0, 77.0, 133.0, 300.0, 400.0, 600.0)
ROUNDED = 1e-12  # exponents reach 1700 at 4 K, and an exponential loses that many unit roundoffs: 4e-13
NANOAMPERE = Decimal("1e-9") * Decimal(5.7e-4**2) / Decimal(ELEMENTARY_CHARGE_C)
"""Electrons per second of 1 nA/cm² on Table 1's pixel of 5.7 µm."""
WARM = Decimal("298.15")


def rated(rate_e_per_s: float, kelvin: float, **more: Any) -> dict[str, Any]:
    """A datasheet's dark current that was measured at this temperature."""
    names = {"dark_current__rate_e_per_s": rate_e_per_s, "dark_current__at_temperature_k": kelvin}
    return {"dark_current__fom_na_per_cm2": None, **names, **more}


MODELS: dict[str, tuple[dict[str, Any], Callable[[Decimal], Decimal]]] = {
    "figure of merit, 1 nA/cm²": ({}, lambda t: NANOAMPERE * activation(t)),
    "MPP, 0.1 and 1 nA/cm²": (
        {"dark_current__diffusion_fom_na_per_cm2": 0.1},
        lambda t: NANOAMPERE * (Decimal("0.1") * activation(t, "3", 1) + activation(t)),
    ),
    "5 e-/s at 298.15 K": (rated(5.0, 298.15), lambda t: 5 * activation(t) / activation(WARM)),
    "5 e-/s at 298.15 K, doubling in 7 K": (
        rated(5.0, 298.15, dark_current__doubling_k=7.0),
        lambda t: 5 * Decimal(2) ** ((t - WARM) / 7),
    ),
}


def rate(model: str, kelvin: float) -> Got:
    """Ours and that of 50 digits, below the smallest float64 taken for 0 [e-/s]."""
    changes, exact = MODELS[model]
    with localcontext() as context:
        context.prec, context.Emin = 50, -(10**17)
        ours, theirs = mean_dark_e(table1(**changes), Exposure(1.0, kelvin)), float(exact(Decimal(kelvin)))
    return relative(ours, theirs, ROUNDED, " e-/s")


ONE_SECOND = Exposure(1.0, 300.0)
FAMILIES = {
    "normal, cut at 0": "gaussian",
    "log-normal": "lognormal",
    "gamma": "gamma",
    "inverse Gaussian": "wald",
    "logistic, cut at 0": "logistic",
    "normal, neighbours coupled by 0.25": "ar",
    "PRNU": "",
}
WIDTHS, SLIGHT = (0.0, 0.01, 0.4, 1.0, 10.0), (5e-324, 1e-150, 1e-9)
FARTHEST = 25.0
"""Standard deviations of the farthest value of the widest tail, the logistic law's: ln(2³³)·√3/π = 12.6, and as many
more for a pattern of coupled neighbours."""
HEAVY = ("log-normal", "gamma", "inverse Gaussian")
"""At a width of 10 a few pixels carry all of the mean, which does not converge: shares of pixels are looked at."""
SHAPE = (256, 256)
COUPLED = (1 - 4 * 0.25**2) ** 0.75 / (1 - 2 * 0.25)
"""By this much, squared and for each axis, the mean of a coupled map varies more: its spectrum at frequency 0."""
SMALLEST_COMPARED = 1e-25  # float32 engines hold e^(−69) at least; what is below is next to nothing anyway


def through_patterns(engine: Engine, light: float, *stages: Any) -> tuple[Array, Moments]:
    """Mean electrons (H, W) that these stages make of so many in a second at 300 K, and the moments in theory."""
    theory = Moments(light, 0.0, 0.0, Frame(ONE_SECOND, SensorWindow(7, SHAPE)))
    for stage in stages:
        theory = stage.moments(theory)
    return engine.through(np.full(SHAPE, light), *stages, electrons=True, exposure=ONE_SECOND), theory


def pattern(engine: Engine, family: str, cv: float) -> tuple[Array, Moments]:
    """A map of mean 1, and its moments."""
    if not FAMILIES[family]:
        return through_patterns(engine, 1.0, stage_of("prnu", pixel__prnu=cv))
    names = {"dark_current__distribution": FAMILIES[family], "dark_current__cv": cv}
    names |= {"dark_current__coupling": 0.25} if "coupled" in family else {}
    return through_patterns(engine, 0.0, stage_of("dark current", **rated(1.0, 300.0), **names))


def quantiles_of(family: str, cv: float) -> Any:
    """SciPy's distribution of mean 1."""
    from scipy import stats

    if family == "log-normal":
        return stats.lognorm(math.sqrt(math.log1p(cv**2)), scale=(1 + cv**2) ** -0.5)
    return stats.gamma(cv**-2, scale=cv**2) if family == "gamma" else stats.invgauss(cv**2, scale=cv**-2)


def mean_kept(engine: Engine, stage: str, family: str) -> Got:
    """At every width, in standard errors; of a heavy tail at 10 the deciles."""
    answers = []
    for cv in WIDTHS:
        x, theory = pattern(engine, family, cv)
        if family in HEAVY and cv > 1:
            law, shares = quantiles_of(family, cv), np.arange(1, 10) / 10
            shares = shares[law.ppf(shares) > SMALLEST_COMPARED]
            seen = [np.mean(x <= q) for q in law.ppf(shares)]
            answers.append(agree(seen, shares, SIGMAS * np.sqrt(shares * (1 - shares) / x.size)))
        else:
            error = math.sqrt(float(theory.spatial) / x.size) * (COUPLED**2 if "coupled" in family else 1.0)
            answers.append(agree(x.mean(), float(theory.mean), SIGMAS * error + 2 * engine.unit))
        answers.append(holds(f"from {x.min():.3g}", np.isfinite(x).all(), x.min() >= 0))
    return together(*answers)


def next_to_none(engine: Engine, stage: str, family: str) -> Got:
    """Shapes are cv⁻² and would overflow; variances are differences and would cancel."""
    answers = []
    for cv in SLIGHT:
        x, theory = pattern(engine, family, cv)
        answers.append(agree(x, 1.0, FARTHEST * cv + 2 * engine.unit))
        answers.append(relative(float(theory.spatial), cv * cv, ROUNDED))
    return together(*answers)


def mixed(engine: Engine, cv: float) -> Got:
    """PRNU and dark pattern: the variance of their sum. A narrow log-normal has an excess of 16·cv²."""
    names = {"dark_current__cv": cv, "dark_current__distribution": "lognormal"}
    dark = stage_of("dark current", **rated(1e4, 300.0), **names)
    total, theory = through_patterns(engine, 1e4, stage_of("prnu", pixel__prnu=cv), dark)
    variance, rounded = float(theory.spatial), (2e4 * 2 * engine.unit) ** 2
    return agree(total.var(), variance, SIGMAS * math.sqrt((2 + 16 * cv**2) / total.size) * variance + rounded, " e-²")


def dark_cases() -> list[Case]:
    """Rates, then patterns."""
    fixed, digits = (
        partial(cases_of, "fixed patterns"),
        "closed form with 50 digits to 1e-12, exactly 0 where that underflows",
    )
    kept = "mean kept within 5 standard errors of 65 536 pixels (of a heavy tail at 10 its deciles), no pixel below 0"
    near_one = "no pixel farther from 1 than 25 times that, or than roundings; theory has its variance"
    stages = [("dark current" if family else "prnu", name) for name, family in FAMILIES.items()]
    theory = "σ as in theory, to its standard error"
    rates = [(model, kelvin) for model in MODELS for kelvin in KELVINS]
    return [
        *cases_of("dark current", "dark current", "{1} K; {0}", digits, rate, rates, ONLY_ONCE),
        *fixed("{}", "{1}; coefficients of variation 0, 0.01, 0.4, 1, 10", kept, mean_kept, stages),
        *fixed("{}", f"{{1}}; {', '.join(map(shown, SLIGHT))}", near_one, next_to_none, stages),
        *fixed("prnu, dark current", "{} on 1e4 e- each", theory, mixed, (1e-200, 1e-6, 0.005, 0.1)),
    ]
