"""Spent render noise against Poisson's law: variance, third cumulant, kurtosis, and the distance between the two.

    python benchmarks/spending.py [--means 1 3 10 100 1e4] [--ratios 0.05 0.16 0.63] [--limit L] [--json]

About two minutes on one core. A render's mean light x comes from one of four laws, electrons are drawn about it as the
chain draws them, and the law of the total is added up exactly over x:

    normal     x normal, cut at 0, its variance known
    skewed     x gamma, its variance known
    measured   x the mean of eight gamma passes, its variance that of the passes
    fireflies  the same of passes of which one in 64 holds a bright sample, so that most renders show no variance at all

Each law has mean μ and variance v, the ratio times μ. Columns: if it is not spent, and if it is. Variance and third
cumulant are over the mean, 1 for Poisson's law; from the excess kurtosis its own is taken away; the distance is that of
Kolmogorov and Smirnov, the largest |P(N ≤ n) − Poisson's|. ``short`` is the share of the renders whose variance could
not be spent in full.
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

from mitsuba_sensor.sensor import compensation

Array = NDArray[np.float64]
Renders = tuple[Array, Array, Array]
"""Mean light [e-], its variance as far as it is known [e-²], and the weight of each; the weights add up to 1."""

MEANS = (1.0, 3.0, 10.0, 100.0, 1e4)
RATIOS = (0.05, 0.1, 0.16, 0.2, 0.25, 0.4, 0.63)
NODES, DRAWN, PASSES = 2000, 6000, 8
FIREFLY = 1 / 64
CHUNK = 250


def main() -> int:
    """Parse the options, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--means", type=float, nargs="+", default=MEANS, help="mean light [e-]")
    parser.add_argument("--ratios", type=float, nargs="+", default=RATIOS, help="v/mean")
    parser.add_argument("--limit", type=float, default=compensation.LIMIT, help="in place of the shipped one")
    parser.add_argument("--json", action="store_true", help="only JSON")
    options = parser.parse_args()
    compensation.LIMIT = options.limit
    rows = [row(name, mean, ratio) for name in LAWS for mean in options.means for ratio in options.ratios]
    print(json.dumps({"limit": options.limit, "rows": rows})) if options.json else show(options.limit, rows)
    return 0


def normal(mean: float, ratio: float) -> Renders:
    """Equal shares of a normal law."""
    return known(np.maximum(mean + math.sqrt(ratio * mean) * stats.norm.ppf(shares(NODES)), 0.0), ratio * mean)


def skewed(mean: float, ratio: float) -> Renders:
    """Equal shares of a gamma law: skewness 2·√(ratio/mean)."""
    return known(stats.gamma.ppf(shares(NODES), mean / ratio, scale=ratio), ratio * mean)


def measured(mean: float, ratio: float) -> Renders:
    """Renders of eight gamma passes; mean and variance of x and the mean of the measured variances are set right."""
    passes = np.random.default_rng(1).gamma(mean / (PASSES * ratio), PASSES * ratio, (DRAWN, PASSES))
    x, variance_e2 = passes.mean(axis=1), passes.var(axis=1, ddof=1) / PASSES
    x = np.maximum(mean + (x - x.mean()) * math.sqrt(ratio * mean) / x.std(), 0.0)
    return x, variance_e2 * (ratio * mean / variance_e2.mean()), np.full(DRAWN, 1 / DRAWN)


def fireflies(mean: float, ratio: float) -> Renders:
    """Renders of eight passes with 0 to 8 bright samples."""
    bright = np.arange(PASSES + 1.0)
    height = math.sqrt(PASSES * ratio * mean / (FIREFLY * (1 - FIREFLY)))
    share = bright / PASSES
    spread = height**2 * share * (1 - share) / (PASSES - 1)
    return mean + height * (share - FIREFLY), spread, stats.binom.pmf(bright, PASSES, FIREFLY)


LAWS = {"normal": normal, "skewed": skewed, "measured": measured, "fireflies": fireflies}


def shares(count: int) -> Array:
    """Middles of equal shares of the probability."""
    return (np.arange(count) + 0.5) / count


def known(x: Array, variance_e2: float) -> Renders:
    """Renders of equal weight, all of a known variance."""
    return x, np.full(x.size, variance_e2), np.full(x.size, 1 / x.size)


class Parts:
    """A frame that hands back what ``counted`` asks to draw, instead of drawing it."""

    def bernoulli(self, _: str, chance: Any) -> float:
        self.chance = np.asarray(chance)
        return 0.0

    def poisson(self, _: str, mean: Any) -> float:
        self.mean = np.asarray(mean)
        return 0.0


def total_law(renders: Renders, spend: bool, counts: Array) -> tuple[Array, float]:
    """P(N = n) of the total over all renders for each of ``counts``, and the share that could not spend in full."""
    law, short = np.zeros(counts.size), 0.0
    for start in range(0, renders[0].size, CHUNK):
        x, variance_e2, weight = (part[start : start + CHUNK, None] for part in renders)
        spent, _ = compensation.compensable(x, 0.0, variance_e2 if spend else 0.0 * variance_e2)
        parts: Any = Parts()
        whole = compensation.counted("photon_shot", x, spent, parts)
        without, with_one = (stats.poisson.pmf(counts - whole - one, parts.mean) for one in (0, 1))
        law += np.sum(weight * ((1 - parts.chance) * without + parts.chance * with_one), axis=0)
        short += float(np.sum(weight * (spent < variance_e2)))
    return law, short


def row(name: str, mean: float, ratio: float) -> dict[str, Any]:
    """One line of the table."""
    renders = LAWS[name](mean, ratio)
    reach = 10 * math.sqrt(mean * (1 + ratio)) + 30
    highest = max(mean, float(renders[0].max())) + reach
    counts = np.arange(max(0.0, math.floor(min(mean, float(renders[0].min())) - reach)), highest)
    found: dict[str, Any] = {"law": name, "mean": mean, "ratio": ratio}
    for label, spend in (("plain", False), ("spent", True)):
        law, short = total_law(renders, spend, counts)
        found[label] = {**shape(law, counts, mean), "short": short}
    return found


def shape(law: Array, counts: Array, mean: float) -> dict[str, float]:
    """What tells a law from Poisson's law of this mean."""
    away = counts - np.sum(law * counts)
    second, third, fourth = (float(np.sum(law * away**k)) for k in (2, 3, 4))
    distance = float(np.abs(np.cumsum(law) - stats.poisson.cdf(counts, mean)).max())
    kurtosis = fourth / second**2 - 3 - 1 / mean
    return {"variance": second / mean, "third": third / mean, "kurtosis": kurtosis, "distance": distance}


def show(limit: float, rows: list[dict[str, Any]]) -> None:
    """The table."""
    print(f"limit {limit:.4g}; each not spent → spent")
    for r in rows:
        plain, spent = r["plain"], r["spent"]
        cells = [f"{n} {plain[n]:.3f} → {spent[n]:.3f}" for n in ("variance", "third", "kurtosis")]
        distance = f"distance {plain['distance']:.4f} → {spent['distance']:.4f}"
        print(f"{r['law']:<10}{r['mean']:>7g} e-  v/μ {r['ratio']:<5g} {'  '.join(cells)}  {distance}  "
              f"short {spent['short']:.2f}")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
