"""The render's part of the page: errors beside times, slopes, and the options to take for a tolerance."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence

from ...pages.page import Line, Mark, MarkedRow, Part, Plot, Section, Table, line, ringed, table
from .render import Render
from .results import INDEPENDENT, STRATIFIED, WITHIN, Choice, Result, choices

PIXELS = "Over pixels below full well, relative to their own light, or to a tenth of the mean where it is darker."


def render_section(render: Render) -> Section:
    """The render's side; it has passed if every slope that has a theory follows it."""
    results = render.results()
    reaching = choices(results, render.tolerance)
    plot = diagram(results, render.tolerance)
    tables = choices_table(reaching, render.tolerance), settings_table(results)
    parts: tuple[Part, ...] = (*([plot] if plot.lines else []), *tables)
    findings = advice(reaching, render.tolerance), *render_findings(results, plot)
    return Section(findings, all(one.verdict != "off" for one in results), parts)


def advice(reaching: Sequence[Choice], tolerance: float) -> str:
    """The options to take for the tolerance."""
    goal = f"For a relative error of {tolerance:.3g} in the light of a pixel"
    if not reaching:
        return f"{goal} any number of samples does: all errors are below the reference's own."
    best = reaching[0]
    return f"{goal} render with {best.options} (about {best.seconds:.2g} s)."


def render_findings(results: Sequence[Result], plot: Plot) -> Iterator[str]:
    """Slopes, the front, and the error of the reference."""
    slopes = [one.slope.value for one in results if one.verdict and one.slope is not None]
    off = [one.setting.name for one in results if one.verdict == "off"]
    if slopes:
        missing = ""
        if off:
            missing = f"; not in {', '.join(off)}"
        yield (
            f"The error goes with the number of samples to a power between {INDEPENDENT:g} (independent samples) and "
            f"{STRATIFIED:g} (stratified ones), as it should, in {len(slopes) - len(off)} of {len(slopes)} settings: "
            f"the powers are {min(slopes):.3f} to {max(slopes):.3f}, of which {WITHIN:g} or the interval is allowed for"
            f"{missing}."
        )
    front = sorted((one.x[k], one.label) for one in plot.lines for k in one.ringed)
    if front:
        names = dict.fromkeys(name for _, name in front)
        yield f"No other setting is both faster and more exact than, from the fastest on: {', '.join(names)}."
    own = math.sqrt(results[0].own)
    yield f"The reference render has a relative error of {own:.2g} itself, which is subtracted from every error."


def diagram(results: Sequence[Result], tolerance: float) -> Plot:
    """Error against seconds of all settings."""
    lines: list[Line] = []
    for one in results:
        points = [(point.seconds, point.error, point.spread) for point in one.points()]
        if points:
            lines.append(line(one.setting.name, points, dashed=not one.setting.has_law))
    level = tolerance, f"tolerance {tolerance:.3g}"
    note = f"Rings mark Pareto-optimal settings. {PIXELS} The reference's own error is subtracted; bars are 1 σ."
    title, y_label = "Pixel error versus render time", "relative rms error of a pixel [1]"
    return Plot(
        title, "wall time of a render [s]", y_label, ringed(lines), level=level, note=note
    )


def choices_table(reaching: Sequence[Choice], tolerance: float) -> Table:
    """The options that reach the tolerance."""
    rows: list[MarkedRow] = []
    for one in reaching:
        rows.append(("best" if one is reaching[0] else "", (one.options, one.seconds)))
    return table(
        f"What reaches {tolerance:.3g}",
        "options | time [s]",
        rows,
        "The quickest first. Loading the scene and compiling come on top, once.",
    )


def settings_table(results: Sequence[Result]) -> Table:
    """The errors of the longest renders, and slopes."""
    marks: dict[str, Mark] = {"holds": "good", "off": "bad", "": "dim"}
    rows: list[MarkedRow] = []
    for one in results:
        points = one.points()
        seconds = statistics.median(run[-1].seconds for run in one.runs)
        slope = one.slope or (None, None)
        if points:
            error = points[-1].error
        else:
            error = None
        verdict = one.verdict or ("below the reference" if one.setting.has_law else "no law")
        rows.append(
            (
                marks[one.verdict],
                (one.setting.name, one.runs[0][-1].spp, seconds, error, *slope, verdict),
            )
        )
    return table(
        "Settings of the render",
        "setting | samples per pixel | time [s] | error [1] | slope [1] | ± [1] | verdict",
        rows,
        f"Errors of the longest renders. {PIXELS} Slopes of log error against log samples with 95 % intervals over "
        f"{len(results[0].runs)} runs; they hold between {INDEPENDENT:g} and {STRATIFIED:g}, within {WITHIN:g} or "
        "a wider interval.",
    )
