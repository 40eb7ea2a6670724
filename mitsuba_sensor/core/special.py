"""Special functions, roots, maxima and integrals in float64, by SciPy."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import scipy

EULER_GAMMA = 0.5772156649015329


def sinh_integrals(x: float) -> float:
    """Return ½[e^(−x)·Ei(x) − e^(x)·E₁(x)] for x > 0; 1/x² + 6/x⁴ if the factors would overflow."""
    if x > 500.0:
        return 1 / x**2 + 6 / x**4
    return 0.5 * float(
        math.exp(-x) * scipy.special.expi(x) - math.exp(x) * scipy.special.exp1(x)
    )


def root(f: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero of f between ``low`` and ``high`` (Brent's method)."""
    return float(scipy.optimize.brentq(f, low, high, xtol=1e-15))


def largest(f: Callable[[float], float], low: float, high: float) -> float:
    """Return the largest value of a unimodal function between ``low`` and ``high``."""
    peak = scipy.optimize.minimize_scalar(
        lambda x: -f(x), bounds=(low, high), method="bounded", options={"xatol": 1e-9}
    )
    return -float(peak.fun)


def integral(f: Callable[[float], float], edges: Sequence[float]) -> float:
    """Return ∫ f from the first to the last edge, by adaptive quadrature between the edges."""
    return math.fsum(
        scipy.integrate.quad(f, a, b, epsrel=1e-10, limit=200)[0] for a, b in pairwise(edges)
    )


def two_term_remainder(x: float) -> float:
    """Return 1 − e^(−x)·(1 + x) ≥ 0, without cancellation below 1e-3."""
    if x < 1e-3:
        return x * x * (0.5 - x / 3 + x * x / 8)
    return 1.0 - math.exp(-x) * (1.0 + x)
