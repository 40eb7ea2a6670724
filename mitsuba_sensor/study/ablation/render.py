"""The render with one feature off at a time: equal seeds, pass by pass, taking turns with the scene as it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...core.options import part_of
from ...lab.statistics.estimators import standard_error
from ...optics.f_number_law import solid_angle_sr
from ...render.light.irradiance import Irradiance
from ...render.motion.aovs import render_aovs
from ...render.options import SceneOptions
from ...render.passes.passes import hashed_seed, whole_grid
from ...render.passes.prepared import PreparedRender
from ...render.passes.requirements import direct_integrator, without_depth_of_field, without_indirect_light
from ...render.passes.stop_criterion import StopCriterion
from ...sensor.gains import gain_dn_per_e
from ..kit import Array, Known, Subject, Values, in_turns, one_turn
from .sensor import FEWEST_PIXELS, WORST

WHOLE_RENDERS = 3  # with and without error bars: no pass of the one is one of the other
AS_IT_IS, WITHOUT = "as it is", "without"
APERTURE, ERROR_BARS, AOVS = "depth of field", "error bars", "AOVs"

Measure = Callable[[], Values]
Load = Callable[[], PreparedRender]
Theory = Callable[[Irradiance, PreparedRender], Array] | None  # electrons (H, W) without a feature, from a render


def measures(subject: Subject, criterion: StopCriterion, seed: int) -> tuple[dict[str, Measure], dict[str, str]]:
    """How the change without each feature of this render is measured; of the features that it has not, why not."""
    job, camera, lens, view = subject.job, subject.camera, subject.camera.lens, subject.job.scene.view
    change = partial(partial, change_without, subject, criterion, seed)  # makes a Measure of what is loaded, and theory

    def lens_change(fields: Known, theory: Theory = None) -> Measure:
        changes = {f"lens.{name}": value for name, value in fields.items()}
        return change(lambda: subject.job_with(camera.replace(**changes)), theory)

    def coarser(size: int) -> Measure:
        return change(partial(subject.job_with, bandwidth_nm=float(job.bands.bandwidths_nm[0]) * size))

    def without_fall_off(_: Irradiance, other: PreparedRender) -> Array:
        before, after = (solid_angle_sr(one.scene.view, one.camera) for one in (job, other))
        return np.asarray(job.renderer.electrons()[0] * after / before)

    cube, bursts = job.bands.kind == "cube", camera.quantum_efficiency.quantum_yield is not None
    count, none = len(job.bands) if cube else 1, "the camera's lens has none"
    sizes = [size for size in range(2, count + 1) if count % size == 0]
    bands = {"one band" if size == count else f"{count // size} bands": coarser(size) for size in sizes}
    why = "electrons come in bursts, which needs bands" if cube else "the scene asks for one band, or for channels"
    curve = lens.transmission_curve or (1.0,)
    mean = lens.transmission * math.fsum(curve) / len(curve)  # one number for all wavelengths
    flat = {"relative_illumination": (1.0, 1.0), "relative_illumination_heights_mm": (0.0, 1e6)}  # beyond any sensor
    plain = {"transmission": mean, "transmission_curve": None, "transmission_wavelengths_nm": None}
    straight = dict.fromkeys(("distortion", "distortion_percent", "distortion_heights_mm"))
    curved = lens.distortion is not None or lens.distortion_percent is not None
    thin, pinhole = view.aperture_radius_m > 0 and not view.sequential, view.half_width > 0 and not view.sequential
    direct, deep = direct_integrator(job.parsed.file), "the integrator follows no path beyond the first surface"
    channels = change(partial(subject.job_with, spectral="channels"))
    rows: list[tuple[str, object, str, Measure]] = [  # what, whether it is here, why not, how it is measured
        *((name, True, "", measure) for name, measure in bands.items()),
        *([] if bands else [("coarser bands", False, "there is one band, or channels", dict)]),
        ("channels instead of bands", cube and not bursts, why, channels),
        (APERTURE, thin, "no thin lens", change(lambda: without_depth_of_field(subject.job_with()))),
        ("indirect light", direct, deep, change(lambda: without_indirect_light(subject.job_with()))),
        ("lens fall-off", pinhole, "telecentric, or a sequential lens", lens_change(flat, without_fall_off)),
        ("lens distortion", curved, none, lens_change(straight)),
        ("lens transmission curve", lens.transmission_curve is not None, none, lens_change(plain)),
        ("lens prescription", view.sequential, none, lens_change({"prescription": None})),
        ("motion and subframes", False, "nothing moves unless a motion is given", dict),
        (ERROR_BARS, True, "", partial(_in_one_pass, subject, criterion, seed)),
        (AOVS, True, "", partial(_without_aovs, subject)),
    ]
    missing = {name: reason for name, is_here, reason, _ in rows if not is_here}
    return {name: measure for name, is_here, _, measure in rows if is_here}, missing


def change_without(subject: Subject, criterion: StopCriterion, seed: int, load: Load, theory: Theory = None) -> Values:
    """The change of the scene that is loaded without a feature, and the seconds of each pass, turn by turn."""
    k, jobs = gain_dn_per_e(subject.camera), {AS_IT_IS: subject.job, WITHOUT: load()}
    pictures: dict[str, list[Array]] = {name: [] for name in (*jobs, "theory")}
    turns: list[dict[str, float]] = []
    lights: dict[str, Irradiance] = {}

    def render(name: str, seed: int) -> None:
        lights[name] = jobs[name].render(seed, StopCriterion(1, criterion.samples))

    for number in range(-1, criterion.passes):  # the first compiles
        own = hashed_seed(seed, -2, max(number, 0))
        turns.append(one_turn({name: partial(render, name, own) for name in jobs}, number + 1))
        if number >= 0:
            for name, job in jobs.items():
                pictures[name].append(k * job.renderer.electrons()[0])
            if theory:
                pictures["theory"].append(k * theory(lights[AS_IT_IS], jobs[WITHOUT]))
    base, changed, expected = (np.array(stack) for stack in pictures.values())
    found = compared(base, changed, expected if theory else None, k * subject.camera.pixel.full_well_e)
    seconds, without = ([turn[name] for turn in turns[1:]] for name in jobs)
    return {**found, "seconds": seconds, "seconds_without": without, "passes": criterion.passes}


def compared(base: Array, changed: Array, theory: Array | None, full_dn: float) -> Values:
    """Two renders of equal passes, (passes, H, W) each [DN]; theory : what it makes of the passes of the first.

    mean_dn, rms_dn, worst_dn : change of the mean signal, cut at the full well: averaged over the pixels; root of the
    mean square, freed of noise; averaged over the worst 1 % of the pixels, which theory names, else half of the passes
    while the others measure.  predicted : by theory, if there is one; z of mean and worst 1 %."""
    off, each, unsaturated = _change(base, changed, full_dn)
    signal_dn, mean_dn = float(np.minimum(base.mean(axis=0), full_dn).mean()), float(off.mean())
    found: Values = {"signal_dn": signal_dn, "mean_dn": mean_dn, "mean_error": standard_error(each.mean(axis=(1, 2)))}
    found["rms_dn"], found["rms_error"] = _rms(each)
    if theory is None:  # the pixels that every other pass names, as the others see them: no noise is picked
        halves = [_change(base[k::2], changed[k::2], full_dn) for k in (0, 1)]
        values, errors = zip(*(_over(*halves[1 - k][:2], _worst(halves[k][0])) for k in (0, 1)), strict=True)
        return {**found, "worst_dn": 0.5 * sum(values), "worst_error": 0.5 * math.hypot(*errors), "predicted": None}
    expected, *_ = _change(base, theory, full_dn)
    weights, least = _worst(expected), 1e-6 * signal_dn  # below which a change is one of float32 films
    rest = np.where(unsaturated, changed - theory, 0.0)
    value, error = _over(off, each, weights)
    said, rest_error = _over(expected, rest, weights)
    z_mean = float((off - expected).mean()) / max(standard_error(rest.mean(axis=(1, 2))), least)
    predicted = {"mean_dn": float(expected.mean()), "worst_dn": said}
    predicted |= {"z_mean": z_mean, "z_worst": (value - said) / max(rest_error, least)}
    return {**found, "worst_dn": value, "worst_error": error, "predicted": predicted}


def _change(base: Array, changed: Array, full_dn: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Change of the mean picture (H, W); of each pass (passes, H, W), 0 where both have full wells; and where not."""
    before, after = base.mean(axis=0), changed.mean(axis=0)
    unsaturated = (before < full_dn) | (after < full_dn)
    off = np.minimum(after, full_dn) - np.minimum(before, full_dn)
    return off, np.where(unsaturated, changed - base, 0.0), unsaturated


def _worst(change: Array) -> Array:
    """Weights of the worst pixels: the sign of their change over their number, (H, W); 0 for the others."""
    weights, count = np.zeros(change.size), max(int(WORST * change.size), FEWEST_PIXELS)
    worst = np.argsort(np.abs(change), axis=None)[-count:]
    weights[worst] = np.sign(change.ravel()[worst]) / worst.size
    return weights.reshape(change.shape)


def _over(change: Array, each: Array, weights: Array) -> tuple[float, float]:
    """Weighted sum of a change, and its standard error from the passes (passes, H, W)."""
    return float((change * weights).sum()), standard_error((each * weights).sum(axis=(1, 2)))


def _rms(each: Array) -> tuple[float, float]:
    """Root of the mean square over the pixels of the change that all passes share, and its standard error."""

    def square(passes: Array) -> float:  # the mean of products of two different passes has no noise in its mean
        count, total, squares = len(passes), passes.sum(axis=0), (passes**2).sum(axis=0)
        return float(((total**2 - squares) / (count * (count - 1))).mean())

    count, whole = len(each), square(each)
    left = np.array([square(np.delete(each, k, axis=0)) for k in range(count)])
    error = math.sqrt((count - 1) / count * float(((left - left.mean()) ** 2).sum()))
    rms = math.sqrt(max(whole, 0.0))
    return rms, error / (2 * rms) if whole > error else math.sqrt(error)


def _in_one_pass(subject: Subject, criterion: StopCriterion, seed: int) -> Values:
    """As many samples in one pass: nobody knows then how sure the render is. Both have noise of their own."""
    job, k, full_e = subject.job, gain_dn_per_e(subject.camera), subject.camera.pixel.full_well_e
    ways = {AS_IT_IS: criterion, WITHOUT: StopCriterion(1, whole_grid(criterion.passes * criterion.samples))}
    means: dict[str, list[float]] = {name: [] for name in ways}

    def render(name: str) -> None:
        job.render(hashed_seed(seed, -3, max(len(means[name]) - 1, 0)), ways[name])
        means[name].append(float(np.minimum(k * job.renderer.electrons()[0], k * full_e).mean()))

    seconds = in_turns({name: partial(render, name) for name in ways}, WHOLE_RENDERS)
    as_it_is, without = (np.array(means[name][1:]) for name in ways)
    off, nothing = without - as_it_is, dict.fromkeys(("rms_dn", "rms_error", "worst_dn", "worst_error", "predicted"))
    found = {"signal_dn": float(as_it_is.mean()), "mean_dn": float(off.mean()), "mean_error": standard_error(off)}
    return {**found, **nothing, "seconds": seconds[AS_IT_IS], "seconds_without": seconds[WITHOUT], "passes": 1}


def _without_aovs(subject: Subject) -> Values:
    """Nothing of the picture: they are a pass of their own."""
    options = part_of(SceneOptions, {**subject.options, "motion": None})
    render = partial(render_aovs, subject.scene, subject.camera, exposure=subject.exposure, **options)
    zeros = dict.fromkeys(("mean_dn", "mean_error", "rms_dn", "rms_error", "worst_dn", "worst_error"), 0.0)
    nothing = {"signal_dn": None, "predicted": None, "seconds_without": [0.0] * WHOLE_RENDERS, "passes": 1}
    return {**zeros, **nothing, "seconds": in_turns({AOVS: render}, WHOLE_RENDERS)[AOVS]}
