"""``study ablation``: the effect and the cost of each noise source and each render feature."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import mitsuba_sensor as ms

from ..lab.quantity import student_interval
from ..lab.statistics.estimators import Spread, spread, standard_error
from ..pages.page import Dots, Mark, MarkedRow, Section, Study, study_of, table
from .kit import (
    QUANTITIES,
    Array,
    Options,
    Progress,
    Subject,
    change_of_moments,
    measured,
    moments,
    time_in_turns,
)

WHOLE, PLAN = "whole chain", "the plan"
SENSORS, TURNS, PAIRS = 8, 9, 4
"""Compared sensor units, turns of times, and pairs of renders with and without each feature."""
SIGNIFICANT = 3.0
"""Standard errors above which a change is significant."""
LENS: dict[str, tuple[str, ...]] = {
    "no lens distortion": ("distortion", "distortion_percent", "distortion_heights_mm"),
    "no lens transmission curve": ("transmission_curve", "transmission_wavelengths_nm"),
    "no lens prescription": ("prescription",),
}
"""Features of a lens, and the fields that their removal unsets."""
NO_FALL_OFF = {
    "lens.relative_illumination": (1.0, 1.0),
    "lens.relative_illumination_heights_mm": (0.0, 1e6),
}


class Case(NamedTuple):
    """Frames without one noise source, compared with the whole chain with the same random numbers.

    intervals : (change, low, high) of mean, temporal σ and spatial σ, 95 % over the sensor units [DN].
    beyond : excess of the largest change over 3 standard errors [DN].  moved : fraction of the codes that differ.
    """

    intervals: list[tuple[float, float, float]]
    beyond: float
    moved: float

    @property
    def largest(self) -> int:
        """Index of the quantity that changes most."""
        return int(np.abs([change for change, *_ in self.intervals]).argmax())


def ablation(
    subject: Subject,
    progress: Progress,
    *,
    tolerance_dn: float = 0.02,
    frames: int = 8,
    seed: int = 1,
    serial: int = 1,
) -> Study:
    """Measure the changes without each noise source, with the plan, and without each render feature.

    tolerance_dn : of the plan [DN].  frames : of each of 8 sensor units, at least 2.
    seed, serial : of the first frame and the first sensor unit.
    """
    spp, exposure = subject.options.get("spp", 32), subject.exposure
    progress("light", 0.0)
    light = subject.render(seed, spp=spp, denoise=False)
    photons = subject.photons(light)
    plan = ms.plan(subject.camera, exposure, photons, tolerance_dn)
    sections = (
        sensor_section(subject, photons, plan, (frames, seed, serial), progress),
        render_section(subject, light, spp // PAIRS, seed, progress),
    )
    rows, columns = photons.mean.shape[:2]
    about = f"{columns} × {rows} pixels, {exposure.time_s:g} s, {exposure.temperature_k:g} K"
    title = f"Ablation: {Path(subject.scene).stem}, {subject.camera.name} ({about})"
    return study_of("ablation", title, sections)


def sensor_section(
    subject: Subject,
    photons: ms.Photons,
    plan: ms.Plan,
    replicas: tuple[int, int, int],
    progress: Progress,
) -> Section:
    """Measure what each noise source changes and costs; passed if the plan keeps its tolerance.

    replicas : frames of each sensor unit, seed of the first frame, serial number of the first unit.
    """
    frames, seed, serial = replicas
    cameras = {WHOLE: subject.camera, **dict(_reduced(subject.camera)), PLAN: subject.camera}

    def options(case: str) -> Options:
        return {"plan": plan if case == PLAN else None}

    def taken(case: str) -> list[np.ndarray]:
        of_sensor = partial(
            ms.expose, photons, cameras[case], subject.exposure, frames=frames, **options(case)
        )
        numbers = range(SENSORS)
        return [of_sensor(serial=serial + one, seed=seed + one).digital for one in numbers]

    found = measured({f"frames: {case}": partial(taken, case) for case in cameras}, progress)
    whole = found[f"frames: {WHOLE}"]
    cases = {
        case: compared(found[f"frames: {case}"], whole) for case in cameras if case != WHOLE
    }
    tasks = {}
    for case in (WHOLE, *(case for case, one in cases.items() if one.moved)):
        stream = partial(ms.stream, photons, cameras[case], subject.exposure, frames=2**31)
        tasks[case] = partial(next, stream(engine="numpy", **options(case)))
    progress("seconds of frames", 0.95)
    seconds = time_in_turns(tasks, TURNS)
    saved = {case: saved_share(seconds[WHOLE], own) for case, own in seconds.items()}
    keeps = cases[PLAN].beyond <= plan.tolerance_dn
    reasons = {effect.stage: effect.reason for effect in plan.effects}
    rows = list[MarkedRow]()
    for name, one in cases.items():
        mark: Mark = "" if one.moved else "dim"
        if name == PLAN:
            mark = "good" if keeps else "bad"
        changes = (x for change, low, high in one.intervals for x in (change, (high - low) / 2))
        shares = [100 * share for share in saved[name]] if name in saved else [None] * 3
        rows.append((mark, (name, *changes, *shares, reasons.get(name, ""))))
    headings = " | ".join(f"{name} [DN] | ± [DN]" for name in QUANTITIES)
    shown = table(
        "Changes without each noise source",
        f"left out | {headings} | saved, from [%] | median [%] | to [%] | plan",
        rows,
        f"Averages over all pixels of {frames} frames of each of {SENSORS} sensor units, with the random numbers of "
        "the whole chain; ± is half the 95 % interval over the units. Saved: fraction of a frame's time on NumPy, "
        f"quartiles of {TURNS} turns. Sources that change no code are not timed.",
        "left out | mean [DN] | temporal σ [DN] | spatial σ [DN] | median [%] | plan",
    )
    findings = of_plan(plan, cases[PLAN], saved), *of_sources(cases, saved, moments(whole))
    failed = () if keeps else (f"plan at {plan.tolerance_dn:g} DN",)
    parts = picture_of(cases, plan.tolerance_dn), shown
    return Section(findings, keeps, parts, failed=failed)


def _reduced(camera: ms.Camera) -> Iterator[tuple[str, ms.Camera]]:
    """Yield the camera without each of its noise sources."""
    for stage in camera.stages:
        try:
            yield stage.label, camera.without(stage.key())
        except ms.InputError:  # gains, wells and the ADC are not noise sources
            continue


def compared(taken: list[np.ndarray], whole: list[np.ndarray]) -> Case:
    """Compare two sets of frames.  taken, whole : frames of every sensor unit."""
    change, error = change_of_moments(moments(taken), moments(whole))
    pairs = zip(change.tolist(), error.tolist(), strict=True)
    beyond = float((np.abs(change) - SIGNIFICANT * error).max())
    moved = float(np.mean(np.array(taken) != np.array(whole)))
    return Case([student_interval(*pair, SENSORS - 1) for pair in pairs], beyond, moved)


def saved_share(whole: list[float], other: list[float]) -> Spread:
    """Return the fraction of the time saved, with its spread over the turns."""
    return spread(1 - mine / theirs for mine, theirs in zip(other, whole, strict=True))


def in_words(saved: Spread) -> str:
    """Return ``12 % of the time (8 % to 15 %)``, or that nothing exceeds the scatter."""
    if saved.low <= 0:
        return (
            f"no time beyond the scatter ({100 * saved.low:.0f} % to {100 * saved.high:.0f} %)"
        )
    return f"{100 * saved.median:.0f} % of the time ({100 * saved.low:.0f} % to {100 * saved.high:.0f} %)"


def of_plan(plan: ms.Plan, case: Case, saved: Mapping[str, Spread]) -> str:
    """Return a sentence: what the plan omits, changes and saves."""
    change, low, high = case.intervals[case.largest]
    moved = "no code changes"
    if case.moved:
        what = f"the {QUANTITIES[case.largest]} by {change:.2g} ± {(high - low) / 2:.1g} DN"
        moved = (
            f"{case.moved:.2g} of the codes change, {what}; it saves {in_words(saved[PLAN])}"
        )
    left_out = ", ".join(plan.left_out) or "none"
    return (
        f"Within {plan.tolerance_dn:g} DN, the plan omits {len(plan.left_out)} of {len(plan.effects)} stages "
        f"({left_out}): {moved}."
    )


def of_sources(
    cases: Mapping[str, Case], saved: Mapping[str, Spread], whole: Array
) -> Iterator[str]:
    """Yield sentences: which source matters most, and which takes most time."""
    values = [
        float(whole[0].mean()),
        *np.sqrt(np.maximum(whole[1:].mean(axis=1), 0.0)).tolist(),
    ]
    sources = {name: one for name, one in cases.items() if name != PLAN}
    if sources:
        name, most = max(
            sources.items(), key=lambda one: abs(one[1].intervals[one[1].largest][0])
        )
        change, before = most.intervals[most.largest][0], values[most.largest]
        yield (
            f"{name[0].upper()}{name[1:]} matters most: without it, the {QUANTITIES[most.largest]} changes from "
            f"{before:.3g} to {before + change:.3g} DN."
        )
    clear = {name: one for name, one in saved.items() if one.low > 0 and name in sources}
    if clear:
        name = max(clear, key=lambda one: clear[one].median)
        yield f"{name[0].upper()}{name[1:]} takes most time: without it, a frame saves {in_words(clear[name])}."
    else:
        yield "No single source takes time beyond the scatter of the measurement."


def picture_of(cases: Mapping[str, Case], tolerance_dn: float) -> Dots:
    """Draw the changes of mean and σ without each noise source that has an effect."""
    shown = {name: one for name, one in cases.items() if one.moved}
    series = {
        name: [_size(*one.intervals[row]) for one in shown.values()]
        for row, name in enumerate(QUANTITIES)
    }
    return Dots(
        "Change of mean and σ without each noise source",
        "size of the change [DN]",
        tuple(shown),
        series,
        (tolerance_dn, f"tolerance {tolerance_dn:g} DN"),
        log_x=True,
        note=f"Bars are 95 % intervals over {SENSORS} sensor units. Missing dots and sources are no change at all.",
    )


def _size(change: float, low: float, high: float) -> tuple[float, float, float] | None:
    """Return the absolute value of a change with its interval, or None for no change."""
    size, half = abs(change), (high - low) / 2
    return (size, max(size - half, 0.0), size + half) if size else None


def features(subject: Subject, light: ms.Irradiance) -> dict[str, Options]:
    """Return the render options without each feature of the scene; "camera" holds changes of the camera."""
    bands, width_nm = light.data.shape[2], float(light.bandwidths_nm[0])
    found: dict[str, Options] = {}
    if light.filters is None and bands > 1:
        found = {"bands twice as wide": {"bandwidth_nm": 2 * width_nm}}
        found["one band"] = {"bandwidth_nm": bands * width_nm}
        if subject.camera.quantum_efficiency.quantum_yield is None:
            found["channels instead of bands"] = {"spectral": "channels"}
    found |= {"no indirect light": {"integrator": "direct"}}
    found["no lens fall-off"] = {"camera": NO_FALL_OFF}
    for name, fields in LENS.items():
        if any(getattr(subject.camera.lens, one) for one in fields):
            found[name] = {"camera": dict.fromkeys(f"lens.{one}" for one in fields)}
    return found


def render_section(
    subject: Subject, light: ms.Irradiance, spp: int, seed: int, progress: Progress
) -> Section:
    """Measure what a simpler render changes and saves."""

    def rendered(camera: Options, **options: Any) -> list[tuple[Array, float]] | None:
        """Return signal up to the full well, (H, W) [DN], and seconds of every pair; None if the scene cannot."""
        changed, pairs = subject.camera.replace(**camera), []
        for pair in range(PAIRS):
            try:
                own = subject.render(seed + pair, changed, spp=spp, denoise=False, **options)
            except ms.InputError:  # the scene needs the feature
                return None
            photons = ms.collect(own, changed, subject.exposure)
            detected = ms.expose(photons, changed, subject.exposure).detected.mean_e
            signal_e = np.minimum(np.float64(detected), changed.pixel.full_well_e)
            seconds = own.statistics.seconds_per_sample * own.statistics.samples_per_pixel
            pairs.append((changed.system_gain_dn_per_e * signal_e, seconds))
        return pairs

    every = {"as it is": {}, **features(subject, light)}
    steps = {
        name: partial(rendered, **{"camera": {}, **options}) for name, options in every.items()
    }
    found = measured({f"render {name}": step for name, step in steps.items()}, progress)
    base, rows, most = found.pop("render as it is"), list[MarkedRow](), (0.0, "")
    for key, pairs in found.items():
        if pairs is None:
            continue
        name = key.removeprefix("render ")
        off = np.array([other[0] - one[0] for one, other in zip(base, pairs, strict=True)])
        rms, error = shared_rms(off)
        mean, mean_error = float(off.mean()), standard_error(off.mean(axis=(1, 2)))
        saved = saved_share([one[1] for one in base], [one[1] for one in pairs])
        is_change = rms > SIGNIFICANT * error or abs(mean) > SIGNIFICANT * mean_error
        if is_change and rms > most[0]:
            text = f"changes the picture most, by {rms:.3g} ± {error:.2g} DN rms"
            most = rms, f"Of the render, '{name}' {text}; it saves {in_words(saved)}."
        shares = [100 * share for share in saved]
        rows.append(("" if is_change else "dim", (name, mean, mean_error, rms, error, *shares)))
    shown = table(
        "Changes with a simpler render",
        "rendered with | mean [DN] | ± [DN] | rms [DN] | ± [DN] | saved, from [%] | median [%] | to [%]",
        rows,
        f"Change of the signal up to the full well, in {PAIRS} pairs of renders with equal seeds. The rms excludes "
        "their noise; ± is a standard error. Saved: quartiles, without compilation.",
    )
    return Section(tuple(filter(None, most[1:])), True, (shown,))


def shared_rms(off: Array) -> tuple[float, float]:
    """Return the rms over the pixels of the change that all pairs share, and its standard error.

    Noise has no effect on the mean of products of two different pairs.
    """

    def mean_square(pairs: Array) -> float:
        count, total, squares = len(pairs), pairs.sum(axis=0), np.square(pairs).sum(axis=0)
        return float(((total**2 - squares) / (count * (count - 1))).mean())

    count, square = len(off), mean_square(off)
    left = np.array([mean_square(np.delete(off, pair, axis=0)) for pair in range(count)])
    error = math.sqrt((count - 1) / count * float(np.square(left - left.mean()).sum()))
    rms = math.sqrt(max(square, 0.0))
    return rms, error / (2 * rms) if square > error else math.sqrt(error)
