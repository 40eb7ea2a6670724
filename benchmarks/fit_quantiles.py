"""Fit every table of coefficients in core/quantiles.py and core/arrays.py to SciPy's special functions.

    python benchmarks/fit_quantiles.py [--check] [--json]

Each fit minimises the largest weighted error (minimax, a linear programme). The tables are printed as Python code with
this error. With ``--check`` the exit code is 1 if the package has other numbers.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from mitsuba_sensor.core import arrays, quantiles

Array = NDArray[np.float64]

DIGITS = 10
"""Significant digits of a coefficient; nine distinguish all float32 numbers."""

SAME = 1e-8
"""Largest relative difference between two fits that differ by rounding only."""

LARGEST_NORMAL = 6.34
"""Slightly more than the normal deviate of the first input, 6.338."""

SPLIT = 4.0
"""w at which the tail of the normal quantile begins; tail and centre are fitted 0.05 beyond it."""

SKEW_TERMS, SHIFT_TERMS, SMALL_TERMS = 5, 3, 2
"""Fitted terms of the Poisson expansion; the first of SKEW and of SHIFT are 1/6 and 1/3, the limit of large means."""

POISSON_MEANS = (10, 10.5, 11, 12, 13.5, 15, 18, 22, 28, 35, 50, 80, 150, 300, 1e3, 1e4)
TAIL_SHARE = 1.5e-4
"""Weight of the tail of the Poisson distribution, added to its density; more would make the centre less exact."""


def main() -> int:
    """Parse the options, fit, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", action="store_true", help="compare with the tables of the package"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    found = {**fit_normal(), **fit_log(), **fit_exp(), **fit_poisson()}
    in_package = {
        name: list(getattr(arrays if name == "EXP_TAIL" else quantiles, name)) for name in found
    }
    apart = {name: difference(found[name]["table"], in_package[name]) for name in found}
    if options.json:
        print(json.dumps({name: {**fit, "apart": apart[name]} for name, fit in found.items()}))
    else:
        show(found, apart)
    return 1 if options.check and max(apart.values()) > SAME else 0


def minimax(basis: Array, values: Array, weights: Array) -> tuple[Array, float]:
    """The c that makes max |weights·(basis·c − values)| smallest, and that maximum.

    The linear programme is solved for the difference to the least-squares solution, scaled by its largest residual.
    """
    q, r = np.linalg.qr(basis * weights[:, None])
    scale = np.abs(q).max(axis=0)
    q = q / scale
    near = np.linalg.lstsq(q, values * weights, rcond=None)[0]
    rest = values * weights - q @ near
    unit = np.abs(rest).max()
    ones, unknown = np.ones((len(rest), 1)), basis.shape[1] + 1
    limits = np.block([[q, -ones], [-q, -ones]])
    solved = optimize.linprog(
        np.eye(unknown)[-1],
        limits,
        np.concatenate([rest, -rest]) / unit,
        bounds=[(None, None)] * unknown,
    )
    return np.linalg.solve(r, (near + solved.x[:-1] * unit) / scale), float(solved.fun * unit)


def powers(x: Array, terms: int) -> Array:
    """Columns 1, x, x², …"""
    return x[:, None] ** np.arange(terms)


def chebyshev_nodes(low: float, high: float, count: int = 2000) -> Array:
    """Points between low and high, dense at both ends, without the ends."""
    return (low + high) / 2 - (high - low) / 2 * np.cos(
        np.pi * (np.arange(count) + 0.5) / count
    )


def entry(coefficients: Any, error: float, of: str) -> dict[str, Any]:
    """One table, rounded to the printed digits, with its error."""
    return {"table": [float(f"{c:.{DIGITS}g}") for c in coefficients], "error": error, "of": of}


def fit_normal() -> dict[str, Any]:
    """z/x as a polynomial in w = −ln(1 − x²) up to w = 4, and z in √w above; relative error; x = 1 − 2·survival."""
    w = chebyshev_nodes(0.0, SPLIT + 0.05)
    x = np.sqrt(-np.expm1(-w))
    ratio = math.sqrt(2) * special.erfinv(x) / x
    centre, centre_error = minimax(powers(w, len(quantiles.CENTRE)), ratio, 1 / ratio)
    last = 2.0**-33
    root = chebyshev_nodes(math.sqrt(SPLIT - 0.05), math.sqrt(-math.log(4 * last * (1 - last))))
    w = root * root
    z = -special.ndtri(np.exp(-w) / (2 + 2 * np.sqrt(-np.expm1(-w))))
    tail, tail_error = minimax(powers(root, len(quantiles.TAIL)), z, 1 / z)
    return {
        "CENTRE": entry(centre, centre_error, "relative error of the normal"),
        "TAIL": entry(tail, tail_error, "relative error of the normal"),
    }


def fit_log() -> dict[str, Any]:
    """ln(1 + t)/t, with the smallest error of the logarithm; a thousandth of the weight at t = 0."""
    t = chebyshev_nodes(math.sqrt(0.5) - 1, math.sqrt(2) - 1)
    table, error = minimax(powers(t, len(quantiles.LOG)), np.log1p(t) / t, np.abs(t) + 1e-3)
    return {"LOG": entry(table, error, "error of the logarithm")}


def fit_exp() -> dict[str, Any]:
    """(e^r − 1 − r)/r², with the smallest error of e^r; the values come from the series, without cancellation."""
    r = chebyshev_nodes(-0.347, 0.347)
    values = sum(r**k / math.factorial(k + 2) for k in range(15))
    table, error = minimax(powers(r, len(arrays.EXP_TAIL)), values, r * r)
    return {"EXP_TAIL": entry(table, error, "error of the exponential")}


def fit_poisson() -> dict[str, Any]:
    """SKEW, SHIFT and SMALL together: the error in standard deviations, weighted by the normal density."""
    bases, values, weights = zip(
        *(poisson_rows(float(mean)) for mean in POISSON_MEANS), strict=True
    )
    c, error = minimax(np.concatenate(bases), np.concatenate(values), np.concatenate(weights))
    of = "standard deviations at the centre, weighted by density"
    first, second = SKEW_TERMS, SKEW_TERMS + SHIFT_TERMS
    return {
        "SKEW": entry([1 / 6, *c[:first]], error, of),
        "SHIFT": entry([1 / 3, *c[first:second]], error, of),
        "SMALL": entry(c[second:], error, of),
    }


def poisson_rows(mean: float) -> tuple[Array, Array, Array]:
    """For one mean: the columns z²·sᵏ, sᵏ and sᵏ/mean, the values they are fitted to, and the weights."""
    x, z = poisson_points(mean)
    s = z / math.sqrt(mean)
    skew, shift = (
        powers(s, SKEW_TERMS + 1)[:, 1:] * (z * z)[:, None],
        powers(s, SHIFT_TERMS + 1)[:, 1:],
    )
    basis = np.concatenate([skew, shift, powers(s, SMALL_TERMS) / mean], axis=1)
    rest = x - mean - math.sqrt(mean) * z - (z * z / 6 + 1 / 3)
    density = np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
    return basis, rest, (density + TAIL_SHARE) / math.sqrt(mean)


def poisson_points(mean: float) -> tuple[Array, Array]:
    """Counts x, not only whole numbers, and the normal deviates z of the same probability P(N < x) = Q(x, mean).

    From the end of the count 0, a little below x = 1, or from the clip at S_MIN, to the last input.
    """
    guess = chebyshev_nodes(-LARGEST_NORMAL, LARGEST_NORMAL, 241)
    x = np.concatenate(
        [np.linspace(0.9, 3, 22), mean + math.sqrt(mean) * guess + guess * guess / 6 + 1 / 3]
    )
    x = x[x >= 0.9]
    z = np.where(
        x > mean,
        -special.ndtri(special.gammainc(x, mean)),
        special.ndtri(special.gammaincc(x, mean)),
    )
    kept = (z >= quantiles.S_MIN * math.sqrt(mean)) & (np.abs(z) <= LARGEST_NORMAL)
    return x[kept], z[kept]


def difference(new: list[float], old: list[float]) -> float:
    """Largest relative difference of two tables; infinite if their lengths differ."""
    if len(new) != len(old):
        return math.inf
    return max(abs(a - b) / abs(a) for a, b in zip(new, old, strict=True))


def show(found: dict[str, Any], apart: dict[str, float]) -> None:
    """Print the tables as Python code."""
    for name, fit in found.items():
        print(f"# {fit['error']:.1e} {fit['of']}; {apart[name]:.0e} from the package")
        print(f"{name} = ({', '.join(written(c) for c in fit['table'])})")


def written(c: float) -> str:
    """The number, or the fraction that it represents."""
    fraction = {round(1 / k, DIGITS): f"1 / {k}" for k in (3, 6)}
    return fraction.get(c, repr(c))


if __name__ == "__main__":
    sys.exit(main())
