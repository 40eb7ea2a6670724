"""Compare the electron counts of compensated renders with a Poisson distribution: cumulants and distance.

    python benchmarks/compensation.py [--means 1 3 10 100 1e4] [--ratios 0.05 0.16 0.63] [--limit L] [--json]

This takes about two minutes on one core. The mean x of a render has one of four distributions, the electrons are
counted with mean x as in the sensor model, and the distribution of the total is summed exactly over x:

    normal     x is normal, clipped at 0; its variance is known
    skewed     x has a gamma distribution; its variance is known
    measured   x is the mean of eight gamma passes; its variance is measured from the passes
    fireflies  as measured, but one pass in 64 has a bright sample, so that most renders show no variance

Each distribution has mean μ and variance v = ratio · μ. The columns compare renders without and with compensation.
Variance and third cumulant are divided by the mean, so that they are 1 for a Poisson distribution; the excess kurtosis
is the difference to that of the Poisson distribution; the distance is that of Kolmogorov and Smirnov. ``short`` is the
share of the renders whose variance could not be compensated completely.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mitsuba_sensor.stages import compensation

Array = NDArray[np.float64]
Renders = tuple[Array, Array, Array]
"""Mean of each render [e-], its estimated variance [e-²], and its weight; the weights sum to 1."""

MEANS = (1.0, 3.0, 10.0, 100.0, 1e4)
RATIOS = (0.05, 0.1, 0.16, 0.2, 0.25, 0.4, 0.63)
NODES, RENDERS, PASSES = 2000, 6000, 8
FIREFLY = 1 / 64
CHUNK = 250


def main() -> int:
    """Parse the options, compute, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--means", type=float, nargs="+", default=MEANS, help="mean photoelectrons"
    )
    parser.add_argument(
        "--ratios", type=float, nargs="+", default=RATIOS, help="render variance over mean"
    )
    parser.add_argument(
        "--limit", type=float, default=compensation.LIMIT, help="largest compensated v/μ"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    compensation.LIMIT = options.limit
    rows = [
        row(name, mean, ratio)
        for name in DISTRIBUTIONS
        for mean in options.means
        for ratio in options.ratios
    ]
    print(json.dumps({"limit": options.limit, "rows": rows})) if options.json else show(
        options.limit, rows
    )
    return 0


def normal(mean: float, ratio: float) -> Renders:
    """Means with a normal distribution, at equally spaced probabilities."""
    return known(
        np.maximum(mean + math.sqrt(ratio * mean) * stats.norm.ppf(probabilities(NODES)), 0.0),
        ratio * mean,
    )


def skewed(mean: float, ratio: float) -> Renders:
    """Means with a gamma distribution, skewness 2·√(ratio/mean), at equally spaced probabilities."""
    return known(stats.gamma.ppf(probabilities(NODES), mean / ratio, scale=ratio), ratio * mean)


def measured(mean: float, ratio: float) -> Renders:
    """Renders of eight gamma passes, scaled to the exact mean and variance of x and mean of the estimated variances."""
    passes = np.random.default_rng(1).gamma(
        mean / (PASSES * ratio), PASSES * ratio, (RENDERS, PASSES)
    )
    x, variance_e2 = passes.mean(axis=1), passes.var(axis=1, ddof=1) / PASSES
    x = np.maximum(mean + (x - x.mean()) * math.sqrt(ratio * mean) / x.std(), 0.0)
    return x, variance_e2 * (ratio * mean / variance_e2.mean()), np.full(RENDERS, 1 / RENDERS)


def fireflies(mean: float, ratio: float) -> Renders:
    """Renders of eight passes, of which 0 to 8 have a bright sample."""
    bright = np.arange(PASSES + 1.0)
    height = math.sqrt(PASSES * ratio * mean / (FIREFLY * (1 - FIREFLY)))
    share = bright / PASSES
    spread = height**2 * share * (1 - share) / (PASSES - 1)
    return mean + height * (share - FIREFLY), spread, stats.binom.pmf(bright, PASSES, FIREFLY)


DISTRIBUTIONS = {
    "normal": normal,
    "skewed": skewed,
    "measured": measured,
    "fireflies": fireflies,
}


def probabilities(count: int) -> Array:
    """Centres of ``count`` intervals of equal probability."""
    return (np.arange(count) + 0.5) / count


def known(x: Array, variance_e2: float) -> Renders:
    """Renders of equal weight and known variance."""
    return x, np.full(x.size, variance_e2), np.full(x.size, 1 / x.size)


class Arguments:
    """A stand-in for a frame that records the chance of its random numbers instead of returning random numbers."""

    def bernoulli(self, _: str, chance: Any) -> float:
        self.chance = np.asarray(chance)
        return 0.0


def total_distribution(
    renders: Renders, compensated: bool, counts: Array
) -> tuple[Array, float]:
    """P(N = n) over all renders for each of ``counts``, and the share of renders not compensated completely."""
    probability, short = np.zeros(counts.size), 0.0
    for start in range(0, renders[0].size, CHUNK):
        x, variance_e2, weight = (column[start : start + CHUNK, None] for column in renders)
        used_e2, _ = compensation.compensable(
            x, 0.0, variance_e2 if compensated else 0.0 * variance_e2
        )
        frame: Any = Arguments()
        whole, rest = compensation.reserved(x, used_e2, frame)
        without, with_one = (stats.poisson.pmf(counts - whole - one, rest) for one in (0, 1))
        probability += np.sum(
            weight * ((1 - frame.chance) * without + frame.chance * with_one), axis=0
        )
        short += float(np.sum(weight * (used_e2 < variance_e2)))
    return probability, short


def row(name: str, mean: float, ratio: float) -> dict[str, Any]:
    """One row of the table."""
    renders = DISTRIBUTIONS[name](mean, ratio)
    reach = 10 * math.sqrt(mean * (1 + ratio)) + 30
    highest = max(mean, float(renders[0].max())) + reach
    counts = np.arange(
        max(0.0, math.floor(min(mean, float(renders[0].min())) - reach)), highest
    )
    found: dict[str, Any] = {"distribution": name, "mean": mean, "ratio": ratio}
    for label, compensated in (("uncompensated", False), ("compensated", True)):
        probability, short = total_distribution(renders, compensated, counts)
        found[label] = {**shape(probability, counts, mean), "short": short}
    return found


def shape(probability: Array, counts: Array, mean: float) -> dict[str, float]:
    """Cumulants relative to those of the Poisson distribution with this mean, and the distance to it."""
    away = counts - np.sum(probability * counts)
    second, third, fourth = (float(np.sum(probability * away**k)) for k in (2, 3, 4))
    distance = float(np.abs(np.cumsum(probability) - stats.poisson.cdf(counts, mean)).max())
    kurtosis = fourth / second**2 - 3 - 1 / mean
    return {
        "variance": second / mean,
        "third": third / mean,
        "kurtosis": kurtosis,
        "distance": distance,
    }


def show(limit: float, rows: list[dict[str, Any]]) -> None:
    """Print the table."""
    print(f"limit {limit:.4g}; uncompensated → compensated")
    for r in rows:
        before, after = r["uncompensated"], r["compensated"]
        cells = [
            f"{n} {before[n]:.3f} → {after[n]:.3f}" for n in ("variance", "third", "kurtosis")
        ]
        distance = f"distance {before['distance']:.4f} → {after['distance']:.4f}"
        print(f"{r['distribution']:<10}{r['mean']:>7g} e-  v/μ {r['ratio']:<5g} {'  '.join(cells)}  {distance}  "
              f"short {after['short']:.2f}")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
