"""Quantile functions in float64: one 32-bit random integer → one random number of a distribution, by SciPy.

A random integer r gives the survival probability s = (r + ½)/2³², so both tails are equally fine and the largest normal
is 6.3 σ. There is no rejection loop and no state.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import accumulate

import numpy as np
import scipy

from .types import Array, Float64Array, RandomBits

# Poisson means below are summed from 0; above, the exact law checks an expansion.
SEARCH_BELOW = 10.0
# Above this mean, only the expansion is used: its error is below 1e-5 of a count, while SciPy's incomplete gamma
# function loses its upper tail (3 % of the probability above 5σ at a mean of 1e7).
EXACT_BELOW = 1e6
# Columns filtered at a time, and the margin that the filter remembers: φ^2048 < 2e-18. For maps (H, W), the coupling is
# at most 0.45: φ^96 < 4e-20.
AR_BLOCK, AR_WARM_UP = 4096, 2048
AR_MAP_BLOCK, AR_MAP_MARGIN = 512, 96
SQUARE_MIN = 1e-18
"""Smallest square of a normal in Moyal's distribution, which then ends at 41."""
# Smallest survival probabilities [2⁻³²] that are summed individually in a moment; the others are integrated.
TAIL_COUNT = 4096


def survival(bits: RandomBits) -> Float64Array:
    """Return the survival probability P(X > x) of the drawn number: (bits + ½)/2³², exact and never 0 or 1."""
    return (bits.astype(np.float64) + 0.5) * 2.0**-32


def sum_over_upper_half(function: Callable[[Float64Array], Float64Array]) -> float:
    """Return the mean over the 2³² survival probabilities of a function that is 0 above ½."""
    outermost: Float64Array = (np.arange(TAIL_COUNT, dtype=np.float64) + 0.5) * 2.0**-32
    tail = np.sum(function(outermost)) * 2.0**-32
    nodes, weights = np.polynomial.legendre.leggauss(64)
    near, far = math.log(2), -math.log(TAIL_COUNT * 2.0**-32)
    s: Float64Array = np.exp(-(near + (far - near) * (nodes + 1) / 2))
    rest = (far - near) / 2 * (weights @ (function(s) * s))
    return float(tail + rest)


def normal(bits: RandomBits) -> Float64Array:
    """Return standard normals."""
    return normal_of(survival(bits))


def normal_of(survival_probability: Array) -> Float64Array:
    """Return the value that a standard normal exceeds with this probability."""
    z: Float64Array = scipy.special.ndtri(survival_probability)
    return -z


def lognormal(bits: RandomBits, cv: float) -> Float64Array:
    """Return log-normals of mean 1 and coefficient of variation ``cv``: μ = −½ln(1+cv²), σ² = ln(1+cv²)."""
    variance = math.log1p(cv * cv)
    return np.exp(math.sqrt(variance) * normal(bits) - 0.5 * variance)


def lognormal_moment(cv: float, power: int) -> float:
    """Return the mean of the ``power``-th power of the log-normals that can be drawn, up to 6.3 σ."""
    variance = math.log1p(cv * cv)

    def both_tails(s: Float64Array) -> Float64Array:
        z = math.sqrt(variance) * normal_of(s)
        logs = (power * (sign * z - 0.5 * variance) for sign in (1, -1))
        return np.asarray(sum(map(np.exp, logs)))

    return sum_over_upper_half(both_tails)


def gamma(bits: RandomBits, cv: float) -> Float64Array:
    """Return gamma numbers of mean 1 and coefficient of variation ``cv``: shape cv⁻², scale cv²."""
    if cv < 1e-6:  # normal to 1e-12
        return 1 + cv * normal(bits)
    x: Float64Array = scipy.special.gammainccinv(cv**-2, survival(bits))
    return x * cv**2


def gamma_series(cv: float, reach: float, terms: int) -> list[float]:
    """Return Chebyshev coefficients of ln(gamma quantile) over z/reach; 41 terms give 1e-4 σ for a cv up to 2."""
    z = reach * np.cos(np.pi * (np.arange(4 * terms) + 0.5) / (4 * terms))
    coefficients = np.polynomial.chebyshev.chebfit(z / reach, _log_gamma(z, cv), terms - 1)
    return list(map(float, coefficients))


def gamma_of_shape(bits: RandomBits, shape: Array) -> Float64Array:
    """Return gamma numbers of shape k, mean and variance k; above 1e6 by an expansion in 1/√k, to 1e-9 σ.

    Below 1, they are 0, or exponential of mean (1 + k)/2 with probability 2k/(1 + k); mean and variance are also k.
    """
    shape = np.broadcast_to(np.asarray(shape, np.float64), bits.shape)
    s, root = survival(bits), np.sqrt(np.maximum(shape, 1.0))
    exact = scipy.special.gammainccinv(np.clip(shape, 1.0, EXACT_BELOW), s)
    z = normal(bits)
    expanded = shape + root * z + (z * z - 1) / 3 + (z**3 - 7 * z) / (36 * root)
    probability = 2 * shape / (1 + shape)
    relative = np.divide(s, probability, out=np.ones(bits.shape), where=s < probability)
    few = -(1 + shape) / 2 * np.log(relative)
    return np.asarray(np.select([shape < 1, shape < EXACT_BELOW], [few, exact], expanded))


@lru_cache(maxsize=1)
def gamma_shape_series(reach: float, terms: int, of_shape: int) -> list[list[float]]:
    """Return Chebyshev coefficients over z/reach of q in (X/k)^⅓ = 1 + q/√k, as polynomials in 2/√k − 1, for k ≥ 1."""
    z, place = (np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in (terms, of_shape))
    narrow = np.maximum((place + 1) / 2, 1e-3)
    k = narrow[None, :] ** -2
    x = _gamma_quantile(reach * z[:, None], k)
    q = (np.cbrt(x / k) - 1) / narrow
    in_z = np.linalg.solve(np.polynomial.chebyshev.chebvander(z, terms - 1), q)
    in_shape = np.polynomial.chebyshev.chebvander(2 * narrow - 1, of_shape - 1)
    rows = np.linalg.solve(in_shape, in_z.T).T
    return [np.polynomial.chebyshev.cheb2poly(row).tolist() for row in rows]


def _gamma_quantile(z: Float64Array, shape: Array) -> Float64Array:
    """Return the gamma quantile of this shape where a standard normal has z, from the nearer tail."""
    upper = scipy.special.gammainccinv(shape, scipy.special.ndtr(-z))
    lower = scipy.special.gammaincinv(shape, scipy.special.ndtr(z))
    return np.asarray(np.where(z > 0, upper, lower))


def _log_gamma(z: Float64Array, cv: float) -> Float64Array:
    """Return ln of the gamma quantile (mean 1) where a standard normal has z."""
    if cv < 1e-6:
        return np.log1p(cv * z)
    shape = cv**-2
    x = _gamma_quantile(z, shape)
    # P(X < x) = x^k/Γ(k + 1) for x → 0, where SciPy underflows.
    small = (scipy.special.log_ndtr(z) + scipy.special.gammaln(shape + 1)) / shape
    with np.errstate(divide="ignore"):
        logarithm: Float64Array = np.where((x > 1e-290) & (small > -600), np.log(x), small)
    return logarithm + 2 * math.log(cv)


def logistic(bits: RandomBits) -> Float64Array:
    """Return standard logistic numbers ln((1−s)/s), mean 0 and variance π²/3."""
    s = survival(bits)
    return np.log1p(-s) - np.log(s)


def moyal(bits: RandomBits) -> Float64Array:
    """Return Moyal numbers −ln z² for a standard normal z: mode 0, mean γ + ln 2, variance π²/2."""
    z = normal(bits)
    return -np.log(np.maximum(z * z, SQUARE_MIN))


def wald(z: Float64Array, u: Float64Array, cv: float) -> Float64Array:
    """Return inverse Gaussians of mean 1 and shape cv⁻² from a normal and a uniform (Michael, Schucany & Haas 1976)."""
    a = 0.5 * (cv * z) ** 2
    root = 1 / (1 + a + np.sqrt(a * (a + 2)))  # smaller root, without cancellation in float32
    return np.where(u * (1 + root) <= 1, root, 1 / root)


def rectified_normal_mean(sigma: float) -> float:
    """Return the mean of max(0, 1 + sigma·z) for a standard normal z."""
    if sigma < 0.1:  # nothing is cut within 10 σ
        return 1.0
    density = math.exp(-0.5 / sigma**2) / math.sqrt(2 * math.pi)
    return float(scipy.special.ndtr(1 / sigma)) + sigma * density


def rectified_logistic_mean(scale: float) -> float:
    """Return the mean of max(0, 1 + scale·L) for a standard logistic L: scale·ln(1 + e^(1/scale))."""
    if scale < 0.01:  # nothing is cut: e^-100
        return 1.0
    return scale * float(np.logaddexp(0.0, 1 / scale))


def poisson(bits: RandomBits, mean: Array) -> Float64Array:
    """Return Poisson counts in float64: the smallest n with P(N > n) ≤ s. Mean 0 gives 0, +inf gives +inf."""
    s = survival(bits).ravel()
    lam = np.broadcast_to(np.asarray(mean, dtype=np.float64), bits.shape).ravel()
    count = np.where(np.isinf(lam), np.inf, 0.0)
    low = np.flatnonzero((lam > 0) & (lam < SEARCH_BELOW))
    high = np.flatnonzero((lam >= SEARCH_BELOW) & np.isfinite(lam))
    count[low] = _search(1.0 - s[low], lam[low])
    count[high] = _expand(s[high], lam[high])
    return count.reshape(bits.shape)


def _search(u: Float64Array, lam: Float64Array) -> Float64Array:
    """Return the smallest n with cdf(n) ≥ u, counted from 0, for small means."""
    count = np.zeros_like(lam)
    index = np.arange(lam.size)
    term = np.exp(-lam)
    cdf = term.copy()
    n = 0
    while True:
        going = cdf < u
        index, u, lam, term, cdf = index[going], u[going], lam[going], term[going], cdf[going]
        if not index.size:
            return count
        n += 1
        term = term * lam / n
        cdf = cdf + term
        count[index] = n


def _expand(s: Float64Array, lam: Float64Array) -> Float64Array:
    """Return counts by the normal expansion of Giles, *Algorithm 955*, ACM TOMS 42 (2016) 7, or exactly if in doubt."""
    z: Float64Array = -scipy.special.ndtri(s)
    root = np.sqrt(lam)
    x = lam + root * z + (1 / 3 + z * z / 6) - z * (1 / 36 + z * z / 72) / root
    bound = 4.0 * (1 / 40 + z * z / 80 + z**4 / 160) / lam
    count = np.maximum(np.floor(x), 0.0)
    doubt = np.flatnonzero((np.floor(x - bound) != np.floor(x + bound)) & (lam < EXACT_BELOW))
    count[doubt] = _correct(
        count[doubt], s[doubt], lambda n: scipy.special.gammainc(n + 1.0, lam[doubt])
    )
    return count


def _correct(
    n: Float64Array, s: Float64Array, beyond: Callable[[Float64Array], Array]
) -> Array:
    """Return the smallest count with P(N > n) ≤ s from a first guess n.  beyond : returns P(N > n)."""
    while (up := beyond(n) > s).any():
        n = n + up
    while (down := (n > 0) & (beyond(np.maximum(n - 1.0, 0.0)) <= s)).any():
        n = n - down
    return n


def binomial(bits: RandomBits, number: Array, mean: Array, other: Array) -> Float64Array:
    """Return how many of ``number`` electrons are of one kind, with probability mean/(mean + other); +inf is 1e30.

    Third-order Cornish–Fisher expansion, or the exact distribution if in doubt and for variances below 10.
    """
    s = survival(bits).ravel()
    limited = (np.minimum(np.asarray(x, dtype=np.float64), 1e30) for x in (number, mean, other))
    n, a, b = (np.broadcast_to(x, bits.shape).ravel() for x in limited)
    p = np.minimum(a, b) / np.maximum(a + b, 1e-300)
    variance = n * p * (1 - p)
    z, sigma = normal_of(s), np.sqrt(np.maximum(variance, 1e-300))
    third = binomial_third(z * z, p * (1 - p)) * z / sigma
    x = n * p + 0.5 + sigma * z + (1 - 2 * p) * (z * z - 1) / 6 + third
    bound = 8.0 * (1 / 40 + z * z / 80 + z**4 / 160) / sigma**2
    count = np.clip(np.floor(np.where(variance < 1, n * p, x)), 0.0, n)
    near = (variance < SEARCH_BELOW) | (np.floor(x - bound) != np.floor(x + bound))
    doubt = np.flatnonzero(near & (variance > 0) & (variance < EXACT_BELOW))
    n_, p_ = n[doubt], p[doubt]

    def beyond(k: Float64Array) -> Array:
        tail = scipy.special.betainc(k + 1.0, np.maximum(n_ - k, 1.0), p_)
        return np.where(k < n_, tail, 0.0)

    count[doubt] = _correct(count[doubt], s[doubt], beyond)
    result: Float64Array = np.where(a > b, n - count, count)
    return result.reshape(bits.shape)


def binomial_third(z2: Array, pq: Array) -> Array:
    """Return the third-order term of a binomial quantile in 1/σ, over z/σ.  z2 : z².  pq : p·(1 − p)."""
    return (1 - 6 * pq) * (z2 - 3) / 24 - (1 - 4 * pq) * (2 * z2 - 5) / 36 - 1 / 24


def isotropic_ar(normals: Float64Array, coupling: float, margin: int) -> Float64Array:
    """Return x of variance 1 with x_j = a(x_{j−1} + x_{j+1}) + U_j, from white normals U with margins on both sides.

    normals : shape (…, n + 2·margin); the result has shape (…, n).  coupling a : 0 to 0.4999; neighbours correlate by
    ρ₁ = 2a. El Gamal et al. 1998 (paper eq. 28 on a separate vector), as a forward and a backward AR(1) pass.
    """
    phi = 2 * coupling / (1 + math.sqrt((1 - 2 * coupling) * (1 + 2 * coupling)))
    forward = _recursion(normals, phi)
    both = _recursion(forward[..., ::-1], phi)[..., ::-1]
    gain: float = (phi / coupling if coupling else 1.0) * (1 - 4 * coupling * coupling) ** 0.75
    return gain * both[..., margin:-margin]


def _recursion(x: Float64Array, phi: float) -> Float64Array:
    """Return y_j = x_j + φ·y_{j−1} along the last axis; importing scipy.signal for its lfilter takes half a second."""
    if phi == 0:
        return x
    along = np.moveaxis(x, -1, 0)
    terms = along.tolist() if x.ndim == 1 else along  # Python floats are fast
    steps = accumulate(terms, lambda before, new: new + phi * before)
    return np.moveaxis(np.array(list(steps)), 0, -1)
