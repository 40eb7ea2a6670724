"""What follows from the renders of a setting: errors, their slopes, and the options that reach a tolerance."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...lab.statistics.estimators import Slope, slope_of_runs
from ..kit import Values

PILOT_SPP = 16
"""Fewest samples per pixel that are tried."""

FEWEST_RUNGS = 3
"""Renders that make a slope."""

INDEPENDENT, STRATIFIED, WITHIN = -0.5, -1.5, 0.05
"""Slopes of log error against log samples of independent samples, and of samples that are stratified in one dimension;
a slope must lie between, within so much or within its interval where that is wider."""

MARGIN = 1.1
"""On the samples that a fit asks for: the error is known to some percent."""


class Setting(NamedTuple):
    """One way to render: its name, and options of :func:`mitsuba_sensor.render`."""

    name: str
    options: Values

    @property
    def reference(self) -> str:
        """The reference that it is compared with: channels differ from bands by the error of bands of finite width."""
        if self.options.get("spectral") == "channels":
            return "channels"
        return "bands"

    @property
    def is_reference(self) -> bool:
        """Whether its renders have the bands of the reference: all of them, or channels."""
        return self.has_law and "bandwidth_nm" not in self.options

    @property
    def has_law(self) -> bool:
        """Whether its error falls with the root of the time; a denoised one has a bias."""
        return not self.options.get("denoise")


class Rung(NamedTuple):
    """A render of a ladder: samples per pixel, seconds, squared error of the electrons relative to the pixel's."""

    spp: int
    seconds: float
    square: float


class Point(NamedTuple):
    """One rung over all runs: samples, seconds, error, standard error of that."""

    spp: int
    seconds: float
    error: float
    spread: float


class Result(NamedTuple):
    """A setting with its runs, one per seed, and the squared error of its reference."""

    setting: Setting
    runs: Sequence[Sequence[Rung]]
    own: float

    def points(self) -> list[Point]:
        """Rungs whose squared error stands clear of the reference's own, which is taken off."""
        points = []
        for rungs in zip(*self.runs, strict=True):
            squares = [rung.square for rung in rungs]
            square = statistics.fmean(squares) - self.own
            if square > self.own:
                error = math.sqrt(square)
                spread = statistics.stdev(squares) / math.sqrt(len(squares)) / (2 * error)
                seconds = statistics.median(rung.seconds for rung in rungs)
                points.append(Point(rungs[0].spp, seconds, error, spread))
        return points

    @property
    def slope(self) -> Slope | None:
        """Slope of log error against log samples, where enough rungs of all runs are clear of the reference."""
        clear = {point.spp for point in self.points()}
        runs = []
        for run in self.runs:
            rungs = [rung for rung in run if rung.spp in clear and rung.square > self.own]
            if len(rungs) < FEWEST_RUNGS:
                return None
            runs.append(
                (
                    [rung.spp for rung in rungs],
                    [math.sqrt(rung.square - self.own) for rung in rungs],
                )
            )
        return slope_of_runs(runs)

    @property
    def verdict(self) -> str:
        """Whether the slope follows theory; "" where it has none, or no error is clear of the reference's."""
        slope = self.slope
        if slope is None or not self.setting.has_law:
            return ""
        within = max(WITHIN, slope.half_width)
        if STRATIFIED - within <= slope.value <= INDEPENDENT + within:
            return "holds"
        return "off"


class Choice(NamedTuple):
    """Options of ``mitsuba-sensor render``, and what they are expected to give."""

    options: str
    spp: int
    seconds: float


def choices(results: Sequence[Result], tolerance: float) -> list[Choice]:
    """Of every setting the options that reach the tolerance, the quickest first."""
    found = []
    for result in results:
        points = result.points()
        if points and (result.setting.has_law or points[-1].error <= tolerance):
            spp = samples_for(points, tolerance)
            seconds = math.exp(
                interpolated(math.log(spp), [(p.spp, p.seconds) for p in points], 1.0)
            )
            found.append(Choice(typed_options(result.setting, spp), spp, seconds))
    return sorted(found, key=lambda choice: choice.seconds)


def samples_for(points: Sequence[Point], tolerance: float) -> int:
    """Samples whose error is the tolerance, with a margin; at least those of the first rung."""
    inverse = [(1 / point.error, point.spp) for point in points]
    spp = math.exp(interpolated(-math.log(tolerance), inverse, 1 / -INDEPENDENT))
    return max(math.ceil(MARGIN * spp), points[0].spp)


def interpolated(log_x: float, points: Sequence[tuple[float, float]], power: float) -> float:
    """Logarithm of y at a logarithm of x, between points (x, y) that rise; beyond the last with this power of x."""
    log_xs, log_ys = np.log(np.array(points, dtype=float)).T
    return float(np.interp(log_x, log_xs, log_ys)) + power * max(log_x - float(log_xs[-1]), 0.0)


def typed_options(setting: Setting, spp: int) -> str:
    """Options of a render as they are typed."""
    options: Values = {"spp": spp, **setting.options}
    denoise = options.pop("denoise")
    typed = [f"--{name.replace('_', '-')} {value}" for name, value in options.items()]
    return " ".join(typed if denoise else [*typed, "--no-denoise"])
