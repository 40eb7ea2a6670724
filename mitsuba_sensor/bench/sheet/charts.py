"""The charts of the sheet, in the order of the page."""

from __future__ import annotations

from collections.abc import Sequence

from ...core import InputError, nearest
from .chart import Chart
from .colours import ColoursChart
from .edge import EDGES
from .emva import EmvaChart
from .grey import GreyChart
from .leaves import LeavesChart
from .led import LedChart
from .star import StarChart
from .steps import StepsChart

CHARTS: tuple[Chart, ...] = (
    EmvaChart(),
    *EDGES,
    StarChart(),
    LeavesChart(),
    StepsChart(),
    ColoursChart(),
    GreyChart(),
    LedChart(),
)
"""One more chart is one more file of this folder, and its place here."""


def chosen_charts(names: Sequence[str]) -> list[Chart]:
    """The charts of these names, or of these kinds; all where none is given. Raises InputError for another name."""
    known = list(dict.fromkeys(name for chart in CHARTS for name in (chart.kind, chart.name)))
    for name in names:
        if name not in known:
            raise InputError(
                f"--charts has {name!r}; the charts are {', '.join(known)}.{nearest(name, known)}"
            )
    return [chart for chart in CHARTS if not names or {chart.kind, chart.name} & set(names)]
