"""The sensor's part of the page: what to take for a tolerance, and tables and plots of error against time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..page import Line, Mark, Plot, Section, Table, table
from . import sensor as measured
from .samplers import GAUSSIAN, GENERATOR, QUANTILE, REFERENCE, SAMPLERS, Setting
from .sensor_results import LEAST_DN, Planned, Results, Row

USUAL_DN = 0.02  # the tolerance that the first finding is about, where it was tried
NANOSECONDS = "time [ns/pixel]"
CHANGE = "change of mean, temporal σ or spatial σ [DN]"
SINGLE = Setting("numpy", "float32", QUANTILE)


def sensor_section(results: Results) -> Section:
    """Everything that was measured, in the order of reading."""
    requirements = table(
        "What must hold on the sensor side",
        "what | found | limit",
        (("good" if one.held else "bad", (one.what, one.found, one.limit)) for one in results.requirements),
        "Limits of measured changes hold as many standard errors that chance fails one setting in a thousand.",
    )
    parts = (
        *(what_to_take(results), error_against_time(results), settings_table(results), plans_plot(results)),
        *(plans_table(results), laws_plot(results), variation_table(results), moments_table(results), requirements),
    )
    held = all(one.held for one in results.requirements)
    return Section(tuple(findings(results)), held, parts)


def findings(results: Results) -> Iterator[str]:
    """Sentences, the most important first."""
    for one in results.requirements:
        if not one.held:
            yield f"Not as it must be: {one.what} is {one.found:.3g}, the limit {one.limit:.3g}."
    if results.plans:
        yield _advice(
            results, next((plan for plan in results.plans if plan.tolerance_dn == USUAL_DN), results.plans[0])
        )
    yield from _engines(results)
    yield _samplers(results)
    pixels = results.row(SINGLE).pixels or {}
    share, largest_dn = 100 * pixels["share_of_pixels"], pixels["largest_dn"]
    yield (
        f"In float32 {share:.2g} % of the pixels are off, by up to {largest_dn:g} DN, from float64 with equal random "
        "bits."
    )


def _advice(results: Results, plan: Planned) -> str:
    row = results.recommended(plan)
    value, error, _ = row.change.worst
    start = (
        f"For {plan.tolerance_dn:g} DN take {row.setting.name}: {row.ns.median:.3g} ns/pixel, "
        f"{row.times_faster(results.reference):.3g} times as fast as {REFERENCE.name}"
    )
    if row.setting.tolerance_dn is None:
        return f"{start}. No plan for this tolerance is measurably faster and as near."
    made = next(one for one in results.plans if one.tolerance_dn == row.setting.tolerance_dn)
    saved = results.saved(row)
    time_saved = f"saves {100 * saved.median:.0f} % of" if saved.low > 0 else "saves nothing measurable of"
    return (
        f"{start}. It leaves out {len(made.left_out)} of {made.stages} stages, which {time_saved} the whole chain's "
        f"time; mean, temporal σ and spatial σ change by at most {value:.2g} ± {error:.1g} DN."
    )


def _engines(results: Results) -> Iterator[str]:
    """Every compiled engine against NumPy in float32."""
    twin = results.row(SINGLE)
    for row in results.rows:
        if row.setting.compiled and row.setting == replace(SINGLE, engine=row.setting.engine):
            yield (
                f"The whole chain takes {row.ns.median:.3g} ns/pixel on {row.setting.engine}, "
                f"{row.times_faster(twin):.3g} times as fast as NumPy float32 ({twin.ns.median:.3g}); their first "
                f"frames took {row.first_s:.2g} and {twin.first_s:.2g} s."
            )
    for engine, problem in results.absent.items():
        yield f"The engine {engine} is not here: {problem}."


def _samplers(results: Results) -> str:
    """What a rounded Gaussian would save, and what it would cost."""
    row, rounded, third = (results.row(replace(SINGLE, sampler=one)) for one in (QUANTILE, GAUSSIAN, GENERATOR))
    laws, theirs = results.laws[row.setting.name], results.laws[rounded.setting.name]
    mean = 10.0 if 10.0 in laws else next(iter(laws))
    return (
        f"At a mean of {mean:g} the quantile law is off by {laws[mean]['variation']:.2g} (total variation), a rounded "
        f"Gaussian by {theirs[mean]['variation']:.2g}; in frames the Gaussian saves "
        f"{row.ns.median - rounded.ns.median:.3g} ns/pixel of {row.ns.median:.3g} (NumPy float32), and with NumPy's "
        f"own generator they take {third.ns.median:.3g}."
    )


def what_to_take(results: Results) -> Table:
    """The recommendation for every tolerance."""
    rows: list[tuple[Mark, Sequence[Any]]] = []
    for plan in results.plans:
        row = results.recommended(plan)
        times = row.ns.median, row.times_faster(results.reference)
        rows.append(("", (plan.tolerance_dn, row.setting.name, *times, *row.change.worst[:2])))
    return table(
        "What to take for a tolerance",
        f"tolerance [DN] | fastest that keeps it | {NANOSECONDS} | times as fast as {REFERENCE.name} | "
        "measured change [DN] | ± standard error [DN]",
        rows,
        "The change is the largest of mean, temporal σ and spatial σ at any light level, from float64, whole chain.",
    )


def error_against_time(results: Results) -> Plot:
    """Every setting as a point; plans share a colour, and each sampler has its own."""
    kinds: dict[tuple[str, int], list[int]] = {}
    for i, row in enumerate(results.rows):
        s = row.setting
        label = f"{s.engine} {s.precision}" + ("" if s.offered else f", {s.sampler}")
        planned = s.tolerance_dn is not None
        kind = (f"{label}, plans", len(SAMPLERS)) if planned else (label, SAMPLERS.index(s.sampler))
        kinds.setdefault(kind, []).append(i)
    lines = []
    for (label, colour), members in kinds.items():
        rows = [results.rows[i] for i in members]
        x, y = tuple(row.ns.median for row in rows), tuple(row.error_dn for row in rows)
        ringed = tuple(k for k, i in enumerate(members) if i in results.front)
        lines.append(Line(label, x, y, joined=False, colour=colour, ringed=ringed))
    note = (
        "The largest change at any light level, or its standard error where that is larger, and at least "
        f"{LEAST_DN:g} DN, where the reference lies. Rings: nothing is both faster and nearer."
    )
    return Plot("Error of the frames against time", NANOSECONDS, CHANGE, tuple(lines), note=note)


def settings_table(results: Results) -> Table:
    """Every setting with all its numbers, and what is not here."""
    columns = (
        f"setting | {NANOSECONDS} | quartiles [ns/pixel] | times as fast as {REFERENCE.name} | first frame [s] | "
        "pixels that differ [%] | largest [DN] | rms [DN] | pixels that differ from NumPy float32 [%] | "
        "change of the moments [DN] | ± [DN] | distance from theory [DN] | ± [DN]"
    )
    rows: list[tuple[Mark, Sequence[Any]]] = []
    for i, row in enumerate(results.rows):
        best: Mark = "best" if i in results.front else ""
        rows.append((best if row.setting.offered else "dim", _settings_row(results, row)))
    for engine, problem in results.absent.items():
        rows.append(("dim", (f"{engine}: not here ({problem})", *(None,) * columns.count(" | "))))
    note = (
        f"Frames of {measured.LARGE[0]} × {measured.LARGE[1]} pixels under the scene's light, in turns, each in its "
        f"own order. Pixels: one frame against {REFERENCE.name}, with equal random bits; NumPy's generator has others. "
        f"Moments: largest change of mean, temporal σ and spatial σ over {measured.LEVELS} light levels, "
        f"{measured.REPLICAS.sensors} sensors; compiled engines show NumPy's, whose bytes they share but for the "
        "pixels named. Theory: moments of the same stages. The first frame holds light, maps and, if Dr.Jit had not "
        "compiled it before, the kernel. Grey: not offered, for comparison. Green: nothing is both faster and nearer."
    )
    return table("Settings of the sensor", columns, rows, note)


def _settings_row(results: Results, row: Row) -> tuple[Any, ...]:
    pixels = row.pixels or {}
    share, twin = pixels.get("share_of_pixels"), pixels.get("share_of_numpy")
    times = row.ns.median, f"{row.ns.low:.3g} … {row.ns.high:.3g}", row.times_faster(results.reference), row.first_s
    steps = None if share is None else 100 * share, pixels.get("largest_dn"), pixels.get("rms_dn")
    differ = 100 * twin if twin is not None and row.setting.compiled else None
    return (row.setting.name, *times, *steps, differ, *row.change.worst[:2], *row.theory.worst[:2])


def plans_plot(results: Results) -> Plot:
    """What every tolerance buys, a line per engine."""
    planned = [row for row in results.rows if row.setting.tolerance_dn is not None]
    lines = []
    for engine in dict.fromkeys(row.setting.engine for row in planned):
        rows = [row for row in planned if row.setting.engine == engine]
        lines.append(Line(engine, tuple(row.error_dn for row in rows), tuple(row.ns.median for row in rows)))
    note = f"Plans for {', '.join(f'{plan.tolerance_dn:g}' for plan in results.plans)} DN."
    return Plot("What a tolerance buys", f"measured {CHANGE}", NANOSECONDS, tuple(lines), log_y=False, note=note)


def plans_table(results: Results) -> Table:
    """Every plan: what it leaves out, what theory and frames say of it, what it saves."""
    rows: list[tuple[Mark, Sequence[Any]]] = []
    for plan in results.plans:
        for row in (row for row in results.rows if row.setting.tolerance_dn == plan.tolerance_dn):
            saved, name = results.saved(row), f"{row.setting.engine} {row.setting.precision}"
            predicted = plan.worst_pixel_dn, float(np.abs(plan.predicted).max())
            times = row.ns.median, 100 * saved.median, f"{100 * saved.low:.0f} … {100 * saved.high:.0f}"
            mark: Mark = "" if row.of_plan.within(plan.tolerance_dn) else "bad"
            left_out = ", ".join(plan.left_out)
            rows.append((mark, (plan.tolerance_dn, name, left_out, *predicted, *row.of_plan.worst, *times)))
    return table(
        "Plans",
        "tolerance [DN] | engine | left out | predicted, worst pixel [DN] | predicted, worst level [DN] | "
        f"measured, worst level [DN] | ± [DN] | of what | {NANOSECONDS} | time saved [%] | quartiles [%]",
        rows,
        "Change of mean, temporal σ and spatial σ, the largest of the three, from the whole chain in the same "
        f"precision. A level is one of {measured.LEVELS} equal groups of pixels.",
    )


Laws = Mapping[float, Mapping[str, Any]]


def distinct_laws(results: Results) -> list[tuple[str, Laws]]:
    """Laws by name, without those that are an earlier one once more: engines that share their bytes."""
    seen: list[tuple[str, Laws]] = []
    for name, laws in results.laws.items():
        if laws not in [one for _, one in seen]:
            seen.append((name, laws))
    return seen


def laws_plot(results: Results) -> Plot:
    """Total variation against the mean, a line per sampler."""
    lines = []
    for name, laws in distinct_laws(results):
        dashed, means = name.endswith(GENERATOR), tuple(laws)
        lines.append(Line(name, means, tuple(float(law["variation"]) for law in laws.values()), dashed=dashed))
        if dashed:
            chance = tuple(float(law["resolution"]) for law in laws.values())
            lines.append(Line("as many exact draws, by chance", means, chance, dashed=True))
    note = (
        "Over all 2^32 random bits, by bisection; a generator that has a state by 2 million draws, whose distance from "
        "the law is then chance."
    )
    title, x_label, y_label = "Distance of the drawn law from Poisson's", "mean [events]", "total variation ½Σ|p − q|"
    return Plot(title, x_label, y_label, tuple(lines), note=note)


def variation_table(results: Results) -> Table:
    """The same in numbers."""
    laws = {name: [law["variation"] for law in laws.values()] for name, laws in results.laws.items()}
    laws["resolution"] = [law["resolution"] for law in results.laws[REFERENCE.name].values()]
    return table(
        "Total variation from the Poisson law of each mean",
        f"sampler | {_means(results)}",
        (("", (name, *values)) for name, values in laws.items()),
        "Resolution: the counts that are drawn at all, over 2^32 random bits.",
    )


def moments_table(results: Results) -> Table:
    """Relative errors of mean, variance and skewness."""
    return table(
        "Relative errors of mean, variance and skewness of the drawn laws",
        f"sampler | of | {_means(results)}",
        (
            ("", (name, quantity, *(law[quantity] for law in laws.values())))
            for name, laws in distinct_laws(results)
            for quantity in ("mean", "variance", "skewness")
        ),
        "Skewness is compared with λ^-½; a single value has none. Those of the generator are chance.",
    )


def _means(results: Results) -> str:
    return " | ".join(f"mean {mean:g}" for mean in next(iter(results.laws.values())))
