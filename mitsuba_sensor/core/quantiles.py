"""Quantile functions in float32: one 32-bit random integer → one random number of a distribution.

They use the operations of arrays.py, so NumPy and Dr.Jit return the same bits, without rejection loops or state.
distributions.py has the same functions in float64. d57d910e:benchmarks/fit_quantiles.py fitted the coefficients, and
benchmarks/enumerate_quantiles.py compares all 2³² integers with the exact distributions.
"""

import math
from collections.abc import Sequence

from . import arrays
from .distributions import SQUARE_MIN
from .types import Array

# z/x as a polynomial in w = −ln(1 − x²), x = 1 − 2·survival, for w ≤ 4: relative error 4e-7.
CENTRE = (
    1.253314592,
    0.3281080185,
    0.01635788389,
    -0.003316699511,
    -1.955606575e-4,
    8.646023542e-5,
    -6.095012219e-6,
)
# |z| as a polynomial in √w for w > 4, that is |z| > 2.8: relative error 2e-6.
TAIL = (
    0.138020056,
    0.9906899686,
    0.1851234197,
    -0.03989237447,
    0.004375504154,
    -0.0001948238342,
)
# ln(1 + t)/t for 1 + t from √½ to √2: error of the logarithm 2e-7.
LOG = (
    1.000003227,
    -0.5000196213,
    0.3330338257,
    -0.2488143322,
    0.2060383069,
    -0.1890119449,
    0.1182914637,
)
# Poisson quantile for a mean λ ≥ 10, s = z/√λ: λ + √λ·z + z²·SKEW(s) + SHIFT(s) + SMALL(s)/λ. The form is Temme's
# uniform expansion (Giles, *Algorithm 955*, ACM TOMS 42 (2016) 7); its functions of s are fitted.
SKEW = (
    1 / 6,
    -0.01395293809,
    0.003613032943,
    -0.001354436534,
    0.0009754749891,
    -0.0003452336965,
)
SHIFT = (1 / 3, -0.0277541182, 0.007822504982, -0.00188953298)
SMALL = (-0.01993274513, 0.01704197039)
S_MIN = (
    -1.33
)  # s is clipped: for means from 10 to 22.7, the count is 0 below; larger means never reach it
# Smaller means are summed from 0 in float64: their tail needs more than 24 bits.
SEARCH_BELOW = 10.0
UNROLLED = 5  # counts tried before the loop, without a test
# |z| at the ends of the Chebyshev series, above the largest normal (6.3), and its number of terms.
CHEBYSHEV_REACH, CHEBYSHEV_TERMS = 6.5, 41
# Terms in z and in 1/√shape of the cube root of the gamma quantile: error 5e-5 σ within 4 σ, and 7e-4 σ outside.
GAMMA_TERMS = 22, 9


def _signed(bits: Array) -> Array:
    """Return t = 2³¹ − 1 − bits as a signed integer: (t + ½)/2³¹ is x = 1 − 2·survival, from −1 to 1 and never 0."""
    return arrays.signed_bits(bits ^ 0x7FFFFFFF)


def _two_tails(t: Array) -> Array:
    """Return 1 − |x|, twice the probability of the nearer tail, with full float32 precision at the ends."""
    return (arrays.float32((t ^ (t >> 31)) ^ 0x7FFFFFFF) + 0.5) * 2.0**-31


def log(x: Array) -> Array:
    """Return ln x of a positive float32, to 2e-7."""
    pattern = arrays.signed_bits(x)
    exponent = (pattern - 0x3F3504F3) >> 23
    t = arrays.from_float_bits(pattern - (exponent << 23)) - 1.0
    return arrays.float32(exponent) * math.log(2) + t * arrays.polynomial(t, LOG)


def uniform(bits: Array) -> Array:
    """Return the survival probability P(X > x) of the drawn number, (bits + ½)/2³²."""
    t = _signed(bits)
    half = _two_tails(t) * 0.5
    return arrays.where(t < 0, 1.0 - half, half)


def normal(bits: Array) -> Array:
    """Return standard normals."""
    t = _signed(bits)
    return _normal(arrays.float32(t) + 0.5, _two_tails(t))


def lognormal(bits: Array, sigma: Array, shift: Array) -> Array:
    """Return exp(σ·z − shift)."""
    return arrays.exp(sigma * normal(bits) - shift)


def exp_chebyshev(bits: Array, coefficients: Sequence[Array]) -> Array:
    """Return exp of a Chebyshev series in z/6.5 for a standard normal z: for the gamma distribution."""
    return arrays.exp(_chebyshev(normal(bits) * (2 / CHEBYSHEV_REACH), coefficients))


def gamma_of_shape(bits: Array, shape: Array, series: Sequence[Sequence[float]]) -> Array:
    """Return gamma numbers of shape k, by a series of q in (x/k)^⅓ = 1 + q/√k: about z/3 (Wilson & Hilferty 1931).

    Below 1, 0 or exponential, as in distributions.py.
    """
    many = arrays.maximum(shape, 1.0)
    root = arrays.sqrt(many)
    narrow = 1.0 / root
    place = 2.0 * narrow - 1.0
    coefficients = [arrays.polynomial(place, row) for row in series]
    q = _chebyshev(normal(bits) * (2 / CHEBYSHEV_REACH), coefficients)
    off = narrow * q
    found = arrays.maximum(many + root * (q * (3.0 + off * (3.0 + off))), 0.0)
    s, chance = uniform(bits), 2.0 * shape / (1.0 + shape)
    share = arrays.where(s < chance, s / arrays.maximum(chance, 1e-30), 1.0)
    return arrays.where(shape < 1.0, (1.0 + shape) * -0.5 * log(share), found)


def stretched_normal(bits: Array, coefficients: Sequence[Array]) -> Array:
    """Return z·exp of a Chebyshev series in z²/6.5² for a standard normal z: for symmetric distributions."""
    z = normal(bits)
    return z * arrays.exp(_chebyshev((z * z) * (4 / CHEBYSHEV_REACH**2) - 2.0, coefficients))


def _chebyshev(twice: Array, coefficients: Sequence[Array]) -> Array:
    """Return the series at ``twice``/2, by Clenshaw's recurrence."""
    ahead, behind = 0.0, 0.0
    for c in coefficients[:0:-1]:
        ahead, behind = (twice * ahead - behind) + c, ahead
    return (twice * 0.5 * ahead - behind) + coefficients[0]


def normal_of(survival_probability: Array) -> Array:
    """Return the value that a standard normal exceeds with this probability, at most ±6.3."""
    two_tails = 2.0 * arrays.minimum(survival_probability, 1.0 - survival_probability)
    return _normal(
        (1.0 - 2.0 * survival_probability) * 2.0**31, arrays.maximum(two_tails, 2.0**-32)
    )


def _normal(x: Array, two_tails: Array) -> Array:
    """Return a standard normal from x = 1 − 2·survival, in units of 2⁻³¹, and 1 − |x|."""
    w = -log(two_tails * (2.0 - two_tails))
    centre = x * arrays.polynomial(w, [c * 2.0**-31 for c in CENTRE])
    return arrays.replace_where(w > 4.0, centre, _tail, w, x)


def _tail(w: Array, x: Array) -> Array:
    z = arrays.polynomial(arrays.sqrt(w), TAIL)
    return arrays.where(x < 0, -z, z)


def logistic(bits: Array) -> Array:
    """Return standard logistic numbers ln((1−s)/s), mean 0 and variance π²/3."""
    t = _signed(bits)
    y = _two_tails(t)
    size = log(2.0 - y) - log(y)
    return arrays.where(t < 0, -size, size)


def moyal(bits: Array) -> Array:
    """Return Moyal numbers −ln z² for a standard normal z: mode 0, mean γ + ln 2, variance π²/2."""
    z = normal(bits)
    return -log(arrays.maximum(z * z, SQUARE_MIN))


def wald(z: Array, u: Array, cv: Array) -> Array:
    """Return inverse Gaussians of mean 1 and shape cv⁻² from a normal and a uniform (Michael, Schucany & Haas 1976)."""
    a = 0.5 * ((cv * z) * (cv * z))
    root = 1.0 / (1.0 + a + arrays.sqrt(a * (a + 2.0)))
    return arrays.where(u * (1.0 + root) <= 1.0, root, 1.0 / root)


def poisson(bits: Array, mean: Array) -> Array:
    """Return Poisson counts in float32 for means from 0 to 1e30, in the shape of ``bits``."""
    return arrays.branch(mean < SEARCH_BELOW, _search, _expand, bits, mean)


def _expand(bits: Array, mean: Array) -> Array:
    """Return counts by the uniform expansion; floor(mean) is added last to keep the digits of the deviation."""
    root = arrays.sqrt(mean)
    inverse = 1.0 / root
    s = normal(bits) * inverse
    s = arrays.where(s < S_MIN, S_MIN, s)
    z = s * root
    rest = arrays.polynomial(s, SHIFT) + arrays.polynomial(s, SMALL) * (inverse * inverse)
    deviation = root * z + ((z * z) * arrays.polynomial(s, SKEW) + rest)
    below = arrays.floor(mean)
    return below + arrays.floor((mean - below) + deviation)


def _search(bits: Array, mean: Array) -> Array:
    """Return the smallest n whose cumulative probability reaches 1 − survival; ``left`` is the rest times n!."""
    reach = 0.5 + (arrays.float64(_signed(bits)) + 0.5) * 2.0**-32
    rate = arrays.float64(mean)
    none = _exp_of_minus(rate)
    left, term = reach - none, none * rate
    count = arrays.where(left > 0, 1.0, rate * 0.0)
    for n in range(1, UNROLLED):  # most pixels end here; left then stays ≤ 0
        left, term = left * n - term, term * rate
        count = count + arrays.where(left > 0, 1.0, rate * 0.0)
    state = left * UNROLLED - term, term * rate, rate, count
    return arrays.float32(arrays.loop(lambda left, *_: left > 0, _next_count, state))


def _next_count(left: Array, term: Array, rate: Array, count: Array) -> tuple[Array, ...]:
    count = count + 1.0
    return left * count - term, term * rate, rate, count


def binomial(bits: Array, number: Array, mean: Array, other: Array) -> Array:
    """Return how many of ``number`` electrons are of one kind, with probability mean/(mean + other); equal shapes.

    The total variation is at most 6e-4, just above a variance of 10, and below 3e-5 from a variance of 100.
    """
    chance = arrays.minimum(mean, other) / arrays.maximum(mean + other, 1e-30)
    spread = number * chance * (1.0 - chance)
    count = arrays.branch(
        spread < SEARCH_BELOW, _search_binomial, _expand_binomial, bits, number, chance
    )
    return arrays.where(mean > other, number - count, count)


def _expand_binomial(bits: Array, number: Array, chance: Array) -> Array:
    """Return counts by the Cornish–Fisher expansion to third order in 1/σ."""
    z, mean = normal(bits), number * chance
    z2, pq = z * z, chance * (1.0 - chance)
    sigma = arrays.sqrt(mean * (1.0 - chance))
    third = (
        (1.0 - 6.0 * pq) * (z2 - 3.0) * (1 / 24)
        - (1.0 - 4.0 * pq) * (2.0 * z2 - 5.0) * (1 / 36)
        - 1 / 24
    )
    deviation = sigma * z + (
        (1.0 - 2.0 * chance) * (z2 - 1.0) * (1 / 6) + (third * z / sigma + 0.5)
    )
    below = arrays.floor(mean)
    return arrays.minimum(
        arrays.maximum(below + arrays.floor((mean - below) + deviation), 0.0), number
    )


def _search_binomial(bits: Array, number: Array, chance: Array) -> Array:
    """Return the smallest k whose cumulative probability reaches 1 − survival, counted in float64, for a chance ≤ ½."""
    reach = 0.5 + (arrays.float64(_signed(bits)) + 0.5) * 2.0**-32
    n, p = arrays.float64(number), arrays.float64(chance)
    y = p / (2.0 - p)  # ln(1 − p) = −2·artanh(y), y ≤ ⅓
    none = _exp_of_minus(
        n * (2.0 * y * arrays.polynomial(y * y, [1 / (2 * k + 1) for k in range(12)]))
    )
    state = n, p / (1.0 - p), reach - none, none, n * 0.0
    return arrays.float32(
        arrays.loop(lambda n, odds, left, term, k: (left > 0) & (k < n), _next_of_n, state)
    )


def _next_of_n(n: Array, odds: Array, left: Array, term: Array, k: Array) -> tuple[Array, ...]:
    term = term * ((n - k) * odds / (k + 1.0))
    return n, odds, left - term, term, k + 1.0


def _exp_of_minus(x: Array) -> Array:
    """Return e^−x in float64 for 0 ≤ x < 10, to 1e-12: the series of e^(−x/64), squared six times."""
    power = arrays.polynomial(x * (-1 / 64), [1 / math.factorial(k) for k in range(10)])
    for _ in range(6):
        power = power * power
    return power
