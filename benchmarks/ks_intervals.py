"""Intervals for the distance of Kolmogorov and Smirnov of two samples: how often three of them hold the true distance.

    python benchmarks/ks_intervals.py [--pairs 1500] [--seed 14]

Samples of 200 to 4000 normal values of two laws, apart by more than chance at 95 %, nearer, or of one law.

inequality : of Dvoretzky, Kiefer, Wolfowitz and Massart for both samples.
delta : standard error of the two shares at the place of the largest difference.
halves : one half of the values says where the difference is the largest, and the other how large it is there.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict

import numpy as np
from scipy.special import ndtr

TWO_SIDED = 1.96
GRID = np.linspace(-6, 6, 1201)
Samples = tuple[np.ndarray, np.ndarray]


def largest(first: np.ndarray, second: np.ndarray) -> tuple[float, float]:
    """The largest difference of the distributions, with its sign, and its place."""
    places = np.sort(np.concatenate([first, second]))
    shares = [
        np.searchsorted(np.sort(values), places, "right") / values.size
        for values in (first, second)
    ]
    difference = shares[0] - shares[1]
    index = int(np.abs(difference).argmax())
    return float(difference[index]), float(places[index])


def difference_at(samples: Samples, place: float) -> tuple[float, float]:
    """Difference of the distributions at a place, and its variance."""
    shares = [float((values <= place).mean()) for values in samples]
    variances = [p * (1 - p) / x.size for p, x in zip(shares, samples, strict=True)]
    return shares[0] - shares[1], sum(variances)


def by_halves(samples: Samples) -> tuple[float, float]:
    """Distance and standard error of halves that say the place to each other."""
    halves = [tuple(values[start::2] for values in samples) for start in (0, 1)]
    total = variance = 0.0
    for one, other in (halves, halves[::-1]):
        sign, place = largest(*one)
        value, own = difference_at(other, place)
        total, variance = total + math.copysign(1, sign) * value / 2, variance + own / 4
    return total, math.sqrt(variance)


def intervals(samples: Samples) -> dict[str, tuple[float, float]]:
    """The ends of every interval."""
    signed, place = largest(*samples)
    distance, error = abs(signed), math.sqrt(difference_at(samples, place)[1])
    wide = math.sqrt(math.log(4 / 0.05) / 2) * sum(x.size**-0.5 for x in samples)
    split, split_error = by_halves(samples)
    low = distance - TWO_SIDED * error
    if distance < chance(samples):
        low = 0.0
    return {
        "inequality": (distance - wide, distance + wide),
        "delta": (low, distance + TWO_SIDED * error),
        "halves": (
            max(split, 0.0) - TWO_SIDED * split_error,
            max(split, 0.0) + TWO_SIDED * split_error,
        ),
    }


def chance(samples: Samples) -> float:
    """The distance that two samples of one law exceed in 5 of 100 pairs."""
    return 1.358 * math.sqrt(sum(1 / values.size for values in samples))


def main() -> None:
    """Print the share of the pairs whose true distance each interval holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=14)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    held: dict[tuple[str, str], list[bool]] = defaultdict(list)
    for number in range(given.pairs):
        sizes = [int(10 ** rng.uniform(2.3, 3.6)) for _ in range(2)]
        shift, sigma = rng.uniform(0, 0.3), rng.uniform(0.8, 1.25)
        if number % 3 == 0:
            shift, sigma = 0.0, 1.0
        samples = rng.normal(size=sizes[0]), rng.normal(shift, sigma, sizes[1])
        true = float(np.abs(ndtr(GRID) - ndtr((GRID - shift) / sigma)).max())
        kind = "apart"
        if true < chance(samples):
            kind = "nearer"
        if number % 3 == 0:
            kind = "one law"
        for name, (low, high) in intervals(samples).items():
            held[kind, name].append(low <= true <= high)
    for (kind, name), values in sorted(held.items()):
        print(f"{kind:10}{name:12}{100 * np.mean(values):6.1f} % of {len(values)}")


if __name__ == "__main__":
    main()
