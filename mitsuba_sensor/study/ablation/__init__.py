"""``study ablation``: each stage of the sensor and each feature of the render off in turn, beside the seconds saved."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path

from ...core import InputError, require, require_seed
from ...lab.statistics.estimators import as_normal, spread, z_limit
from ...render.passes.requirements import render_requirements
from ...render.passes.stop_criterion import stop_criterion_of
from ...render.variants import restores_variant
from ...sensor.gains import gain_dn_per_e
from ..frames import QUANTITIES, Replicas
from ..kit import Kit, Known, Step, Subject, Values
from ..page import Bars, Mark, MarkedRow, Part, Section, Study, Table, study_of, table
from .render import AOVS, APERTURE, ERROR_BARS, WHOLE_RENDERS, measures
from .sensor import CALL_S, DETECTION, KERNEL_S, LOOKED_AT, PLAN, SENSORS, SHAPE, WHOLE, SensorAblation, SensorResults

FEWEST_PASSES = 4  # two in each half, so that both have a standard error
LABELS = {PLAN: "all that the plan leaves out"}


@restores_variant
def ablation(
    kit: Kit, subject: Subject, *, tolerance_dn: float = 0.02, frames: int = 24, seed: int = 1, serial: int = 1
) -> Study:
    """What each stage and each feature does to the picture, in theory and in frames, and what it costs.

    kit : measures, and knows what is measured already.  tolerance_dn : of the plan [DN].
    frames : of each of the 64 sensors, at least 2.  seed, serial : of the first frame and the first sensor.
    Raises InputError.
    """
    require("tolerance_dn", tolerance_dn, 0.0, float("inf"), "digital numbers, e.g. 0.02")
    if require_seed("frames", frames) < 2:
        raise InputError(f"frames is {frames}; a sensor needs at least 2 frames to show its temporal noise (e.g. 16).")
    replicas = Replicas(SENSORS, frames, require_seed("seed", seed), require_seed("serial", serial))
    spp, camera, exposure = subject.options.get("spp", 32), subject.camera, subject.exposure
    criterion = stop_criterion_of({"spp": spp})
    if criterion.passes < FEWEST_PASSES:
        raise InputError(f"spp is {spp}; the study compares halves of the passes: ask for at least {FEWEST_PASSES}.")

    light = cache(lambda: subject.job.render(seed, criterion))
    ways = cache(lambda: measures(subject, criterion, seed))

    def scene() -> Values:
        here, missing = ways()
        columns, rows = subject.job.scene.view.crop_size
        return {"features": list(here), "missing": missing, "columns": columns, "rows": rows}

    def requirements() -> list[Values]:
        return [*map(asdict, render_requirements(light(), camera, exposure, gain_dn_per_e(camera), tolerance_dn))]

    found = kit.measure("loading the scene", 60.0, scene)
    pixels = found["columns"] * found["rows"]
    render_s = criterion.passes * (CALL_S + 4e-6 * pixels * criterion.samples)  # at first: 4 µs per path of 30 bands
    sensor = SensorAblation(kit, subject, light, tolerance_dn, replicas)
    steps = [Step("rendering the scene", KERNEL_S + render_s, requirements), *sensor.steps(pixels)]
    expected_s = dict.fromkeys(found["features"], KERNEL_S + 2 * render_s)  # AOVs and error bars are always among them
    expected_s |= {AOVS: 1.0, ERROR_BARS: KERNEL_S + 2 * (WHOLE_RENDERS + 1) * render_s}
    steps += (Step(f"render: {one}", s, partial(lambda name: ways()[0][name](), one)) for one, s in expected_s.items())
    kit.take(steps)
    changes = {name: kit[f"render: {name}"] for name in found["features"]}
    shown = render_section(changes, found["missing"], kit["rendering the scene"])
    sections = sensor_section(SensorResults(sensor), replicas, tolerance_dn), shown
    about = f"{found['columns']} × {found['rows']} pixels, {exposure.time_s:g} s, {exposure.temperature_k:g} K"
    return study_of("ablation", f"What {Path(subject.scene).stem} and {camera.name} can do without ({about})", sections)


def sensor_section(results: SensorResults, replicas: Replicas, tolerance_dn: float) -> Section:
    """What the sensor shows. passed : theory and frames agree, and the plan keeps to its tolerance."""
    keeps = results.theory["cases"][PLAN]["worst_dn"] <= 1.05 * tolerance_dn + 1e-9  # between the plan's levels
    parts: tuple[Part, ...] = _changes(results, replicas), _costs(results), *_sensor_bars(results, tolerance_dn)
    return Section(tuple(_sensor_findings(results, tolerance_dn)), results.agree and keeps, parts)


def _sensor_findings(results: SensorResults, tolerance_dn: float) -> Iterator[str]:
    """What the plan leaves out, saves and costs; whether theory and frames agree; what is needed and costs most."""
    cases, plan, far = results.theory["cases"], results.worst[PLAN], results.furthest
    times = []
    for engine in results.turns:
        low, median, high = results.saved(engine, PLAN, share=True)
        shown = f"{median:.0%} ({low:.0%} to {high:.0%}) of the sensor's time on {engine}"
        none = f"no time that shows on {engine} ({low:.0%} to {high:.0%})"
        times.append(none if low <= 0 <= high else shown)
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
        numbers = (x for one in compared for x in (one.predicted_dn, one.measured_dn, one.error_dn))
        rows.append((results.mark(compared), (LABELS.get(case, case), *numbers, max(abs(one.z) for one in compared))))
    changes = " | ".join(f"{one}, predicted [DN] | {one}, measured [DN] | {one}, ± [DN]" for one in QUANTITIES)
    return table(
        "What changes when a stage is left out",
        f"left out | {changes} | largest |z| [1]",
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
        rows.append((results.mark([one]), (LABELS.get(case, case), *measured, *pixels, *times, said.get(case, ""))))
    whole, detection = (spread(results.turns["numpy"][name]).median for name in (WHOLE, DETECTION))
    return table(
        "Worst pixels, seconds, and what the plan says",
        "left out | worst pixel, predicted [DN] | of | worst 1 %, predicted [DN] | measured [DN] | ± [DN] | z [1] | "
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
    both = {name: tuple(abs(getattr(one, f"{name}_dn")) for one in changes) for name in ("predicted", "measured")}
    error = {"measured": tuple(one.error_dn for one in changes)}
    level = (tolerance_dn, f"tolerance {tolerance_dn:g} DN") if tolerance_dn > 0 else None
    title, x_label = "Change in the worst 1 % of the pixels", "change of mean or σ [DN]"
    yield Bars(title, x_label, labels, both, error, log_x=True, level=level)
    if saved := [results.saved("numpy", case) for case in cases]:
        times, whiskers = tuple(one.median for one in saved), tuple(0.5 * (one.high - one.low) for one in saved)
        note, title = "Whiskers are half the distance of the quartiles.", "Time saved on NumPy"
        yield Bars(title, "saved [ns/pixel]", labels, {"saved": times}, {"saved": whiskers}, note=note)


def render_section(features: Known, missing: Known, said: Iterable[Known]) -> Section:
    """What the render shows, by feature; missing : what is not in this scene, and why.  said : the requirements."""
    plan = {one["what"]: one for one in said}
    rows = [_row(name, found, plan) for name, found in features.items()]
    scores = [abs(z) for row in rows for z in row["z"] if z is not None]
    limit = z_limit(len(scores))
    agree = max(scores, default=0.0) <= limit  # theory and renders, wherever theory says something
    findings = [*_render_findings(rows, plan)]
    if scores:
        told = "renders agree" if agree else f"renders do not agree (limit {limit:.2f})"
        findings.append(f"Where theory says what a render loses, {told}: largest |z| {max(scores):.2f}.")
    return Section(tuple(findings), agree, (_table(rows, missing, limit), *_render_bars(rows)))


def _row(name: str, found: Known, plan: Mapping[str, Known]) -> Values:
    """What was measured of a feature, and what follows from it: seconds of a render saved, z of mean and worst."""
    pairs = zip(found["seconds"], found["seconds_without"], strict=True)
    saved_s = float(found["passes"] * statistics.median(x - y for x, y in pairs))
    share = saved_s / float(found["passes"] * statistics.median(found["seconds"]))
    rms_dn, rms_error = found["rms_dn"] or 0.0, found["rms_error"] or 0.0
    changes = rms_dn > 2 * rms_error or abs(found["mean_dn"]) > 3 * found["mean_error"]  # as surely
    predicted, said = found["predicted"] or {}, ""
    z = [as_normal(predicted[one], found["passes"] - 1) if predicted else None for one in ("z_mean", "z_worst")]
    if name == ERROR_BARS:
        said = "kept: without them nobody knows how noisy the render is"
    elif name in plan and name in (APERTURE, AOVS):
        said = f"{'kept' if plan[name]['kept'] else 'left out'}: {plan[name]['reason']}"
    own = {"name": name, "saved_s": saved_s, "saved_share": share, "changes": changes, "z": z, "said": said}
    return {**found, **own, "predicted": predicted, "rms": f"{rms_dn:.2g} ± {rms_error:.2g} DN"}


def _render_findings(rows: Sequence[Known], plan: Mapping[str, Known]) -> Iterator[str]:
    if changing := [row for row in rows if row["changes"]]:
        most = max(changing, key=lambda row: float(row["rms_dn"] or 0.0))
        dear = most["saved_share"] > 0.05  # turns of one render differ by as much
        cost = f"for {most['saved_share']:.0%} of the seconds" if dear else "at no cost that shows"
        yield (
            f"Of the render, the picture depends most on what '{most['name']}' leaves out: {most['rms_dn']:.3g} ± "
            f"{most['rms_error']:.2g} DN rms, {cost}."
        )
    if free := [row for row in rows if not row["changes"] and row["name"] not in (AOVS, ERROR_BARS)]:
        best = max(free, key=lambda row: float(row["saved_share"]))
        yield (
            f"What '{best['name']}' changes cannot be told from noise in {best['passes']} passes (rms {best['rms']}), "
            f"and it saves {best['saved_share']:.0%} of the render's seconds."
        )
    yield from (f"Bands: {one['reason']} ({what} now)." for what, one in plan.items() if what.endswith(" bands"))


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
        "left out | mean, predicted [DN] | measured [DN] | ± [DN] | z [1] | worst 1 %, predicted [DN] | "
        "measured [DN] | ± [DN] | z [1] | rms [DN] | ± [DN] | saved [s] | saved [%] | what is said of it",
        lines,
        "Change of the mean signal in DN, cut at the full well; equal seeds, so that most of the noise is in both. ± "
        "is the standard error from pass to pass. The worst 1 % are the pixels that theory names, from these same "
        "passes and with their noise; where there is no theory, half of the passes name them and the others measure. "
        "rms is freed of the render's noise. Seconds are medians of interleaved passes, for all passes of a render."
        f"{absent and f' Not in this scene: {absent}.'}",
    )


def _render_bars(rows: Sequence[Known]) -> Iterator[Bars]:
    timed = [row for row in rows if row["name"] != AOVS]
    if shown := [row for row in rows if row["rms_dn"]]:
        rms, error = ({"measured": tuple(row[one] for row in shown)} for one in ("rms_dn", "rms_error"))
        labels, seconds = (tuple(row["name"] for row in some) for some in (shown, timed))
        yield Bars("Change of the picture", "rms over the pixels [DN]", labels, rms, error, log_x=True)
        saved = {"saved": tuple(row["saved_s"] for row in timed)}
        yield Bars("Time of a render saved", "saved [s]", seconds, saved)
