"""Logarithmic axes, where there is anything to draw on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def set_log_axes(axes: Axes) -> None:
    """Make both axes logarithmic; not where no value is above 0, of which Matplotlib draws none."""
    if np.isfinite(axes.dataLim.minpos).all():
        axes.set(xscale="log", yscale="log")
