"""The render with one feature off at a time: equal seeds, pass by pass, taking turns with the scene as it is."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...optics.f_number_law import solid_angle_sr
from ...render.aovs import render_aovs
from ...render.irradiance import Irradiance, Job
from ...render.passes import hashed_seed, whole_grid
from ...render.requirements import grouped_electrons
from ...render.stop_criterion import StopCriterion
from ...sensor.chain import gain_dn_per_e
from ..timing import one_turn
from .features import ERROR_BARS, FALL_OFF, TRUTH, Subject
from .stages import FEWEST_PIXELS, WORST

WHOLE_RENDERS = 3
"""How often the render is made in full, with and without error bars: no pass of the one is one of the other."""

LAST_DIGIT = 1e-6
"""Of the mean signal: below it a change is one of float32 films."""

Array = NDArray[np.float64]


def change_without(subject: Subject, feature: str, budget: StopCriterion, seed: int) -> dict[str, Any]:
    """What happens to the picture, and the seconds that are saved, ready for JSON.

    mean_dn, rms_dn, worst_dn : change of the mean signal, cut at the full well: averaged over the pixels; root of the
        mean square, freed of the render's own noise; and averaged over the worst 1 % of the pixels, which theory names,
        else half of the passes while the others measure. Each has its ``_error``.
    predicted : what theory says of mean and worst 1 %, of the worst pixel, and z of the first two; else None.
    seconds, seconds_without : of each pass, turn by turn.  passes : that a render has.
    """
    if feature == TRUTH:
        return _truth(subject)
    if feature == ERROR_BARS:
        return _one_pass(subject, budget, seed)
    return _passes(subject, feature, budget, seed)


def _passes(subject: Subject, feature: str, budget: StopCriterion, seed: int) -> dict[str, Any]:
    other, k = subject.without(feature), gain_dn_per_e(subject.camera)
    jobs, one = {"as it is": subject.job, "without": other}, StopCriterion(1, budget.samples)
    base, changed, theory = [], [], []
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for number in range(-1, budget.passes):  # the first compiles
        lights: dict[str, Irradiance] = {}
        tasks = {
            name: _task(job, hashed_seed(seed, -2, max(number, 0)), one, name, lights) for name, job in jobs.items()
        }
        spent = one_turn(dict(list(tasks.items())[:: -1 if number % 2 else 1]))
        if number < 0:
            continue
        for name in jobs:
            seconds[name].append(spent[name])
        base.append(k * subject.job.renderer.electrons()[0])
        changed.append(k * other.renderer.electrons()[0])
        if (expected := _predicted(subject, feature, other, lights["as it is"])) is not None:
            theory.append(k * expected)
    found = compared(np.array(base), np.array(changed), np.array(theory) if theory else None, _full_dn(subject))
    times = {"seconds": seconds["as it is"], "seconds_without": seconds["without"], "passes": budget.passes}
    return {**found, **times}


def _task(job: Job, seed: int, budget: StopCriterion, name: str, lights: dict[str, Irradiance]) -> Any:
    def task() -> int:
        lights[name] = job.irradiance(seed, budget, lambda step: None, time.monotonic())
        return 1

    return task


def _predicted(subject: Subject, feature: str, other: Job, light: Irradiance) -> Array | None:
    """Electrons that theory makes of a render of the scene as it is, (H, W); None where it has nothing to say."""
    if (size := subject.group_of(feature)) is not None:
        return grouped_electrons(light, subject.camera, subject.exposure, size)
    if feature == FALL_OFF:
        job = subject.job
        before, after = (solid_angle_sr(one.scene.view, one.camera) for one in (job, other))
        return np.asarray(job.renderer.electrons()[0] * after / before)
    return None


def compared(base: Array, changed: Array, theory: Array | None, full_dn: float) -> dict[str, Any]:
    """Two renders of equal passes, (passes, H, W) each [DN]; theory : what it makes of the passes of the first."""
    off, still = _change(base, changed, full_dn)
    each = np.where(still, 0.0, changed - base)
    rms, rms_error = _rms(each)
    signal_dn = float(np.minimum(base.mean(axis=0), full_dn).mean())
    found: dict[str, Any] = {
        "signal_dn": signal_dn, "mean_dn": float(off.mean()), "mean_error": _error(each.mean(axis=(1, 2))),
        "rms_dn": rms, "rms_error": rms_error,
    }  # fmt: skip
    if theory is None:
        return {**found, **_worst_by_halves(base, changed, full_dn), "predicted": None}
    expected, _ = _change(base, theory, full_dn)
    worst, least = _worst(expected), LAST_DIGIT * signal_dn
    rest = np.where(still, 0.0, changed - theory)
    value, error = _over(off, each, worst)
    said, rest_error = _over(expected, rest, worst)
    return {
        **found, "worst_dn": value, "worst_error": error,
        "predicted": {
            "mean_dn": float(expected.mean()), "worst_dn": said, "pixel_dn": float(np.abs(expected).max()),
            "z_mean": float((off - expected).mean()) / max(_error(rest.mean(axis=(1, 2))), least),
            "z_worst": (value - said) / max(rest_error, least),
        },
    }  # fmt: skip


def _change(base: Array, changed: Array, full_dn: float) -> tuple[Array, NDArray[np.bool_]]:
    """Change of the mean picture, and where both have full wells, (H, W) each."""
    before, after = base.mean(axis=0), changed.mean(axis=0)
    return np.minimum(after, full_dn) - np.minimum(before, full_dn), (before >= full_dn) & (after >= full_dn)


def _error(values: Array) -> float:
    """Standard error of the mean."""
    return float(values.std(ddof=1)) / math.sqrt(len(values))


def _worst(change: Array) -> Array:
    """Weights of the worst pixels: the sign of their change over their number, (H, W); 0 for the others."""
    count = min(max(int(WORST * change.size), FEWEST_PIXELS), change.size)
    weights = np.zeros(change.size)
    places = np.argsort(np.abs(change), axis=None)[-count:]
    weights[places] = np.sign(change.ravel()[places]) / count
    return weights.reshape(change.shape)


def _over(change: Array, each: Array, weights: Array) -> tuple[float, float]:
    """Weighted sum of a change, and its standard error from the passes (passes, H, W)."""
    return float((change * weights).sum()), _error((each * weights).sum(axis=(1, 2)))


def _rms(each: Array) -> tuple[float, float]:
    """Root of the mean square over the pixels of the change that all passes share, and its standard error.

    The mean of products of two different passes has no noise in its mean; each pass left out once gives the error.
    """
    count, total, squares = len(each), each.sum(axis=0), (each**2).sum(axis=0)
    whole = float(((total**2 - squares) / (count * (count - 1))).mean())
    left = [float((((total - one) ** 2 - (squares - one**2)) / ((count - 1) * (count - 2))).mean()) for one in each]
    error = math.sqrt((count - 1) / count * float(((np.array(left) - np.mean(left)) ** 2).sum()))
    rms = math.sqrt(max(whole, 0.0))
    return rms, error / (2 * rms) if whole > error else math.sqrt(error)


def _worst_by_halves(base: Array, changed: Array, full_dn: float) -> dict[str, float]:
    """The pixels that every other pass names, as the others see them, and the other way round: no noise is picked."""
    values, errors = [], []
    for first in (0, 1):
        weights = _worst(_change(base[first::2], changed[first::2], full_dn)[0])
        seen, still = _change(base[1 - first :: 2], changed[1 - first :: 2], full_dn)
        each = np.where(still, 0.0, changed[1 - first :: 2] - base[1 - first :: 2])
        value, error = _over(seen, each, weights)
        values.append(value)
        errors.append(error)
    return {"worst_dn": 0.5 * sum(values), "worst_error": 0.5 * math.hypot(*errors)}


def _one_pass(subject: Subject, budget: StopCriterion, seed: int) -> dict[str, Any]:
    """As many samples in one pass: nobody knows then how sure the render is. Both have noise of their own."""
    k, job = gain_dn_per_e(subject.camera), subject.job
    ways = {"as it is": budget, "without": StopCriterion(1, whole_grid(budget.passes * budget.samples))}
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    means: dict[str, list[float]] = {name: [] for name in ways}
    for number in range(-1, WHOLE_RENDERS):
        for name, one in ways.items():
            spent = one_turn({name: _task(job, hashed_seed(seed, -3, max(number, 0)), one, name, {})})
            if number >= 0:
                seconds[name].append(spent[name])
                means[name].append(float(np.minimum(k * job.renderer.electrons()[0], _full_dn(subject)).mean()))
    off = np.subtract(means["without"], means["as it is"])
    nothing = dict.fromkeys(("rms_dn", "rms_error", "worst_dn", "worst_error", "predicted"))
    return {
        "signal_dn": float(np.mean(means["as it is"])), "mean_dn": float(off.mean()), "mean_error": _error(off),
        **nothing, "seconds": seconds["as it is"], "seconds_without": seconds["without"], "passes": 1,
    }  # fmt: skip


def _truth(subject: Subject) -> dict[str, Any]:
    """Nothing of the picture: it is a pass of its own."""
    words = subject.options
    seconds = []
    for _ in range(WHOLE_RENDERS + 1):  # the first compiles
        start = time.perf_counter()
        render_aovs(
            subject.scene, subject.camera, parameters=words.parameters, variant=words.variant,
            scene_unit=words.scene_unit, width=words.columns, exposure=subject.exposure,
        )  # fmt: skip
        seconds.append(time.perf_counter() - start)
    zeros = dict.fromkeys(("mean_dn", "mean_error", "rms_dn", "rms_error", "worst_dn", "worst_error"), 0.0)
    nothing = {"signal_dn": None, "predicted": None, "seconds_without": [0.0] * WHOLE_RENDERS, "passes": 1}
    return {**zeros, **nothing, "seconds": seconds[1:]}


def _full_dn(subject: Subject) -> float:
    return float(gain_dn_per_e(subject.camera) * subject.camera.pixel.full_well_e)
