"""The sensor's part of the page: errors beside times, what must hold of them, and what to take for a tolerance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping

import numpy as np

from ...lab.statistics.estimators import pareto, ratio
from ...pages.page import Mark, MarkedRow, Part, Plot, Section, Table, line, ringed, table
from .sensor import (
    FRAMES,
    LARGE,
    LEAST_DN,
    REFERENCE,
    SENSORS,
    SIGNIFICANT,
    FrameSetting,
    Row,
    Sensor,
)

MOST_PIXELS, LARGEST_DN = 0.01, 1.0
"""Share of the pixels that float32 may move, and by how much (docs/accuracy-and-limits.md)."""

USUAL_DN = 0.02
"""The tolerance that the first finding is about."""

QUANTITIES = "mean", "temporal σ", "spatial σ"
Rows = Mapping[FrameSetting, Row]


def sensor_section(sensor: Sensor) -> Section:
    """Everything that was measured, in the order of reading."""
    rows = {setting: Row(sensor, setting) for setting in sensor.settings}
    required = list(requirements(rows))
    missed, shown = [], list[MarkedRow]()
    for what, unit, found, limit in required:
        if found > limit:
            missed.append(f"Beyond its limit of {limit:.3g}: {what}, {found:.3g}.")
        shown.append(("bad" if found > limit else "good", (what, unit, found, limit)))
    note = f"{SIGNIFICANT:g} standard errors are subtracted from changes."
    must_hold = table("Checks on the sensor side", "what | unit | found | limit", shown, note)
    parts: tuple[Part, ...] = error_plot(rows), settings_table(rows, sensor.problems), must_hold
    return Section((*missed, *sensor_findings(rows, sensor.problems)), not missed, parts)


def requirements(rows: Rows) -> Iterator[tuple[str, str, float, float]]:
    """What the package says of itself: what it is about, its unit, what was found, and its limit."""
    for setting, row in rows.items():
        if setting.engine == "drjit":
            yield (
                f"share of pixels that differ from NumPy's, {setting.name}",
                "1",
                row.pixels["share_of_numpy"],
                0.0,
            )
        if setting.tolerance_dn is None and setting.precision == "float32":
            yield (
                f"share of pixels that float32 changes, {setting.name}",
                "1",
                row.pixels["share_of_pixels"],
                MOST_PIXELS,
            )
            yield (
                f"largest change by float32, {setting.name}",
                "DN",
                row.pixels["largest_dn"],
                LARGEST_DN,
            )
        if setting.tolerance_dn is not None:
            beyond = np.abs(row.plan_change_dn) - SIGNIFICANT * row.plan_error_dn
            limit_dn = setting.tolerance_dn + LEAST_DN
            yield (
                f"change by the plan, {setting.name}",
                "DN",
                max(float(beyond.max()), 0.0),
                limit_dn,
            )


def recommended(rows: Rows, tolerance_dn: float) -> Row:
    """The fastest setting whose frames keep the tolerance; of those as fast as its upper quartile the nearest."""
    fit = [row for row in rows.values() if row.keeps(tolerance_dn)]
    fastest = min(fit, key=lambda row: row.ns.median)
    return min(
        (row for row in fit if row.ns.median <= fastest.ns.high), key=lambda row: row.worst_dn
    )


def sensor_findings(rows: Rows, problems: dict[str, str]) -> Iterator[str]:
    """Sentences, the most important first."""
    best = recommended(rows, USUAL_DN)
    yield (
        f"For frames within {USUAL_DN:g} DN take {best.setting.name}: {best.ns.median:.3g} ns/pixel, {best.faster:.3g} "
        f"times as fast as {REFERENCE.name}; mean and σ change by {best.worst_dn:.2g} DN at most."
    )
    plain = rows[FrameSetting("numpy", "float32")]
    for setting, row in rows.items():
        if setting.engine != "numpy" and setting.tolerance_dn is None:
            faster = ratio(plain.seconds, row.seconds)
            yield (
                f"The whole chain takes {row.ns.median:.3g} ns/pixel on {setting.engine} and {plain.ns.median:.3g} on "
                f"NumPy in float32 ({faster:.3g} times as fast); the first frame, with compiling, "
                f"{row.first_s:.2g} and {plain.first_s:.2g} s."
            )
    for engine, problem in problems.items():
        yield f"Not measured on this machine: engine {engine} ({problem.removesuffix('.')})."
    share, largest = plain.pixels["share_of_pixels"], plain.pixels["largest_dn"]
    yield (
        f"In float32 {share:.2%} of the pixels differ from a float64 frame of the same random numbers, by "
        f"{largest:g} DN at most."
    )


def error_plot(rows: Rows) -> Plot:
    """Every setting as a point; plans of one engine are one series."""
    series = defaultdict[str, list[tuple[float, float]]](list)
    for setting, row in rows.items():
        plans = ", plans"
        if setting.tolerance_dn is None:
            plans = ""
        series[f"{setting.engine} {setting.precision}{plans}"].append(
            (row.ns.median, row.worst_dn)
        )
    lines = [line(label, points, joined=False) for label, points in series.items()]
    note = "Each point is one setting's largest change in mean, temporal σ or spatial σ. Smaller changes, and the "
    note += f"reference, are drawn at {LEAST_DN:g} DN. Rings mark Pareto-optimal settings."
    title, y_label = (
        "Frame error versus run time",
        "change of mean, temporal σ or spatial σ [DN]",
    )
    return Plot(title, "run time [ns/pixel]", y_label, ringed(lines), note=note)


def settings_table(rows: Rows, problems: dict[str, str]) -> Table:
    """Times and errors of every setting."""
    points = [(row.ns.median, row.worst_dn) for row in rows.values()]
    front = set(pareto(points))
    shown: list[MarkedRow] = []
    for number, (setting, row) in enumerate(rows.items()):
        quartiles = f"{row.ns.low:.3g} … {row.ns.high:.3g}"
        if setting.tolerance_dn is None:
            saved = None
        else:
            saved = 100 * row.saved.median
        pixels = 100 * row.pixels["share_of_pixels"], row.pixels["largest_dn"]
        changes = [abs(float(change)) for change in row.change_dn]
        mark: Mark = "best" if number in front else ""
        shown.append(
            (
                mark,
                (
                    setting.name,
                    row.ns.median,
                    quartiles,
                    row.faster,
                    row.first_s,
                    saved,
                    *pixels,
                    *changes,
                ),
            )
        )
    absent = "; ".join(
        f"{engine}: not measured on this machine ({problem})"
        for engine, problem in problems.items()
    )
    changes_of = " | ".join(f"{name} changes by [DN]" for name in QUANTITIES)
    return table(
        "Settings of the sensor",
        f"setting | time [ns/pixel] | quartiles [ns/pixel] | times as fast as {REFERENCE.name} [1] | first frame [s] | "
        f"saved by the plan [%] | pixels that differ [%] | largest [DN] | {changes_of}",
        shown,
        f"Frames of {LARGE[0]} × {LARGE[1]} pixels under the scene's light, in turns. Pixels: one frame against "
        f"{REFERENCE.name}, with the same random numbers. Changes: averages over all pixels of {SENSORS} sensors "
        f"of {FRAMES} frames. Green: no other setting is both faster and nearer to the reference. {absent}",
    )
