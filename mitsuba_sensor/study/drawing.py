"""Plots, bars and grids of verdicts as SVG for a page and as PNG for a README: the one place that uses Matplotlib."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

from .page import Bars, Grid, Line, Mark, Picture, Plot
from .statistics import Values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F3C8D", "#4D4D4D")
"""Told apart by colour-blind readers (Okabe & Ito 2008), two more at the end."""
MARKERS = "osD^vPX*>"  # one more than colours: all pairs come before one comes again
CELL: dict[Mark, str] = {"good": "#BFE3CF", "bad": "#F2B6A0", "best": "#8CCBA8", "dim": "#EEEEEE", "": "#FFFFFF"}
INK, FAINT, GRID_LINE = "#222222", "#888888", "#E4E4E4"
WIDTH_IN, HEIGHT_IN, BAR_IN, CELL_IN = 8.4, 4.6, 0.2, 0.3
PNG_DPI = 120
PLAIN_FROM, PLAIN_TO = 1e-3, 1e4  # between these a tick says its number in digits, beyond them as a power of ten
STYLE: Values = {
    "font.size": 9.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID_LINE,
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "mitsuba_sensor",  # equal studies give equal files
}


def svg(picture: Picture) -> str:
    """An <svg> element to put into a page, below a heading."""
    text = _drawn(picture, "svg").decode("utf-8")
    return text[text.index("<svg") :]


def png(picture: Picture) -> bytes:
    """The same with its title, as a PNG file's bytes, about 1000 pixels wide."""
    return _drawn(picture, "png")


def _drawn(picture: Picture, kind: str) -> bytes:
    import matplotlib
    from matplotlib.figure import Figure

    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(WIDTH_IN, _height(picture)))
        axes = figure.subplots()
        match picture:
            case Plot():
                _plot(picture, axes)
            case Bars():
                _bars(picture, axes)
            case Grid():
                _grid(picture, axes)
        if kind == "png":
            axes.set_title(picture.title, loc="left", fontsize=10.5, color=INK)
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(buffer, format=kind, dpi=PNG_DPI, bbox_inches="tight", metadata=metadata)
    return buffer.getvalue()


def _height(picture: Picture) -> float:
    if isinstance(picture, Plot):
        return HEIGHT_IN
    if isinstance(picture, Grid):
        return 1.0 + CELL_IN * len(picture.rows)
    return 1.2 + BAR_IN * len(picture.labels) * (len(picture.series) + 0.6)


def _plot(plot: Plot, axes: Axes) -> None:
    for number, line in enumerate(plot.lines):
        _line(axes, line, number)
    for log, axis, name in ((plot.log_x, axes.xaxis, "x"), (plot.log_y, axes.yaxis, "y")):
        positive = [v for line in plot.lines for v in getattr(line, name) if v > 0]
        if log and positive:
            getattr(axes, f"set_{name}scale")("log", nonpositive="clip")
            axis.set_major_formatter(_tick)
            axis.set_minor_formatter(_tick if max(positive) < 10 * min(positive) else lambda _value, _place: "")
    if plot.level is not None:
        value, text = plot.level
        axes.axhline(value, color=INK, linewidth=1, linestyle=":")
        above = {"xytext": (0, 3), "textcoords": "offset points", "ha": "right", "fontsize": 8.5, "color": INK}
        axes.annotate(text, (1, value), xycoords=("axes fraction", "data"), **above)  # type: ignore[arg-type]
    axes.set(xlabel=plot.x_label, ylabel=plot.y_label)
    _legend(axes, any(line.label for line in plot.lines))


def _legend(axes: Axes, shown: bool) -> None:
    if shown:
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=8.5)


def _line(axes: Axes, line: Line, number: int) -> None:
    colour = COLOURS[(number if line.colour is None else line.colour) % len(COLOURS)]
    style: Values = {"marker": MARKERS[number % len(MARKERS)], "markersize": 4.5, "capsize": 2}
    style |= {"linewidth": 1.4 if line.joined else 0, "linestyle": "--" if line.dashed else "-", "elinewidth": 0.9}
    axes.errorbar(line.x, line.y, yerr=line.error or None, label=line.label or None, color=colour, **style)
    x, y = ([values[i] for i in line.ringed] for values in (line.x, line.y))
    axes.scatter(x, y, s=95, facecolors="none", edgecolors=INK, linewidths=1.1, zorder=3)


def _tick(value: float, _place: float) -> str:
    if PLAIN_FROM <= value < PLAIN_TO:
        return f"{value:g}"
    return f"$10^{{{round(math.log10(value))}}}$" if value > 0 else f"{value:g}"


def _bars(bars: Bars, axes: Axes) -> None:
    count = len(bars.series)
    for number, (name, values) in enumerate(bars.series.items()):
        shown = [(row, value) for row, value in enumerate(values) if value is not None]
        places = [row + (number - (count - 1) / 2) * 0.8 / count for row, _ in shown]
        error = [bars.error[name][row] or 0.0 for row, _ in shown] if name in bars.error else None
        style: Values = {"color": COLOURS[number % len(COLOURS)], "error_kw": {"elinewidth": 0.9, "capsize": 2}}
        axes.barh(places, [value for _, value in shown], height=0.8 / count, label=name, xerr=error, **style)
    if bars.log_x and any(v and v > 0 for values in bars.series.values() for v in values):
        axes.set_xscale("log", nonpositive="clip")
        axes.xaxis.set_major_formatter(_tick)
    axes.set_yticks(range(len(bars.labels)), bars.labels)
    axes.set_ylim(len(bars.labels) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(bars.x_label)
    if bars.level is not None:
        axes.axvline(bars.level[0], color=INK, linewidth=1, linestyle=":", label=bars.level[1])
    _legend(axes, count > 1 or bars.level is not None)


def _grid(grid: Grid, axes: Axes) -> None:
    from matplotlib.patches import Rectangle

    for y, (marks, texts) in enumerate(zip(grid.marks, grid.texts, strict=True)):
        for x, (mark, text) in enumerate(zip(marks, texts, strict=True)):
            axes.add_patch(Rectangle((x, y), 1, 1, facecolor=CELL[mark], edgecolor="white", linewidth=1.5))
            axes.text(x + 0.5, y + 0.5, text, ha="center", va="center", fontsize=8.5, color=INK)
    axes.set(xlim=(0, len(grid.columns)), ylim=(len(grid.rows), 0))
    axes.set_xticks([x + 0.5 for x in range(len(grid.columns))], grid.columns)
    axes.set_yticks([y + 0.5 for y in range(len(grid.rows))], grid.rows)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
