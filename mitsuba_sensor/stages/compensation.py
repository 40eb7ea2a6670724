"""Compensated render noise: shot noise gives way to the noise of the render where each frame has a render of its own.

The mean light of a render has an error of some variance v. Electrons are then drawn about that mean μ with variance
μ − v, so that over frames, each with its own render, the total has the variance μ of a Poisson law and no more.

Of a mean μ, light or dark, the variance s ≤ μ is compensated by drawing

    N = m + Bernoulli(f) + Poisson(μ − m − f),    m = ⌊s⌋, f = √(s − m)

whole electrons, mean μ, variance f(1 − f) + μ − m − f = μ − s: both exact at every mean. It needs m + f ≤ μ; below one
electron that is s ≤ μ², and no law of whole numbers goes further, for those about a mean μ < 1 vary by μ − μ² at least.
Of light and dark current the one whose mean allows it gives way to all of v: only their sum shows.

A frame alone varies by μ − s about its own render. A plan and its levels take the mean for exact.
"""

from ..core import Array, Frame, arrays

# Share of μ that is compensated at most; what a render has beyond stays in the frame, and is reported. The noise that
# is drawn must hide the shape of the render's. Renders should aim at half of this, v = 0.16·μ: where v comes from eight
# passes, it is measured as more than the double in one pixel of twenty. Then the total has the variance of Poisson's
# law to 1 % and its third moment to 38 %, from 1 e- up.
LIMIT = 1 / 3


def compensable(light_e: Array, dark_e: Array, variance_e2: Array) -> tuple[Array, Array]:
    """How much of the render's variance the shot noise of light and of dark current compensate, (H, W) each [e-²].

    min(v, LIMIT·(light + dark), the most that the larger of the two allows), all of it from the light where that
    allows it, else all of it from the dark current.  variance_e2 : v, of the mean light over renders [e-²].
    """
    found = arrays.minimum(variance_e2, LIMIT * (light_e + dark_e))
    found = arrays.minimum(found, largest_e2(arrays.maximum(light_e, dark_e)))
    by_light = found <= largest_e2(light_e)
    return arrays.where(by_light, found, found * 0.0), arrays.where(
        by_light, found * 0.0, found
    )


def largest_e2(mean_e: Array) -> Array:
    """The largest variance s with ⌊s⌋ + √(s − ⌊s⌋) ≤ mean: ⌊mean⌋ + (mean − ⌊mean⌋)² [e-²]."""
    whole = arrays.floor(mean_e)
    return whole + (mean_e - whole) * (mean_e - whole)


def reserved(mean_e: Array, compensated_e2: Array, frame: Frame) -> tuple[Array, Array]:
    """Whole electrons m + Bernoulli(f), and the mean of the Poisson count beside them, (H, W).

    With that count they are electrons of mean ``mean_e`` and variance ``mean_e − compensated_e2``.
    """
    whole = arrays.floor(compensated_e2)
    chance = arrays.sqrt(compensated_e2 - whole)
    rest = arrays.maximum((mean_e - whole) - chance, 0.0)
    # One stream of Bernoulli draws for all, for only one source compensates.
    return whole + frame.bernoulli("compensation", chance), rest
