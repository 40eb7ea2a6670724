"""Pictures of a study, drawn with Matplotlib: as SVG for the page, as PNG for a file."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from functools import singledispatch
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from .page import Bars, Grid, Line, Mark, Picture, Plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#7F3C8D",
    "#4D4D4D",
)
"""Colours that colour-blind readers tell apart (Okabe & Ito 2008, and two more)."""

MARKERS = "osD^vPX*>"
"""One more than colours, so that series differ in both."""

CELL_COLOURS: dict[Mark, str] = {
    "good": "#BFE3CF",
    "bad": "#F2B6A0",
    "best": "#8CCBA8",
    "dim": "#EEEEEE",
    "": "#FFFFFF",
}
WIDTH_IN, HEIGHT_IN, MARGIN_IN, BAR_IN, CELL_IN = 8.4, 4.6, 1.2, 0.2, 0.3
SMALL_WIDTH_IN, SMALL_HEIGHT_IN = 4.6, 3.2
RING_LABEL = "ring: none is both faster and more exact"

LEAST_TICKS, MOST_TICKS = 3, 9
"""Labelled ticks of a logarithmic axis."""
SETTINGS: dict[
    str, Any
] = {  # of Matplotlib; text stays text, and equal studies give equal files
    "font.size": 9.5,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "errorbar.capsize": 2,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "mitsuba_sensor",
}


def svg(picture: Picture) -> str:
    """An <svg> element to put into a page, below a heading."""
    document = _drawn(picture, "svg", {"Date": None}).decode("utf-8")
    return document[document.index("<svg") :]


def png(picture: Picture, small: bool = False) -> bytes:
    """Return a PNG file of the picture and its title, about 1000 pixels wide.

    small : about 550 pixels wide, with the legend below the axes, to stand beside text.
    """
    return _drawn(picture, "png", None, small)


def _drawn(
    picture: Picture, kind: str, metadata: dict[str, None] | None, small: bool = False
) -> bytes:
    import matplotlib
    from matplotlib.figure import Figure

    buffer = io.BytesIO()
    with matplotlib.rc_context(cast(Any, SETTINGS)):
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
        axes = figure.subplots()
        axes.set_prop_cycle(color=COLOURS)
        figure.set_figheight(draw(picture, axes))
        if small:
            height_in = min(figure.get_figheight(), SMALL_HEIGHT_IN)
            figure.set_size_inches(SMALL_WIDTH_IN, height_in)
        labels = axes.get_legend_handles_labels()[1]
        if labels and small:
            place = (0.5, -0.5 / figure.get_figheight())
            axes.legend(loc="upper center", bbox_to_anchor=place, fontsize=8.5, ncols=2)
        elif labels:
            axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8.5)
        if kind == "png":
            axes.set_title(picture.title, loc="left", fontsize=10.5)
        figure.savefig(
            buffer, format=kind, dpi=120, bbox_inches="tight", metadata=cast(Any, metadata)
        )
    return buffer.getvalue()


@singledispatch
def draw(picture: Any, axes: Axes) -> float:
    """Draw a picture onto axes.

    Returns the height of the figure [inch].
    """
    picture.draw(axes)
    return HEIGHT_IN * float(picture.lines)


@draw.register(Plot)
def draw_plot(plot: Plot, axes: Axes) -> float:
    """Draw lines, markers, error bars and rings."""
    for number, line in enumerate(plot.lines):
        if line.colour is None:
            colour = number
        else:
            colour = line.colour
        axes.errorbar(
            line.x,
            line.y,
            yerr=line.error or None,
            label=line.label or None,
            **_style(line, colour),
        )
    rings = [(line.x[i], line.y[i]) for line in plot.lines for i in line.ringed]
    if rings:
        ring: dict[str, Any] = {
            "s": 95,
            "facecolors": "none",
            "edgecolors": "black",
            "zorder": 3,
        }
        axes.scatter(*zip(*rings, strict=True), label=RING_LABEL, **ring)
    axes.set(xlabel=plot.x_label, ylabel=plot.y_label)
    if plot.level is not None:
        axes.axhline(
            plot.level[0], color="black", linewidth=1, linestyle=":", label=plot.level[1]
        )
    if plot.log_x:
        _set_log_scale(axes, "x", (x for line in plot.lines for x in line.x))
    if plot.log_y:
        _set_log_scale(axes, "y", (y for line in plot.lines for y in line.y))
    return HEIGHT_IN


def _style(line: Line, colour: int) -> dict[str, Any]:
    return {
        "color": COLOURS[colour % len(COLOURS)],
        "marker": MARKERS[colour % len(MARKERS)] if line.marked else "",
        "markersize": 4.5,
        "elinewidth": 0.9,
        "linewidth": 1.4 if line.joined else 0,
        "linestyle": "--" if line.dashed else "-",
    }


@draw.register(Bars)
def draw_bars(bars: Bars, axes: Axes) -> float:
    """Draw groups of horizontal bars, the first label on top."""
    height = 0.8 / len(bars.series)
    rows = np.arange(len(bars.labels))
    for number, (name, values) in enumerate(bars.series.items()):
        places = rows + (number - (len(bars.series) - 1) / 2) * height
        if name in bars.error:
            error = np.array(bars.error[name], dtype=float)
        else:
            error = None
        colour = COLOURS[bars.colours.get(name, number) % len(COLOURS)]
        if len(bars.series) > 1:
            label = name
        else:
            label = None
        lengths = np.array(values, dtype=float)
        axes.barh(
            places,
            lengths,
            height,
            xerr=error,
            color=colour,
            label=label,
            error_kw={"elinewidth": 0.9},
        )
    if bars.level is not None:
        axes.axvline(
            bars.level[0], color="black", linewidth=1, linestyle=":", label=bars.level[1]
        )
    if bars.log_x:
        _set_log_scale(
            axes, "x", (x for values in bars.series.values() for x in values if x is not None)
        )
    axes.set_yticks(rows, bars.labels)
    axes.set(xlabel=bars.x_label, ylim=(len(rows) - 0.4, -0.6))
    axes.grid(visible=False, axis="y")
    return MARGIN_IN + BAR_IN * len(bars.labels) * (len(bars.series) + 0.6)


@draw.register(Grid)
def draw_grid(grid: Grid, axes: Axes) -> float:
    """Draw verdicts as a table of coloured cells."""
    axes.set_axis_off()
    cells = axes.table(
        cellText=grid.texts,
        rowLabels=grid.rows,
        colLabels=grid.columns,
        cellColours=[[CELL_COLOURS[mark] for mark in marks] for marks in grid.marks],
        cellLoc="center",
        bbox=axes.viewLim.unit(),
    )
    for (row, _), cell in cells.get_celld().items():
        heading = row == 0  # of two lines
        cell.set(edgecolor="white", height=cell.get_height() * (1.6 if heading else 1.0))
    return MARGIN_IN + CELL_IN * len(grid.rows)


def _set_log_scale(axes: Axes, name: str, values: Iterable[float]) -> None:
    """Set a logarithmic axis where any value is positive, and label at least three ticks of it."""
    if not any(value > 0 for value in values):
        return
    axes.set(**{f"{name}scale": "log"})
    axis = axes.xaxis if name == "x" else axes.yaxis
    axis.set_ticks(_log_ticks(*sorted(axis.get_view_interval())))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")


def _log_ticks(low: float, high: float) -> list[float]:
    """Powers of ten between two positive numbers; where they are fewer than three, round numbers between them too."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for multiples in ((1,), (1, 3), (1, 2, 5), tuple(range(1, 10))):
        every = [float(f"{number}e{decade}") for decade in decades for number in multiples]
        ticks = [tick for tick in every if low <= tick <= high]
        if len(ticks) >= LEAST_TICKS:
            return ticks[:: -(-len(ticks) // MOST_TICKS)]
    from matplotlib.ticker import MaxNLocator

    close = MaxNLocator(6, min_n_ticks=LEAST_TICKS + 2).tick_values(low, high)
    return [tick for tick in close if low <= tick <= high]
