"""``study work-precision``: error against run time, of the light that is rendered and of the frames made from it."""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Iterator, Sequence
from itertools import chain

from ...core import InputError
from ...render.variants import restores_variant
from ..kit import Kit, Subject
from ..page import Line, Mark, MarkedRow, Part, Plot, Section, Study, Table, line, ringed, study_of, table
from .errors import COMPENSATED, DENOISED, PLAIN, Ladder, Reference
from .render import FRAME_SIGMA, THEORY, WITHIN, Render
from .sensor import Results, Sensor
from .sensor_page import sensor_section

SIDES = ("render", "sensor")
RECORDS = Reference, Ladder  # that its measurements consist of
SECONDS = "wall time of a render [s]"
FRAMES = {PLAIN: "render noise on top", COMPENSATED: "render noise compensated", DENOISED: "denoised"}
SEEN = "Over all pixels below full well"
PIXELS = f"{SEEN}, each relative to its own light, or to a tenth of the mean where it is darker."
SHOWN = "Pixels below full well, without the noisiest one in a hundred, at edges of lamps."
DIAGRAMS = {
    "electrons": ("Error of the detected electrons", "relative rms error of a pixel [1]"),
    "irradiance": ("Error of the irradiance", "relative rms error of a pixel and band [1]"),
    "dn": ("Error of the mean digital number", "rms error of a pixel [DN]"),
}


@restores_variant
def work_precision(
    kit: Kit,
    subject: Subject,
    *,
    tolerance: float = 0.01,
    seeds: int = 4,
    variants: Sequence[str] | None = None,
    sides: Sequence[str] = SIDES,
) -> Study:
    """What an error costs, of a render and of the frames.

    kit : measures, and knows what is measured already.  sides : "render", "sensor" or both.
    tolerance : relative rms error of the electrons of a pixel, over the picture, for which options are recommended.
    seeds : independent runs of each setting, 2 … 64; their spread makes the intervals.
    variants : of Mitsuba, the first with all settings; by default every spectral one that works here.
    Raises InputError for a variant that is not there, and for what :func:`mitsuba_sensor.render` would refuse.
    """
    if isinstance(sides, str) or not sides or set(sides) - set(SIDES):
        raise InputError(f"sides is {sides!r}; it must be one or both of {', '.join(SIDES)}.")
    render, sections = Render(kit, subject, tolerance, seeds, variants), []
    if "render" in sides:
        render.measure()
        sections.append(render_section(render))
    if "sensor" in sides:
        sensor = Sensor(kit, subject, render.photons())
        sensor.measure()
        sections.append(sensor_section(Results(sensor)))
    title = f"Error against run time: {os.path.basename(subject.scene)}, {subject.camera.name}"
    return study_of("work-precision", title, sections)


def render_section(found: Render) -> Section:
    """The whole side; it has passed if every slope that has a theory follows it and compensated frames have their σ."""
    diagrams, (sigma, frames) = [_diagram(found, measure) for measure in DIAGRAMS], _frames_parts(found)
    plots, tables = (*diagrams, sigma), (_choices(found), _settings(found), frames, _references(found))
    parts: tuple[Part, ...] = *(one for one in plots if one.lines), *(one for one in tables if one.rows)
    framed = [point for one in found.results for point in one.sigma(COMPENSATED)[-1:]]  # of the longest renders
    passed = all(abs(point.error) <= FRAME_SIGMA + 3.0 * point.spread for point in framed)  # three standard errors
    passed = passed and all(one.verdict != "off" for one in found.results)
    return Section((_advice(found), *_findings(found, diagrams[0])), passed, parts)


def _advice(found: Render) -> str:
    goal = f"For a relative error of {found.tolerance:.3g} of the light of a pixel"
    if not any(one.points("electrons") for one in found.results):
        return f"{goal} any number of samples does: all errors are below the reference's own."
    if not found.choices:
        return f"{goal} no setting is enough; take more light or a larger tolerance."
    if not found.checks:
        best = found.choices[0]
        return f"{goal}: {best.options} ({best.error:.2g} in {best.seconds:.3g} s as the fits tell; too long to check)."
    best, got = found.checks[-1]
    told = f"predicted {best.error:.3g} in {best.seconds:.3g} s, rendered {got['error']:.3g} in {got['seconds']:.3g} s"
    return f"{goal}: {best.options} ({told}{'' if found.reached else '; not reached yet, take more samples'})."


def _findings(found: Render, diagram: Plot) -> Iterator[str]:
    if slopes := [slope.value for one in found.results for slope in one.slopes.values()]:
        held, off = ([one.label for one in found.results if one.verdict == verdict] for verdict in ("holds", "off"))
        yield (
            f"The error falls as time to the power −1/2, within {WITHIN:g} or its interval, in {len(held)} of "
            f"{len(held) + len(off)} settings, all slopes from {min(slopes):.3f} to {max(slopes):.3f}"
            f"{'; not in ' + ', '.join(off) if off else ''}."
        )
    if front := sorted((line.x[k], line.label) for line in diagram.lines for k in line.ringed):
        labels = dict.fromkeys(label for _, label in front)
        yield f"Electrons: no other setting beats, from the quickest to the most exact, {', '.join(labels)}."
    for one in found.results:  # how long frames with renders of their own take, compensated and plain
        if (framed := one.ladder.framed) and one.sigma(COMPENSATED):
            right, plain = (one.sigma(treatment)[0] for treatment in (COMPENSATED, PLAIN))
            share = "" if framed.share == 1 else f"; all {1 / framed.share:.3g} times as long at the full exposure"
            needed = "" if one.plain_s is None else f"{FRAME_SIGMA:.0%} after {one.plain_s:.2g} s without, "
            yield (
                f"Frames of {framed.exposure.time_s:.2g} s, each with a render ({one.label}): after "
                f"{right.seconds:.2g} s σ is off by {right.error:+.1%} ± {right.spread:.1%} with --render-noise "
                f"compensated, by {plain.error:+.1%} ± {plain.spread:.1%} without; {needed}compensable after "
                f"{framed.compensable * one.pass_s:.2g} s{share}."
            )
    spp, own = found.references["auto"].light.statistics.samples_per_pixel, found.results[0].own
    yield (
        f"The reference's own error ({spp} samples per pixel): electrons {math.sqrt(own['electrons']):.2g}, mean "
        f"{math.sqrt(own['dn']):.2g} DN; it is taken off every error."
    )
    if not found.smooth:
        yield "Denoising was left out: pip install pyoidn."


def _diagram(found: Render, measure: str) -> Plot:
    """Error against seconds of all settings, and of what the denoiser makes of the base setting."""
    lines = [line(one.label, points) for one in found.results if (points := [p[1:] for p in one.points(measure)])]
    if smooth := [point[1:] for point in found.results[0].points(measure, DENOISED)]:
        lines.append(line("denoised", smooth, dashed=True))
    level = (found.tolerance, f"tolerance {found.tolerance:.3g}") if measure == "electrons" else None
    pixels = f"{SEEN}." if measure == "dn" else PIXELS
    note = f"Rings: no other is as quick and as exact. {pixels} The reference's own error is taken off; bars are 1 σ."
    title, y_label = DIAGRAMS[measure]
    return Plot(title, SECONDS, y_label, ringed(lines), level=level, note=note)


def _frames_parts(found: Render) -> tuple[Plot, Table]:
    """Temporal σ of frames over what it must be, drawn and in numbers."""
    lines: list[Line] = []
    rows: list[MarkedRow] = []
    for one, framed in ((one, framed) for one in found.results if (framed := one.ladder.framed)):
        by = {name: {point.passes: point for point in one.sigma(name)} for name in FRAMES}
        for name, points in by.items():
            if places := [(point.seconds, 1 + point.error, point.spread) for point in points.values()]:
                label = f"{one.label} at {framed.exposure.time_s:.2g} s: {FRAMES[name]}"
                lines.append(line(label, places, dashed=name == DENOISED))
        for passes, point in by[PLAIN].items():
            about = framed.exposure.time_s, passes, point.seconds, "yes" if passes >= framed.compensable else "no"
            errors = (points[passes][2:] if passes in points else (None, None) for points in by.values())
            rows.append(("", (one.label, *about, *chain.from_iterable(errors))))
    note, y_label = f"Every frame has a render of its own. {SHOWN} Bars are 1 σ.", "σ of frames / σ of the camera [1]"
    title, level = "Temporal σ of the digital numbers", (1.0, "right")
    return Plot(title, SECONDS, y_label, tuple(lines), log_y=False, level=level, note=note), table(
        "Temporal σ of frames, relative error",
        "setting | exposure [s] | passes | time [s] | compensable | plain [1] | ± σ [1] | compensated [1] | ± σ [1] | "
        "denoised [1] | ± σ [1]",
        rows,
        f"Compensable: the render's noise is as low as --render-noise compensated aims at. {SHOWN}",
    )


def _settings(found: Render) -> Table:
    marks: dict[str, Mark] = {"holds": "good", "off": "bad", "": "dim"}
    rows: list[MarkedRow] = []
    for one in found.results:
        ladder, seconds = one.ladder, statistics.median(run[PLAIN][-1]["seconds"] for run in one.runs)
        passes = ladder.samples * ladder.groups, ladder.first_s, 1e3 * one.pass_s, ladder.passes, seconds
        errors = (points[-1].error if (points := one.points(measure)) else None for measure in DIAGRAMS)
        slopes = (x for measure in ("electrons", "irradiance") for x in one.slopes.get(measure, (None, None)))
        verdict = THEORY, one.verdict or "below the reference"
        rows.append((marks[one.verdict], (one.label, *passes, *errors, *slopes, *verdict)))
    base = found.results[0].setting
    return table(
        "Settings",
        "setting | samples per pass | first pass [s] | pass [ms] | passes | time [s] | error: electrons [1] | "
        "irradiance [1] | mean [DN] | slope, electrons [1] | ± [1] | slope, irradiance [1] | ± [1] | "
        "theory [1] | verdict",
        rows,
        f"Errors after all passes. {PIXELS} Slopes of log error against log seconds with 95 % intervals over "
        f"{len(found.results[0].runs)} runs; they hold within {WITHIN:g} of theory, or within a wider interval. "
        "First pass: loading and compiling, or fetching what was compiled before. "
        f"As shipped: {base.variant}, {base.sampler}, {base.samples} samples per pass, all bands together.",
    )


def _choices(found: Render) -> Table:
    tried = {one.options: (got["seconds"], got["error"]) for one, got in found.checks}
    every = {one.options: one for one in (*(one for one, _ in found.checks[::-1]), *found.choices)}
    rows = [(name, one.seconds, one.error, *tried.get(name, (None, None))) for name, one in every.items()]
    best: Mark = "best" if found.reached or not found.checks else "bad"
    return table(
        f"What reaches {found.tolerance:.3g}",
        "options | time, predicted [s] | error, predicted [1] | time, rendered [s] | error, rendered [1]",
        ((best if row is rows[0] else "", row) for row in rows),
        "The fewest samples of each kind, the quickest first. Loading the scene and compiling come on top, once.",
    )


def _references(found: Render) -> Table:
    rows: list[MarkedRow] = []
    auto = found.references["auto"]
    for kind, own in found.references.items():
        squares, mean_e = found.target(kind).squares_of(own), float(auto.electrons.mean())
        error_e = math.sqrt(own.variance_e2.sum() + auto.variance_e2.sum()) / auto.electrons.size
        bias = (None, None) if kind == "auto" else (float(own.electrons.mean()) / mean_e - 1, error_e / mean_e)
        errors = (math.sqrt(squares[name]) for name in DIAGRAMS)
        about = own.light.statistics
        rows.append(("", (kind, about.passes, about.samples_per_pixel, about.seconds, *errors, *bias)))
    return table(
        "References",
        "bands | passes | samples per pixel | time [s] | standard error: electrons [1] | irradiance [1] | mean [DN] | "
        "electrons, difference to auto [1] | ± σ [1]",
        rows,
        "Channels are compared with a reference of their own: what it differs by is the error of bands of finite "
        "width, which no samples cure.",
    )
