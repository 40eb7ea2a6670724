"""The sensor's part of the page: sentences, tables and bars of what each stage is for and what it costs."""

from __future__ import annotations

from collections.abc import Sequence

from ..frames import QUANTITIES, Replicas
from ..kit import Spread, spread
from ..page import Bars, Mark, MarkedRow, Part, Section, Table, table
from .sensor import DETECTION, LOOKED_AT, PLAN, SHAPE, WHOLE, Comparison, SensorResults

SLACK = 1.05
"""A plan looks at some light levels of the scene (sensor/plan.py): between them it may move a pixel by so much more."""


def sensor_section(results: SensorResults, replicas: Replicas, tolerance_dn: float) -> Section:
    """What the sensor shows. passed : theory and frames agree, and the plan keeps to its tolerance."""
    findings = _plan_finding(results, tolerance_dn), _agreement(results), _most(results)
    keeps = results.theory["cases"][PLAN]["worst_dn"] <= SLACK * tolerance_dn + 1e-9
    parts: tuple[Part, ...] = (_changes(results, replicas), _costs(results), *_bars(results, tolerance_dn))
    return Section(findings, results.agree and keeps, parts)


def _plan_finding(results: SensorResults, tolerance_dn: float) -> str:
    """What the plan leaves out, saves and costs."""
    said, measured = results.theory["cases"][PLAN], results.worst[PLAN]
    shares = {engine: results.saved(engine, PLAN, share=True) for engine in results.turns}
    engines = " and ".join(_time(engine, share) for engine, share in shares.items() if share is not None)
    seen = f"{abs(measured.measured_dn):.2g} ± {measured.error_dn:.1g} DN measured over its worst 1 % of the pixels"
    if not results.looked[PLAN]["share_of_pixels"]:
        seen = f"{LOOKED_AT} frames are those of the whole chain, byte by byte"
    return (
        f"The plan at {tolerance_dn:g} DN leaves out {len(results.left_out)} of {len(results.theory['plan'])} stages "
        f"({', '.join(results.left_out) or 'none'}), saves {engines or 'time that was not measured'}, and moves no "
        f"pixel's mean or σ by more than {said['worst_dn']:.2g} DN (predicted; {seen})."
    )


def _time(engine: str, share: Spread) -> str:
    """What the turns tell of the sensor's time, with the quartiles."""
    span = f"({share.low:.0%} to {share.high:.0%})"
    if share.low <= 0 <= share.high:
        return f"no time that shows on {engine} {span}"
    return f"{share.median:.0%} {span} of the sensor's time on {engine}"


def _agreement(results: SensorResults) -> str:
    """Whether theory and frames say the same."""
    if not results.compared:
        return "No chain differs from the whole one, in theory or in frames."
    far, verb = results.furthest, "agree" if results.agree else "do not agree"
    return (
        f"Theory and frames {verb} in {len(results.compared)} comparisons: the largest |z| is {abs(far.z):.2f} "
        f"({far.quantity} without {far.case}), and by chance one above {results.limit:.2f} is found in 1% of such "
        "studies."
    )


def _most(results: SensorResults) -> str:
    """Which stage the picture needs most, and which costs most."""
    cases = {case: said for case, said in results.theory["cases"].items() if case not in (WHOLE, PLAN)}
    most = max(cases, key=lambda case: cases[case]["worst_dn"])
    said = cases[most]
    sentence = f"Most depends on {most}: without it the {said['of']} of a pixel moves by {said['worst_dn']:.3g} DN"
    shares = {case: one.median for case in cases if (one := results.saved("numpy", case, share=True)) is not None}
    if not shares:
        return sentence + "."
    dear = max(shares, key=lambda case: shares[case])
    return f"{sentence}; most time goes into {dear}, {shares[dear]:.0%} on numpy."


def _changes(results: SensorResults, replicas: Replicas) -> Table:
    rows = []
    for case, compared in results.changes.items():
        numbers = [x for one in compared for x in (one.predicted_dn, one.measured_dn, one.error_dn)]
        largest = max(abs(one.z) for one in compared)
        rows.append((_mark(results, compared), (_without(case), *numbers, largest)))
    return table(
        "What changes when a stage is left out",
        f"left out | {' | '.join(f'{one}, predicted [DN] | {one}, measured | {one}, ±' for one in QUANTITIES)} | "
        "largest |z|",
        rows,
        f"Averages over all pixels; of the whole chain the values, below it their changes. Predicted by the moments of "
        f"every pixel; measured on {replicas.frames} frames of each of {replicas.sensors} sensors, with equal random "
        "bits in all chains; ± is the standard error from sensor to sensor. Variances are compared, and divided by the "
        f"sum of the predicted σ. Known limits of the theory: {'; '.join(results.theory['limits'])}.",
    )


def _costs(results: SensorResults) -> Table:
    effects = {effect["stage"]: effect for effect in results.theory["plan"]}
    rows: list[MarkedRow] = []
    for case, one in results.worst.items():
        said, looked = results.theory["cases"][case], results.looked[case]
        saved, share = results.saved("numpy", case), results.saved("numpy", case, share=True)
        kept = {True: "kept", False: f"left out: {effects[case]['reason']}"} if case != PLAN else {}
        times = (None, None) if saved is None or share is None else (saved.median, 100 * share.median)
        measured = abs(one.predicted_dn), abs(one.measured_dn), one.error_dn, one.z
        pixels = 100 * looked["share_of_pixels"], looked["largest_dn"]
        plan = kept[effects[case]["kept"]] if kept else ""
        rows.append(
            (_mark(results, [one]), (_without(case), said["worst_dn"], said["of"], *measured, *pixels, *times, plan))
        )
    return table(
        "Worst pixels, seconds, and what the plan says",
        "left out | worst pixel, predicted [DN] | of | worst 1 %, predicted [DN] | measured | ± | z | "
        "pixels that differ [%] | by at most [DN] | saved [ns/pixel] | saved [%] | plan",
        rows,
        "The worst pixel is the one that theory moves most, in mean, temporal σ or spatial σ; measured are averages "
        f"over the worst 1 % of the pixels. Pixel by pixel, {LOOKED_AT} frames are compared with those of the whole "
        f"chain. Seconds are those of NumPy on {SHAPE['numpy'][0] * SHAPE['numpy'][1]} pixels, medians of interleaved "
        f"runs{_whole_ns(results)}.",
    )


def _whole_ns(results: SensorResults) -> str:
    if "numpy" not in results.turns:
        return ""
    whole, detection = (spread(results.turns["numpy"][name]).median for name in (WHOLE, DETECTION))
    return (
        f"; the whole chain takes {whole:.4g} ns/pixel. Detecting the light takes {detection:.4g} ns/pixel more, once "
        "for all frames on a compiled engine"
    )


def _bars(results: SensorResults, tolerance_dn: float) -> tuple[Bars, ...]:
    """Changes and seconds of the chains that are not the whole one."""
    cases = [case for case in results.worst if results.theory["cases"][case]["worst_dn"] > 0]
    changes, labels = [results.worst[case] for case in cases], tuple(map(_without, cases))
    both = {"predicted": tuple(abs(one.predicted_dn) for one in changes)}
    both["measured"] = tuple(abs(one.measured_dn) for one in changes)
    title, x_label = "Change in the worst 1 % of the pixels", "change of mean or σ [DN]"
    error = {"measured": tuple(one.error_dn for one in changes)}
    level = (tolerance_dn, f"tolerance {tolerance_dn:g} DN") if tolerance_dn > 0 else None
    sizes = Bars(title, x_label, labels, both, error, log_x=True, level=level)
    saved = [one for case in cases if (one := results.saved("numpy", case)) is not None]
    if not saved:
        return (sizes,)
    times, whiskers = tuple(one.median for one in saved), tuple(0.5 * (one.high - one.low) for one in saved)
    note, title = "Whiskers are half the distance of the quartiles.", "Time saved on NumPy"
    return sizes, Bars(title, "saved [ns/pixel]", labels, {"saved": times}, {"saved": whiskers}, note=note)


def _without(case: str) -> str:
    return "all that the plan leaves out" if case == PLAN else case


def _mark(results: SensorResults, compared: Sequence[Comparison]) -> Mark:
    """Nothing changes; theory and frames disagree; they agree."""
    if all(one.error_dn == 0 for one in compared):
        return "dim"
    return "bad" if max(abs(one.z) for one in compared) > results.limit else "good"
