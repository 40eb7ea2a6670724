"""Colours of the series of a page, by their names: one each through all plots, another one beside each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

MOST_SERIES = 8
"""Series of one plot: so many colours are told apart."""


def colours_of_series(plots: Sequence[Sequence[str]]) -> dict[str, int]:
    """Number of the colour of every series.  plots : the names of the series of each.

    A series takes the colour that is used least so far, of those that no series has beside which it stands in any plot.
    """
    colours: dict[str, int] = {}
    for name in dict.fromkeys(name for names in plots for name in names):
        taken = {colours.get(other) for names in plots if name in names for other in names}
        used = Counter(colours.values())
        colours[name] = min(
            range(MOST_SERIES), key=lambda colour: (colour in taken, used[colour], colour)
        )
    return colours


def plots_of_series(count: int) -> list[range]:
    """Indices of the series that share a plot, beside the first one, which all plots have."""
    return [
        range(first, min(first + MOST_SERIES - 1, count))
        for first in range(1, count, MOST_SERIES - 1)
    ]
