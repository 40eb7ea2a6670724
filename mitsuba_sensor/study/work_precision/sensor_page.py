"""The sensor's part of the page: errors beside times, what must hold of them, and what to take for a tolerance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import starmap

import numpy as np

from ...lab.statistics.estimators import ratio
from .. import frames
from ..page import Mark, MarkedRow, Plot, Section, Table, line, ringed, table
from . import sensor as measured
from .sensor import LEAST_DN, SINGLE, Results
from .settings import GAUSSIAN, GENERATOR, OWN, QUANTILE, REFERENCE

USUAL_DN = 0.02  # the tolerance that the first finding is about, where it was tried
NANOSECONDS, FASTER = "time [ns/pixel]", f"times as fast as {REFERENCE.name}"
CHANGE = "change of mean, temporal σ or spatial σ [DN]"


def sensor_section(results: Results) -> Section:
    """Everything that was measured, in the order of reading."""
    every = list(results.requirements())
    off = [one for one in every if one[1] > one[2]]
    requirements = table(
        "What must hold on the sensor side",
        "what | unit | found | limit",
        (("bad" if one in off else "good", _with_unit(*one)) for one in every),
        "Limits of measured changes hold as many standard errors that chance fails one setting in a thousand.",
    )
    best = {dn: results.recommended(dn) for dn in results.plans}
    what_to_take = table(
        "What to take for a tolerance",
        f"tolerance [DN] | fastest that keeps it | {NANOSECONDS} | {FASTER} [1] | measured change [DN] | "
        "± standard error [DN]",
        (("", (dn, row.setting.name, row.ns.median, row.faster, *row.change.worst[:2])) for dn, row in best.items()),
        "The change is the largest of mean, temporal σ and spatial σ at any light level, from float64, whole chain.",
    )
    missed = [f"Not as it must be: {what} is {found:.3g}, the limit {limit:.3g}." for what, found, limit in off]
    parts = what_to_take, _error_against_time(results), _settings_table(results), *_plans_parts(results)
    return Section((*missed, *findings(results)), not off, (*parts, *_laws_parts(results), requirements))


def _with_unit(what: str, found: float, limit: float) -> tuple[str, str, float, float]:
    """A requirement with its unit, which stands at the end of its name if it has one, in a cell of its own."""
    name, _, unit = what.removesuffix("]").partition(" [")
    return name, unit or "1", found, limit


def findings(results: Results) -> Iterator[str]:
    """Sentences, the most important first."""
    yield _advice(results, USUAL_DN if USUAL_DN in results.plans else next(iter(results.plans)))
    plain, rounded, third = (results.rows[SINGLE._replace(sampler=one)] for one in (QUANTILE, GAUSSIAN, GENERATOR))
    for engine in frames.BACKENDS:  # the whole chain against NumPy in float32
        if row := results.rows.get(SINGLE._replace(engine=engine)):
            fast = f"{ratio(plain.turns_ns, row.turns_ns):.3g} times as fast as NumPy float32 ({plain.ns.median:.3g})"
            first = f"their first frames took {row.first_s:.2g} and {plain.first_s:.2g} s"
            yield f"The whole chain takes {row.ns.median:.3g} ns/pixel on {engine}, {fast}; {first}."
    for engine, problem in results.absent.items():
        yield f"The engine {engine} is not here: {problem}."
    mean = min(measured.MEANS, key=lambda mean: mean != 10)
    mine, theirs = (results.laws[one.setting.name][mean]["variation"] for one in (plain, rounded))
    yield (
        f"At a mean of {mean:g} the quantile law is off by {mine:.2g} (total variation), a rounded Gaussian by "
        f"{theirs:.2g}; in frames the Gaussian saves {plain.ns.median - rounded.ns.median:.3g} ns/pixel of "
        f"{plain.ns.median:.3g} (NumPy float32), and with NumPy's own generator they take {third.ns.median:.3g}."
    )
    off = f"{100 * plain.pixels['share_of_pixels']:.2g} % of the pixels are off"
    yield f"In float32 {off}, by up to {plain.pixels['largest_dn']:g} DN, from float64 with equal random bits."


def _advice(results: Results, dn: float) -> str:
    row = results.recommended(dn)
    start = f"For {dn:g} DN take {row.setting.name}: {row.ns.median:.3g} ns/pixel, {row.faster:.3g} {FASTER}"
    if row.setting.tolerance_dn is None:
        return f"{start}. No plan for this tolerance is measurably faster and as near."
    made, (value, error, _) = results.plans[row.setting.tolerance_dn], row.change.worst
    saved = f"saves {100 * row.saved.median:.0f} % of" if row.saved.low > 0 else "saves nothing measurable of"
    left = len(made["left_out"])
    return (
        f"{start}. It leaves out {left} of {left + len(made['stages'])} stages, which {saved} the whole chain's time; "
        f"mean, temporal σ and spatial σ change by at most {value:.2g} ± {error:.1g} DN."
    )


def _error_against_time(results: Results) -> Plot:
    """Every setting as a point; the plans of one engine and precision are one series."""
    kinds = defaultdict[str, list[tuple[float, float]]](list)
    for s, row in results.rows.items():
        label = f"{s.engine} {s.precision}" + ("" if s.sampler in OWN else f", {s.sampler}")
        kinds[label if s.tolerance_dn is None else f"{label}, plans"].append((row.ns.median, row.error_dn))
    lines = [line(label, points, joined=False) for label, points in kinds.items()]
    note = (
        "The largest change at any light level, or its standard error where that is larger, and at least "
        f"{LEAST_DN:g} DN, where the reference lies. Rings: nothing is both faster and nearer."
    )
    return Plot("Error of the frames against time", NANOSECONDS, CHANGE, ringed(lines), note=note)


def _settings_table(results: Results) -> Table:
    rows: list[MarkedRow] = []
    for one, row in results.rows.items():
        times = row.ns.median, f"{row.ns.low:.3g} … {row.ns.high:.3g}", row.faster, row.first_s
        share, plain = (100 * row.pixels[k] if row.pixels else None for k in ("share_of_pixels", "share_of_numpy"))
        steps = share, row.pixels.get("largest_dn"), row.pixels.get("rms_dn"), plain if one.compiled else None
        mark: Mark = "dim" if one.sampler not in OWN else "best" if one in results.front else ""
        rows.append((mark, (one.name, *times, *steps, *row.change.worst[:2], *row.theory.worst[:2])))
    none = (None,) * (len(rows[0][1]) - 1)
    rows += (("dim", (f"{engine}: not here ({problem})", *none)) for engine, problem in results.absent.items())
    return table(
        "Settings of the sensor",
        f"setting | {NANOSECONDS} | quartiles [ns/pixel] | {FASTER} [1] | first frame [s] | "
        "pixels that differ [%] | largest [DN] | rms [DN] | pixels that differ from NumPy float32 [%] | "
        "change of the moments [DN] | ± [DN] | distance from theory [DN] | ± [DN]",
        rows,
        f"Frames of {measured.LARGE[0]} × {measured.LARGE[1]} pixels under the scene's light, in turns, each in its "
        f"own order. Pixels: one frame against {REFERENCE.name}, with equal random bits; NumPy's generator has others. "
        f"Moments: largest change of mean, temporal σ and spatial σ over {measured.LEVELS} light levels, "
        f"{measured.REPLICAS.sensors} sensors; compiled engines show NumPy's, whose bytes they share but for the "
        "pixels named. Theory: moments of the same stages. The first frame holds light, maps and, if Dr.Jit had not "
        "compiled it before, the kernel. Grey: not offered, for comparison. Green: nothing is both faster and nearer.",
    )


def _plans_parts(results: Results) -> tuple[Plot, Table]:
    """What every tolerance buys, a line per engine; and what each plan leaves out, changes and saves."""
    lines = defaultdict[str, list[tuple[float, float]]](list)
    rows: list[MarkedRow] = []
    for s, row in results.rows.items():
        if s.tolerance_dn is not None:
            lines[s.engine].append((row.error_dn, row.ns.median))
            made = results.plans[s.tolerance_dn]
            what = s.tolerance_dn, f"{s.engine} {s.precision}", ", ".join(made["left_out"])
            predicted = made["worst_pixel_dn"], float(np.abs(made["predicted_dn"]).max())
            times = row.ns.median, 100 * row.saved.median, f"{100 * row.saved.low:.0f} … {100 * row.saved.high:.0f}"
            mark: Mark = "" if row.of_plan.within(s.tolerance_dn) else "bad"
            rows.append((mark, (*what, *predicted, *row.of_plan.worst, *times)))
    drawn, note = tuple(starmap(line, lines.items())), f"Plans for {', '.join(f'{dn:g}' for dn in results.plans)} DN."
    plot = Plot("What a tolerance buys", f"measured {CHANGE}", NANOSECONDS, drawn, log_y=False, note=note)
    return plot, table(
        "Plans",
        "tolerance [DN] | engine | left out | predicted, worst pixel [DN] | predicted, worst level [DN] | "
        f"measured, worst level [DN] | ± [DN] | of what | {NANOSECONDS} | time saved [%] | quartiles [%]",
        rows,
        "Change of mean, temporal σ and spatial σ, the largest of the three, from the whole chain in the same "
        f"precision. A level is one of {measured.LEVELS} equal groups of pixels.",
    )


def _laws_parts(results: Results) -> tuple[Plot, Table, Table]:
    """How far the samplers' laws are from Poisson's: total variation, drawn and in numbers, and the lowest moments."""
    every = {name: list(laws.values()) for name, laws in results.laws.items()}
    distinct = {name: laws for k, (name, laws) in enumerate(every.items()) if laws not in [*every.values()][:k]}
    headings = " | ".join(f"mean {mean:g} [1]" for mean in measured.MEANS)

    third = next(name for name in distinct if name.endswith(GENERATOR))
    drawn = [*((name, name, "variation") for name in distinct), ("as many exact draws, by chance", third, "resolution")]
    lines = tuple(
        line(label, [(mean, law[what]) for mean, law in results.laws[name].items()], dashed=name == third)
        for label, name, what in drawn
    )
    note = "Over all 2^32 random bits, by bisection; a generator that has a state by 2 million draws, whose distance "
    note += "from the law is then chance."
    title, y_label = "Distance of the drawn law from Poisson's", "total variation ½Σ|p − q| [1]"
    plot = Plot(title, "mean [events]", y_label, lines, note=note)
    values = {name: [law["variation"] for law in laws] for name, laws in every.items()}
    values["resolution"] = [law["resolution"] for law in every[REFERENCE.name]]
    variations = table(
        "Total variation from the Poisson law of each mean",
        f"sampler | {headings}",
        (("", (name, *laws)) for name, laws in values.items()),
        "Resolution: the counts that are drawn at all, over 2^32 random bits.",
    )
    of = "mean", "variance", "skewness"
    moments = table(
        "Relative errors of mean, variance and skewness of the drawn laws",
        f"sampler | of | {headings}",
        (("", (name, what, *(law[what] for law in laws))) for name, laws in distinct.items() for what in of),
        "Skewness is compared with λ^-½; a single value has none. Those of the generator are chance.",
    )
    return plot, variations, moments
