"""Pictures of a study, drawn with Matplotlib: SVG for the page, PNG for a file."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, cast

from ..core.plots import set_log_axis
from .page import Dots, Line, Picture, Plot

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
"""Colours that colour-blind readers can distinguish (Okabe & Ito 2008, and two more)."""
FILTERS = {"R": "#C0392B", "G": "#1E8449", "G (2)": "#7CB342", "B": "#1F5FBF"}
"""Colours of series named after a colour filter."""
LEVEL_STYLES = ":", "-.", "--"
"""Line styles of the levels of a plot."""
MARKERS = "osD^vPX*>"
"""One more than the colours, so series differ in both."""
WIDTH_IN, HEIGHT_IN, ROW_IN, MARGIN_IN, DPI = 6.4, 3.8, 0.26, 0.1, 160
LABEL_LETTERS_MAX = 22
"""A legend with a longer label has two columns."""
SETTINGS: dict[str, Any] = {
    "font.size": 9.5,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E4E4E4",
    "errorbar.capsize": 2,
    "legend.frameon": False,
    "svg.hashsalt": "mitsuba_sensor",  # equal studies give equal files
}


def svg(picture: Picture) -> bytes:
    """Return an SVG file of the picture without its title."""
    return _drawn(picture, format="svg", metadata={"Date": None})


def png(picture: Picture) -> bytes:
    """Return a PNG file of the picture and its title, about 1000 pixels wide."""
    return _drawn(picture, format="png", dpi=DPI)


def _drawn(picture: Picture, **options: Any) -> bytes:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    buffer = io.BytesIO()
    with matplotlib.rc_context(cast(Any, SETTINGS)):
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
        axes = figure.subplots()
        axes.set_prop_cycle(color=COLOURS)
        figure.set_figheight(_draw(picture, axes))
        handles, labels = axes.get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        if unique:
            columns = 2 if max(map(len, unique)) > LABEL_LETTERS_MAX else min(4, len(unique))
            place = 0.5, -0.55 / figure.get_figheight()
            axes.legend(
                list(unique.values()),
                list(unique),
                ncols=columns,
                loc="upper center",
                bbox_to_anchor=place,
            )
        if options["format"] == "png":
            axes.set_title(picture.title, loc="left", fontsize=10.5)
        renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
        box = figure.get_tightbbox(renderer)
        figure.savefig(buffer, bbox_inches=box.padded(MARGIN_IN), **options)
    return buffer.getvalue()


def _draw(picture: Picture, axes: Axes) -> float:
    """Draw a picture onto axes and return the height of the figure [inch]."""
    if isinstance(picture, Plot):
        draw_plot(picture, axes)
    elif isinstance(picture, Dots):
        draw_dots(picture, axes)
        return 1.0 + ROW_IN * len(picture.labels)
    else:
        picture.draw(axes)
    return HEIGHT_IN


def colour_of(label: str, number: int) -> str:
    """Return the colour of a series: of the filter that it is named after, or the next colour."""
    return FILTERS.get(label, COLOURS[number % len(COLOURS)])


def draw_plot(plot: Plot, axes: Axes) -> None:
    """Draw lines, markers, error bars and levels."""
    for number, one in enumerate(plot.lines):
        axes.errorbar(
            one.x,
            one.y,
            yerr=one.error or None,
            xerr=one.x_error or None,
            label=one.label or None,
            color=colour_of(one.label, number),
            **_style(one, number),
        )
    for (name, value), style in zip(plot.levels.items(), LEVEL_STYLES, strict=False):
        draw = axes.axvline if name.startswith("|") else axes.axhline
        draw(value, color="black", linewidth=1, linestyle=style, label=name.lstrip("|"))
    axes.set(xlabel=_without_one(plot.x_label), ylabel=_without_one(plot.y_label))
    if plot.log_x:
        of_x = (x for one in plot.lines for x in one.x)
        set_log_axis(
            axes, "x", [*of_x, *(x for name, x in plot.levels.items() if name[0] == "|")]
        )
    if plot.log_y:
        of_y = (y for one in plot.lines for y in one.y)
        set_log_axis(
            axes, "y", [*of_y, *(y for name, y in plot.levels.items() if name[0] != "|")]
        )


def _without_one(label: str) -> str:
    """Return an axis label without the unit [1] of a ratio."""
    return label.removesuffix(" [1]")


def _style(one: Line, number: int) -> dict[str, Any]:
    marker = MARKERS[number % len(MARKERS)] if one.marked else ""
    return {
        "marker": "*" if one.star else marker,
        "markersize": 14 if one.star else 4.5,
        "zorder": 4 if one.star else 2,
        "elinewidth": 0.9,
        "linewidth": 1.4 if one.joined else 0,
        "linestyle": "--" if one.dashed else "-",
    }


def draw_dots(dots: Dots, axes: Axes) -> None:
    """Draw a dot with its interval for each label and series, the first label on top."""
    for number, (name, values) in enumerate(dots.series.items()):
        shift = 0.7 * ((number + 0.5) / len(dots.series) - 0.5)
        shown = [(row + shift, *one) for row, one in enumerate(values) if one is not None]
        rows, value, low, high = zip(*shown, strict=True) if shown else ((),) * 4
        widths = [
            [x - end for x, end in zip(value, low, strict=True)],
            [end - x for x, end in zip(value, high, strict=True)],
        ]
        style: dict[str, Any] = {"color": colour_of(name, number), "markersize": 5}
        style["marker"] = MARKERS[number % len(MARKERS)]
        axes.errorbar(value, rows, xerr=widths, label=name, linewidth=0, **style)
        for drawn in axes.containers[-1][2]:
            drawn.set_linewidth(1.2)
    axes.axvline(dots.level[0], color="black", linewidth=1, linestyle=":", label=dots.level[1])
    axes.set_yticks(range(len(dots.labels)), dots.labels)
    axes.set(xlabel=_without_one(dots.x_label), ylim=(len(dots.labels) - 0.5, -0.5))
    if dots.log_x:
        every = [one for values in dots.series.values() for one in values if one is not None]
        set_log_axis(axes, "x", [dots.level[0], *(value for value, *_ in every)])
