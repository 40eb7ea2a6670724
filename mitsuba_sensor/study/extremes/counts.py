"""Electrons that are counted: Poisson means from 0 to 1e30, full wells from 1 to 5e7."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from ...core.exposure import Exposure
from ...core.signals import Electrons
from ...sensor.camera import load_camera
from ...sensor.electrons import FullWell, ShotNoise
from ...sensor.expose import expose
from .case import FLOAT32, RARE, SIGMAS, Case, Engine, Got, once, refusal, shown

SHAPE = (512, 512)
"""262 144 pixels: 5 standard errors of a variance are 1.4 %."""
MILLION = (1024, 1024)

MEANS = (1e-6, 0.1, 1.0, 9.99, 10.0, 30.0, 1e3, 1e5, 1e7, 1e12)
"""On both sides of 10, where an expansion takes over from a search, and of 2^24, where float32 no longer counts."""

WELLS = (1.0, 33_000.0, 5e7)


def counts(engine: Engine, mean: float, shape: tuple[int, int]) -> tuple[Any, float]:
    """Poisson counts of a flat light (H, W), and the mean as the engine holds it."""
    frame = engine.frame(shape, Exposure(0.1))
    light = engine.take(np.full(shape, mean), frame)
    counted, held = engine.give([frame.poisson("photon_shot", light), light], frame)
    return counted, float(held[0, 0])


def none_of(engine: Engine, mean: float) -> Got:
    """No light, or next to none."""
    counted, _ = counts(engine, mean, MILLION)
    return Got(f"{counted.sum():g} electrons in {counted.size} pixels", not counted.any())


def three_moments(engine: Engine, mean: float) -> Got:
    """Mean, variance and third moment against those of Poisson's law, all λ; a skewness is λ^(−½).

    The standard errors come from its central moments: μ₄ − λ² = λ + 2λ², μ₆ − λ² = λ + 24λ² + 15λ³.
    """
    counted, held = counts(engine, mean, SHAPE)
    off = counted - held
    seen = [float(np.mean(off**power)) for power in (1, 2, 3)]
    spread = (held, held + 2 * held**2, held + 24 * held**2 + 15 * held**3)
    allowed = [SIGMAS * math.sqrt(v / off.size) + RARE / off.size for v in spread]
    good = all(abs(x - e) <= a for x, e, a in zip(seen, (0.0, held, held), allowed, strict=True))
    whole = bool((np.floor(counted) == counted).all() and counted.min() >= 0)
    skewness = seen[2] / seen[1] ** 1.5 if seen[1] else 0.0
    words = f"mean {counted.mean():.6g}, variance {seen[1]:.5g}, skewness {skewness:.3g}"
    return Got(words if whole else f"{words}, not whole", good and whole)


def fills(engine: Engine, mean: float) -> Got:
    """Counts beyond any well: finite, about their mean, and then the full well exactly."""
    frame = engine.frame((64, 64), Exposure(0.1))
    electrons = ShotNoise()(Electrons(engine.take(np.full((64, 64), mean), frame)), frame)
    full = FullWell(33_000.0)(electrons, frame)
    counted, total = engine.give([electrons.light, full.total], frame)
    expected = min(mean, 1e30)
    close = bool(np.isfinite(counted).all() and np.abs(counted / expected - 1).max() < 1e-5)
    words = f"{counted.min():.6g} … {counted.max():.6g} counted, {total.min():g} … {total.max():g} in the well"
    return Got(words, close and bool((total == 33_000).all()))


def clipped(engine: Engine, full_well_e: float) -> Got:
    """A light from 1 % to 100 wells through the whole camera, dark left out."""
    camera = load_camera("konnik_table1").replace(**{"pixel.full_well_e": full_well_e, "adc.bits": 16})
    light = np.geomspace(full_well_e / 100, full_well_e * 100, 200).reshape(10, 20)
    electrons = expose(light, camera, Exposure(0.0), keep="electrons", **engine.how).electrons
    assert electrons is not None
    whole, odd = bool((electrons == np.floor(electrons)).all()), bool((electrons % 2 == 1).any())
    counts_all = engine.precision == "float64" or full_well_e <= 1 / FLOAT32
    good = electrons.max() == full_well_e and whole and (odd or not counts_all)
    return Got(f"at most {electrons.max():.10g}, odd counts {'too' if odd else 'are left out'}", bool(good))


def both_overflow(engine: Engine, full_well_e: float) -> Got:
    """min(light + dark, full well), whichever of the two overflows; to the last bit where counts are exact."""
    light = [0.0, 1.0, full_well_e - 1, full_well_e, full_well_e + 1, 1e12, 1e30, 0.0, 5.0]
    dark = [0.0, 1.0, 1.0, 0.0, 3.0, 1e12, 7.0, full_well_e + 5, full_well_e]
    frame = engine.frame((1, len(dark)), Exposure(0.1))
    after = FullWell(full_well_e)(Electrons(engine.take([light], frame), engine.take([dark], frame)), frame)
    total, *parts = engine.give([after.total, after.light, after.dark], frame)
    expected = np.minimum(np.add(light, dark), full_well_e)
    exact = 0.0 if engine.precision == "float64" or full_well_e < 1 / FLOAT32 else 2 * FLOAT32 * full_well_e
    off = float(np.abs(total - expected).max())
    return Got(f"off by {off:g} e- at most", off <= exact and min(part.min() for part in parts) >= 0)


def no_exact_count() -> Got:
    """Beyond 2^24 the precision that nobody chose is float64, and a compiled engine says that it has none."""
    camera = load_camera("konnik_table1").replace(**{"pixel.full_well_e": 5e7})
    found = expose(np.ones((2, 2)), camera, Exposure(0.0), engine="numpy").first.window.backend.precision
    words = "compiled engines are float32: take numpy, or precision float32"
    refused = refusal(lambda: expose(np.ones((2, 2)), camera, Exposure(0.0), engine="drjit"), words)
    return Got(f"NumPy takes {found}; {refused.words}", found == "float64" and refused.passed)


def cases() -> list[Case]:
    """Counts and wells."""
    shot, well = partial(Case, "Poisson means", "shot noise"), partial(Case, "full well", "full well")
    law = "mean λ, variance λ, skewness λ^(−½) within 5 standard errors of 262 144 whole numbers"
    least = "that many at most, exactly; whole numbers, and odd ones among them up to 2^24 or in float64"
    exact = "min(light + dark, full well), exactly up to 2^24 or in float64, else to a float32 step"
    unasked = "float64 on NumPy; a compiled engine says that it has none"
    return [
        *(shot(f"λ = {shown(mean)}", "0 electrons in a million pixels", partial(none_of, mean=mean))
          for mean in (0.0, 1e-12)),
        *(shot(f"λ = {shown(mean)}", law, partial(three_moments, mean=mean)) for mean in MEANS),
        *(Case("Poisson means", "shot noise, full well", f"λ = {shown(mean)}", "finite, no hang, then 33000 e- exactly",
               partial(fills, mean=mean)) for mean in (1e12, 1e30, math.inf)),
        *(well(f"{shown(e)} e-, light from 1 % to 100 wells", least, partial(clipped, full_well_e=e)) for e in WELLS),
        *(well(f"{shown(e)} e-, light or dark or both beyond it", exact, partial(both_overflow, full_well_e=e))
          for e in WELLS),
        once("full well", "expose", "5e7 e- without a precision", unasked, no_exact_count),
    ]  # fmt: skip
