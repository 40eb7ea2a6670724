"""What the runs of a setting say together: errors with the reference's own taken off, and their slopes."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..statistics import Slope, slope_of_runs
from .per_frame import FrameExposure
from .series import Setting

THEORY = -0.5  # slope of an unbiased mean of independent passes; of its variance, twice that
WITHIN = 0.05  # how near a slope must come
FEWEST_RUNGS = 3  # that make a slope
FRAME_SIGMA = 0.01  # how much too large the temporal σ of a frame may be
CLEAR = 3.0  # standard errors above zero from which a difference is fitted


@dataclass(frozen=True)
class Point:
    """One rung: passes, seconds of a render of so many, its error, and the standard error of that."""

    passes: int
    seconds: float
    error: float
    spread: float


@dataclass(frozen=True)
class Ladder:
    """The passes of a setting's runs.

    samples : per pixel, pass and group of bands.  groups : of bands.  first_s : loading and compiling.
    pass_s : of one pass.  passes : of a run.  framed : the exposure of the frames, where any are made.
    """

    samples: int
    groups: int
    first_s: float
    pass_s: float
    passes: int
    framed: FrameExposure | None


@dataclass(frozen=True, eq=False)
class Result:
    """A setting with its runs.

    runs : one per seed, as :class:`errors.Run` measures them.  own : squared standard errors of the reference, by
    measure: "irradiance" and "electrons", relative to their pixel's light; "dn", of the mean digital numbers [DN].
    """

    setting: Setting
    label: str
    ladder: Ladder
    runs: Sequence[Mapping[str, Any]]
    own: Mapping[str, float]

    def rungs(self, treatment: str = "plain") -> list[list[dict[str, Any]]]:
        """Rung by rung, what every run has."""
        return [list(rung) for rung in zip(*(run.get(treatment, []) for run in self.runs), strict=True)]

    def points(self, measure: str, treatment: str = "plain") -> list[Point]:
        """Rungs whose error stands clear of the reference's own: those whose square is above it."""
        found = []
        for rung in self.rungs(treatment):
            squares = [run[measure] for run in rung if measure in run]
            left = statistics.fmean(squares) - self.own[measure] if squares else 0.0
            if left > self.own[measure]:
                spread = statistics.stdev(squares) / math.sqrt(len(squares)) / (2 * math.sqrt(left))
                seconds = statistics.median(run["seconds"] for run in rung)
                found.append(Point(rung[0]["passes"], seconds, math.sqrt(left), spread))
        return found

    def slope(self, measure: str, treatment: str = "plain") -> Slope | None:
        """Of log error against log seconds, None with too few rungs."""
        clear = {point.passes for point in self.points(measure, treatment)}
        runs = []
        for run in self.runs:
            rungs = [rung for rung in run.get(treatment, []) if rung["passes"] in clear]
            squares = [rung[measure] - self.own[measure] for rung in rungs]
            if len(rungs) < FEWEST_RUNGS or min(squares) <= 0:
                return None
            runs.append(([rung["seconds"] for rung in rungs], [math.sqrt(square) for square in squares]))
        return slope_of_runs(runs)

    @property
    def slopes(self) -> list[Slope]:
        """Those that have a theory."""
        return [slope for measure in ("electrons", "irradiance") if (slope := self.slope(measure)) is not None]

    @property
    def verdict(self) -> str:
        """Whether every slope follows theory; "" where none is clear of the reference's own error."""
        held = [slope.within(THEORY, WITHIN) for slope in self.slopes]
        return ("holds" if all(held) else "off") if held else ""

    def sigma(self, treatment: str) -> list[Point]:
        """Temporal σ of frames that each have a render of their own over what it must be, minus one, by rung.

        treatment : of the render noise, "plain", "compensated" or "denoised".
        Its standard error is that of the runs, but no less than that of normal noise: few runs may agree by chance.
        """
        found, framed = [], self.ladder.framed
        for rung in self.rungs("denoised" if treatment == "denoised" else "plain"):
            variances = [run["frames"][treatment] for run in rung if treatment in run["frames"]]
            if framed is not None and len(variances) > 1:
                ratio = math.sqrt(statistics.fmean(variances) / framed.variance_dn2)
                of_runs = statistics.stdev(variances) / math.sqrt(len(variances)) / (2 * ratio * framed.variance_dn2)
                frames = min(run["blocks"] for run in rung)
                spread = max(of_runs, ratio * framed.spread(frames, len(variances)))
                seconds = statistics.median(run["seconds"] for run in rung)
                found.append(Point(rung[0]["passes"], seconds, ratio - 1, spread))
        return found

    @property
    def compensates(self) -> bool:
        """Whether the longest renders whose noise was compensated gave frames with the right σ, as far as is known."""
        return all(abs(p.error) <= FRAME_SIGMA + CLEAR * p.spread for p in self.sigma("compensated")[-1:])

    @property
    def plain_s(self) -> float | None:
        """Seconds after which a frame on top of a render has a σ that is FRAME_SIGMA too large, at the frames' own
        exposure: the excess of its variance falls as 1/t. None where no excess was seen."""
        every = [(point.seconds, 1 + point.error, point.spread) for point in self.sigma("plain")]
        if not every:
            return None
        seconds, ratio, spread = np.array(every).T
        mean = np.average((ratio**2 - 1) * seconds, weights=(2 * ratio * spread * seconds) ** -2.0)
        return float(mean) / ((1 + FRAME_SIGMA) ** 2 - 1) if mean > 0 else None

    @property
    def pass_s(self) -> float:
        """Seconds per pass: the least of all runs, because neighbours only ever make it longer."""
        last = [run["plain"][-1] for run in self.runs]
        return min(self.ladder.pass_s, *(float(one["seconds"] / one["passes"]) for one in last))

    @property
    def square_of_one_pass(self) -> float:
        """Squared relative error of the electrons of one pass, from all rungs."""
        points = self.points("electrons")
        return float(np.exp(np.mean([math.log(p.error**2 * p.passes) for p in points]))) if points else 0.0
