"""The render's part of the page: sentences, diagrams and tables about its error against its wall time."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..page import Line, Mark, Part, Plot, Section, Table, table
from ..statistics import pareto
from .render import Render
from .render_results import FRAME_SIGMA, THEORY, WITHIN, Point, Result

SECONDS = "wall time of a render [s]"
FRAMES = {"plain": "render noise on top", "compensated": "render noise compensated", "denoised": "denoised"}
PIXELS = (
    "Over all pixels below full well, each relative to its own light, or to a tenth of the mean where it is darker."
)
SHOWN = "Pixels below full well, without the noisiest one in a hundred, at edges of lamps."
DIAGRAMS = {
    "electrons": ("Error of the detected electrons", "relative rms error of a pixel"),
    "irradiance": ("Error of the irradiance", "relative rms error of a pixel and band"),
    "dn": ("Error of the mean digital number", "rms error of a pixel [DN]"),
}


def render_section(found: Render) -> Section:
    """The whole side; it has passed if every slope that has a theory follows it and compensated frames have their σ."""
    diagrams = *(diagram(found, measure) for measure in DIAGRAMS), sigma_diagram(found)
    tables = choice_table(found), settings_table(found), frames_table(found), reference_table(found)
    parts: tuple[Part, ...] = *(one for one in diagrams if one.lines), *(one for one in tables if one.rows)
    passed = all(one.verdict != "off" and one.compensates for one in found.results)
    left = "" if found.smooth else "Denoising was left out: pip install 'mitsuba-sensor[denoise]'."
    findings = (_advice(found), _law(found), _front(found), *map(_frames, found.results), _floor(found), left)
    return Section(tuple(filter(None, findings)), passed, parts)


def _advice(found: Render) -> str:
    """The options to take."""
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


def _law(found: Render) -> str:
    """Whether the slopes are what theory says."""
    compared = [one for one in found.results if one.verdict]
    if not compared:
        return ""
    off = [one.label for one in compared if one.verdict == "off"]
    slopes = [slope.value for one in compared for slope in one.slopes]
    return (
        f"The error falls as time to the power −1/2, within {WITHIN:g}, in {len(compared) - len(off)} of "
        f"{len(compared)} settings, all slopes from {min(slopes):.3f} to {max(slopes):.3f}"
        f"{'; not in ' + ', '.join(off) if off else ''}."
    )


def _front(found: Render) -> str:
    """Who is on the front."""
    lines = curves(found, "electrons")
    if not lines:
        return ""
    labels = ", ".join(dict.fromkeys(lines[c].label for c, _ in front(lines)))
    return f"Electrons: no other setting beats, from the quickest to the most exact, {labels}."


def _frames(result: Result) -> str:
    """How long frames with renders of their own take, compensated and plain; "" where none were made."""
    framed, right, plain = result.ladder.framed, result.sigma("compensated")[:1], result.sigma("plain")[:1]
    if framed is None or not right:
        return ""
    share = "" if framed.share == 1 else f"; all {1 / framed.share:.3g} times as long at the full exposure"
    needed = "" if result.plain_s is None else f"{FRAME_SIGMA:.0%} after {result.plain_s:.2g} s without, "
    return (
        f"Frames of {framed.exposure.time_s:.2g} s, each with a render ({result.label}): after {right[0].seconds:.2g} "
        f"s σ is off by {right[0].error:+.1%} ± {right[0].spread:.1%} with --render-noise compensated, by "
        f"{plain[0].error:+.1%} ± {plain[0].spread:.1%} without; {needed}compensable after "
        f"{framed.compensable * result.pass_s:.2g} s{share}."
    )


def _floor(found: Render) -> str:
    own = found.references["auto"]
    return (
        f"The reference's own error ({own.samples_per_pixel} samples per pixel): electrons "
        f"{math.sqrt(own.squares['electrons']):.2g}, mean {math.sqrt(own.squares['dn']):.2g} DN; it is taken off every "
        "error."
    )


@dataclass(frozen=True)
class Curve:
    """One line of a diagram."""

    label: str
    points: Sequence[Point]
    dashed: bool = False

    def line(self, ringed: tuple[int, ...] = (), above: float = 0.0) -> Line:
        """Drawn. ringed : which points have a ring.  above : added to the errors."""
        rows = [(point.seconds, above + point.error, point.spread) for point in self.points]
        x, y, error = zip(*rows, strict=True)
        return Line(self.label, x, y, error, dashed=self.dashed, ringed=ringed)


def curves(found: Render, measure: str) -> list[Curve]:
    """Of all settings, and of what the denoiser makes of the base setting."""
    lines = [Curve(one.label, one.points(measure)) for one in found.results]
    lines.append(Curve("denoised", found.results[0].points(measure, "denoised"), dashed=True))
    return [curve for curve in lines if curve.points]


def front(lines: Sequence[Curve]) -> list[tuple[int, int]]:
    """Places, (curve, point), of those that no other beats in seconds and error; the quickest first."""
    every = [(c, k, point) for c, curve in enumerate(lines) for k, point in enumerate(curve.points)]
    return [every[i][:2] for i in pareto([(point.seconds, point.error) for *_, point in every])]


def diagram(found: Render, measure: str) -> Plot:
    """Error against seconds; rings are on the front of all points together."""
    every = curves(found, measure)
    on_front = front(every)
    lines = tuple(curve.line(tuple(k for n, k in on_front if n == c)) for c, curve in enumerate(every))
    level = (found.tolerance, f"tolerance {found.tolerance:.3g}") if measure == "electrons" else None
    pixels = "Over all pixels below full well." if measure == "dn" else PIXELS
    note = f"Rings: no other is as quick and as exact. {pixels} The reference's own error is taken off; bars are 1 σ."
    title, y_label = DIAGRAMS[measure]
    return Plot(title, SECONDS, y_label, lines, level=level, note=note)


def sigma_diagram(found: Render) -> Plot:
    """Temporal σ of frames over what it must be."""
    lines = [
        Curve(f"{one.label} at {one.ladder.framed.exposure.time_s:.2g} s: {text}", one.sigma(name), name == "denoised")
        for one in found.results
        for name, text in FRAMES.items()
        if one.ladder.framed is not None and one.sigma(name)
    ]
    note = f"Every frame has a render of its own. {SHOWN} Bars are 1 σ."
    drawn, title = tuple(line.line(above=1.0) for line in lines), "Temporal σ of the digital numbers"
    return Plot(title, SECONDS, "σ of frames / σ of the camera", drawn, log_y=False, level=(1.0, "right"), note=note)


def frames_table(found: Render) -> Table:
    """The same in numbers."""
    rows: list[tuple[Mark, Sequence[Any]]] = []
    for one in found.results:
        by = {name: {point.passes: point for point in one.sigma(name)} for name in FRAMES}
        for passes, plain in by["plain"].items() if one.ladder.framed else ():
            points = [points.get(passes) for points in by.values()]
            values = [x for p in points for x in ((None, None) if p is None else (p.error, p.spread))]
            framed = one.ladder.framed
            assert framed is not None
            enough = "yes" if passes >= framed.compensable else "no"
            rows.append(("", (one.label, framed.exposure.time_s, passes, plain.seconds, enough, *values)))
    return table(
        "Temporal σ of frames, relative error",
        "setting | exposure [s] | passes | seconds | compensable | plain | ± σ | compensated | ± σ | denoised | ± σ",
        rows,
        f"Compensable: the render's noise is as low as --render-noise compensated aims at. {SHOWN}",
    )


def settings_table(found: Render) -> Table:
    """What was compared."""
    marks: dict[str, Mark] = {"holds": "good", "off": "bad", "": "dim"}
    rows: list[tuple[Mark, Sequence[Any]]] = []
    for result in found.results:
        ladder, top = result.ladder, result.rungs()[-1]
        times = ladder.first_s, 1e3 * result.pass_s, ladder.passes, statistics.median(run["seconds"] for run in top)
        errors = [points[-1].error if (points := result.points(measure)) else None for measure in DIAGRAMS]
        slopes = [result.slope(measure) for measure in ("electrons", "irradiance")]
        numbers = [x for s in slopes for x in ((None, None) if s is None else (s.value, s.half_width))]
        verdict = result.verdict or "below the reference"
        row = (result.label, ladder.samples * ladder.groups, *times, *errors, *numbers, THEORY, verdict)
        rows.append((marks[result.verdict], row))
    base = found.results[0].setting
    return table(
        "Settings",
        "setting | samples per pass | first pass [s] | pass [ms] | passes | seconds | electrons | irradiance | "
        "mean [DN] | slope, electrons | ± | slope, irradiance | ± | theory | verdict",
        rows,
        f"Errors after all passes. {PIXELS} Slopes of log error against log "
        f"seconds with 95 % intervals over {len(found.results[0].runs)} runs; they hold within {WITHIN:g} of theory. "
        "First pass: loading and compiling, or fetching what was compiled before. "
        f"As shipped: {base.variant}, {base.sampler}, {base.samples} samples per pass, all bands together.",
    )


def choice_table(found: Render) -> Table:
    """Options that reach the tolerance."""
    tried = {one.options: (got["seconds"], got["error"]) for one, got in found.checks}
    every = {one.options: one for one in (*(one for one, _ in found.checks[::-1]), *found.choices)}
    best: Mark = "best" if found.reached or not found.checks else "bad"
    return table(
        f"What reaches {found.tolerance:.3g}",
        "options | seconds, predicted | error, predicted | seconds, rendered | error, rendered",
        (
            ("" if number else best, (options, one.seconds, one.error, *tried.get(options, (None, None))))
            for number, (options, one) in enumerate(every.items())
        ),
        "The fewest samples of each kind, the quickest first. Loading the scene and compiling come on top, once.",
    )


def reference_table(found: Render) -> Table:
    """What all was compared with."""
    rows: list[tuple[Mark, Sequence[Any]]] = []
    for kind, own in found.references.items():
        bias = (None, None) if kind == "auto" else own.difference(found.references["auto"])
        errors = (math.sqrt(own.squares[name]) for name in DIAGRAMS)
        rows.append(("", (kind, own.passes, own.samples_per_pixel, own.seconds, *errors, *bias)))
    return table(
        "References",
        "bands | passes | samples per pixel | seconds | standard error, electrons | irradiance | mean [DN] | "
        "electrons, difference to auto | ± σ",
        rows,
        "Channels are compared with a reference of their own: what it differs by is the error of bands of finite "
        "width, which no samples cure.",
    )
