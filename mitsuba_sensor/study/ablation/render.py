"""The render with one feature off at a time: equal seeds, pass by pass, taking turns with the scene as it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...optics.f_number_law import solid_angle_sr
from ...render.aovs import render_aovs
from ...render.irradiance import Irradiance
from ...render.passes import hashed_seed, whole_grid
from ...render.prepared import PreparedRender
from ...render.reduced import direct_integrator, without_depth_of_field, without_indirect_light
from ...render.requirements import grouped_electrons
from ...render.stop_criterion import StopCriterion
from ...sensor.gains import gain_dn_per_e
from ..kit import in_turns, one_turn
from ..statistics import Array, Known, Values, standard_error
from ..subject import Subject
from .sensor import FEWEST_PIXELS, WORST

FLAT_TO_MM = 1e6  # to this image height a lens without fall-off is as bright as on its axis: beyond any sensor
WHOLE_RENDERS = 3
"""How often the render is made in full, with and without error bars: no pass of the one is one of the other."""
LAST_DIGIT = 1e-6  # of the mean signal: below it a change is one of float32 films
AS_IT_IS, WITHOUT = "as it is", "without"
CHANNELS, FALL_OFF, INDIRECT = "channels instead of bands", "lens fall-off", "indirect light"
APERTURE, ERROR_BARS, AOVS = "depth of field", "error bars", "AOVs"
DISTORTION, CURVE, PRESCRIPTION = "lens distortion", "lens transmission curve", "lens prescription"


def groupings(subject: Subject) -> dict[str, int]:
    """How many neighbouring bands may be one, so that all groups are equal; by what is left, e.g. "5 bands"."""
    count = len(subject.job.bands) if subject.job.bands.kind == "cube" else 1
    sizes = [size for size in range(2, count + 1) if count % size == 0]
    return {"one band" if size == count else f"{count // size} bands": size for size in sizes}


def features(subject: Subject) -> tuple[list[str], dict[str, str]]:
    """What can be left out of this subject's render, in order; and what cannot, with the reason."""
    lens, view = subject.camera.lens, subject.job.scene.view
    direct, none = direct_integrator(subject.job.parsed.file), "the camera's lens has none"
    no_channels = None if subject.job.bands.kind == "cube" else "the scene asks for one band, or for channels"
    if no_channels is None and subject.camera.quantum_efficiency.quantum_yield is not None:
        no_channels = "electrons come in bursts, which needs bands"
    reasons = {
        CHANNELS: no_channels,
        APERTURE: None if view.aperture_radius_m > 0 and not view.sequential else "no thin lens",
        INDIRECT: None if direct else "the integrator follows no path beyond the first surface",
        FALL_OFF: None if view.half_width > 0 and not view.sequential else "telecentric, or a sequential lens",
        DISTORTION: none if lens.distortion is None and lens.distortion_percent is None else None,
        CURVE: none if lens.transmission_curve is None else None,
        PRESCRIPTION: None if view.sequential else none,
        "motion and subframes": "nothing moves unless a motion is given",
        ERROR_BARS: None,
        AOVS: None,
    }
    coarser = groupings(subject)
    missing = {} if coarser else {"coarser bands": "there is one band, or channels"}
    missing |= {name: reason for name, reason in reasons.items() if reason is not None}
    return [*coarser, *(name for name, reason in reasons.items() if reason is None)], missing


def loaded_without(subject: Subject, feature: str) -> PreparedRender:
    """The scene, loaded without a feature that it has; error bars and AOVs are no part of a scene."""
    lens, coarser = subject.camera.lens, groupings(subject)
    if feature in coarser:
        return subject.job_with(bandwidth_nm=float(subject.job.bands.bandwidths_nm[0]) * coarser[feature])
    curve = lens.transmission_curve or (1.0,)
    mean = lens.transmission * math.fsum(curve) / len(curve)  # one number for all wavelengths
    lenses: Mapping[str, Known] = {
        FALL_OFF: {"relative_illumination": (1.0, 1.0), "relative_illumination_heights_mm": (0.0, FLAT_TO_MM)},
        DISTORTION: dict.fromkeys(("distortion", "distortion_percent", "distortion_heights_mm")),
        CURVE: {"transmission": mean, "transmission_curve": None, "transmission_wavelengths_nm": None},
        PRESCRIPTION: {"prescription": None},
    }
    if feature in lenses:
        changes = {f"lens.{name}": value for name, value in lenses[feature].items()}
        return subject.job_with(subject.camera.replace(**changes))
    others: Mapping[str, Callable[[], PreparedRender]] = {
        CHANNELS: lambda: subject.job_with(spectral="channels"),
        APERTURE: lambda: without_depth_of_field(subject.job_with()),
        INDIRECT: lambda: without_indirect_light(subject.job_with()),
    }
    return others[feature]()


def change_without(subject: Subject, feature: str, criterion: StopCriterion, seed: int) -> Values:
    """What happens to the picture, and the seconds that are saved.

    mean_dn, rms_dn, worst_dn : change of the mean signal, cut at the full well: averaged over the pixels; root of the
        mean square, freed of the render's own noise; and averaged over the worst 1 % of the pixels, which theory names,
        else half of the passes while the others measure. Each has its ``_error``.
    predicted : what theory says of mean and worst 1 %, of the worst pixel, and z of the first two; else None.
    seconds, seconds_without : of each pass, turn by turn.  passes : that a render has.
    """
    if feature == AOVS:
        return _without_aovs(subject)
    if feature == ERROR_BARS:
        return _in_one_pass(subject, criterion, seed)
    k, other = gain_dn_per_e(subject.camera), loaded_without(subject, feature)
    jobs, one = {AS_IT_IS: subject.job, WITHOUT: other}, StopCriterion(1, criterion.samples)
    pictures: dict[str, list[Array]] = {name: [] for name in jobs}
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    lights: dict[str, Irradiance] = {}
    theory = []

    def render(name: str, seed: int) -> int:
        lights[name] = jobs[name].render(seed, one)
        return 1

    for number in range(-1, criterion.passes):  # the first compiles
        own = hashed_seed(seed, -2, max(number, 0))
        elapsed = one_turn({name: partial(render, name, own) for name in jobs}, number + 1)
        expected = _predicted(subject, feature, other, lights[AS_IT_IS])
        if number >= 0:
            theory += [] if expected is None else [k * expected]
            for name, job in jobs.items():
                seconds[name].append(elapsed[name])
                pictures[name].append(k * job.renderer.electrons()[0])
    base, changed = (np.array(pictures[name]) for name in jobs)
    found = compared(base, changed, np.array(theory) if theory else None, k * subject.camera.pixel.full_well_e)
    return {**found, "seconds": seconds[AS_IT_IS], "seconds_without": seconds[WITHOUT], "passes": criterion.passes}


def _predicted(subject: Subject, feature: str, other: PreparedRender, light: Irradiance) -> Array | None:
    """Electrons that theory makes of a render of the scene as it is, (H, W); None where it has nothing to say."""
    if feature in (coarser := groupings(subject)):
        return grouped_electrons(light, subject.camera, subject.exposure, coarser[feature])
    if feature == FALL_OFF:
        before, after = (solid_angle_sr(job.scene.view, job.camera) for job in (subject.job, other))
        return np.asarray(subject.job.renderer.electrons()[0] * after / before)
    return None


def compared(base: Array, changed: Array, theory: Array | None, full_dn: float) -> Values:
    """Two renders of equal passes, (passes, H, W) each [DN]; theory : what it makes of the passes of the first."""
    off, unsaturated = _change(base, changed, full_dn)
    each = np.where(unsaturated, changed - base, 0.0)
    rms, rms_error = _rms(each)
    signal_dn = float(np.minimum(base.mean(axis=0), full_dn).mean())
    mean_error = standard_error(each.mean(axis=(1, 2)))
    found: Values = {"signal_dn": signal_dn, "mean_dn": float(off.mean()), "mean_error": mean_error}
    found |= {"rms_dn": rms, "rms_error": rms_error}
    if theory is None:
        return {**found, **_worst_by_halves(base, changed, full_dn), "predicted": None}
    expected, _ = _change(base, theory, full_dn)
    weights, least = _worst(expected), LAST_DIGIT * signal_dn
    rest = np.where(unsaturated, changed - theory, 0.0)
    value, error = _over(off, each, weights)
    said, rest_error = _over(expected, rest, weights)
    z_mean = float((off - expected).mean()) / max(standard_error(rest.mean(axis=(1, 2))), least)
    predicted = {"mean_dn": float(expected.mean()), "worst_dn": said, "pixel_dn": float(np.abs(expected).max())}
    predicted |= {"z_mean": z_mean, "z_worst": (value - said) / max(rest_error, least)}
    return {**found, "worst_dn": value, "worst_error": error, "predicted": predicted}


def _change(base: Array, changed: Array, full_dn: float) -> tuple[Array, NDArray[np.bool_]]:
    """Change of the mean picture, and where not both have full wells, (H, W) each."""
    before, after = base.mean(axis=0), changed.mean(axis=0)
    return np.minimum(after, full_dn) - np.minimum(before, full_dn), (before < full_dn) | (after < full_dn)


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
    found = []
    for first in (0, 1):
        weights = _worst(_change(base[first::2], changed[first::2], full_dn)[0])
        before, after = base[1 - first :: 2], changed[1 - first :: 2]
        seen, unsaturated = _change(before, after, full_dn)
        found.append(_over(seen, np.where(unsaturated, after - before, 0.0), weights))
    values, errors = zip(*found, strict=True)
    return {"worst_dn": 0.5 * sum(values), "worst_error": 0.5 * math.hypot(*errors)}


def _in_one_pass(subject: Subject, criterion: StopCriterion, seed: int) -> Values:
    """As many samples in one pass: nobody knows then how sure the render is. Both have noise of their own."""
    job, k = subject.job, gain_dn_per_e(subject.camera)
    ways = {AS_IT_IS: criterion, WITHOUT: StopCriterion(1, whole_grid(criterion.passes * criterion.samples))}
    means: dict[str, list[float]] = {name: [] for name in ways}

    def render(name: str) -> int:
        job.render(hashed_seed(seed, -3, max(len(means[name]) - 1, 0)), ways[name])
        means[name].append(
            float(np.minimum(k * job.renderer.electrons()[0], k * subject.camera.pixel.full_well_e).mean())
        )
        return 1

    seconds = in_turns({name: partial(render, name) for name in ways}, WHOLE_RENDERS)
    as_it_is, without = (np.array(means[name][1:]) for name in ways)
    off = without - as_it_is
    nothing = dict.fromkeys(("rms_dn", "rms_error", "worst_dn", "worst_error", "predicted"))
    found = {"signal_dn": float(as_it_is.mean()), "mean_dn": float(off.mean()), "mean_error": standard_error(off)}
    return {**found, **nothing, "seconds": seconds[AS_IT_IS], "seconds_without": seconds[WITHOUT], "passes": 1}


def _without_aovs(subject: Subject) -> Values:
    """Nothing of the picture: they are a pass of their own."""
    options = {name: subject.options.get(name) for name in ("parameters", "variant", "scene_unit", "width")}

    def render() -> int:
        render_aovs(subject.scene, subject.camera, exposure=subject.exposure, **options)
        return 1

    zeros = dict.fromkeys(("mean_dn", "mean_error", "rms_dn", "rms_error", "worst_dn", "worst_error"), 0.0)
    nothing = {"signal_dn": None, "predicted": None, "seconds_without": [0.0] * WHOLE_RENDERS, "passes": 1}
    return {**zeros, **nothing, "seconds": in_turns({AOVS: render}, WHOLE_RENDERS)[AOVS]}
