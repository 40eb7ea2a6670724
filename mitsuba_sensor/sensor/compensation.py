"""Spending the render's noise: where every frame has a render of its own, shot noise need only be what is missing.

The mean light of a render is off by noise of some variance v. Electrons are then drawn about that mean μ with variance
μ − v, so that over frames, each with its own render, the total has the variance μ of a Poisson law and no more.

Of a mean μ, light or dark, the variance s ≤ μ is spent by drawing

    N = m + Bernoulli(f) + Poisson(μ − m − f),    m = ⌊s⌋, f = √(s − m)

whole electrons, mean μ, variance f(1 − f) + μ − m − f = μ − s: both exact at every mean. It needs m + f ≤ μ; below one
electron that is s ≤ μ², and no law of whole numbers goes further, for those about a mean μ < 1 vary by μ − μ² at least.
Light and dark current are counted apart, and whichever has room pays the whole: what shows is their sum.

A frame alone varies by μ − s about its own render. A plan and its levels take the mean for exact.
"""

from __future__ import annotations

from typing import Any

from ..core import arrays
from ..core.frame import Frame

LIMIT = 1 / 3
"""Share of μ that is spent at most; what a render has beyond stays in the frame, and is counted.

What is drawn must hide the shape of the render's noise. Renders should aim at half of this, v = 0.16·μ: where v comes
from eight passes, it is measured as more than the double in one pixel of twenty. Then the total has the variance of
Poisson's law to 1 % and its third moment to 38 %, from 1 e- up (benchmarks/compensation.py).
"""


def compensable(light_e: Any, dark_e: Any, variance_e2: Any) -> tuple[Any, Any]:
    """What of the render's variance the light's and the dark current's shot noise give way to, (H, W) each [e-²].

    min(v, LIMIT·(light + dark), what the larger of the two has room for), all of it from the light where that has room,
    else all of it from the dark current.

    light_e, dark_e : mean electrons.  variance_e2 : of the mean light over renders [e-²].
    """
    spent = arrays.minimum(variance_e2, LIMIT * (light_e + dark_e))
    spent = arrays.minimum(spent, room_e2(arrays.maximum(light_e, dark_e)))
    by_light = spent <= room_e2(light_e)
    return arrays.where(by_light, spent, spent * 0.0), arrays.where(by_light, spent * 0.0, spent)


def room_e2(mean_e: Any) -> Any:
    """The largest variance s with ⌊s⌋ + √(s − ⌊s⌋) ≤ mean: ⌊mean⌋ + (mean − ⌊mean⌋)² [e-²]."""
    whole = arrays.floor(mean_e)
    return whole + (mean_e - whole) * (mean_e - whole)


def counted(source: str, mean_e: Any, compensated_e2: Any, frame: Frame) -> Any:
    """Whole electrons about ``mean_e`` with variance ``mean_e − compensated_e2``, (H, W).

    source : the place of the Poisson words; those of the Bernoulli draw are shared, for one source alone spends.
    """
    whole = arrays.floor(compensated_e2)
    chance = arrays.sqrt(compensated_e2 - whole)
    rest = arrays.maximum((mean_e - whole) - chance, 0.0)
    return whole + frame.bernoulli("compensation", chance) + frame.poisson(source, rest)
