"""Findings, tables and bars of an ablation: what each stage and each feature of the render does, and its cost."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence

from ..frames import QUANTITIES, Replicas
from ..kit import spread
from ..page import Bars, Mark, MarkedRow, Part, Section, Table, table
from ..statistics import Known, Values, as_normal, z_limit
from .render import AOVS, APERTURE, ERROR_BARS
from .sensor import DETECTION, LOOKED_AT, PLAN, SHAPE, WHOLE, Comparison, SensorResults

LABELS = {PLAN: "all that the plan leaves out"}
SLACK = 1.05  # A plan looks at some light levels (sensor/plan.py): between them it may move a pixel by so much more
SHOWN = 0.05  # share of a render's seconds from which on a sentence speaks of them: turns of one differ by as much


def sensor_section(results: SensorResults, replicas: Replicas, tolerance_dn: float) -> Section:
    """What the sensor shows. passed : theory and frames agree, and the plan keeps to its tolerance."""
    keeps = results.theory["cases"][PLAN]["worst_dn"] <= SLACK * tolerance_dn + 1e-9
    parts: tuple[Part, ...] = _changes(results, replicas), _costs(results), *_sensor_bars(results, tolerance_dn)
    return Section(tuple(_sensor_findings(results, tolerance_dn)), results.agree and keeps, parts)


def _sensor_findings(results: SensorResults, tolerance_dn: float) -> Iterator[str]:
    """What the plan leaves out, saves and costs; whether theory and frames agree; what is needed and costs most."""
    cases, plan, far = results.theory["cases"], results.worst[PLAN], results.furthest
    times = []
    for engine in results.turns:
        share = results.saved(engine, PLAN, share=True)
        span = f"({share.low:.0%} to {share.high:.0%})"
        shown = f"{share.median:.0%} {span} of the sensor's time on {engine}"
        times.append(f"no time that shows on {engine} {span}" if share.low <= 0 <= share.high else shown)
    seen = f"{abs(plan.measured_dn):.2g} ± {plan.error_dn:.1g} DN measured over its worst 1 % of the pixels"
    if not results.looked[PLAN]["share_of_pixels"]:
        seen = f"{LOOKED_AT} frames are those of the whole chain, byte by byte"
    yield (
        f"The plan at {tolerance_dn:g} DN leaves out {len(results.left_out)} of {len(results.theory['plan'])} stages "
        f"({', '.join(results.left_out) or 'none'}), saves {' and '.join(times)}, and "
        f"moves no pixel's mean or σ by more than {cases[PLAN]['worst_dn']:.2g} DN (predicted; {seen})."
    )
    yield (
        f"Theory and frames {'agree' if results.agree else 'do not agree'} in {len(results.compared)} comparisons: the "
        f"largest |z| is {abs(far.z):.2f} ({far.quantity} without {far.case}), and by chance one above "
        f"{results.limit:.2f} is found in 1% of such studies."
        if results.compared
        else "No chain differs from the whole one, in theory or in frames."
    )
    stages = [case for case in cases if case not in (WHOLE, PLAN)]
    most = max(stages, key=lambda case: float(cases[case]["worst_dn"]))
    shares = {case: results.saved("numpy", case, share=True).median for case in stages}
    dear = max(shares, key=lambda case: shares[case])
    moved = f"the {cases[most]['of']} of a pixel moves by {cases[most]['worst_dn']:.3g} DN"
    yield f"Most depends on {most}: without it {moved}; most time goes into {dear}, {shares[dear]:.0%} on numpy."


def _changes(results: SensorResults, replicas: Replicas) -> Table:
    rows: list[MarkedRow] = []
    for case, compared in results.changes.items():
        numbers = [x for one in compared for x in (one.predicted_dn, one.measured_dn, one.error_dn)]
        rows.append((_mark(results, compared), (LABELS.get(case, case), *numbers, max(abs(one.z) for one in compared))))
    changes = " | ".join(f"{one}, predicted [DN] | {one}, measured | {one}, ±" for one in QUANTITIES)
    return table(
        "What changes when a stage is left out",
        f"left out | {changes} | largest |z|",
        rows,
        f"Averages over all pixels; of the whole chain the values, below it their changes. Predicted by the moments of "
        f"every pixel; measured on {replicas.frames} frames of each of {replicas.sensors} sensors, with equal random "
        "bits in all chains; ± is the standard error from sensor to sensor. Variances are compared, and divided by the "
        f"sum of the predicted σ. Known limits of the theory: {'; '.join(results.theory['limits'])}.",
    )


def _costs(results: SensorResults) -> Table:
    said = {one["stage"]: "kept" if one["kept"] else f"left out: {one['reason']}" for one in results.theory["plan"]}
    rows: list[MarkedRow] = []
    for case, one in results.worst.items():
        theory, looked = results.theory["cases"][case], results.looked[case]
        measured = theory["worst_dn"], theory["of"], abs(one.predicted_dn), abs(one.measured_dn), one.error_dn, one.z
        pixels = 100 * looked["share_of_pixels"], looked["largest_dn"]
        times = results.saved("numpy", case).median, 100 * results.saved("numpy", case, share=True).median
        rows.append((_mark(results, [one]), (LABELS.get(case, case), *measured, *pixels, *times, said.get(case, ""))))
    whole, detection = (spread(results.turns["numpy"][name]).median for name in (WHOLE, DETECTION))
    return table(
        "Worst pixels, seconds, and what the plan says",
        "left out | worst pixel, predicted [DN] | of | worst 1 %, predicted [DN] | measured | ± | z | "
        "pixels that differ [%] | by at most [DN] | saved [ns/pixel] | saved [%] | plan",
        rows,
        "The worst pixel is the one that theory moves most, in mean, temporal σ or spatial σ; measured are averages "
        f"over the worst 1 % of the pixels. Pixel by pixel, {LOOKED_AT} frames are compared with those of the whole "
        f"chain. Seconds are those of NumPy on {SHAPE['numpy'][0] * SHAPE['numpy'][1]} pixels, medians of interleaved "
        f"runs; the whole chain takes {whole:.4g} ns/pixel. Detecting the light takes {detection:.4g} ns/pixel more, "
        "once for all frames on a compiled engine.",
    )


def _sensor_bars(results: SensorResults, tolerance_dn: float) -> Iterator[Bars]:
    """Changes and seconds of the chains that are not the whole one."""
    cases = [case for case in results.worst if results.theory["cases"][case]["worst_dn"] > 0]
    changes, labels = [results.worst[case] for case in cases], tuple(LABELS.get(case, case) for case in cases)
    measured = tuple(abs(one.measured_dn) for one in changes)
    both = {"predicted": tuple(abs(one.predicted_dn) for one in changes), "measured": measured}
    error = {"measured": tuple(one.error_dn for one in changes)}
    level = (tolerance_dn, f"tolerance {tolerance_dn:g} DN") if tolerance_dn > 0 else None
    title, x_label = "Change in the worst 1 % of the pixels", "change of mean or σ [DN]"
    yield Bars(title, x_label, labels, both, error, log_x=True, level=level)
    if saved := [results.saved("numpy", case) for case in cases]:
        times, whiskers = tuple(one.median for one in saved), tuple(0.5 * (one.high - one.low) for one in saved)
        note, title = "Whiskers are half the distance of the quartiles.", "Time saved on NumPy"
        yield Bars(title, "saved [ns/pixel]", labels, {"saved": times}, {"saved": whiskers}, note=note)


def _mark(results: SensorResults, compared: Sequence[Comparison]) -> Mark:
    """Nothing changes; theory and frames disagree; they agree."""
    if all(one.error_dn == 0 for one in compared):
        return "dim"
    return "bad" if max(abs(one.z) for one in compared) > results.limit else "good"


def render_section(features: Known, missing: Known, said: Iterable[Known], tolerance_dn: float) -> Section:
    """What the render shows, by feature; passed : theory and renders agree wherever theory says something.

    missing : what is not in this scene, and why.  said : the requirements of the render.
    """
    plan = {one["what"]: one for one in said}
    rows = [_row(name, found, plan, tolerance_dn) for name, found in features.items()]
    scores = [abs(z) for row in rows for z in row["z"] if z is not None]
    limit = z_limit(len(scores))
    findings = tuple(_render_findings(rows, plan, scores))
    return Section(findings, max(scores, default=0.0) <= limit, (_table(rows, missing, limit), *_render_bars(rows)))


def _row(name: str, found: Known, plan: Mapping[str, Known], tolerance_dn: float) -> Values:
    """What was measured of a feature, and what follows from it: seconds of a render saved, z of mean and worst."""
    pairs = zip(found["seconds"], found["seconds_without"], strict=True)
    saved_s = float(found["passes"] * statistics.median(x - y for x, y in pairs))
    share = saved_s / float(found["passes"] * statistics.median(found["seconds"]))
    rms_dn, rms_error = found["rms_dn"] or 0.0, found["rms_error"] or 0.0
    changes = rms_dn > 2 * rms_error or abs(found["mean_dn"]) > 3 * found["mean_error"]  # as surely
    predicted, said = found["predicted"] or {}, ""
    z = [as_normal(predicted[one], found["passes"] - 1) if predicted else None for one in ("z_mean", "z_worst")]
    if predicted and name.endswith(("bands", "band")):
        enough = "would do" if predicted["pixel_dn"] <= tolerance_dn else "too few"
        said = f"{enough}: a pixel moves by up to {predicted['pixel_dn']:.3g} DN"
    if name == ERROR_BARS:
        said = "kept: without them nobody knows how noisy the render is"
    elif name in plan and name in (APERTURE, AOVS):
        said = f"{'kept' if plan[name]['kept'] else 'left out'}: {plan[name]['reason']}"
    own = {"name": name, "saved_s": saved_s, "saved_share": share, "changes": changes, "z": z, "said": said}
    return {**found, **own, "predicted": predicted, "rms": f"{rms_dn:.2g} ± {rms_error:.2g} DN"}


def _render_findings(rows: Sequence[Known], plan: Mapping[str, Known], scores: Sequence[float]) -> Iterator[str]:
    if changing := [row for row in rows if row["changes"]]:
        most = max(changing, key=lambda row: float(row["rms_dn"] or 0.0))
        dear = most["saved_share"] > SHOWN
        cost = f"for {most['saved_share']:.0%} of the seconds" if dear else "at no cost that shows"
        yield (
            f"Of the render, the picture depends most on what '{most['name']}' leaves out: {most['rms_dn']:.3g} ± "
            f"{most['rms_error']:.2g} DN rms, {cost}."
        )
    free = [row for row in rows if not row["changes"] and row["name"] not in (AOVS, ERROR_BARS)]
    if free:
        best = max(free, key=lambda row: float(row["saved_share"]))
        yield (
            f"What '{best['name']}' changes cannot be told from noise in {best['passes']} passes (rms {best['rms']}), "
            f"and it saves {best['saved_share']:.0%} of the render's seconds."
        )
    yield from (f"Bands: {one['reason']} ({what} now)." for what, one in plan.items() if what.endswith(" bands"))
    if noisy := [row for row in free if row["predicted"]]:  # the plan looks at one render, whose bands are noisy
        yield (
            f"With {noisy[-1]['name']} a pixel of this render moves by up to {noisy[-1]['predicted']['pixel_dn']:.3g} "
            f"DN, but that is the noise of its bands: freed of it, by {noisy[-1]['rms']} rms."
        )
    if scores:
        yield f"Where theory says what a render loses, renders agree: largest |z| {max(scores):.2f}."


def _table(rows: Sequence[Known], missing: Mapping[str, str], limit: float) -> Table:
    lines: list[MarkedRow] = []
    for row in rows:
        predicted, (z_mean, z_worst) = row["predicted"], row["z"]
        mean = predicted.get("mean_dn"), row["mean_dn"], row["mean_error"], z_mean
        worst = predicted.get("worst_dn"), row["worst_dn"], row["worst_error"], z_worst
        times = row["saved_s"], None if row["name"] == AOVS else 100 * row["saved_share"]
        mark: Mark = ("bad" if max(map(abs, row["z"])) > limit else "good") if predicted else ""
        lines.append((mark, (row["name"], *mean, *worst, row["rms_dn"], row["rms_error"], *times, row["said"])))
    absent = "; ".join(f"{name} ({why})" for name, why in missing.items())
    return table(
        "What changes when the render leaves something out",
        "left out | mean, predicted [DN] | measured | ± | z | worst 1 %, predicted [DN] | measured | ± | z | "
        "rms [DN] | ± | saved [s] | saved [%] | what is said of it",
        lines,
        "Change of the mean signal in DN, cut at the full well; equal seeds, so that most of the noise is in both. ± "
        "is the standard error from pass to pass. The worst 1 % are the pixels that theory names, from these same "
        "passes and with their noise; where there is no theory, half of the passes name them and the others measure. "
        "rms is freed of the render's noise. Seconds are medians of interleaved passes, for all passes of a render."
        f"{absent and f' Not in this scene: {absent}.'}",
    )


def _render_bars(rows: Sequence[Known]) -> Iterator[Bars]:
    shown, timed = [row for row in rows if row["rms_dn"]], [row for row in rows if row["name"] != AOVS]
    if shown:
        rms, error = ({"measured": tuple(row[one] for row in shown)} for one in ("rms_dn", "rms_error"))
        labels, title = tuple(row["name"] for row in shown), "Change of the picture"
        yield Bars(title, "rms over the pixels [DN]", labels, rms, error, log_x=True)
        labels, seconds = tuple(row["name"] for row in timed), {"saved": tuple(row["saved_s"] for row in timed)}
        yield Bars("Time of a render saved", "saved [s]", labels, seconds)
