"""Results of all runs: errors less the reference's own, slopes, σ of frames, and the fastest options for an error."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from ...render.passes import FEWEST, MOST_IN_ALL, SAMPLER
from ...render.photons import collect
from ...render.stop_criterion import stop_criterion_of
from ..statistics import Array, Slope, slope_of_runs
from .errors import DENOISED, PLAIN, Ladder, Rung, Target, electrons_of
from .series import RenderSetting

THEORY = -0.5  # slope of an unbiased mean of independent passes; of its variance, twice that
WITHIN = 0.05  # how near a slope must come, or as near as its interval is wide
FEWEST_RUNGS = 3  # that make a slope
FRAME_SIGMA = 0.01  # how much too large the temporal σ of a frame may be
SAMPLE_COUNTS = [2**k * part // 2 for k in range(4, MOST_IN_ALL.bit_length()) for part in (2, 3)]  # 16, 24, 32, 48 …
CHECK_SEEDS = (1001, 1002)  # no run and no reference has them. The first compiles, the second is timed
MARGIN = 1.1  # on the samples that a check asks for: its error is known to some percent


class Point(NamedTuple):
    """One rung: passes, seconds of a render of so many, its error, and the standard error of that."""

    passes: int
    seconds: float
    error: float
    spread: float


class Result(NamedTuple):
    """A setting with its runs.

    runs : one per seed, as :class:`errors.Run` measures them.  own : squared standard errors of the reference, by
    measure: "irradiance" and "electrons", relative to their pixel's light; "dn", of the mean digital numbers [DN].
    """

    setting: RenderSetting
    label: str
    ladder: Ladder
    runs: Sequence[Mapping[str, Sequence[Rung]]]
    own: Mapping[str, float]

    def _means(self, name: str, treatment: str) -> Iterator[tuple[int, float, float, float, float]]:
        """Of every rung that all runs have: passes, seconds, mean of a value, its standard error, blocks of a run."""
        for rungs in zip(*(run.get(treatment, []) for run in self.runs), strict=True):
            values = [rung[name] for rung in rungs if name in rung]
            if values:
                error = statistics.stdev(values) / math.sqrt(len(values))
                seconds = statistics.median(rung["seconds"] for rung in rungs)
                yield int(rungs[0]["passes"]), seconds, statistics.fmean(values), error, rungs[0]["blocks"]

    def points(self, measure: str, treatment: str = PLAIN) -> list[Point]:
        """Rungs whose error stands clear of the reference's own: those whose square is above it."""
        own = self.own[measure]
        return [
            Point(passes, seconds, math.sqrt(square - own), error / (2 * math.sqrt(square - own)))
            for passes, seconds, square, error, _ in self._means(measure, treatment)
            if square - own > own
        ]

    def slope(self, measure: str) -> Slope | None:
        """Of log error against log seconds, None with too few rungs."""
        clear = {point.passes for point in self.points(measure)}
        runs = []
        for run in self.runs:
            rungs = [rung for rung in run[PLAIN] if rung["passes"] in clear]
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
        """Whether every slope follows theory, as far as its runs can tell; "" where no error is clear of the
        reference's own."""
        held = [slope.within(THEORY, max(WITHIN, slope.half_width)) for slope in self.slopes]
        return ("holds" if all(held) else "off") if held else ""

    def sigma(self, treatment: str) -> list[Point]:
        """Temporal σ of frames that each have a render of their own over what it must be, minus one, by rung.

        Its standard error is that of the runs, but no less than that of normal noise: few runs may agree by chance.
        """
        framed, found = self.ladder.framed, list[Point]()
        if framed is None:
            return found
        for passes, seconds, variance, error, frames in self._means("variance_dn2", treatment):
            ratio = math.sqrt(variance / framed.variance_dn2)
            normal = ratio * math.sqrt(0.5 / (framed.pixels * (frames - 1) * len(self.runs)))
            found.append(Point(passes, seconds, ratio - 1, max(error / (2 * ratio * framed.variance_dn2), normal)))
        return found

    @property
    def plain_s(self) -> float | None:
        """Seconds after which a frame on top of a render has a σ that is FRAME_SIGMA too large, at the frames' own
        exposure: the excess of its variance falls as 1/t. None where no excess was seen."""
        every = [(point.seconds, 1 + point.error, point.spread) for point in self.sigma(PLAIN)]
        if not every:
            return None
        seconds, ratio, spread = np.array(every).T
        mean = np.average((ratio**2 - 1) * seconds, weights=(2 * ratio * spread * seconds) ** -2.0)
        return float(mean) / ((1 + FRAME_SIGMA) ** 2 - 1) if mean > 0 else None

    @property
    def pass_s(self) -> float:
        """Seconds per pass: the least of all runs, because neighbours only ever make it longer."""
        return min(self.ladder.pass_s, *(run[PLAIN][-1]["seconds"] / run[PLAIN][-1]["passes"] for run in self.runs))

    @property
    def square_of_one_pass(self) -> float:
        """Squared relative error of the electrons of one pass, from all rungs."""
        points = self.points("electrons")
        return float(np.exp(np.mean([math.log(p.error**2 * p.passes) for p in points]))) if points else 0.0


class Choice(NamedTuple):
    """Options of ``mitsuba-sensor render``, and what they are expected to give."""

    spectral: str
    spp: int
    denoise: bool
    variant: str
    usual: bool  # whether the variant is the one that is taken by itself, and need not be named
    seconds: float  # predicted
    error: float  # predicted; relative rms error of the electrons

    @property
    def options(self) -> str:
        """As they are typed."""
        variant = "" if self.usual else f" --variant {self.variant}"
        return f"--spp {self.spp} --spectral {self.spectral}{' --denoise' if self.denoise else ''}{variant}"


def predict(result: Result, sizes: Sequence[Result], spp: int) -> tuple[float, float] | None:
    """Seconds and error of --spp in a setting; None where the bands would not be rendered apart.

    What passes of other sizes gain and cost is known of the base setting, and taken to be the same here.
    sizes : results of the base setting, for each size of pass.
    """
    criterion = stop_criterion_of({"spp": spp}, result.ladder.groups)
    if criterion.grouped != (result.ladder.groups > 1):
        return None
    known = {one.ladder.samples: one for one in sorted(sizes, key=lambda one: one.ladder.samples)}
    here, samples = known[result.ladder.samples], np.log([*known])
    squares = np.log([one.square_of_one_pass / here.square_of_one_pass for one in known.values()])
    seconds = np.log([one.pass_s / here.pass_s for one in known.values()])

    def line(x: float, values: Array) -> float:  # beyond the points as between the last two
        return float(make_interp_spline(samples, values, k=1)(x)) if len(known) > 1 else 0.0

    size = math.log(criterion.samples)
    within = min(size, samples[-1])  # beyond, a pass takes as much longer as it has more samples
    pass_s = result.pass_s * math.exp(line(within, seconds) + size - within)
    square = result.square_of_one_pass * math.exp(line(size, squares))
    return criterion.passes * pass_s, math.sqrt(square / criterion.passes)


def choices(results: Sequence[Result], tolerance: float, usual: str) -> list[Choice]:
    """The cheapest options of every kind that reach the tolerance, the quickest first.

    results : the base setting first.  usual : the variant that is taken by itself.
    """
    base, found = results[0], []
    known = [one for one in results if one.points("electrons")]
    sizes = [one for one in known if one.setting._replace(samples=base.setting.samples) == base.setting]
    for result in known if base in known else []:
        variant, sampler, samples, spectral = result.setting
        if sampler == SAMPLER and spectral != "loop" and samples == base.setting.samples:
            for spp in SAMPLE_COUNTS:
                if (told := predict(result, sizes, spp)) and told[1] <= tolerance:
                    found.append(Choice(spectral, spp, False, variant, variant == usual, *told))
                    break
    for point in base.points("electrons", DENOISED):  # it has a bias, and no law: what was measured of it
        if point.passes >= FEWEST and point.error <= tolerance:
            spp, variant = point.passes * base.ladder.samples * base.ladder.groups, base.setting.variant
            found.append(Choice("auto", spp, True, variant, variant == usual, point.seconds, point.error))
            break
    return sorted(found, key=lambda choice: choice.seconds)


def corrected(choice: Choice, error: float, tolerance: float) -> Choice:
    """The same with as many more samples as an error that was found says."""
    more = MARGIN * (error / tolerance) ** 2
    spp = next(count for count in SAMPLE_COUNTS if count >= min(choice.spp * more, MOST_IN_ALL))
    return choice._replace(spp=spp, seconds=choice.seconds * spp / choice.spp, error=tolerance / math.sqrt(MARGIN))


def checked(choice: Choice, target: Target) -> dict[str, float]:
    """Render with these very options and compare with the reference: seconds and relative error of electrons."""
    subject, squares = target.subject, []
    asked = {name: getattr(choice, name) for name in ("spp", "spectral", "denoise", "variant")}
    for seed in CHECK_SEEDS:
        light = subject.render(seed, **asked)
        off = electrons_of(collect(light, subject.camera, subject.exposure), subject) - target.own.electrons
        squares.append(target.mean_square("electrons", off) - target.squares["electrons"])
    return {"seconds": light.statistics.seconds, "error": math.sqrt(max(statistics.fmean(squares), 0.0))}
