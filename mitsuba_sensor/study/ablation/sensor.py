"""The sensor with one noise source off at a time, and with all that a plan leaves out: in its laws, frames, seconds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

import mitsuba_sensor as ms

from ...lab.statistics.estimators import Spread, as_normal, spread, standard_error, z_limit
from ...pages.page import Bars, Mark, MarkedRow, Part, Section, Table, table
from ..kit import (
    Array,
    Kit,
    Step,
    Subject,
    Values,
    measured_moments,
    resized,
    spatial_variances,
    time_in_turns,
)

WHOLE, PLAN = "whole chain", "the plan"
QUANTITIES = "mean", "temporal σ", "spatial σ"
SENSORS = 8
"""Serial numbers whose frames are measured; their spread makes the standard errors."""

TIMED_SHAPE = 256, 512
TURNS = 9
MOVED_BY_CHANCE = 3.0
"""So many times its tolerance may a plan move the mean of a pixel over these sensors: fixed patterns that are left out
average to less than this."""

LEAST_DN = 1e-6
"""What no frame shows: differences of laws below are roundings."""

FEWEST_CODES = 10
"""Changed codes that a standard error is at least worth. If about 100 codes or fewer change in all frames, their count
follows Poisson's law; sensors then agree by chance, and the spread between them does not tell the error."""

TOO_FEW = "too few to tell"


class Moments(NamedTuple):
    """Averages over the pixels, for each sensor, (3, sensors): mean, temporal and spatial variance [DN, DN², DN²].

    predicted : by the exact law of every pixel.  measured : of frames.
    pixel_dn : mean of every pixel over the sensors by its law, (H, W) [DN].
    """

    predicted: Array
    measured: Array
    pixel_dn: Array


class Comparison(NamedTuple):
    """A change by the laws and in frames, with its standard error, and how many of these the two are apart.

    too_few : so few codes change that the error is that of FEWEST_CODES instead of the spread between sensors.
    """

    predicted_dn: float
    measured_dn: float
    error_dn: float
    z: float
    too_few: bool


class SensorAblation:
    """A camera in the light of a scene, and what a kit measures without each of its noise sources.

    light : renders the scene, when it is needed.  frames : of each sensor.  seed, serial : of the first frame, sensor.
    """

    def __init__(
        self,
        kit: Kit,
        subject: Subject,
        light: Callable[[], ms.Photons],
        tolerance_dn: float,
        replicas: tuple[int, int, int],
    ) -> None:
        self.kit, self._subject, self._light = kit, subject, light
        self.tolerance_dn = tolerance_dn
        self.frames, self._seed, self._serial = replicas
        self.camera, self.cameras = subject.camera, dict(reduced_cameras(subject.camera))

    @cached_property
    def photons(self) -> ms.Photons:
        """Mean photons of every pixel, taken as exact."""
        return self._light()

    @cached_property
    def plan(self) -> ms.Plan:
        """What this exposure can do without."""
        found = ms.plan(
            self._subject.camera, self._subject.exposure, self.photons, self.tolerance_dn
        )
        assert isinstance(found, ms.Plan)  # of a camera with one read-out
        return found

    def steps(self) -> Iterator[Step]:
        """All measurements."""
        yield Step("the plan's verdicts", 2.0, self.verdicts)
        for case in self.cameras:
            yield Step(f"frames: {case}", 1.0, partial(self.moments, case))
        yield Step("seconds of frames", 10.0, self.nanoseconds)

    def verdicts(self) -> Values:
        """What the plan leaves out, and why."""
        planned = self.plan.to_dict()["stages"]
        return {
            "left_out": self.plan.left_out,
            "stages": {one["stage"]: one["reason"] for one in planned},
        }

    def moments(self, case: str) -> Moments:
        """Moments of every sensor by its laws and in frames; all cases have the same random bits."""
        means, temporal, digital = [], [], []
        for number in range(SENSORS):
            frames = ms.expose(
                self.photons,
                self.cameras[case],
                self._subject.exposure,
                plan=self.plan if case == PLAN else None,
                frames=self.frames,
                serial=self._serial + number,
                seed=self._seed + number,
            )
            means.append(np.float64(frames.clean))
            temporal.append(frames.temporal_variance.mean(dtype=float))
            digital.append(frames.digital)
        pixels = np.array(means)
        predicted = pixels.mean(axis=(1, 2)), temporal, spatial_variances(pixels)
        return Moments(np.array(predicted), measured_moments(digital), pixels.mean(axis=0))

    def nanoseconds(self) -> dict[str, list[float]]:
        """Nanoseconds per pixel of every case's frames on NumPy, in each turn."""
        photons, streams = resized(self.photons, TIMED_SHAPE), {}
        for case, camera in self.cameras.items():
            if case == PLAN:
                plan = ms.plan(camera, self._subject.exposure, photons, self.tolerance_dn)
            else:
                plan = None
            streams[case] = ms.stream(
                photons, camera, self._subject.exposure, engine="numpy", frames=2**31, plan=plan
            )
        tasks = {case: partial(next, frames) for case, frames in streams.items()}
        seconds = time_in_turns(tasks, TURNS)
        return {
            case: [1e9 * x / math.prod(TIMED_SHAPE) for x in taken]
            for case, taken in seconds.items()
        }


def reduced_cameras(camera: ms.Camera) -> Iterator[tuple[str, ms.Camera]]:
    """The whole camera, the camera without each of its noise sources, and that of the plan."""
    yield WHOLE, camera
    for stage in camera.stages:
        try:
            yield stage.label, camera.without(stage.key())
        except ms.InputError:  # no noise source: gains, wells and the converter stay
            continue
    yield PLAN, camera


class SensorResults:
    """What was measured without each noise source, beside the whole chain.

    changes : by case, of each quantity; of the whole chain its own values.  limit : of |z|, one in 100 studies by
    chance.
    """

    def __init__(self, ablation: SensorAblation) -> None:
        kit = ablation.kit
        self.verdicts: Values = kit["the plan's verdicts"]
        self.nanoseconds: Mapping[str, list[float]] = kit["seconds of frames"]
        moments: dict[str, Moments] = {
            case: kit[f"frames: {case}"] for case in ablation.cameras
        }
        whole = moments[WHOLE]
        step_dn = max(1.0, ablation.camera.system_gain_dn_per_e)
        self.changes = {
            case: compare(one, None if case == WHOLE else whole, ablation.frames, step_dn)
            for case, one in moments.items()
        }
        self.worst_pixel_dn = {
            case: float(np.abs(one.pixel_dn - whole.pixel_dn).max())
            for case, one in moments.items()
        }
        every = [one for case in self.changes.values() for one in case if one.error_dn > 0]
        self.limit = z_limit(len(every))
        self.compared = [one for one in every if not one.too_few or abs(one.z) > self.limit]
        self.agree = max((abs(one.z) for one in self.compared), default=0.0) <= self.limit
        self.plan_keeps = (
            self.worst_pixel_dn[PLAN] <= MOVED_BY_CHANCE * ablation.tolerance_dn + LEAST_DN
        )

    def saved_share(self, case: str) -> Spread:
        """Share of the whole chain's time that leaving out saves."""
        pairs = zip(self.nanoseconds[WHOLE], self.nanoseconds[case], strict=True)
        return spread(1 - other / whole for whole, other in pairs)

    def verdict(self, case: str) -> tuple[Mark, str]:
        """Whether laws and frames agree, do not, or cannot be told apart because too few codes change, or none."""
        changes = self.changes[case]
        if not any(one.error_dn or one.measured_dn for one in changes):
            return "dim", "no change"
        if any(abs(one.z) > self.limit for one in changes):
            return "bad", "differ"
        if all(one.too_few or not one.error_dn for one in changes):
            return "dim", TOO_FEW
        return "good", "agree"


def compare(
    moments: Moments, whole: Moments | None, frames: int, step_dn: float
) -> tuple[Comparison, ...]:
    """Changes of mean, temporal σ and spatial σ from the whole chain; of the whole chain itself its values.

    frames : of each sensor.  step_dn : by which one electron changes a code, at least 1.
    """
    predicted, measured = moments.predicted, moments.measured
    if whole is None:
        before = [0.0] * 3
    else:
        before = [float(values.mean()) for values in whole.predicted]
    off = measured - predicted - (0.0 if whole is None else whole.measured - whole.predicted)
    few_codes = FEWEST_CODES * step_dn / (moments.pixel_dn.size * frames * predicted.shape[1])
    noisier = predicted if whole is None else np.maximum(predicted, whole.predicted)
    sigma_dn = math.sqrt(max(float(noisier[1:].mean(axis=1).sum()), 0.0))
    comparisons = []
    for row in range(3):
        now = predicted[row].mean()
        error, least = 0.0, few_codes
        if row:  # a variance, to which a code x that becomes x + d adds about 2 σ |d| + d²
            least *= 2 * sigma_dn + step_dn
        too_few = False
        if np.abs(off[row]).max() > LEAST_DN:
            error = standard_error(off[row])
            too_few = error < least
            error = max(error, least)
        mean_off = 0.0
        if error:
            mean_off = float(off[row].mean())
        unit, change = 1.0, now - before[row]
        if row:  # Δσ = ΔV/(σ + σ′); a variance that is not resolved has no root that is
            change = math.sqrt(max(now, 0.0)) - math.sqrt(max(before[row], 0.0))
            unit = max(
                math.sqrt(max(now, 0.0)) + math.sqrt(max(before[row], 0.0)),
                math.sqrt(error),
                LEAST_DN,
            )
        z = 0.0
        if error:
            z = as_normal(mean_off / error, SENSORS - 1)
        comparisons.append(
            Comparison(float(change), float(change) + mean_off / unit, error / unit, z, too_few)
        )
    return tuple(comparisons)


def sensor_section(results: SensorResults, ablation: SensorAblation) -> Section:
    """What the sensor shows; it has passed if laws and frames agree and the plan keeps to its tolerance."""
    parts: tuple[Part, ...] = (
        changes_table(results, ablation),
        *changes_bars(results, ablation.tolerance_dn),
    )
    return Section(
        tuple(sensor_findings(results, ablation)), results.agree and results.plan_keeps, parts
    )


def sensor_findings(results: SensorResults, ablation: SensorAblation) -> Iterator[str]:
    """What the plan leaves out, whether theory and frames agree, what is needed and what costs most."""
    left_out, saved = results.verdicts["left_out"], results.saved_share(PLAN)
    saves = (
        f"saves {saved.median:.0%} of the sensor's time ({saved.low:.0%} to {saved.high:.0%})"
    )
    if saved.low <= 0:  # this plan is no faster, or the machine was busy
        saves = f"saves no time that could be measured ({saved.low:.0%} to {saved.high:.0%})"
    yield (
        f"The plan at {ablation.tolerance_dn:g} DN leaves out {len(left_out)} of {len(results.verdicts['stages'])} "
        f"stages ({', '.join(left_out) or 'none'}), {saves}, and changes the mean of no pixel, over {SENSORS} chips, "
        f"by more than {results.worst_pixel_dn[PLAN]:.2g} DN."
    )
    if results.compared:
        furthest = max(abs(one.z) for one in results.compared)
        verdict = "do not agree"
        if results.agree:
            verdict = "agree"
        yield (
            f"Theory and frames {verdict} in {len(results.compared)} comparisons: they differ by {furthest:.2f} "
            f"standard errors at most; by chance 1 % of such studies have more than {results.limit:.2f}."
        )
    sources = [case for case in results.changes if case not in (WHOLE, PLAN)]
    if sources:
        needed = max(sources, key=lambda case: largest_change(results.changes[case]))
        dear = max(sources, key=lambda case: results.saved_share(case).median)
        yield (
            f"What matters most is {needed}: without it a mean or σ changes by "
            f"{largest_change(results.changes[needed]):.3g} DN. What takes most time is {dear}: "
            f"{results.saved_share(dear).median:.0%} of a frame's on NumPy."
        )


def largest_change(changes: Sequence[Comparison]) -> float:
    """The largest predicted change of mean, temporal σ and spatial σ [DN]."""
    return max(abs(one.predicted_dn) for one in changes)


def changes_table(results: SensorResults, ablation: SensorAblation) -> Table:
    """Changes and seconds of every case."""
    rows: list[MarkedRow] = []
    for case, changes in results.changes.items():
        numbers = [
            x for one in changes for x in (one.predicted_dn, one.measured_dn, one.error_dn)
        ]
        z = max(abs(one.z) for one in changes)
        saved = 100 * results.saved_share(case).median
        reason = results.verdicts["stages"].get(case, "")
        mark, verdict = results.verdict(case)
        rows.append(
            (
                mark,
                (case, *numbers, z, verdict, results.worst_pixel_dn[case], saved, reason),
            )
        )
    headings = " | ".join(
        f"{name}, predicted [DN] | {name}, measured [DN] | {name}, ± [DN]"
        for name in QUANTITIES
    )
    whole_ns = spread(results.nanoseconds[WHOLE]).median
    return table(
        "What changes when a noise source is left out",
        f"left out | {headings} | largest abs(z) [1] | theory and frames | worst pixel's mean [DN] | saved [%] | plan",
        rows,
        f"Averages over all pixels; of the whole chain the values, below it their changes. Predicted by the theory "
        f"of every pixel; measured on {ablation.frames} frames of each of {SENSORS} sensors, with the same random "
        f"numbers; ± is the standard error from sensor to sensor, or that of {FEWEST_CODES} changed codes if that "
        f"is larger; a row with only such errors is {TOO_FEW}. Seconds are those of NumPy on "
        f"{math.prod(TIMED_SHAPE)} pixels, medians of interleaved runs; the whole chain takes {whole_ns:.4g} ns/pixel.",
    )


def changes_bars(results: SensorResults, tolerance_dn: float) -> list[Bars]:
    """Changes without each noise source, where there are any."""
    cases = [
        case
        for case in results.changes
        if case != WHOLE and largest_change(results.changes[case]) > LEAST_DN
    ]
    series = {}
    for row, name in enumerate(QUANTITIES):
        series[name] = tuple(
            abs(results.changes[case][row].predicted_dn) or None for case in cases
        )
    if tolerance_dn > 0:
        level = (tolerance_dn, f"tolerance {tolerance_dn:g} DN")
    else:
        level = None
    title = "Frame change versus omitted noise source"
    note = "Predicted changes, averaged over all pixels. Sources without a bar change no frame."
    axis = "change of mean or σ [DN]"
    bars = Bars(title, axis, tuple(cases), series, log_x=True, level=level, note=note)
    if cases:
        return [bars]
    return []
