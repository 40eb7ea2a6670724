"""The sensor side for people: what to take, and tables and plots of error against time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ..page import Line, Mark, Plot, Table
from ..side import Side
from .frames import DEVICES, LARGE, LEVELS, REFERENCE
from .results import LEAST_DN, Planned, Promise, Results, Row, promises
from .samplers import GAUSSIAN, GENERATOR, QUANTILE, SAMPLERS, Setting

USUAL_DN = 0.02
"""The tolerance that the headline is about, where it was tried."""

NANOSECONDS = "time [ns/pixel]"
CHANGE = "change of mean, temporal σ or fixed σ [DN]"


def page(results: Results, done: Mapping[str, Any]) -> Side:
    """Everything that was measured, in the order of reading."""
    kept = tuple(promises(results))
    parts = (
        what_to_take(results), error_against_time(results), settings_table(results), plans_plot(results),
        plans_table(results), laws_plot(results), variation_table(results), moments_table(results),
        promises_table(kept),
    )  # fmt: skip
    return Side(tuple(findings(results, kept)), all(one.held for one in kept), parts, numbers(results, kept, done))


def findings(results: Results, kept: Sequence[Promise]) -> Iterator[str]:
    """Sentences, the most important first."""
    for one in kept:
        if not one.held:
            yield f"Not as it must be: {one.words} is {one.found:.3g}, the limit {one.limit:.3g}."
    if results.plans:
        usual = next((plan for plan in results.plans if plan.tolerance_dn == USUAL_DN), results.plans[0])
        yield _advice(results, usual)
    yield from _engines(results)
    yield from _samplers(results)
    pixels = results.row(Setting("numpy", "float32", QUANTILE)).pixels or {}
    share, largest_dn = 100 * pixels["share_of_pixels"], pixels["largest_dn"]
    yield f"In float32 {share:.2g} % of the pixels are off, by up to {largest_dn:g} DN, from float64 with equal words."


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
        f"time; mean, temporal σ and fixed σ change by at most {value:.2g} ± {error:.1g} DN."
    )


def _engines(results: Results) -> Iterator[str]:
    """Every compiled engine against NumPy in float32."""
    twin = results.row(Setting("numpy", "float32", QUANTILE))
    for row in results.rows:
        if row.setting.compiled and row.setting == replace(twin.setting, engine=row.setting.engine):
            yield (
                f"The whole chain takes {row.ns.median:.3g} ns/pixel on {row.setting.engine}, "
                f"{row.times_faster(twin):.3g} times as fast as NumPy float32 ({twin.ns.median:.3g}); their first "
                f"frames took {row.first_s:.2g} and {twin.first_s:.2g} s."
            )
    for engine, problem in results.absent.items():
        yield f"The engine {engine} is not here: {problem}."


def _samplers(results: Results) -> Iterator[str]:
    """What a rounded Gaussian would save, and what it would cost."""
    row, rounded = (results.row(Setting("numpy", "float32", sampler)) for sampler in (QUANTILE, GAUSSIAN))
    laws, theirs = results.laws[row.setting.name], results.laws[rounded.setting.name]
    mean = 10.0 if 10.0 in laws else next(iter(laws))
    third = results.row(Setting("numpy", "float32", GENERATOR))
    yield (
        f"At a mean of {mean:g} the quantile law is off by {laws[mean]['variation']:.2g} (total variation), a rounded "
        f"Gaussian by {theirs[mean]['variation']:.2g}; in frames the Gaussian saves "
        f"{row.ns.median - rounded.ns.median:.3g} ns/pixel of {row.ns.median:.3g} (NumPy float32), and with NumPy's "
        f"own generator they take {third.ns.median:.3g}."
    )


def what_to_take(results: Results) -> Table:
    """The recommendation for every tolerance."""
    rows = []
    for plan in results.plans:
        row = results.recommended(plan)
        value, error, _ = row.change.worst
        rows.append(
            (plan.tolerance_dn, row.setting.name, row.ns.median, row.times_faster(results.reference), value, error)
        )
    return Table(
        "What to take for a tolerance",
        (
            "tolerance [DN]",
            "fastest that keeps it",
            NANOSECONDS,
            f"times as fast as {REFERENCE.name}",
            "measured change [DN]",
            "± standard error [DN]",
        ),
        tuple(rows),
        note="The change is the largest of mean, temporal σ and fixed σ at any light level, from float64, whole chain.",
    )


def _kinds(results: Results) -> Iterator[tuple[str, int, list[int]]]:
    """Rows that belong together, with a label and the number of a colour: plans share one, and each sampler has its."""
    kinds: dict[tuple[str, int], list[int]] = {}
    for i, row in enumerate(results.rows):
        s = row.setting
        label = f"{s.engine} {s.precision}" + ("" if s.offered else f", {s.sampler}")
        if s.tolerance_dn is None:
            kinds.setdefault((label, SAMPLERS.index(s.sampler)), []).append(i)
        else:
            kinds.setdefault((f"{label}, plans", len(SAMPLERS)), []).append(i)
    for (label, colour), members in kinds.items():
        yield label, colour, members


def error_against_time(results: Results) -> Plot:
    """Every setting as a point."""
    lines = []
    for label, colour, members in _kinds(results):
        rows = [results.rows[i] for i in members]
        x, y = tuple(row.ns.median for row in rows), tuple(row.error_dn for row in rows)
        ringed = tuple(k for k, i in enumerate(members) if i in results.front)
        lines.append(Line(label, x, y, joined=False, colour=colour, ringed=ringed))
    return Plot(
        "Error of the frames against time", NANOSECONDS, CHANGE, tuple(lines),
        note="The largest change at any light level, or its standard error where that is larger, and at least "
        f"{LEAST_DN:g} DN, where the reference lies. Rings: nothing is both faster and nearer.",
    )  # fmt: skip


def settings_table(results: Results) -> Table:
    """Every setting with all its numbers, and what is not here."""
    rows, marks = [], []
    for i, row in enumerate(results.rows):
        rows.append(_settings_row(results, row))
        marks.append(_mark(i in results.front, row.setting.offered))
    for engine, problem in results.absent.items():
        rows.append((f"{engine}: not here ({problem})", *(None,) * (len(rows[0]) - 1)))
        marks.append("dim")
    return Table(
        "Settings of the sensor",
        (
            "setting", NANOSECONDS, "quartiles [ns/pixel]", f"times as fast as {REFERENCE.name}", "first frame [s]",
            "pixels that differ [%]", "largest [DN]", "rms [DN]", "pixels that differ from NumPy float32 [%]",
            "change of the moments [DN]", "± [DN]", "distance from theory [DN]", "± [DN]",
        ),
        tuple(rows), tuple(marks),
        note=f"Frames of {LARGE[0]} × {LARGE[1]} pixels under the scene's light, in turns, each in its own order. "
        f"Pixels: one frame against {REFERENCE.name}, with equal words; NumPy's generator has none. Moments: largest "
        f"change of mean, temporal σ and fixed σ over {LEVELS} light levels, {DEVICES} devices; compiled engines show "
        "NumPy's, whose bytes they share but for the pixels named. Theory: moments() of the same stages. The first "
        "frame holds light, maps and, if Dr.Jit had not compiled it before, the kernel. Grey: not offered, for "
        "comparison. Green: nothing is both faster and nearer.",
    )  # fmt: skip


def _settings_row(results: Results, row: Row) -> tuple[Any, ...]:
    pixels = row.pixels or {}
    share, twin = pixels.get("share_of_pixels"), pixels.get("share_of_numpy")
    return (
        row.setting.name, row.ns.median, f"{row.ns.low:.3g} … {row.ns.high:.3g}",
        row.times_faster(results.reference), row.first_s,
        None if share is None else 100 * share, pixels.get("largest_dn"), pixels.get("rms_dn"),
        100 * twin if twin is not None and row.setting.compiled else None,
        *row.change.worst[:2], *row.theory.worst[:2],
    )  # fmt: skip


def _mark(on_front: bool, offered: bool) -> Mark:
    if not offered:
        return "dim"
    return "best" if on_front else ""


def plans_plot(results: Results) -> Plot:
    """What every tolerance buys, a line per engine."""
    engines = dict.fromkeys(row.setting.engine for row in results.rows if row.setting.tolerance_dn is not None)
    lines = []
    for engine in engines:
        rows = [row for row in results.rows if row.setting.engine == engine and row.setting.tolerance_dn is not None]
        x = tuple(row.error_dn for row in rows)
        lines.append(Line(engine, x, tuple(row.ns.median for row in rows)))
    return Plot(
        "What a tolerance buys", f"measured {CHANGE}", NANOSECONDS, tuple(lines), log_y=False,
        note="Plans for " + ", ".join(f"{plan.tolerance_dn:g}" for plan in results.plans) + " DN.",
    )  # fmt: skip


def plans_table(results: Results) -> Table:
    """Every plan: what it leaves out, what theory and frames say of it, what it saves."""
    rows: list[tuple[Any, ...]] = []
    marks: list[Mark] = []
    for plan in results.plans:
        for row in results.rows:
            if row.setting.tolerance_dn == plan.tolerance_dn:
                saved = results.saved(row)
                value, error, where = row.of_plan.worst
                rows.append((
                    plan.tolerance_dn, f"{row.setting.engine} {row.setting.precision}", ", ".join(plan.left_out),
                    plan.worst_pixel_dn, float(np.abs(plan.predicted).max()), value, error, where, row.ns.median,
                    100 * saved.median, f"{100 * saved.low:.0f} … {100 * saved.high:.0f}",
                ))  # fmt: skip
                marks.append("" if row.of_plan.within(plan.tolerance_dn) else "bad")
    return Table(
        "Plans",
        (
            "tolerance [DN]", "engine", "left out", "predicted, worst pixel [DN]", "predicted, worst level [DN]",
            "measured, worst level [DN]", "± [DN]", "of what", NANOSECONDS, "time saved [%]",
            "quartiles [%]",
        ),
        tuple(rows), tuple(marks),
        note="Change of mean, temporal σ and fixed σ, the largest of the three, from the whole chain in the same "
        f"precision. A level is one of {LEVELS} equal groups of pixels.",
    )  # fmt: skip


def laws_plot(results: Results) -> Plot:
    """Total variation against the mean, a line per sampler; of engines that share their bytes only one."""
    lines = []
    for name, laws in _distinct(results):
        dashed = name.endswith(GENERATOR)
        values = tuple(float(law["variation"]) for law in laws.values())
        lines.append(Line(name, tuple(laws), values, dashed=dashed))
        if dashed:
            chance = tuple(float(law["resolution"]) for law in laws.values())
            lines.append(Line("as many exact draws, by chance", tuple(laws), chance, dashed=True))
    return Plot(
        "Distance of the drawn law from Poisson's", "mean [events]", "total variation ½Σ|p − q|", tuple(lines),
        note="Over all 2^32 words, by bisection; a generator without words by 2 million draws, whose distance from the "
        "law is then chance.",
    )  # fmt: skip


def _distinct(results: Results) -> Iterator[tuple[str, Mapping[float, Mapping[str, Any]]]]:
    """Laws by name, without those that are an earlier one once more."""
    seen: list[Any] = []
    for name, laws in results.laws.items():
        if laws not in seen:
            seen.append(laws)
            yield name, laws


def variation_table(results: Results) -> Table:
    """The same in numbers."""
    means = list(next(iter(results.laws.values())))
    rows = [(name, *(laws[mean]["variation"] for mean in means)) for name, laws in results.laws.items()]
    rows.append(("resolution", *(results.laws[REFERENCE.name][mean]["resolution"] for mean in means)))
    return Table(
        "Total variation from the Poisson law of each mean", ("sampler", *(f"mean {mean:g}" for mean in means)),
        tuple(rows), note="Resolution: the counts that are drawn at all, over 2^32 words.",
    )  # fmt: skip


def moments_table(results: Results) -> Table:
    """Relative errors of mean, variance and skewness."""
    rows = []
    for name, laws in _distinct(results):
        for quantity in ("mean", "variance", "skewness"):
            rows.append((name, quantity, *(law[quantity] for law in laws.values())))
    means = list(next(iter(results.laws.values())))
    return Table(
        "Relative errors of mean, variance and skewness of the drawn laws",
        ("sampler", "of", *(f"mean {mean:g}" for mean in means)), tuple(rows),
        note="Skewness is compared with λ^-½; a single value has none. Those of the generator are chance.",
    )  # fmt: skip


def promises_table(kept: Sequence[Promise]) -> Table:
    """What must hold, and whether it does."""
    return Table(
        "What must hold on the sensor side", ("what", "found", "limit"),
        tuple((one.words, one.found, one.limit) for one in kept),
        tuple("good" if one.held else "bad" for one in kept),
        note="Limits of measured changes hold as many standard errors that chance fails one setting in a thousand.",
    )  # fmt: skip


def numbers(results: Results, kept: Sequence[Promise], done: Mapping[str, Any]) -> dict[str, Any]:
    """Every measured number, ready for JSON."""
    recommended = {f"{plan.tolerance_dn:g}": results.recommended(plan).setting.name for plan in results.plans}
    found = {
        "pixels": LARGE[0] * LARGE[1],
        "settings": [_numbers_of(results, row, i in results.front) for i, row in enumerate(results.rows)],
        "plans": [asdict(plan) | {"predicted": plan.predicted.tolist()} for plan in results.plans],
        "laws": {name: {f"{mean:g}": dict(law) for mean, law in laws.items()} for name, laws in results.laws.items()},
        "not_here": results.absent,
        "recommended": recommended,
        "promises": [asdict(one) for one in kept],
        "measured": {key: value for key, value in done.items() if key.startswith("sensor/")},
    }
    return {"sensor": found}


def _numbers_of(results: Results, row: Row, on_front: bool) -> dict[str, Any]:
    return {
        "setting": row.setting.name, **asdict(row.setting), "ns_per_pixel": asdict(row.ns), "first_s": row.first_s,
        "times_faster": row.times_faster(results.reference), "pixels": None if row.pixels is None else dict(row.pixels),
        "change_dn": row.change.value_dn.tolist(), "change_error_dn": row.change.error_dn.tolist(),
        "of_plan_dn": row.of_plan.value_dn.tolist(), "of_plan_error_dn": row.of_plan.error_dn.tolist(),
        "theory_dn": row.theory.value_dn.tolist(), "theory_error_dn": row.theory.error_dn.tolist(),
        "front": on_front,
    }  # fmt: skip
