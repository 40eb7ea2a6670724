"""Matplotlib axes for plots: labels, logarithmic scales and named levels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOG_RATIO_MIN = 4.0
"""Values that span a smaller ratio are drawn on a linear axis."""
DECADES_MAX = 2.6
"""A wider logarithmic axis has ticks at powers of ten only."""
TICKS_MAX = 8


def labelled_axes(axes: Axes | None, title: str, x_label: str, y_label: str) -> Axes:
    """Return the axes, or new axes, with title and labels."""
    if axes is None:
        from matplotlib import pyplot

        _, axes = pyplot.subplots(layout="constrained")
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    return axes


def name_level(
    axes: Axes, name: str, *, x: float | None = None, y: float | None = None
) -> None:
    """Draw a dotted vertical line at ``x``, or a horizontal line at ``y``, with its name beside it."""
    if x is not None:
        draw: Callable[..., object] = axes.axvline
        place, turn, transform = (x, 0.02), 90, axes.get_xaxis_transform()
    else:
        assert y is not None
        draw = axes.axhline
        place, turn, transform = (1.0, y), 0, axes.get_yaxis_transform()
    if (name, place) in [(text.get_text(), text.get_position()) for text in axes.texts]:
        return  # drawn for another filter
    draw(y if x is None else x, color="0.5", linewidth=1, linestyle=":")
    style: dict[str, Any] = {"fontsize": 8, "ha": "right", "va": "bottom"}
    axes.text(*place, name, transform=transform, rotation=turn, **style)


def set_log_axes(axes: Axes) -> None:
    """Make both axes logarithmic if their data span enough, unless no value is above 0."""
    box = axes.dataLim
    set_log_axis(axes, "x", [max(box.intervalx[0], box.minposx), box.intervalx[1]])
    set_log_axis(axes, "y", [max(box.intervaly[0], box.minposy), box.intervaly[1]])


def set_log_axis(axes: Axes, name: str, values: Iterable[float]) -> None:
    """Make an axis logarithmic if its values span enough, with at least three labelled ticks."""
    from matplotlib.ticker import NullLocator

    positive = [value for value in values if value > 0 and math.isfinite(value)]
    if not positive or max(positive) < LOG_RATIO_MIN * min(positive):
        return
    axis = axes.xaxis if name == "x" else axes.yaxis
    axes.set(**{f"{name}scale": "log"})
    ends, ticks = log_ticks(min(positive), max(positive))
    axis.set_ticks(ticks)
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter("{x:g}")
    axes.set(**{f"{name}lim": (ends[0] / 1.15, ends[1] * 1.15)})


def log_ticks(low: float, high: float) -> tuple[tuple[float, float], list[float]]:
    """Return the ends and ticks of an axis that holds two numbers: 1-2-5, or powers of ten for a wide range."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    steps = (1, 2, 5) if math.log10(high / low) < DECADES_MAX else (1,)
    every = [float(f"{step}e{decade}") for decade in range(first, last + 1) for step in steps]
    below = max(place for place, tick in enumerate(every) if tick <= low)
    above = min(place for place, tick in enumerate(every) if tick >= high)
    inside = every[below : above + 1]
    return (inside[0], inside[-1]), inside[:: -(-len(inside) // TICKS_MAX)]
