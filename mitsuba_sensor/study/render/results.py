"""What the runs of a setting say together: errors with the reference's own taken off, and their slopes."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..fits import Slope, slope_of_runs
from .frames import Framed
from .series import Setting

THEORY = -0.5
"""Slope of an unbiased mean of independent passes; of its variance, twice that."""
WITHIN = 0.05
"""How near a slope must come."""
FEWEST_RUNGS = 3
"""That make a slope."""
MEASURES = ("irradiance", "electrons", "dn")
"""Errors: of the bands and of the electrons, relative to their pixel's light; of the mean digital numbers [DN]."""
FRAME_SIGMA = 0.01
"""How much too large the temporal σ of a frame may be."""
CLEAR = 3.0
"""Standard errors above zero from which a difference is fitted."""


@dataclass(frozen=True)
class Point:
    """One rung: passes, seconds of a render of so many, its error, and the standard error of that."""

    passes: int
    seconds: float
    error: float
    spread: float


@dataclass(frozen=True, eq=False)
class Result:
    """A setting with its runs.

    ladder : seconds and samples of its passes, as the journal has them.  runs : one per seed, as the journal has them.
    own : squared standard errors of the reference, by measure.
    """

    setting: Setting
    label: str
    ladder: dict[str, Any]
    runs: Sequence[dict[str, Any]]
    own: dict[str, float]

    @property
    def framed(self) -> Framed | None:
        """The exposure of the frames, where any were drawn."""
        return Framed.from_dict(self.ladder["framed"])

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

    def sigma(self, treatment: str) -> list[Point]:
        """Temporal σ of frames that each have a render of their own over what it must be, minus one, by rung.

        Its standard error is that of the runs, but no less than that of normal noise: few runs may agree by chance.
        """
        found, framed = [], self.framed
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
    def verdict(self) -> str:
        """Whether every slope that has a theory follows it; "" where none is clear of the reference's own error."""
        slopes = [slope for measure in ("irradiance", "electrons") if (slope := self.slope(measure)) is not None]
        if not slopes:
            return ""
        return "holds" if all(slope.within(THEORY, WITHIN) for slope in slopes) else "off"

    @property
    def spends_right(self) -> bool:
        """Whether the longest renders that were spent gave frames with the right σ, as far as can be told."""
        return all(abs(p.error) <= FRAME_SIGMA + CLEAR * p.spread for p in self.sigma("spend")[-1:])

    @property
    def plain_s(self) -> float | None:
        """Seconds after which a frame on top of a render has a σ that is FRAME_SIGMA too large, at the frames' own
        exposure: the excess of its variance falls as 1/t. None where no excess was seen."""
        points = self.sigma("plain")
        if not points:
            return None
        every = [(point.seconds, 1 + point.error, point.spread) for point in points]
        seconds, ratio, spread = np.array(every).T
        mean = np.average((ratio**2 - 1) * seconds, weights=(2 * ratio * spread * seconds) ** -2.0)
        return float(mean) / ((1 + FRAME_SIGMA) ** 2 - 1) if mean > 0 else None

    @property
    def spent_s(self) -> float | None:
        """Seconds after which a render's noise can be spent, at the frames' own exposure; None where it never was."""
        return self.framed.compensable * self.pass_s if self.framed and self.sigma("spend") else None

    def excess_slope(self) -> Slope | None:
        """Of the log variance that plain renders add to their frames [DN²] against log seconds; its theory is −1."""
        clear = {point.passes for point in self.sigma("plain") if point.error > CLEAR * point.spread}
        right_dn2, runs = self.framed.variance_dn2 if self.framed else 0.0, []
        for run in self.runs:
            rungs = [rung for rung in run["plain"] if rung["passes"] in clear]
            excess = [rung["frames"]["plain"] - right_dn2 for rung in rungs]
            if len(rungs) < FEWEST_RUNGS or min(excess) <= 0:
                return None
            runs.append(([rung["seconds"] for rung in rungs], excess))
        return slope_of_runs(runs)

    @property
    def pass_s(self) -> float:
        """Seconds per pass: the least of all runs, because neighbours only ever make it longer."""
        return min(
            self.ladder["pass_s"], *(run["plain"][-1]["seconds"] / run["plain"][-1]["passes"] for run in self.runs)
        )

    @property
    def square_of_one_pass(self) -> float:
        """Squared relative error of the electrons of one pass, from all rungs."""
        points = self.points("electrons")
        return float(np.exp(np.mean([math.log(p.error**2 * p.passes) for p in points]))) if points else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        treatments = ("plain", "denoised")
        slopes = {
            f"{treatment} {measure}": self.slope(measure, treatment) for treatment in treatments for measure in MEASURES
        }
        return {
            "setting": self.setting.key,
            "verdict": self.verdict,
            "label": self.label,
            **self.ladder,
            "points": {
                f"{treatment} {measure}": [vars(point) for point in self.points(measure, treatment)]
                for treatment in treatments
                for measure in MEASURES
            },
            "excess_slope": None if (excess := self.excess_slope()) is None else vars(excess),
            "slopes": {name: vars(slope) for name, slope in slopes.items() if slope is not None},
            "sigma": {name: [vars(p) for p in self.sigma(name)] for name in ("plain", "spend", "denoised")},
        }
