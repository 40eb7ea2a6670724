"""One 32-bit word → one draw in float32, by the quantile function of the law: the fast engines' draws.

Written on the operations of arrays.py, so NumPy and Dr.Jit give the same bits. No rejection, no state, no threshold
above which a law becomes another. The exact twin of every function, in float64, stands in draws.py.

The coefficients are fitted by benchmarks/fit_quantiles.py; benchmarks/enumerate_draws.py puts all 2³² words through and
compares with the exact laws.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from . import arrays

CENTRE = (
    1.253314592, 0.3281080185, 0.01635788389, -0.003316699511, -0.0001955606575, 8.646023542e-05, -6.095012219e-06,
)  # fmt: skip
"""z/x as a polynomial in w = −ln(1 − x²), x = 1 − 2·survival, for w ≤ 4: relative error 4e-7."""

TAIL = (0.138020056, 0.9906899686, 0.1851234197, -0.03989237447, 0.004375504154, -0.0001948238342)
"""|z| as a polynomial in √w for w > 4, that is |z| > 2.8: relative error 2e-6."""

LOG = (1.000003227, -0.5000196213, 0.3330338257, -0.2488143322, 0.2060383069, -0.1890119449, 0.1182914637)
"""ln(1 + t)/t for 1 + t from √½ to √2: error of the logarithm 2e-7."""

SKEW = (1 / 6, -0.01395293809, 0.003613032943, -0.001354436534, 0.0009754749891, -0.0003452336965)
SHIFT = (1 / 3, -0.0277541182, 0.007822504982, -0.00188953298)
SMALL = (-0.01993274513, 0.01704197039)
"""Quantile of the Poisson law of mean λ ≥ 10, s = z/√λ: λ + √λ·z + z²·SKEW(s) + SHIFT(s) + SMALL(s)/λ.

The form is Temme's uniform expansion (Giles, *Algorithm 955*, ACM TOMS 42 (2016) 7); its functions of s are fitted.
"""

SEARCH_BELOW = 10.0
"""Poisson means below this are searched from zero, in float64: the tail of a small mean needs more than 24 bits."""

CURVE_REACH, CURVE_TERMS = 6.5, 41
"""Where the Chebyshev series of ``curve`` end, beyond the normal of the last word, and how many terms they have."""

LOWEST_S = -1.33
"""Below this s every count of a mean from 10 to 22.7 is 0, and of a larger mean no word asks for it."""


def _signed(bits: Any) -> Any:
    """2³¹ − 1 − word, as a signed number: (t + ½)/2³¹ is x = 1 − 2·survival, from −1 to 1 and never 0."""
    return arrays.signed(bits ^ 0x7FFFFFFF)


def _to_end(t: Any) -> Any:
    """1 − |x|, twice the probability of the nearer tail, at full float32 precision also in the last words."""
    return (arrays.real((t ^ (t >> 31)) ^ 0x7FFFFFFF) + 0.5) * 2.0**-31


def log(x: Any) -> Any:
    """ln x of a positive float32, to 2e-7."""
    pattern = arrays.bits(x)
    exponent = (pattern - 0x3F3504F3) >> 23
    t = arrays.of_bits(pattern - (exponent << 23)) - 1.0
    return arrays.real(exponent) * math.log(2) + t * arrays.polynomial(t, LOG)


def uniform(bits: Any) -> Any:
    """P(X > x) that the word asks for, (word + ½)/2³²."""
    t = _signed(bits)
    half = _to_end(t) * 0.5
    return arrays.where(t < 0, 1.0 - half, half)


def normal(bits: Any) -> Any:
    """Standard normal, mean 0 and variance 1."""
    t = _signed(bits)
    return _normal(arrays.real(t) + 0.5, _to_end(t))


def lognormal(bits: Any, sigma: Any, shift: Any) -> Any:
    """exp(σ·z − shift)."""
    return arrays.exp(sigma * normal(bits) - shift)


def curve(bits: Any, coefficients: Sequence[Any]) -> Any:
    """exp of a Chebyshev series in z/6.5, by Clenshaw's recurrence: a law whose logarithm is smooth in the normal."""
    x = normal(bits) * (2 / CURVE_REACH)
    ahead: Any = 0.0
    behind: Any = 0.0
    for c in coefficients[:0:-1]:
        ahead, behind = (x * ahead - behind) + c, ahead
    return arrays.exp((x * 0.5 * ahead - behind) + coefficients[0])


def normal_of(survival_probability: Any) -> Any:
    """The standard normal above which this share of the draws lies; never beyond that of the last word."""
    to_end = 2.0 * arrays.minimum(survival_probability, 1.0 - survival_probability)
    return _normal((1.0 - 2.0 * survival_probability) * 2.0**31, arrays.maximum(to_end, 2.0**-32))


def _normal(x: Any, to_end: Any) -> Any:
    """x is in units of 2⁻³¹."""
    w = -log(to_end * (2.0 - to_end))
    centre = x * arrays.polynomial(w, [c * 2.0**-31 for c in CENTRE])
    return arrays.amend(w > 4.0, centre, _tail, w, x)


def _tail(w: Any, x: Any) -> Any:
    z = arrays.polynomial(arrays.sqrt(w), TAIL)
    return arrays.where(x < 0, -z, z)


def logistic(bits: Any) -> Any:
    """Standard logistic ln((1−s)/s), mean 0 and variance π²/3."""
    t = _signed(bits)
    y = _to_end(t)
    size = log(2.0 - y) - log(y)
    return arrays.where(t < 0, -size, size)


def wald(z: Any, pick: Any, cv: Any) -> Any:
    """Inverse Gaussian of mean 1 and shape cv⁻² from a normal and a uniform (Michael, Schucany & Haas 1976)."""
    a = 0.5 * ((cv * z) * (cv * z))
    root = 1.0 / (1.0 + a + arrays.sqrt(a * (a + 2.0)))
    return arrays.where(pick * (1.0 + root) <= 1.0, root, 1.0 / root)


def poisson(bits: Any, mean: Any) -> Any:
    """Poisson counts (whole numbers in float32) of these means, from 0 to 1e30; both of the same shape."""
    return arrays.choose(mean < SEARCH_BELOW, _search, _expand, bits, mean)


def _expand(bits: Any, mean: Any) -> Any:
    """The uniform expansion; the whole part of the mean is set apart, so that the deviation keeps its digits."""
    root = arrays.sqrt(mean)
    inverse = 1.0 / root
    s = normal(bits) * inverse
    s = arrays.where(s < LOWEST_S, LOWEST_S, s)
    z = s * root
    rest = arrays.polynomial(s, SHIFT) + arrays.polynomial(s, SMALL) * (inverse * inverse)
    deviation = root * z + ((z * z) * arrays.polynomial(s, SKEW) + rest)
    below = arrays.floor(mean)
    return below + arrays.floor((mean - below) + deviation)


def _search(bits: Any, mean: Any) -> Any:
    """Smallest n whose cumulated probability reaches 1 − survival.

    ``left`` is what is missing to it, times n!, so that no step divides.
    """
    reach = 0.5 + (arrays.double(_signed(bits)) + 0.5) * 2.0**-32
    rate = arrays.double(mean)
    none = _exp_of_minus(rate)
    left, term = reach - none, none * rate
    count = arrays.where(left > 0, 1.0, rate * 0.0)
    for n in range(1, AT_ONCE):  # most pixels are done before the loop; once nothing is missing, nothing ever is
        left, term = left * n - term, term * rate
        count = count + arrays.where(left > 0, 1.0, rate * 0.0)
    state = left * AT_ONCE - term, term * rate, rate, count
    return arrays.real(arrays.repeat(_missing, _one_more, state))


AT_ONCE = 5
"""Counts that are tried without asking whether any pixel needs them."""


def _missing(left: Any, term: Any, rate: Any, count: Any) -> Any:
    return left > 0


def _one_more(left: Any, term: Any, rate: Any, count: Any) -> tuple[Any, ...]:
    count = count + 1.0
    return left * count - term, term * rate, rate, count


SERIES = tuple(1 / math.factorial(k) for k in range(10))


def _exp_of_minus(x: Any) -> Any:
    """e^−x in float64 for 0 ≤ x < 10, to 1e-12: the 64th part, whose series is short, squared six times."""
    power = arrays.polynomial(x * (-1 / 64), SERIES)
    for _ in range(6):
        power = power * power
    return power
