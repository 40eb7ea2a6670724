"""Compute the exact distribution of the float32 Poisson and normal random numbers from all 2³² inputs.

    python benchmarks/enumerate_quantiles.py [--means 1 10 1e6] [--stride 1] [--json]

On two cores this takes up to a minute per mean, and five minutes for the normal distribution. ``--stride N`` uses every
N-th input, starting at half a stride. The reference is SciPy, whose probabilities have an error of 1e-9 at a mean of
1e6. The exit code is 1 if a distribution exceeds its limits.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats
from timing import lines

from mitsuba_sensor.core.drjit_backend import DrJitBackend
from mitsuba_sensor.core.llvm import backend_problem

MEANS = (1e-6, 0.01, 1.0, 5.0, 9.9, 10.0, 12.0, 30.0, 100.0, 1e3, 1e4, 1e5, 1e6)
ALL = 2**32
CHUNK = 2**24
MEAN_LIMIT, VARIANCE_LIMIT = 1e-5, 3e-5
NORMAL_LIMITS = {"mean": 1e-8, "variance": 1e-6, "largest_error": 2e-5}


def main() -> int:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--means",
        type=mean_number,
        nargs="+",
        default=MEANS,
        help="means of the Poisson counts [events]",
    )
    parser.add_argument(
        "--stride", type=int, default=1, help="use every N-th input (default 1: all)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if problem := backend_problem("llvm"):
        sys.exit(f"this benchmark needs Dr.Jit with LLVM: {problem}")
    backend, stride = DrJitBackend("llvm"), options.stride
    result = {
        "inputs": -(-ALL // stride),
        "poisson": [
            check_poisson(backend, float(np.float32(mean)), stride) for mean in options.means
        ],
        "zero_mean_is_zero": only_zeros(backend, stride),
        "normal": check_normal(backend, stride),
    }
    print(json.dumps(result) if options.json else "\n".join(lines(result)))
    return (
        0
        if result["zero_mean_is_zero"]
        and all(r["within_limits"] for r in (*result["poisson"], result["normal"]))
        else 1
    )


def mean_number(text: str) -> float:
    """Parse a mean whose counts float32 can represent: whole numbers up to 2²⁴."""
    if not 0 < float(text) <= 1e7:
        raise argparse.ArgumentTypeError(f"{text} is not above 0 and at most 1e7")
    return float(text)


def chunks(backend: DrJitBackend, stride: int, share: int = 1) -> Iterator[tuple[Any, str]]:
    """Yield every ``stride``-th of the lower 1/share of all inputs, in arrays of up to 2²⁴, and the progress."""
    total = -(-ALL // (stride * share))
    for start in range(0, total, CHUNK):
        number = backend.dr.arange(backend.uint, min(CHUNK, total - start))
        offset = start * stride + stride // 2
        yield (
            number * backend.dr.opaque(backend.uint, stride)
            + backend.dr.opaque(backend.uint, offset),
            f"{start / total:4.0%}",
        )
    print(end="\r\033[K", file=sys.stderr)


def show_progress(text: str) -> None:
    """Print the progress line."""
    print(f"\r{text}\033[K", end="", file=sys.stderr, flush=True)


def poisson_counts(
    backend: DrJitBackend, mean: float, stride: int
) -> tuple[int, NDArray[np.int64]]:
    """Return the lowest count of the histogram, and the histogram of all counts."""
    dr, reach = backend.dr, 7 * math.sqrt(mean) + 20
    lowest = max(0, math.floor(mean - reach))
    seen = np.zeros(math.ceil(mean + reach) - lowest, dtype=np.int64)
    for bits, progress in chunks(backend, stride):
        show_progress(f"Poisson, mean {mean:g}: {progress}")
        counts = backend.poisson(bits, dr.opaque(backend.float, mean, len(bits)))
        tally = dr.zeros(backend.uint, seen.size)
        inside = (counts >= lowest) & (counts < lowest + seen.size)
        dr.scatter_add(tally, backend.uint(1), backend.uint(counts - lowest), inside)
        seen += tally.numpy()
    if seen.sum() != -(-ALL // stride):
        raise RuntimeError(
            f"counts for mean {mean:g} are outside {lowest} … {lowest + seen.size}"
        )
    return lowest, seen


def poisson_limits(mean: float, inputs: int) -> dict[str, float]:
    """Return the limits of the total variation distance and of the relative errors of mean and variance.

    Each input counts as a whole, which gives an error of up to half an input. With a stride, each of the counts within
    ±6σ may begin up to half a stride away from its exact place.
    """
    variation = 1e-6 if mean < 10 else 2e-5 if mean <= 1e5 else 4e-5
    half_an_input, skipped = 0.5 / (inputs * mean), 1 / inputs - 1 / ALL
    return {
        "variation": variation + skipped * (6 * math.sqrt(mean) + 1),
        "mean": MEAN_LIMIT + half_an_input + skipped * 12 / mean,
        "variance": VARIANCE_LIMIT + half_an_input + skipped * (40 + 12 / mean),
    }


def check_poisson(backend: DrJitBackend, mean: float, stride: int) -> dict[str, Any]:
    """Return the total variation distance ½Σ|p − q|, and the relative errors of mean and variance."""
    lowest, seen = poisson_counts(backend, mean, stride)
    n, share = lowest + np.arange(seen.size), seen / seen.sum()
    exact = stats.poisson.pmf(n, mean)
    found = {
        "variation": 0.5 * float(np.abs(share - exact).sum() + 1 - exact.sum()),
        "mean": float(np.sum(share * (n - mean))) / mean,
    }
    found["variance"] = (
        float(np.sum(share * (n - mean) ** 2)) - (found["mean"] * mean) ** 2
    ) / mean - 1
    limits = poisson_limits(mean, int(seen.sum()))
    within_limits = all(abs(found[name]) <= limits[name] for name in limits)
    return {"electrons": mean, **found, "limits": limits, "within_limits": within_limits}


def only_zeros(backend: DrJitBackend, stride: int) -> bool:
    """Return True if every input gives exactly 0 for the mean 0."""
    for bits, progress in chunks(backend, stride):
        show_progress(f"Poisson, mean 0: {progress}")
        if not backend.dr.all(
            backend.poisson(bits, backend.dr.opaque(backend.float, 0.0, len(bits))) == 0
        ):
            return False
    return True


def check_normal(backend: DrJitBackend, stride: int) -> dict[str, Any]:
    """Return mean, variance − 1, and the largest error relative to SciPy; z of an input is −z of its complement."""
    count, total, squares, largest = 0, 0.0, 0.0, 0.0
    for bits, progress in chunks(backend, stride, share=2):
        show_progress(f"normal: {progress}")
        exact = -special.ndtri((bits.numpy() + 0.5) * 2.0**-32)
        for sign, asked in ((1, bits), (-1, ~bits)):
            z = backend.normal(asked).numpy().astype(np.float64)
            count, total, squares = (
                count + z.size,
                total + float(z.sum()),
                squares + float(np.dot(z, z)),
            )
            largest = max(largest, float(np.abs(z - sign * exact).max()))
    found = {"mean": total / count, "variance": squares / count - 1, "largest_error": largest}
    limits = {
        **NORMAL_LIMITS,
        "variance": NORMAL_LIMITS["variance"] + 3 / count,
    }  # the tails beyond the last inputs
    within_limits = all(abs(found[name]) <= limits[name] for name in limits)
    return {**found, "limits": limits, "within_limits": within_limits}


if __name__ == "__main__":
    sys.exit(main())
