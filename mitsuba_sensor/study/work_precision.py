"""``study work-precision``: error versus run time of the rendered light and of the frames made from it."""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

from ..lab.statistics.estimators import Spread, spread
from ..pages.page import Line, Mark, MarkedRow, Plot, Section, Study, line, study_of, table
from .kit import (
    QUANTITIES,
    Array,
    Options,
    Progress,
    Subject,
    change_of_moments,
    measured,
    moments,
    time_in_turns,
)

SIDES = ("render", "sensor")
RENDERS: dict[str, Options] = {
    "default": {},
    "one band": {"bandwidth_nm": 470.0},
    "channels": {"spectral": "channels"},
    "denoised": {"denoise": True},
}
"""Render options; the first set is compared on every variant."""
VARIANTS = "cuda_ad_spectral", "llvm_ad_spectral", "scalar_spectral"
ENGINES: tuple[tuple[Any, str], ...] = (
    ("numpy", "float32"),
    ("drjit", "float32"),
    ("cuda", "float32"),
)
TOLERANCES_DN: tuple[float | None, ...] = None, 0.02, 1.0
"""Tolerances of the plans; None for the whole chain."""
REFERENCE = "NumPy float64"
REFERENCE_MARGIN = 4.0
"""Tolerance over the error of the reference, at least."""
REFERENCE_S, RUN_S = 8.0, 0.6
"""Longest reference, and longest render of a ladder [s]."""
SPP_MIN, RUNGS_MIN, RUNGS = 16, 3, 7
"""Samples of the first rung (each next rung has three times as many), fewest and most rungs."""
DARKEST = 0.1
"""Errors of darker pixels are relative to this fraction of the mean light, or they would dominate."""
TURNS, SENSORS, FRAMES, FRAMES_A_TURN = 7, 16, 2, 4
TOLERANCE_DN, FLOAT32_DN, DRAWN_MIN_DN = 0.02, 0.01, 1e-5
"""Tolerance of the recommendation, allowed change by float32, and the smallest drawn change [DN]."""
SIGNIFICANT = 4.0
"""Standard errors by which chance may exceed a limit in this many comparisons."""


class Point(NamedTuple):
    """Error and run time of one setting.  seconds : median and quartiles, of a render or a frame."""

    setting: str
    options: str
    seconds: Spread
    error: float
    standard_error: float


def work_precision(
    subject: Subject,
    progress: Progress,
    *,
    tolerance: float = 0.01,
    seeds: int = 4,
    variants: Sequence[str] | None = None,
    sides: Sequence[str] = SIDES,
) -> Study:
    """Measure error versus run time of a render and of its frames.

    tolerance : relative rms error of a pixel's electrons that the recommended options keep.
    seeds : independent runs of each setting.  variants : of Mitsuba; the first runs all settings.
    sides : "render", "sensor" or both.
    Raises InputError for a variant that does not work here.
    """
    if isinstance(sides, str) or not sides or set(sides) - set(SIDES):
        raise ms.InputError(
            f"sides is {sides!r}; it must be one or both of {', '.join(SIDES)}."
        )
    sections = []
    if "render" in sides:
        sections.append(render_section(subject, tolerance, seeds, variants, progress))
    if "sensor" in sides:
        sections.append(sensor_section(subject, progress))
    name = os.path.basename(subject.scene)
    title = f"Error versus run time: {name}, {subject.camera.name}"
    return study_of("work-precision", title, sections)


class Reference(NamedTuple):
    """A long render.

    electrons : mean of each pixel, (H, W).  scale : what errors are relative to.  seen : compared pixels.
    error : relative rms error of this render.
    """

    electrons: Array
    scale: Array
    seen: NDArray[np.bool_]
    error: float

    def square(self, electrons: Array) -> float:
        """Return the mean squared relative error of another render, including the reference's error."""
        return float(np.mean(np.square((electrons - self.electrons) / self.scale)[self.seen]))


def working_variants(subject: Subject, asked: Sequence[str] | None) -> list[str]:
    """Return the requested variants, else those that work here. Raises InputError if one does not work."""
    names, problem = [], None
    for name in asked or VARIANTS:
        try:
            subject.render(1, spp=1, denoise=False, variant=name)
            names.append(name)
        except ms.InputError as error:
            problem = error
    if problem and (asked or not names):
        raise problem
    return names


def rendered(subject: Subject, seed: int, **options: Any) -> tuple[Array, ms.Irradiance]:
    """Render once; return the mean electrons of each pixel, (H, W), and the light."""
    light = subject.render(seed, **{"denoise": False, **options})
    detected = ms.expose(subject.photons(light), subject.camera, subject.exposure).detected
    return np.asarray(detected.mean_e, np.float64), light


def reference_of(subject: Subject, settings: Mapping[str, Options]) -> Reference:
    """Render the reference with channels, which have no band error, or with the default bands."""
    has_channels = subject.camera.quantum_efficiency.quantum_yield is None
    options = settings["channels" if has_channels else "default"]
    electrons, light = rendered(subject, 0, max_seconds=REFERENCE_S, **options)
    seen = (electrons > 0) & (electrons < subject.camera.pixel.full_well_e)
    seen = seen if seen.any() else electrons > 0
    scale = np.maximum(electrons, DARKEST * electrons[seen].mean())
    error = light.relative_error * electrons / scale
    return Reference(electrons, scale, seen, float(np.sqrt(np.square(error[seen]).mean())))


def render_section(
    subject: Subject,
    tolerance: float,
    seeds: int,
    variants: Sequence[str] | None,
    progress: Progress,
) -> Section:
    """Compare all render settings with one long render."""
    progress("variants", 0.0)
    names = working_variants(subject, variants)
    settings = {name: {**options, "variant": names[0]} for name, options in RENDERS.items()}
    settings |= {name: {"variant": name} for name in names[1:]}
    progress("reference render", 0.0)
    exact = reference_of(subject, settings)
    steps = {
        f"renders {name}": partial(ladder, subject, name, options, exact, tolerance, seeds)
        for name, options in settings.items()
    }
    points = [point for rungs in measured(steps, progress).values() for point in rungs]
    best, advice = recommended(points, exact.error, tolerance)
    picture = Plot(
        "Error of a pixel versus render time",
        "time of a render [s]",
        "relative rms error [1]",
        lines_of(points, best),
        levels={f"tolerance {tolerance:g}": tolerance, "error of the reference": exact.error},
        note="Relative rms error of a pixel's electrons below the full well; errors of pixels darker than a tenth of "
        f"the mean are relative to that tenth. The reference's error ({exact.error:.2g}) is subtracted; smaller errors "
        "are not shown. Bars are 1 σ, and quartiles of the time.",
    )
    rows = list[MarkedRow]()
    for one in points:
        mark: Mark = "best" if one is best else ""
        rows.append((mark, (one.setting, one.options, *_middle_first(one.seconds), *one[3:])))
    headings = "setting | options | time [s] | from | to | error [1] | ± [1]"
    return Section((advice,), True, (picture, table("Renders", headings, rows)))


def ladder(
    subject: Subject,
    name: str,
    options: Options,
    exact: Reference,
    tolerance: float,
    seeds: int,
) -> list[Point]:
    """Render one setting with three times the samples on each rung, until a rung is precise or long enough.

    The reference's error is subtracted; rungs that do not exceed it are skipped.
    """
    rendered(subject, 0, spp=SPP_MIN, **options)  # compiles
    points = []
    for rung in range(RUNGS):
        spp, squares, seconds = SPP_MIN * 3**rung, list[float](), list[float]()
        for seed in range(1, seeds + 1):
            electrons, light = rendered(subject, 1000 * seed + spp, spp=spp, **options)
            squares.append(exact.square(electrons))
            seconds.append(light.statistics.seconds)
        square = statistics.fmean(squares) - exact.error**2
        if square > exact.error**2:
            error = math.sqrt(square)
            scatter = statistics.stdev(squares) / math.sqrt(seeds) / (2 * error)
            typed = typed_options(options, light.statistics.samples_per_pixel)
            points.append(Point(name, typed, spread(seconds), error, scatter))
        if square <= exact.error**2 or error + scatter <= tolerance:
            break
        if len(points) >= RUNGS_MIN and statistics.median(seconds) > RUN_S:
            break
    return points


def recommended(
    points: Sequence[Point], own_error: float, tolerance: float
) -> tuple[Point | None, str]:
    """Return the fastest point within the tolerance, or None, and a sentence."""
    goal = f"For a relative error of {tolerance:g}"
    if own_error * REFERENCE_MARGIN > tolerance:
        return None, (
            f"No render is recommended: after {REFERENCE_S:g} s, the reference has an error of {own_error:.2g}, which "
            f"must be at most 1/{REFERENCE_MARGIN:g} of the tolerance of {tolerance:g}; use tolerance="
            f"{REFERENCE_MARGIN * own_error * 1.1:.1g} or more."
        )
    best = fastest(points, tolerance)
    if best is None:
        return None, f"{goal}, no measured setting is sufficient."
    return best, f"{goal}, render with {best.options}: {best.seconds.median:.2g} s."


def fastest(points: Sequence[Point], tolerance: float) -> Point | None:
    """Return the fastest point whose error plus one standard error is within the tolerance."""
    fit = [one for one in points if one.error + one.standard_error <= tolerance]
    return min(fit, key=lambda one: one.seconds.median, default=None)


def _middle_first(seconds: Spread) -> tuple[float, float, float]:
    return seconds.median, seconds.low, seconds.high


def typed_options(options: Options, spp: int) -> str:
    """Return the options of a render as command-line flags."""
    asked = {"spp": spp, **options}
    denoised = asked.pop("denoise", False)
    typed = [f"--{name.replace('_', '-')} {value}" for name, value in asked.items()]
    return " ".join(typed if denoised else [*typed, "--no-denoise"])


def lines_of(
    points: Sequence[Point], best: Point | None, unit: float = 1.0
) -> tuple[Line, ...]:
    """Return a line for each setting, and a star on the recommended point.  unit : of the times."""
    lines = []
    for name in dict.fromkeys(one.setting for one in points):
        lines.append(line(name, [_place(one, unit) for one in points if one.setting == name]))
    if best is not None:
        place = _place(best, unit)[:2]
        lines.append(line(f"recommended: {best.options}", [place], joined=False, star=True))
    return tuple(lines)


def _place(one: Point, unit: float) -> tuple[float, float, float, float]:
    seconds = one.seconds
    return (
        unit * seconds.median,
        max(one.error, DRAWN_MIN_DN),
        one.standard_error,
        unit * (seconds.high - seconds.low) / 2,
    )


def sensor_section(subject: Subject, progress: Progress) -> Section:
    """Compare frames of every engine, precision and plan with NumPy in float64 and the same random numbers."""
    progress("light", 0.0)
    photons = subject.photons(subject.render(1, spp=32, denoise=False))
    settings, absent = dict[str, Options](), list[str]()
    limits, plans = dict[str, float](), dict[float | None, Any]({None: None})
    for dn in filter(None, TOLERANCES_DN):
        plans[dn] = ms.plan(subject.camera, subject.exposure, photons, dn)
    for engine, precision in ENGINES:
        try:
            ms.expose(np.ones((1, 1)), subject.camera, subject.exposure, engine=engine)
        except ms.InputError as problem:
            absent.append(
                f"Not measured on this machine: engine {engine} ({str(problem)[:-1]})."
            )
            continue
        for tolerance_dn, plan in plans.items():
            name = f"{engine} {precision}"
            name += f", plan {tolerance_dn:g} DN" if tolerance_dn else ""
            settings[name] = {"engine": engine, "precision": precision, "plan": plan}
            limits[name] = tolerance_dn or FLOAT32_DN
    every = {REFERENCE: {"engine": "numpy", "precision": "float64"}, **settings}
    pixels = photons.mean.shape[0] * photons.mean.shape[1]
    stream = partial(ms.stream, photons, subject.camera, subject.exposure, frames=2**31)
    tasks = {name: partial(_take, stream(**options)) for name, options in every.items()}
    steps: Options = {
        f"frames {name}": partial(_moments, photons, subject, options)
        for name, options in every.items()
    }
    steps["seconds of frames"] = lambda: time_in_turns(tasks, TURNS)
    found = measured(steps, progress)
    seconds, exact = found["seconds of frames"], found[f"frames {REFERENCE}"]
    points, rows, failed = list[Point](), list[MarkedRow](), list[str]()
    for name, limit in limits.items():
        change, error = change_of_moments(found[f"frames {name}"], exact)
        worst = int(np.abs(change).argmax())
        holds = bool((np.abs(change) <= limit + SIGNIFICANT * error).all())
        failed += [] if holds else [name]
        size = abs(float(change[worst]))
        points.append(Point(name, name, spread(seconds[name]), size, float(error[worst])))
        times = (1e9 * x / pixels for x in _middle_first(points[-1].seconds))
        rows.append(("good" if holds else "bad", (name, *times, *change.tolist(), limit)))
    best = fastest(points, TOLERANCE_DN)
    reference_ns = 1e9 * spread(seconds[REFERENCE]).median / pixels
    findings = list(absent)
    if best is not None:
        ns = 1e9 * best.seconds.median / pixels
        findings.insert(
            0,
            f"For frames within {TOLERANCE_DN:g} DN, use {best.setting}: {ns:.3g} ns per pixel, "
            f"{reference_ns / ns:.2g} times as fast as {REFERENCE}; mean and σ change by at most {best.error:.1g} DN.",
        )
    shape = f"{photons.mean.shape[1]} × {photons.mean.shape[0]}"
    note = (
        f"Each point is one setting's largest change of mean, temporal σ or spatial σ from {REFERENCE} with the same "
        f"random numbers, in frames of {shape} pixels. Changes below {DRAWN_MIN_DN:g} DN are drawn there. Bars are "
        "1 σ, and quartiles of the time."
    )
    picture = Plot(
        "Frame error versus run time",
        "run time [ns/pixel]",
        "largest change [DN]",
        lines_of(points, best, 1e9 / pixels),
        levels={
            f"tolerance {TOLERANCE_DN:g} DN": TOLERANCE_DN,
            f"|{REFERENCE}, reference": reference_ns,
        },
        note=note,
    )
    changes = " | ".join(f"change of {name} [DN]" for name in QUANTITIES)
    headings = f"setting | time [ns/pixel] | from | to | {changes} | limit [DN]"
    shown = table(
        "Settings of the sensor",
        headings,
        rows,
        f"{SENSORS} sensor units with {FRAMES} frames each. A change may exceed its limit by {SIGNIFICANT:g} standard "
        "errors. Times are medians and quartiles, measured in turns.",
    )
    return Section(tuple(findings), not failed, (picture, shown), failed=tuple(failed))


def _take(frames: Iterator[object]) -> int:
    """Take several frames of a stream, which computes the next frame meanwhile; return their number."""
    for _ in range(FRAMES_A_TURN):
        next(frames)
    return FRAMES_A_TURN


def _moments(photons: ms.Photons, subject: Subject, options: Options) -> Array:
    """Return the moments of the frames of every sensor unit."""
    taken = [
        ms.expose(
            photons,
            subject.camera,
            subject.exposure,
            frames=FRAMES,
            serial=n,
            seed=n,
            **options,
        ).digital
        for n in range(1, SENSORS + 1)
    ]
    return moments(taken)
