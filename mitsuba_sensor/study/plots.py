"""Plots, bars and grids of verdicts as SVG for a page and as PNG for a README: the one door to Matplotlib."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

from .page import Bars, Grid, Line, Mark, Plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F3C8D", "#4D4D4D")
"""Told apart by colour-blind readers (Okabe & Ito 2008), two more at the end."""
MARKERS = "osD^vPX*>"  # one more than colours: all pairs come before one comes again
CELL: dict[Mark, str] = {"good": "#BFE3CF", "bad": "#F2B6A0", "best": "#8CCBA8", "dim": "#EEEEEE", "": "#FFFFFF"}
INK, FAINT = "#222222", "#888888"
WIDTH_IN, HEIGHT_IN, BAR_IN, CELL_IN = 8.4, 4.6, 0.2, 0.3
PNG_DPI = 120
PLAIN_FROM, PLAIN_TO = 1e-3, 1e4
"""Between these a tick says its number in digits, beyond them as a power of ten."""
STYLE: dict[str, Any] = {
    "font.size": 9.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "mitsuba_sensor",  # equal studies give equal files
}


def svg(picture: Plot | Bars | Grid) -> str:
    """An <svg> element to put into a page, below a heading."""
    text = _drawn(picture, "svg").decode("utf-8")
    return text[text.index("<svg") :]


def png(picture: Plot | Bars | Grid) -> bytes:
    """The same with its title, as a PNG file's bytes, about 1000 pixels wide."""
    return _drawn(picture, "png")


def _drawn(picture: Plot | Bars | Grid, kind: Literal["svg", "png"]) -> bytes:
    import matplotlib
    from matplotlib.figure import Figure

    draw: Callable[[Any, Axes], None] = {Plot: _plot, Bars: _bars, Grid: _grid}[type(picture)]
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, _height(picture)))
        axes = figure.subplots()
        draw(picture, axes)
        if kind == "png":
            axes.set_title(picture.title, loc="left", fontsize=10.5, color=INK)
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(buffer, format=kind, dpi=PNG_DPI, bbox_inches="tight", metadata=metadata)
    return buffer.getvalue()


def _height(picture: Plot | Bars | Grid) -> float:
    if isinstance(picture, Plot):
        return HEIGHT_IN
    if isinstance(picture, Grid):
        return 1.0 + CELL_IN * len(picture.rows)
    return 1.2 + BAR_IN * len(picture.labels) * (len(picture.series) + 0.6)


def _plot(plot: Plot, axes: Axes) -> None:
    for number, line in enumerate(plot.lines):
        _line(axes, line, number if line.colour is None else line.colour, number)
    _scale(axes, plot)
    if plot.level is not None:
        axes.axhline(plot.level[0], color=INK, linewidth=1, linestyle=":")
        axes.annotate(
            plot.level[1], (1, plot.level[0]), xycoords=("axes fraction", "data"), xytext=(0, 3),
            textcoords="offset points", ha="right", fontsize=8.5, color=INK,
        )  # fmt: skip
    axes.set_xlabel(plot.x_label)
    axes.set_ylabel(plot.y_label)
    if any(line.label for line in plot.lines):
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=8.5)


def _line(axes: Axes, line: Line, colour: int, number: int) -> None:
    shown = COLOURS[colour % len(COLOURS)]
    axes.errorbar(
        line.x, line.y, yerr=line.error or None, label=line.label or None, color=shown, capsize=2,
        marker=MARKERS[number % len(MARKERS)], markersize=4.5, linewidth=1.4 if line.joined else 0,
        linestyle="--" if line.dashed else "-", elinewidth=0.9,
    )  # fmt: skip
    rings = [(line.x[i], line.y[i]) for i in line.ringed]
    if rings:
        axes.scatter(*zip(*rings, strict=True), s=95, facecolors="none", edgecolors=INK, linewidths=1.1, zorder=3)


def _scale(axes: Axes, plot: Plot) -> None:
    for log, axis, name in ((plot.log_x, axes.xaxis, "x"), (plot.log_y, axes.yaxis, "y")):
        values = [v for line in plot.lines for v in getattr(line, name)]
        if log and any(v > 0 for v in values):
            getattr(axes, f"set_{name}scale")("log", nonpositive="clip")
            axis.set_major_formatter(_tick)
            axis.set_minor_formatter(_tick if max(values) < 10 * min(v for v in values if v > 0) else _no_tick)


def _tick(value: float, _place: int) -> str:
    if PLAIN_FROM <= value < PLAIN_TO:
        return f"{value:g}"
    return f"$10^{{{round(math.log10(value))}}}$" if value > 0 else f"{value:g}"


def _no_tick(_value: float, _place: int) -> str:
    return ""


def _bars(bars: Bars, axes: Axes) -> None:
    count = len(bars.series)
    for number, (name, values) in enumerate(bars.series.items()):
        places = [row + (number - (count - 1) / 2) * 0.8 / count for row in range(len(values))]
        there = [i for i, value in enumerate(values) if value is not None]
        error = bars.error.get(name)
        axes.barh(
            [places[i] for i in there], [values[i] for i in there], height=0.8 / count, label=name,
            color=COLOURS[number % len(COLOURS)],
            xerr=[error[i] or 0.0 for i in there] if error else None, error_kw={"elinewidth": 0.9, "capsize": 2},
        )  # fmt: skip
    if bars.log_x and any(v and v > 0 for values in bars.series.values() for v in values):
        axes.set_xscale("log", nonpositive="clip")
        axes.xaxis.set_major_formatter(_tick)
    axes.set_yticks(range(len(bars.labels)), bars.labels)
    axes.set_ylim(len(bars.labels) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(bars.x_label)
    if bars.level is not None:
        axes.axvline(bars.level[0], color=INK, linewidth=1, linestyle=":", label=bars.level[1])
    if count > 1 or bars.level is not None:
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=8.5)


def _grid(grid: Grid, axes: Axes) -> None:
    from matplotlib.patches import Rectangle

    for y, marks in enumerate(grid.marks):
        for x, mark in enumerate(marks):
            axes.add_patch(Rectangle((x, y), 1, 1, facecolor=CELL[mark], edgecolor="white", linewidth=1.5))
            if grid.words:
                axes.text(x + 0.5, y + 0.5, grid.words[y][x], ha="center", va="center", fontsize=8.5, color=INK)
    axes.set_xlim(0, len(grid.columns))
    axes.set_ylim(len(grid.rows), 0)
    axes.set_xticks([x + 0.5 for x in range(len(grid.columns))], grid.columns)
    axes.set_yticks([y + 0.5 for y in range(len(grid.rows))], grid.rows)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
