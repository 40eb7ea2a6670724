"""Special functions of Python numbers, in float64: the one place where the physics meets SciPy's."""

from __future__ import annotations

import math

from scipy import special

EULER_GAMMA = 0.5772156649015329


def sinh_integrals(x: float) -> float:
    """½[e^(−x)·Ei(x) − e^(x)·E₁(x)] for x > 0; 1/x² + 6/x⁴ once the parts would overflow."""
    if x > 500.0:
        return 1 / x**2 + 6 / x**4
    return 0.5 * float(math.exp(-x) * special.expi(x) - math.exp(x) * special.exp1(x))


def two_term_remainder(x: float) -> float:
    """1 − e^(−x)·(1 + x) ≥ 0, without the cancellation below 1e-3."""
    if x < 1e-3:
        return x * x * (0.5 - x / 3 + x * x / 8)
    return 1.0 - math.exp(-x) * (1.0 + x)
