"""Looks of the series of a page, by their names: one each through all plots, of another colour than those beside it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

MOST = 8
"""Series of one plot: so many colours are told apart."""


def looks(plots: Sequence[Sequence[str]]) -> dict[str, int]:
    """Number of the look of every series: modulo MOST its colour.  plots : the names of the series of each.

    The colour is the one that is used least so far, of those that no series has beside which this one stands in any
    plot; series of one colour in different plots have different numbers, from which other markers follow.
    """
    found: dict[str, int] = {}
    for name in dict.fromkeys(name for names in plots for name in names):
        beside = {found[other] % MOST for names in plots if name in names for other in names if other in found}
        used = Counter(look % MOST for look in found.values())
        colour = min(range(MOST), key=lambda one: (one in beside, used[one], one))
        found[name] = colour + MOST * used[colour]
    return found


def groups(count: int) -> list[range]:
    """Of so many series the indices of those in each plot; beside the first one, which all plots have."""
    return [range(first, min(first + MOST - 1, count)) for first in range(1, count, MOST - 1)]
