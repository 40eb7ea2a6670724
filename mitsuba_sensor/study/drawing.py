"""Plots, bars and grids of verdicts as SVG for a page and as PNG for a README: the one place that uses Matplotlib."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from .page import Bars, Grid, Mark, Picture, Plot
from .statistics import Values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F3C8D", "#4D4D4D"]
"""Told apart by colour-blind readers (Okabe & Ito 2008), two more at the end."""
MARKERS = "osD^vPX*>"  # one more than colours: all pairs come before one comes again
CELL: dict[Mark, str] = {"good": "#BFE3CF", "bad": "#F2B6A0", "best": "#8CCBA8", "dim": "#EEEEEE", "": "#FFFFFF"}
WIDTH_IN, HEIGHT_IN, BAR_IN, CELL_IN = 8.4, 4.6, 0.2, 0.3
STYLE: Values = {
    "font.size": 9.5,
    "axes.prop_cycle": f"cycler('color', {COLOURS})",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "errorbar.capsize": 2,
    "legend.frameon": False,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "mitsuba_sensor",  # equal studies give equal files
}


def svg(picture: Picture) -> str:
    """An <svg> element to put into a page, below a heading."""
    text = _drawn(picture, "svg", {"Date": None}).decode("utf-8")
    return text[text.index("<svg") :]


def png(picture: Picture) -> bytes:
    """The same with its title, as a PNG file's bytes, about 1000 pixels wide."""
    return _drawn(picture, "png")


def _drawn(picture: Picture, kind: str, metadata: Values | None = None) -> bytes:
    import matplotlib
    from matplotlib.figure import Figure

    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
        axes = figure.subplots()
        if isinstance(picture, Grid):
            figure.set_figheight(1.0 + CELL_IN * len(picture.rows))
            _grid(picture, axes)
        elif isinstance(picture, Bars):
            figure.set_figheight(1.2 + BAR_IN * len(picture.labels) * (len(picture.series) + 0.6))
            _bars(picture, axes)
        else:
            _plot(picture, axes)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8.5)
        if kind == "png":
            axes.set_title(picture.title, loc="left", fontsize=10.5)
        figure.savefig(buffer, format=kind, dpi=120, bbox_inches="tight", metadata=metadata)
    return buffer.getvalue()


def _plot(plot: Plot, axes: Axes) -> None:
    for number, line in enumerate(plot.lines):
        colour = f"C{number if line.colour is None else line.colour}"
        style: Values = {"marker": MARKERS[number % len(MARKERS)], "markersize": 4.5, "elinewidth": 0.9}
        style |= {"linewidth": 1.4 if line.joined else 0, "linestyle": "--" if line.dashed else "-"}
        axes.errorbar(line.x, line.y, yerr=line.error or None, label=line.label or None, color=colour, **style)
        x, y = ([values[i] for i in line.ringed] for values in (line.x, line.y))
        axes.scatter(x, y, s=95, facecolors="none", edgecolors="black", zorder=3)
    axes.set(xlabel=plot.x_label, ylabel=plot.y_label)
    if plot.level is not None:
        axes.axhline(plot.level[0], color="black", linewidth=1, linestyle=":", label=plot.level[1])
    if plot.log_x:
        _log_scale(axes, "x", [x for line in plot.lines for x in line.x])
    if plot.log_y:
        _log_scale(axes, "y", [y for line in plot.lines for y in line.y])


def _log_scale(axes: Axes, name: str, values: list[float]) -> None:
    """Where any value is positive; between decades numbers stand only if there is less than one."""
    positive = [value for value in values if value > 0]
    if positive:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("{x:g}" if max(positive) < 10 * min(positive) else "")


def _bars(bars: Bars, axes: Axes) -> None:
    height, rows = 0.8 / len(bars.series), np.arange(len(bars.labels))
    for number, (name, values) in enumerate(bars.series.items()):
        places = rows + (number - (len(bars.series) - 1) / 2) * height
        error = np.array(bars.error[name], dtype=float) if name in bars.error else None
        label = name if len(bars.series) > 1 else None
        axes.barh(places, np.array(values, dtype=float), height, xerr=error, label=label, error_kw={"elinewidth": 0.9})
    if bars.log_x:
        _log_scale(axes, "x", [value for values in bars.series.values() for value in values if value is not None])
    axes.set_yticks(rows, bars.labels)
    axes.set(xlabel=bars.x_label, ylim=(len(rows) - 0.4, -0.6))
    axes.grid(visible=False, axis="y")
    if bars.level is not None:
        axes.axvline(bars.level[0], color="black", linewidth=1, linestyle=":", label=bars.level[1])


def _grid(grid: Grid, axes: Axes) -> None:
    axes.set_axis_off()
    colours = [[CELL[mark] for mark in marks] for marks in grid.marks]
    texts = {"cellText": grid.texts, "rowLabels": grid.rows, "colLabels": grid.columns}
    table = axes.table(cellColours=colours, cellLoc="center", bbox=axes.viewLim.unit(), **texts)  # type: ignore[arg-type]
    for cell in table.get_celld().values():
        cell.set_edgecolor("white")
