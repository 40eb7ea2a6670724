"""The sensor's part of the page: sentences, tables and bars of what each stage is for and what it costs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ..page import Bars, Mark, Table
from ..side import Side
from ..timing import Spread
from .seconds import SHAPE
from .stages import DEVICES, LOOKED_AT, PLAN, WHOLE, Replicas
from .stages_results import FALSE_ALARM, Comparison, Results

SLACK = 1.05
"""A plan looks at some light levels of the scene (sensor/plan.py): between them it may move a pixel by so much more."""

CHANGES = (
    "left out",
    *(f"{name}, {what}" for name in ("mean", "temporal σ", "fixed σ") for what in ("predicted [DN]", "measured", "±")),
    "largest |z|",
)
COSTS = (
    "left out", "worst pixel, predicted [DN]", "of", "worst 1 %, predicted [DN]", "measured", "±", "z",
    "pixels that differ [%]", "by at most [DN]", "saved [ns/pixel]", "saved [%]", "plan",
)  # fmt: skip


def page(results: Results, replicas: Replicas, tolerance_dn: float) -> Side:
    """What the sensor shows. passed : theory and frames agree, and the plan keeps to its tolerance."""
    worst_dn = results.theory["cases"][PLAN]["worst_dn"]
    agree = not results.compared or abs(results.furthest.z) <= results.limit
    return Side(
        findings=(_plan_finding(results, tolerance_dn), _agreement(results, agree), _extremes(results)),
        passed=agree and worst_dn <= SLACK * tolerance_dn + 1e-9,
        parts=(_changes(results, replicas), _costs(results), *_bars(results, tolerance_dn)),
        data={"sensor": _data(results)},
    )


def _plan_finding(results: Results, tolerance_dn: float) -> str:
    """What the plan leaves out, saves and costs."""
    said, measured = results.theory["cases"][PLAN], results.worst[PLAN]
    times = [_time(engine, shares[PLAN]) for engine, shares in results.saved_share.items()]
    engines = " and ".join(times) or "time that was not measured"
    seen = f"{abs(measured.measured_dn):.2g} ± {measured.error_dn:.1g} DN measured over its worst 1 % of the pixels"
    if not results.looked[PLAN]["share_of_pixels"]:
        seen = f"{LOOKED_AT} frames are those of the whole chain, byte by byte"
    return (
        f"The plan at {tolerance_dn:g} DN leaves out {len(results.left_out)} of {len(results.theory['plan'])} stages "
        f"({', '.join(results.left_out) or 'none'}), saves {engines}, and moves no pixel's "
        f"mean or σ by more than {said['worst_dn']:.2g} DN (predicted; {seen})."
    )


def _time(engine: str, share: Spread) -> str:
    """What the turns tell of the sensor's time, with the quartiles."""
    span = f"({share.low:.0%} to {share.high:.0%})"
    if share.low <= 0 <= share.high:
        return f"no time that shows on {engine} {span}"
    return f"{share.median:.0%} {span} of the sensor's time on {engine}"


def _agreement(results: Results, agree: bool) -> str:
    """Whether theory and frames say the same."""
    if not results.compared:
        return "No chain differs from the whole one, in theory or in frames."
    far, count = results.furthest, len(results.compared)
    verb = "agree" if agree else "do not agree"
    return (
        f"Theory and frames {verb} in {count} comparisons: the largest |z| is {abs(far.z):.2f} ({far.quantity} without "
        f"{far.case}), and by chance one above {results.limit:.2f} is found in {FALSE_ALARM:.0%} of such studies."
    )


def _extremes(results: Results) -> str:
    """Which stage the picture needs most, and which costs most."""
    cases = {case: said for case, said in results.theory["cases"].items() if case not in (WHOLE, PLAN)}
    most = max(cases, key=lambda case: cases[case]["worst_dn"])
    said = cases[most]
    sentence = f"Most depends on {most}: without it the {said['of']} of a pixel moves by {said['worst_dn']:.3g} DN"
    saved = {engine: {case: one[case] for case in one if case in cases} for engine, one in results.saved_share.items()}
    if "numpy" not in saved:
        return sentence + "."
    dear = max(saved["numpy"], key=lambda case: saved["numpy"][case].median)
    return f"{sentence}; most time goes into {dear}, {saved['numpy'][dear].median:.0%} on numpy."


def _changes(results: Results, replicas: Replicas) -> Table:
    rows, marks = [], []
    for case, compared in results.changes.items():
        numbers = [x for one in compared for x in (one.predicted_dn, one.measured_dn, one.error_dn)]
        largest = max(abs(one.z) for one in compared)
        rows.append((case if case == WHOLE else _without(case), *numbers, largest))
        marks.append(_mark(results, largest, compared))
    note = (
        f"Averages over all pixels; of the whole chain the values, below it their changes. Predicted by the moments of "
        f"every pixel; measured on {replicas.frames} frames of each of {DEVICES} devices, with equal words in all "
        "chains; ± is the standard error from device to device. Variances are compared, and divided by the sum of the "
        f"predicted σ. Known limits of the theory: {'; '.join(results.theory['limits'])}."
    )
    return Table("What changes when a stage is left out", CHANGES, tuple(rows), tuple(marks), note)


def _costs(results: Results) -> Table:
    effects = {effect["stage"]: effect for effect in results.theory["plan"]}
    rows, marks = [], []
    for case, one in results.worst.items():
        said, looked = results.theory["cases"][case], results.looked[case]
        saved = [_median(by["numpy"], case) if by else None for by in (results.saved_ns, results.saved_share)]
        plan = "" if case == PLAN else _verdict(effects[case])
        rows.append((
            _without(case), said["worst_dn"], said["of"], abs(one.predicted_dn), abs(one.measured_dn), one.error_dn,
            one.z, 100 * looked["share_of_pixels"], looked["largest_dn"], saved[0],
            None if saved[1] is None else 100 * saved[1], plan,
        ))  # fmt: skip
        marks.append(_mark(results, abs(one.z), (one,)))
    note = (
        "The worst pixel is the one that theory moves most, in mean, temporal σ or fixed σ; measured are averages over "
        f"the worst 1 % of the pixels. Pixel by pixel, {LOOKED_AT} frames are compared with those of the whole chain. "
        f"Seconds are those of NumPy on {SHAPE['numpy'][0] * SHAPE['numpy'][1]} pixels, medians of interleaved runs"
        f"{_whole_ns(results)}."
    )
    return Table("Worst pixels, seconds, and what the plan says", COSTS, tuple(rows), tuple(marks), note)


def _whole_ns(results: Results) -> str:
    if results.detection_ns is None:
        return ""
    whole_ns, detection_ns = results.whole_ns["numpy"].median, results.detection_ns.median
    return (
        f"; the whole chain takes {whole_ns:.4g} ns/pixel. Detecting the light takes {detection_ns:.4g} ns/pixel more, "
        "once for all frames on a compiled engine"
    )


def _bars(results: Results, tolerance_dn: float) -> tuple[Bars, ...]:
    """Changes and seconds of the chains that are not the whole one."""
    cases = [case for case in results.worst if results.theory["cases"][case]["worst_dn"] > 0]
    changes = [results.worst[case] for case in cases]
    level = (tolerance_dn, f"tolerance {tolerance_dn:g} DN") if tolerance_dn > 0 else None
    sizes = Bars(
        "Change in the worst 1 % of the pixels", "change of mean or σ [DN]", tuple(map(_without, cases)),
        {"predicted": tuple(abs(one.predicted_dn) for one in changes),
         "measured": tuple(abs(one.measured_dn) for one in changes)},
        {"measured": tuple(one.error_dn for one in changes)}, log_x=True, level=level,
    )  # fmt: skip
    if "numpy" not in results.saved_ns:
        return (sizes,)
    saved = [results.saved_ns["numpy"][case] for case in cases]
    seconds = Bars(
        "Time saved on NumPy", "saved [ns/pixel]", tuple(map(_without, cases)),
        {"saved": tuple(one.median for one in saved)}, {"saved": tuple(0.5 * (one.high - one.low) for one in saved)},
        note="Whiskers are half the distance of the quartiles.",
    )  # fmt: skip
    return sizes, seconds


def _without(case: str) -> str:
    return "all that the plan leaves out" if case == PLAN else case


def _verdict(effect: dict[str, Any]) -> str:
    return "kept" if effect["kept"] else f"left out: {effect['reason']}"


def _mark(results: Results, largest: float, compared: tuple[Comparison, ...]) -> Mark:
    """Nothing changes; theory and frames disagree; they agree."""
    if all(one.error_dn == 0 for one in compared):
        return "dim"
    return "bad" if largest > results.limit else "good"


def _median(by_case: dict[str, Any], case: str) -> float | None:
    return by_case[case].median if case in by_case else None


def _data(results: Results) -> dict[str, Any]:
    """Every number, for JSON."""
    return {
        "theory": results.theory,
        "equal_words": results.looked,
        "comparisons": [asdict(one) for row in results.changes.values() for one in row],
        "worst": {case: asdict(one) for case, one in results.worst.items()},
        "z_limit": results.limit,
        "whole_ns_per_pixel": {engine: asdict(one) for engine, one in results.whole_ns.items()},
        "saved_ns_per_pixel": {e: {case: asdict(x) for case, x in by.items()} for e, by in results.saved_ns.items()},
        "saved_share": {e: {case: asdict(x) for case, x in by.items()} for e, by in results.saved_share.items()},
        "detection_ns_per_pixel": None if results.detection_ns is None else asdict(results.detection_ns),
        "false_alarm": FALSE_ALARM,
    }
