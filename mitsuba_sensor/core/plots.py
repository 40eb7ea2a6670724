"""Matplotlib axes for the ``plot`` methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def labelled_axes(axes: Axes | None, title: str, x_label: str, y_label: str) -> Axes:
    """Return the axes, or new axes, with title and labels."""
    if axes is None:
        from matplotlib import pyplot

        _, axes = pyplot.subplots(layout="constrained")
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    return axes
