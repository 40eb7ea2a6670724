"""Error of a render against its wall time: what is measured, its slopes, σ of frames, and the fastest options."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from ...core import InputError, Photons, require
from ...lab.statistics.estimators import Slope, slope_of_runs
from ...render.denoise.network import library
from ...render.light.photons import collect
from ...render.passes.passes import FEWEST, MOST_IN_ALL, SAMPLER
from ...render.passes.stop_criterion import stop_criterion_of
from ...render.variants import use
from ..kit import Array, Kit, Step, Subject
from . import errors
from .errors import DENOISED, PLAIN, Ladder, Rung, Target
from .settings import Choice, RenderSetting, Series, all_settings, usable_variants

RUN_S = 2.5  # seconds that the passes of one run may take: so long is its ladder
FEWEST_PASSES, FEWEST_FRAMED, MOST_PASSES = 4, 32, 256  # of a run: for three rungs; for frames of two sizes; for nine
COMPILE_S, COMPARING = 6.0, 1.4  # as expected until the first pass; of a run, over the seconds of its passes
CHECK_S, CHECKS = 15.0, 3  # no longer recommendation is checked; renders of one, with more samples after a miss
THEORY = -0.5  # slope of an unbiased mean of independent passes; of its variance, twice that
WITHIN, FEWEST_RUNGS = 0.05, 3  # how near a slope must come, or as near as its interval is wide; that make a slope
FRAME_SIGMA = 0.01  # how much too large the temporal σ of a frame may be
SAMPLE_COUNTS = [n for k in range(3, 24) for n in (2 * 2**k, 3 * 2**k) if n <= MOST_IN_ALL]  # 16, 24, 32, 48 …
MARGIN = 1.1  # on the samples that a check asks for: its error is known to some percent


class Render:
    """Every way to render this scene for this camera, and what a kit measures of them: see :func:`work_precision`."""

    def __init__(
        self, kit: Kit, subject: Subject, tolerance: float, seeds: int, variants: Sequence[str] | None
    ) -> None:
        self.tolerance = require("tolerance", tolerance, 1e-6, 1.0, "relative error, e.g. 0.01")
        if require("seeds", seeds, 2, 64, "independent runs, e.g. 4") != int(seeds):
            raise InputError(f"seeds is {seeds!r}; it must be a whole number of runs (e.g. 4).")
        self.kit, self._subject, self._numbers = kit, subject, range(1, int(seeds) + 1)
        self._variants = usable_variants(variants)
        self._base = RenderSetting(self._variants[0].name)
        self.smooth = False
        with suppress(InputError):  # Open Image Denoise is not installed
            self.smooth = bool(library())
        self.checks: list[tuple[Choice, dict[str, float]]] = []
        self.reached = False  # whether the recommended options were rendered and kept the tolerance
        self._open: Series | None = None

    def photons(self) -> Photons:
        """The light that the sensor side exposes: that of the reference."""
        self.kit.take([self._reference(self._base)])
        return self.target("auto").own.photons

    def measure(self) -> None:
        """References, ladders, runs and checks: what is not measured yet."""
        bands, kit, numbers = Series(self._subject, self._base).bands, self.kit, self._numbers
        channels = bands.kind == "cube" and self._subject.camera.quantum_efficiency.quantum_yield is None
        settings = all_settings(self._base, self._variants, bands, channels)
        own = [one for one in settings if one == self._base._replace(banding=one.banding) and one.banding != "loop"]
        first = [Step(f"first passes: {one}", COMPILE_S, partial(self._ladder, one)) for one in settings]
        kit.take([*map(self._reference, own), *first], len(settings) * len(numbers) * RUN_S)
        ladders: dict[RenderSetting, Ladder] = {one: kit[f"first passes: {one}"] for one in settings}
        kit.take(
            Step(f"run {k}: {one}", COMPARING * ladder.passes * ladder.pass_s, partial(self._run, one, ladder, k))
            for one, ladder in ladders.items()
            for k in numbers
        )
        self.references: dict[str, errors.Reference] = {one.banding: kit[f"reference: {one.banding}"] for one in own}
        self.results: list[Result] = []
        for one, ladder in ladders.items():
            runs = [kit[f"run {k}: {one}"] for k in numbers]
            self.results.append(Result(one, one.label(self._base), ladder, runs, self.target(one.banding).squares))
        self.choices = choices(self.results, self.tolerance, usable_variants(None)[0].name)
        self._check()
        use(self._variants[0])  # the last one was another

    def _reference(self, setting: RenderSetting) -> Step:
        measure = partial(errors.render_reference, self._subject, setting)
        return Step(f"reference: {setting.banding}", errors.REFERENCE_S + COMPILE_S, measure)

    def target(self, banding: str) -> Target:
        """What a banding is compared with."""
        keys = {f"reference: {kind}": kind for kind in ("auto", "cube", "channels")}
        return Target(self._subject, {keys[key]: self.kit[key] for key in keys if key in self.kit.known}, banding)

    def _ladder(self, setting: RenderSetting) -> Ladder:
        """What a pass costs, how many passes a run has, a power of two, and at which exposure frames are made."""
        began = time.perf_counter()
        series = Series(self._subject, setting)
        list(series.passes(0, 1))
        first_s = time.perf_counter() - began
        pass_s = min(block.seconds for block in series.passes(0, 2))
        framed = setting in (self._base, self._base._replace(banding="channels"))
        passes = 2 ** max(math.floor(math.log2(max(RUN_S / pass_s, 1.0))), 0)
        passes = int(np.clip(passes, FEWEST_FRAMED if framed else FEWEST_PASSES, MOST_PASSES))
        frames = errors.frame_exposure(series, self.target(setting.banding), passes) if framed else None
        return Ladder(setting.samples, series.groups, max(first_s - pass_s, 0.0), pass_s, passes, frames)

    def _run(self, setting: RenderSetting, ladder: Ladder, number: int) -> dict[str, list[Rung]]:
        """All errors of one run. The scene that was compiled last is kept, and no other."""
        if self._open is None or self._open.setting != setting:
            self._open = None
            self._open = Series(self._subject, setting)
            if not self._open.loop:  # where every band compiles anew
                list(self._open.passes(0, 1))
        run = errors.Run(self._open, self.target(setting.banding), ladder, number)
        return run.measure(self.smooth and setting == self._base)

    def _check(self) -> None:
        """Render with the recommended options until they keep the tolerance; then they are what is recommended."""
        choice = self.choices[0] if self.choices else None
        while choice is not None and (self.checks or choice.seconds <= CHECK_S):
            measure = partial(checked, choice, self.target(choice.spectral))
            found = self.kit.measure(f"check: {choice.options}", 2 * choice.seconds + COMPILE_S, measure)
            self.checks.append((choice, found))
            self.reached = found["error"] <= self.tolerance
            more = corrected(choice, found["error"], self.tolerance)
            choice = None if self.reached or len(self.checks) == CHECKS else more


class Point(NamedTuple):
    """One rung: passes, seconds of a render of so many, its error, and the standard error of that."""

    passes: int
    seconds: float
    error: float
    spread: float


class Result(NamedTuple):
    """A setting with its runs, one per seed."""

    setting: RenderSetting
    label: str
    ladder: Ladder
    runs: Sequence[Mapping[str, Sequence[Rung]]]  # as :class:`errors.Run` measures them
    own: Mapping[str, float]  # squared standard errors of the reference, by measure, as :class:`errors.Target` has them

    def _means(self, name: str, treatment: str) -> Iterator[tuple[int, float, float, float, float]]:
        """Of every rung that all runs have: passes, seconds, mean of a value, its standard error, blocks of a run."""
        for rungs in zip(*(run.get(treatment, []) for run in self.runs), strict=True):
            if values := [rung[name] for rung in rungs if name in rung]:
                error = statistics.stdev(values) / math.sqrt(len(values))
                seconds = statistics.median(rung["seconds"] for rung in rungs)
                yield int(rungs[0]["passes"]), seconds, statistics.fmean(values), error, rungs[0]["blocks"]

    def points(self, measure: str, treatment: str = PLAIN) -> list[Point]:
        """Rungs whose error stands clear of the reference's own: those whose square is above it."""
        own, every = self.own[measure], self._means(measure, treatment)
        clear = [(passes, s, math.sqrt(x - own), error) for passes, s, x, error, _ in every if x - own > own]
        return [Point(passes, seconds, root, error / (2 * root)) for passes, seconds, root, error in clear]

    @property
    def slopes(self) -> dict[str, Slope]:
        """Of log error against log seconds, by measures that have a theory and enough rungs."""
        found = {}
        for measure in ("electrons", "irradiance"):
            clear, own = {point.passes for point in self.points(measure)}, self.own[measure]
            runs = [[rung for rung in run[PLAIN] if rung["passes"] in clear] for run in self.runs]
            if all(len(rungs) >= FEWEST_RUNGS and min(rung[measure] for rung in rungs) > own for rungs in runs):
                roots = [[math.sqrt(rung[measure] - own) for rung in rungs] for rungs in runs]
                seconds = [[rung["seconds"] for rung in rungs] for rungs in runs]
                found[measure] = slope_of_runs(zip(seconds, roots, strict=True))
        return found

    @property
    def verdict(self) -> str:
        """Whether every slope follows theory, as its runs can tell; "" where no error is clear of the reference's."""
        held = [abs(one.value - THEORY) <= max(WITHIN, one.half_width) for one in self.slopes.values()]
        return ("holds" if all(held) else "off") if held else ""

    def sigma(self, treatment: str) -> list[Point]:
        """Temporal σ of frames that each have a render of their own over what it must be, minus one, by rung."""
        framed, found = self.ladder.framed, list[Point]()
        for passes, seconds, variance, error, frames in self._means("variance_dn2", treatment):
            assert framed is not None
            ratio, count = math.sqrt(variance / framed.variance_dn2), framed.pixels * (frames - 1) * len(self.runs)
            least = ratio * math.sqrt(0.5 / count)  # few runs agree by chance
            found.append(Point(passes, seconds, ratio - 1, max(error / (2 * ratio * framed.variance_dn2), least)))
        return found

    @property
    def plain_s(self) -> float | None:
        """Seconds after which a frame has a σ that is FRAME_SIGMA too large: excess variance falls as 1/t; or None."""
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


def predict(result: Result, sizes: Sequence[Result], spp: int) -> tuple[float, float] | None:
    """Seconds and error of --spp in a setting, None if its bands are not apart; sizes : of pass, the base setting's."""
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
    """The cheapest options of every kind that reach the tolerance, the quickest first. usual : see :class:`Choice`."""
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
    for seed in (1001, 1002):  # no run and no reference has them; the first compiles, the second is timed
        light = subject.render(seed, **asked)
        off = errors.electrons_of(collect(light, subject.camera, subject.exposure), subject) - target.own.electrons
        squares.append(target.mean_square("electrons", off) - target.squares["electrons"])
    return {"seconds": light.statistics.seconds, "error": math.sqrt(max(statistics.fmean(squares), 0.0))}
