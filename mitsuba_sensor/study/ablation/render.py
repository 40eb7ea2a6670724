"""The render with one feature off at a time: equal seeds, pass by pass, taking turns with the scene as it is."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...optics.f_number_law import solid_angle_sr
from ...render.aovs import render_aovs
from ...render.irradiance import Irradiance
from ...render.passes import hashed_seed, whole_grid
from ...render.prepared import PreparedRender
from ...render.requirements import grouped_electrons
from ...render.stop_criterion import StopCriterion
from ...sensor.gains import gain_dn_per_e
from ..kit import Task, in_turns, one_turn
from ..statistics import Array, Values, standard_error
from .features import AOVS, ERROR_BARS, FALL_OFF, Features
from .sensor import FEWEST_PIXELS, WORST

WHOLE_RENDERS = 3
"""How often the render is made in full, with and without error bars: no pass of the one is one of the other."""
LAST_DIGIT = 1e-6  # of the mean signal: below it a change is one of float32 films
AS_IT_IS, WITHOUT = "as it is", "without"


def change_without(features: Features, feature: str, criterion: StopCriterion, seed: int) -> Values:
    """What happens to the picture, and the seconds that are saved.

    mean_dn, rms_dn, worst_dn : change of the mean signal, cut at the full well: averaged over the pixels; root of the
        mean square, freed of the render's own noise; and averaged over the worst 1 % of the pixels, which theory names,
        else half of the passes while the others measure. Each has its ``_error``.
    predicted : what theory says of mean and worst 1 %, of the worst pixel, and z of the first two; else None.
    seconds, seconds_without : of each pass, turn by turn.  passes : that a render has.
    """
    if feature == AOVS:
        return _aovs(features)
    if feature == ERROR_BARS:
        return _one_pass(features, criterion, seed)
    subject, other, k = features.subject, features.without(feature), gain_dn_per_e(features.subject.camera)
    jobs, one = {AS_IT_IS: subject.job, WITHOUT: other}, StopCriterion(1, criterion.samples)
    pictures: dict[str, list[Array]] = {AS_IT_IS: [], WITHOUT: []}
    seconds: dict[str, list[float]] = {AS_IT_IS: [], WITHOUT: []}
    theory = []
    for number in range(-1, criterion.passes):  # the first compiles
        lights: dict[str, Irradiance] = {}
        own = hashed_seed(seed, -2, max(number, 0))
        elapsed = one_turn({name: _task(job, own, one, name, lights) for name, job in jobs.items()}, number + 1)
        for name, job in jobs.items() if number >= 0 else ():
            seconds[name].append(elapsed[name])
            pictures[name].append(k * job.renderer.electrons()[0])
        expected = _predicted(features, feature, other, lights[AS_IT_IS])
        if number >= 0 and expected is not None:
            theory.append(k * expected)
    base, changed = (np.array(pictures[name]) for name in jobs)
    found = compared(base, changed, np.array(theory) if theory else None, _full_dn(features))
    return {**found, "seconds": seconds[AS_IT_IS], "seconds_without": seconds[WITHOUT], "passes": criterion.passes}


def _task(job: PreparedRender, seed: int, criterion: StopCriterion, name: str, lights: dict[str, Irradiance]) -> Task:
    def task() -> int:
        lights[name] = job.render(seed, criterion)
        return 1

    return task


def _predicted(features: Features, feature: str, other: PreparedRender, light: Irradiance) -> Array | None:
    """Electrons that theory makes of a render of the scene as it is, (H, W); None where it has nothing to say."""
    subject = features.subject
    if feature in features.groupings:
        return grouped_electrons(light, subject.camera, subject.exposure, features.groupings[feature])
    if feature == FALL_OFF:
        before, after = (solid_angle_sr(job.scene.view, job.camera) for job in (subject.job, other))
        return np.asarray(subject.job.renderer.electrons()[0] * after / before)
    return None


def compared(base: Array, changed: Array, theory: Array | None, full_dn: float) -> Values:
    """Two renders of equal passes, (passes, H, W) each [DN]; theory : what it makes of the passes of the first."""
    off, saturated = _change(base, changed, full_dn)
    each = np.where(saturated, 0.0, changed - base)
    rms, rms_error = _rms(each)
    signal_dn = float(np.minimum(base.mean(axis=0), full_dn).mean())
    mean_error = standard_error(each.mean(axis=(1, 2)))
    found: Values = {"signal_dn": signal_dn, "mean_dn": float(off.mean()), "mean_error": mean_error}
    found |= {"rms_dn": rms, "rms_error": rms_error}
    if theory is None:
        return {**found, **_worst_by_halves(base, changed, full_dn), "predicted": None}
    expected, _ = _change(base, theory, full_dn)
    weights, least = _worst(expected), LAST_DIGIT * signal_dn
    rest = np.where(saturated, 0.0, changed - theory)
    value, error = _over(off, each, weights)
    said, rest_error = _over(expected, rest, weights)
    z_mean = float((off - expected).mean()) / max(standard_error(rest.mean(axis=(1, 2))), least)
    predicted = {"mean_dn": float(expected.mean()), "worst_dn": said, "pixel_dn": float(np.abs(expected).max())}
    predicted |= {"z_mean": z_mean, "z_worst": (value - said) / max(rest_error, least)}
    return {**found, "worst_dn": value, "worst_error": error, "predicted": predicted}


def _change(base: Array, changed: Array, full_dn: float) -> tuple[Array, NDArray[np.bool_]]:
    """Change of the mean picture, and where both have full wells, (H, W) each."""
    before, after = base.mean(axis=0), changed.mean(axis=0)
    return np.minimum(after, full_dn) - np.minimum(before, full_dn), (before >= full_dn) & (after >= full_dn)


def _worst(change: Array) -> Array:
    """Weights of the worst pixels: the sign of their change over their number, (H, W); 0 for the others."""
    count = min(max(int(WORST * change.size), FEWEST_PIXELS), change.size)
    weights = np.zeros(change.size)
    places = np.argsort(np.abs(change), axis=None)[-count:]
    weights[places] = np.sign(change.ravel()[places]) / count
    return weights.reshape(change.shape)


def _over(change: Array, each: Array, weights: Array) -> tuple[float, float]:
    """Weighted sum of a change, and its standard error from the passes (passes, H, W)."""
    return float((change * weights).sum()), standard_error((each * weights).sum(axis=(1, 2)))


def _rms(each: Array) -> tuple[float, float]:
    """Root of the mean square over the pixels of the change that all passes share, and its standard error.

    The mean of products of two different passes has no noise in its mean; each pass left out once gives the error.
    """

    def square(passes: Array) -> float:
        count, total, squares = len(passes), passes.sum(axis=0), (passes**2).sum(axis=0)
        return float(((total**2 - squares) / (count * (count - 1))).mean())

    count, whole = len(each), square(each)
    left = np.array([square(np.delete(each, k, axis=0)) for k in range(count)])
    error = math.sqrt((count - 1) / count * float(((left - left.mean()) ** 2).sum()))
    rms = math.sqrt(max(whole, 0.0))
    return rms, error / (2 * rms) if whole > error else math.sqrt(error)


def _worst_by_halves(base: Array, changed: Array, full_dn: float) -> dict[str, float]:
    """The pixels that every other pass names, as the others see them, and the other way round: no noise is picked."""
    values, errors = [], []
    for first in (0, 1):
        weights = _worst(_change(base[first::2], changed[first::2], full_dn)[0])
        seen, saturated = _change(base[1 - first :: 2], changed[1 - first :: 2], full_dn)
        each = np.where(saturated, 0.0, changed[1 - first :: 2] - base[1 - first :: 2])
        value, error = _over(seen, each, weights)
        values.append(value)
        errors.append(error)
    return {"worst_dn": 0.5 * sum(values), "worst_error": 0.5 * math.hypot(*errors)}


def _one_pass(features: Features, criterion: StopCriterion, seed: int) -> Values:
    """As many samples in one pass: nobody knows then how sure the render is. Both have noise of their own."""
    job, k = features.subject.job, gain_dn_per_e(features.subject.camera)
    ways = {AS_IT_IS: criterion, WITHOUT: StopCriterion(1, whole_grid(criterion.passes * criterion.samples))}
    means: dict[str, list[float]] = {name: [] for name in ways}

    def render(name: str) -> int:
        number = max(len(means[name]) - 1, 0)
        job.render(hashed_seed(seed, -3, number), ways[name])
        means[name].append(float(np.minimum(k * job.renderer.electrons()[0], _full_dn(features)).mean()))
        return 1

    seconds = in_turns({name: partial(render, name) for name in ways}, WHOLE_RENDERS)
    as_it_is, without = (np.array(means[name][1:]) for name in ways)
    off = without - as_it_is
    nothing = dict.fromkeys(("rms_dn", "rms_error", "worst_dn", "worst_error", "predicted"))
    found = {"signal_dn": float(as_it_is.mean()), "mean_dn": float(off.mean()), "mean_error": standard_error(off)}
    return {**found, **nothing, "seconds": seconds[AS_IT_IS], "seconds_without": seconds[WITHOUT], "passes": 1}


def _aovs(features: Features) -> Values:
    """Nothing of the picture: they are a pass of their own."""
    subject = features.subject
    options = {name: subject.options.get(name) for name in ("parameters", "variant", "scene_unit", "width")}

    def render() -> int:
        render_aovs(subject.scene, subject.camera, exposure=subject.exposure, **options)
        return 1

    seconds = in_turns({AOVS: render}, WHOLE_RENDERS)[AOVS]
    zeros = dict.fromkeys(("mean_dn", "mean_error", "rms_dn", "rms_error", "worst_dn", "worst_error"), 0.0)
    nothing = {"signal_dn": None, "predicted": None, "seconds_without": [0.0] * WHOLE_RENDERS, "passes": 1}
    return {**zeros, **nothing, "seconds": seconds}


def _full_dn(features: Features) -> float:
    return float(gain_dn_per_e(features.subject.camera) * features.subject.camera.pixel.full_well_e)
