"""The exact law of the float32 Poisson and normal draws: all 2³² words go through, so nothing is left to chance.

    python benchmarks/enumerate_draws.py [--means 1 10 1e6] [--stride 1] [--json]

Up to a minute for each mean on two cores, five for the normal. ``--stride N`` takes every N-th word, from half
a stride on. The exact law is SciPy's, whose probabilities are good to 1e-9 at a mean of 1e6. Exit code 1 where a law
misses its limits.
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

from mitsuba_sensor.core.drjit_backend import DrJitBackend
from mitsuba_sensor.core.llvm import backend_problem

MEANS = (1e-6, 0.01, 1.0, 5.0, 9.9, 10.0, 12.0, 30.0, 100.0, 1e3, 1e4, 1e5, 1e6)
ALL = 2**32
CHUNK = 2**24
MEAN_LIMIT, VARIANCE_LIMIT = 1e-5, 3e-5
NORMAL_LIMITS = {"mean": 1e-8, "variance": 1e-6, "largest_error": 2e-5}


def main() -> int:
    """Parse the options, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--means", type=mean_number, nargs="+", default=MEANS, help="of the Poisson laws [events]")
    parser.add_argument("--stride", type=int, default=1, help="every how many-th word (default 1: all)")
    parser.add_argument("--json", action="store_true", help="only JSON")
    options = parser.parse_args()
    if problem := backend_problem("llvm"):
        sys.exit(f"the words are put through by Dr.Jit-LLVM: {problem}")
    backend, stride = DrJitBackend("llvm"), options.stride
    result = {
        "words": -(-ALL // stride),
        "poisson": [judge_poisson(backend, float(np.float32(mean)), stride) for mean in options.means],
        "zero_mean_is_zero": only_zeros(backend, stride),
        "normal": judge_normal(backend, stride),
    }
    print(json.dumps(result)) if options.json else show(result)
    return 0 if result["zero_mean_is_zero"] and all(r["good"] for r in (*result["poisson"], result["normal"])) else 1


def mean_number(text: str) -> float:
    """A mean whose counts can be told apart: float32 holds every whole number up to 2²⁴ only."""
    if not 0 < float(text) <= 1e7:
        raise argparse.ArgumentTypeError(f"{text} is not above 0 and at most 1e7")
    return float(text)


def chunks(backend: DrJitBackend, stride: int, share: int = 1) -> Iterator[tuple[Any, str]]:
    """Every ``stride``-th word of the lower 1/share of all words, in arrays of up to 2²⁴, and how far we are."""
    total = -(-ALL // (stride * share))
    for start in range(0, total, CHUNK):
        number = backend.dr.arange(backend.uint, min(CHUNK, total - start))
        offset = start * stride + stride // 2
        yield (
            number * backend.dr.opaque(backend.uint, stride) + backend.dr.opaque(backend.uint, offset),
            f"{start / total:4.0%}",
        )
    print(end="\r\033[K", file=sys.stderr)


def tell(text: str) -> None:
    """The progress line."""
    print(f"\r{text}\033[K", end="", file=sys.stderr, flush=True)


def poisson_counts(backend: DrJitBackend, mean: float, stride: int) -> tuple[int, NDArray[np.int64]]:
    """How often each count is drawn: the lowest count of the histogram, and the histogram. No draw is outside it."""
    dr, reach = backend.dr, 7 * math.sqrt(mean) + 20
    lowest = max(0, math.floor(mean - reach))
    seen = np.zeros(math.ceil(mean + reach) - lowest, dtype=np.int64)
    for words, progress in chunks(backend, stride):
        tell(f"Poisson, mean {mean:g}: {progress}")
        distributions = backend.poisson(words, dr.opaque(backend.float, mean, len(words)))
        tally = dr.zeros(backend.uint, seen.size)
        inside = (distributions >= lowest) & (distributions < lowest + seen.size)
        dr.scatter_add(tally, backend.uint(1), backend.uint(distributions - lowest), inside)
        seen += tally.numpy()
    if seen.sum() != -(-ALL // stride):
        raise RuntimeError(f"draws of mean {mean:g} lie outside {lowest} … {lowest + seen.size}")
    return lowest, seen


def poisson_limits(mean: float, words: int) -> dict[str, float]:
    """Total variation, and relative errors of mean and variance. No word can be cut: half a one is forgiven.

    Fewer words than all end each cell of the law, ±6σ of them, up to half of a longer stride away from its place.
    """
    variation = 1e-6 if mean < 10 else 2e-5 if mean <= 1e5 else 4e-5
    half_a_word, lost = 0.5 / (words * mean), 1 / words - 1 / ALL
    return {
        "variation": variation + lost * (6 * math.sqrt(mean) + 1),
        "mean": MEAN_LIMIT + half_a_word + lost * 12 / mean,
        "variance": VARIANCE_LIMIT + half_a_word + lost * (40 + 12 / mean),
    }


def judge_poisson(backend: DrJitBackend, mean: float, stride: int) -> dict[str, Any]:
    """Total variation ½Σ|p − q| to the exact law, and the relative errors of mean and variance."""
    lowest, seen = poisson_counts(backend, mean, stride)
    n, share = lowest + np.arange(seen.size), seen / seen.sum()
    exact = stats.poisson.pmf(n, mean)
    found = {
        "variation": 0.5 * float(np.abs(share - exact).sum() + 1 - exact.sum()),
        "mean": float(np.sum(share * (n - mean))) / mean,
    }
    found["variance"] = (float(np.sum(share * (n - mean) ** 2)) - (found["mean"] * mean) ** 2) / mean - 1
    limits = poisson_limits(mean, int(seen.sum()))
    good = all(abs(found[name]) <= limits[name] for name in limits)
    return {"electrons": mean, **found, "limits": limits, "good": good}


def only_zeros(backend: DrJitBackend, stride: int) -> bool:
    """Whether every word draws exactly 0 from the mean 0."""
    for words, progress in chunks(backend, stride):
        tell(f"Poisson, mean 0: {progress}")
        if not backend.dr.all(backend.poisson(words, backend.dr.opaque(backend.float, 0.0, len(words))) == 0):
            return False
    return True


def judge_normal(backend: DrJitBackend, stride: int) -> dict[str, Any]:
    """Mean, variance − 1, and the largest error against SciPy, whose z of a word is −z of the complement."""
    count, total, squares, largest = 0, 0.0, 0.0, 0.0
    for words, progress in chunks(backend, stride, share=2):
        tell(f"normal: {progress}")
        exact = -special.ndtri((words.numpy() + 0.5) * 2.0**-32)
        for sign, asked in ((1, words), (-1, ~words)):
            z = backend.normal(asked).numpy().astype(np.float64)
            count, total, squares = count + z.size, total + float(z.sum()), squares + float(np.dot(z, z))
            largest = max(largest, float(np.abs(z - sign * exact).max()))
    found = {"mean": total / count, "variance": squares / count - 1, "largest_error": largest}
    limits = {**NORMAL_LIMITS, "variance": NORMAL_LIMITS["variance"] + 3 / count}  # the ends beyond the last words
    good = all(abs(found[name]) <= limits[name] for name in limits)
    return {**found, "limits": limits, "good": good}


def show(result: dict[str, Any]) -> None:
    """The table."""
    print(f"{result['words']} words: Poisson draws against the exact law")
    print("       mean   total variation   error of the mean   of the variance")
    for r in result["poisson"]:
        words = f"{r['electrons']:11.6g}   {r['variation']:15.2e}   {r['mean']:17.2e}   {r['variance']:15.2e}"
        print(f"{words}   {'good' if r['good'] else 'MISSED'}")
    print(f"mean 0 draws {'only zeros' if result['zero_mean_is_zero'] else 'NOT ONLY ZEROS'}")
    n = result["normal"]
    print(
        f"normal: mean {n['mean']:.1e}, variance 1 {n['variance']:+.2e}, largest error {n['largest_error']:.2e}   "
        f"{'good' if n['good'] else 'MISSED'}"
    )


if __name__ == "__main__":
    sys.exit(main())
