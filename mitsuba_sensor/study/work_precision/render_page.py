"""The render's part of the page: errors beside times, slopes, and the options to take for a tolerance."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence

from ..page import Line, Mark, MarkedRow, Part, Plot, Section, Table, line, ringed, table
from .render import Render
from .results import INDEPENDENT, STRATIFIED, WITHIN, Choice, Result, choices

CHECK_S = 15.0
"""Options that take longer are recommended without a check."""

MEASURES = {
    "electrons": ("Error of the detected electrons", "relative rms error of a pixel [1]"),
    "dn": ("Error of the mean digital number", "rms error of a pixel [DN]"),
}
PIXELS = (
    "Over all pixels below full well, each relative to its own light, or to a tenth of the mean where it is darker."
)


def render_section(render: Render) -> Section:
    """The render's side; it has passed if every slope that has a theory follows it."""
    results = render.results()
    reaching = choices(results, render.tolerance)
    checked = render.check(reaching[0]) if reaching and reaching[0].seconds <= CHECK_S else None
    plots = [diagram(results, measure, render.tolerance) for measure in MEASURES]
    tables = choices_table(reaching, checked, render.tolerance), settings_table(results)
    parts: tuple[Part, ...] = (*(plot for plot in plots if plot.lines), *tables)
    findings = advice(reaching, checked, render.tolerance), *render_findings(results, plots[0])
    return Section(findings, all(one.verdict != "off" for one in results), parts)


def advice(reaching: Sequence[Choice], checked: tuple[float, float] | None, tolerance: float) -> str:
    """The options to take for the tolerance."""
    goal = f"For a relative error of {tolerance:.3g} of the light of a pixel"
    if not reaching:
        return f"{goal} any number of samples does: all errors are below the reference's own."
    best = reaching[0]
    predicted = f"predicted {best.error:.2g} in {best.seconds:.2g} s"
    rendered = "too long to check" if checked is None else f"rendered {checked[1]:.2g} in {checked[0]:.2g} s"
    return f"{goal}: {best.options} ({predicted}, {rendered})."


def render_findings(results: Sequence[Result], plot: Plot) -> Iterator[str]:
    """Slopes, the front, and the error of the reference."""
    slopes = [one.slope.value for one in results if one.verdict and one.slope is not None]
    off = [one.setting.name for one in results if one.verdict == "off"]
    if slopes:
        missing = f"; not in {', '.join(off)}" if off else ""
        yield (
            f"The error falls as the samples to a power between {INDEPENDENT:g} (independent ones) and {STRATIFIED:g} "
            f"(stratified ones), within {WITHIN:g} or its interval, in "
            f"{len(slopes) - len(off)} of {len(slopes)} settings, slopes from {min(slopes):.3f} to "
            f"{max(slopes):.3f}{missing}."
        )
    front = sorted((one.x[k], one.label) for one in plot.lines for k in one.ringed)
    if front:
        names = dict.fromkeys(name for _, name in front)
        yield f"Electrons: no other setting beats, from the quickest to the most exact, {', '.join(names)}."
    own = results[0].own
    yield (
        f"The reference's own error is {math.sqrt(own['electrons']):.2g} of the electrons, {math.sqrt(own['dn']):.2g} "
        "DN of the mean; it is taken off every error."
    )


def diagram(results: Sequence[Result], measure: str, tolerance: float) -> Plot:
    """Error against seconds of all settings."""
    lines: list[Line] = []
    for one in results:
        points = [(point.seconds, point.error, point.spread) for point in one.points(measure)]
        if points:
            lines.append(line(one.setting.name, points, dashed=not one.setting.has_law))
    title, y_label = MEASURES[measure]
    level = (tolerance, f"tolerance {tolerance:.3g}") if measure == "electrons" else None
    note = f"Rings: no other is as quick and as exact. {PIXELS} The reference's own error is taken off; bars are 1 σ."
    return Plot(title, "wall time of a render [s]", y_label, ringed(lines), level=level, note=note)


def choices_table(reaching: Sequence[Choice], checked: tuple[float, float] | None, tolerance: float) -> Table:
    """The options that reach the tolerance."""
    rows: list[MarkedRow] = []
    for number, one in enumerate(reaching):
        rendered = checked if number == 0 and checked else (None, None)
        mark: Mark = "best" if number == 0 else ""
        rows.append((mark, (one.options, one.seconds, one.error, *rendered)))
    return table(
        f"What reaches {tolerance:.3g}",
        "options | time, predicted [s] | error, predicted [1] | time, rendered [s] | error, rendered [1]",
        rows,
        "The quickest first. Loading the scene and compiling come on top, once.",
    )


def settings_table(results: Sequence[Result]) -> Table:
    """The errors of the longest renders, and slopes."""
    marks: dict[str, Mark] = {"holds": "good", "off": "bad", "": "dim"}
    rows: list[MarkedRow] = []
    for one in results:
        last = [points[-1] if (points := one.points(measure)) else None for measure in MEASURES]
        seconds = statistics.median(run[-1].seconds for run in one.runs)
        slope = one.slope or (None, None)
        errors = [None if point is None else point.error for point in last]
        verdict = one.verdict or ("below the reference" if one.setting.has_law else "no law")
        rows.append((marks[one.verdict], (one.setting.name, one.runs[0][-1].spp, seconds, *errors, *slope, verdict)))
    return table(
        "Settings of the render",
        "setting | samples per pixel | time [s] | error: electrons [1] | mean [DN] | slope [1] | ± [1] | verdict",
        rows,
        f"Errors of the longest renders. {PIXELS} Slopes of log error against log samples with 95 % intervals over "
        f"{len(results[0].runs)} runs; they hold between {INDEPENDENT:g} and {STRATIFIED:g}, within {WITHIN:g} or "
        "a wider interval.",
    )
