"""Colours of the series of a page, by their names: one each through all plots, another one beside each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

MOST = 8
"""Series of one plot: so many colours are told apart."""


def colours(plots: Sequence[Sequence[str]]) -> dict[str, int]:
    """Number of the colour of every series.  plots : the names of the series of each.

    The one that is used least so far, of those that no series has beside which this one stands in any plot.
    """
    found: dict[str, int] = {}
    for name in dict.fromkeys(name for names in plots for name in names):
        beside = {found.get(other) for names in plots if name in names for other in names}
        used = Counter(found.values())
        found[name] = min(range(MOST), key=lambda colour: (colour in beside, used[colour], colour))
    return found


def groups(count: int) -> list[range]:
    """Of so many series the indices of those in each plot; beside the first one, which all plots have."""
    return [range(first, min(first + MOST - 1, count)) for first in range(1, count, MOST - 1)]
