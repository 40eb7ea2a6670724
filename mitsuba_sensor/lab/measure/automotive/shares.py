"""Interval of a share: the beta law of Jeffreys, with as many independent cases as the variance is that of."""

from __future__ import annotations

import scipy

from ...quantity import LEVEL


def share_quantiles(share: float, cases: float) -> tuple[float, float, float]:
    """(value, low, high) of a share of so many independent cases, which need not be whole; 0 and 1 stay ends."""
    tail = (1 - LEVEL) / 2
    hits, misses = share * cases + 0.5, (1 - share) * cases + 0.5
    low, high = (float(scipy.special.betaincinv(hits, misses, p)) for p in (tail, 1 - tail))
    if share * cases < 0.5:
        low = 0.0
    if (1 - share) * cases < 0.5:
        high = 1.0
    return share, min(low, share), max(high, share)
