"""Error of the sensor's frames against their time: engine × precision × sampler × tolerance of the plan."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...core import Photons
from ...lab.statistics.estimators import pareto, ratio, spread
from ...sensor.checks import as_photons
from ...sensor.plan import plan
from ...sensor.precision import LARGEST_DN, SHARE
from ...sensor.stage import Chain
from .. import frames
from ..kit import Array, Kit, Numbers, Step, Subject, Values, one_turn
from .settings import GAUSSIAN, GENERATOR, MEAN_ONLY, OWN, QUANTILE, REFERENCE, FrameSetting, drawn_law

ENGINES = ("numpy", "drjit", "cuda")
TOLERANCES_DN = (0.0, 0.02, 0.2, 1.0, 5.0)  # of the plans that are tried
MEANS = (0.01, 0.1, 1.0, 10.0, 100.0, 1e4, 1e6)  # of the Poisson laws that are compared [events]
TURNS = 7  # in each of which every setting makes frames
LARGE, SMALL = (1024, 1024), (128, 128)  # frames that are timed and compared by pixels; whose moments are measured
REPLICAS = frames.Replicas(sensors=32, frames=2, seed=2)  # the spread between sensors is the standard error
LEVELS = 5  # groups of equally many pixels, from the darkest to the brightest, whose moments are averaged
EXPECTED_S = {"numpy": 0.2, "drjit": 0.02, "cuda": 0.002}  # of a large frame, before anything is measured
OPENING_S, SHORT_S = 0.5, 0.1  # as expected of a stream's kernel and maps; of moments in theory, and of one law
VARIATION, VARIATION_UP_TO = 2e-5, 1e4  # how near float32's Poisson law is to the exact one up to this mean [events]
LEAST_DN = 1e-5  # no change below this is told apart: 0 has no place on a logarithmic axis
SINGLE = FrameSetting("numpy", "float32", QUANTILE)


class Sensor:
    """A camera in a scene's light, without a render's variance. Raises InputError for light that ``expose`` refuses."""

    def __init__(self, kit: Kit, subject: Subject, light: Photons) -> None:
        self.kit, self.subject, self.photons = kit, subject, as_photons(light, subject.camera)
        self._large, self._small = (frames.resized(self.photons, shape) for shape in (LARGE, SMALL))
        self._streams: dict[str, frames.Stream] = {}
        self._reference: Numbers | None = None

    def measure(self) -> None:
        """All that is not measured yet; what is timed comes first, while no other work has warmed a kernel."""
        self.kit.measure("engines", SHORT_S, lambda: {engine: frames.problem_of(engine) for engine in ENGINES})
        self.kit.take(self._steps())
        self._streams.clear()

    @property
    def settings(self) -> list[FrameSetting]:
        """Every engine and sampler with the whole chain, then every plan: in float64 that is NumPy's alone."""
        here = [engine for engine, problem in self.kit["engines"].items() if problem is None]
        own = [FrameSetting(one, "float32", law) for law in (QUANTILE, GAUSSIAN, MEAN_ONLY) for one in here]
        found = [REFERENCE, *own, SINGLE._replace(sampler=GENERATOR)]
        for dn in TOLERANCES_DN:
            exact = self.plan(dn)["precision"] == "float64"
            found += [one._replace(tolerance_dn=dn) for one in ([REFERENCE] if exact else own[: len(here)])]
        return found

    def _steps(self) -> Iterator[Step]:
        for one in self.settings:
            yield Step(f"first frame: {one.name}", OPENING_S, partial(self.first, one))
        turn_s = sum((frames.FRAMES_A_TURN if one.compiled else 1) * EXPECTED_S[one.engine] for one in self.settings)
        for turn in range(TURNS):
            yield Step(f"turn {turn + 1} of {TURNS}, frames of every setting", turn_s, partial(self.turn, turn))
        for one in self.settings:
            if one.sampler != GENERATOR:  # its counts do not come from the same bits
                yield Step(f"pixels: {one.name}", 2 * EXPECTED_S[one.engine], partial(self.pixels, one))
            if not one.compiled:
                yield Step(f"moments: {one.name}", EXPECTED_S[one.engine], partial(self.moments, one))
            for mean in MEANS if one.tolerance_dn is None else ():
                yield Step(f"Poisson law, mean {mean:g}: {one.name}", SHORT_S, partial(drawn_law, one, mean))

    def plan(self, tolerance_dn: float | None) -> Values:
        """Labels of the stages that a plan leaves (None: all); what theory says of it by light level (3, levels)."""
        key, measure = f"plan: {tolerance_dn}", partial(self._planned, tolerance_dn)
        return dict(self.kit[key] if key in self.kit.known else self.kit.measure(key, SHORT_S, measure))

    def stages(self, tolerance_dn: float | None) -> Chain:
        """The stages that a plan leaves (None: all)."""
        kept = self.plan(tolerance_dn)["stages"]
        return tuple(stage for stage in self.subject.camera.stages if stage.label in kept)

    def _planned(self, tolerance_dn: float | None) -> Values:
        camera, precision = self.subject.camera, "float64"
        whole = stages = camera.stages
        if tolerance_dn is not None:
            made = plan(camera, self.subject.exposure, self.photons, tolerance_dn)
            stages, precision = made.stages, made.precision
        pixels = [self.expected(one) for one in (stages, whole)]
        moments = [np.stack([*frames.averages(one, self.groups).values()], axis=1) for one in pixels]
        kept, worst_dn = [stage.label for stage in stages], float(np.abs(frames.in_dn(*pixels)).max())
        left_out = [stage.label for stage in whole if stage.label not in kept]
        found = {"stages": kept, "left_out": left_out, "precision": precision, "moments": moments[0]}
        return {**found, "predicted_dn": frames.in_dn(*moments), "worst_pixel_dn": worst_dn}

    def expected(self, stages: Chain) -> Array:
        """Moments of every pixel of the small window in theory, (3, H, W)."""
        return frames.expected_moments(stages, self._small, self.subject.exposure)

    @cached_property
    def groups(self) -> dict[str, NDArray[np.intp]]:
        """The pixels of each light level: places in the flattened small window."""
        order = np.argsort(self.expected(self.subject.camera.stages)[0], axis=None, kind="stable")
        return {f"level {k + 1}": group for k, group in enumerate(np.array_split(order, LEVELS))}

    def stream(self, setting: FrameSetting) -> frames.Stream:
        """Frames of the large window."""
        light = frames.Illuminated(self._large, self.subject.camera, self.subject.exposure, setting.backend())
        return frames.Stream(self.stages(setting.tolerance_dn), light)

    def first(self, setting: FrameSetting) -> float:
        """Seconds until the first frame: light, maps and, unless Dr.Jit has it already, the kernel."""
        start = time.perf_counter()
        self._streams[setting.name] = self.stream(setting)
        next(self._streams[setting.name])
        return time.perf_counter() - start

    def turn(self, number: int) -> dict[str, float]:
        """Seconds of a frame of each setting."""
        for setting in self.settings:
            if setting.name not in self._streams:  # resumed: its first frame was timed before
                self.first(setting)
        return one_turn({name: stream.turn for name, stream in self._streams.items()}, number)

    def pixels(self, setting: FrameSetting) -> dict[str, float]:
        """One frame against the reference's; share_of_numpy : of the pixels that differ from NumPy float32."""
        self._reference = next(self.stream(REFERENCE)) if self._reference is None else self._reference
        digital = next(self.stream(setting))
        on_numpy = next(self.stream(setting._replace(engine="numpy"))) if setting.compiled else digital
        differ = float(np.mean(digital != on_numpy))
        return {**frames.pixel_difference(digital, self._reference), "share_of_numpy": differ}

    def moments(self, setting: FrameSetting) -> Array:
        """Of frames on the host, by light level, (3, levels, sensors); equal random bits make differences clear."""
        stages = self.stages(setting.tolerance_dn)
        light = frames.Illuminated(self._small, self.subject.camera, self.subject.exposure, setting.backend())
        found = light.measured_moments(stages, REPLICAS, self.expected(stages), self.groups)
        return np.stack([*found.values()], axis=1)


class Change(NamedTuple):
    """Of mean, temporal σ and spatial σ at every light level, (3, levels) [DN], with its standard errors."""

    value_dn: Array
    error_dn: Array
    chance_dn: Array  # what no change reaches by chance, but in one of a thousand studies

    @property
    def worst(self) -> tuple[float, float, str]:
        """The largest change, its standard error, and what it is of."""
        row, level = np.unravel_index(np.argmax(np.abs(self.value_dn)), self.value_dn.shape)
        of = f"{frames.QUANTITIES[row]} of level {level + 1}"
        return float(abs(self.value_dn[row, level])), float(self.error_dn[row, level]), of

    def within(self, tolerance_dn: float) -> bool:
        """Whether every change is at most the tolerance, as far as the sensors can tell."""
        return bool((np.abs(self.value_dn) <= tolerance_dn + self.chance_dn).all())


def change(found: Array, other: Array, theory: Array, other_theory: Array) -> Change:
    """found − other, (3, levels, sensors), of frames with equal random bits; ``other`` may be a theory, without error.

    √a − √b = (a − b)/(√a + √b), with temporal variances of the frames and spatial ones of theory, known better; where a
    variance is not resolved, neither is its root: √a + √b is at least √|a − b| and the root of the standard error."""
    off = found - (other if other.ndim == 3 else other[..., None])
    value, error = off.mean(axis=2), off.std(axis=2, ddof=1) / np.sqrt(off.shape[2])
    temporal = [x[1].mean(axis=-1) if x.ndim == 3 else x[1] for x in (found, other)]
    roots = np.sqrt(np.maximum([temporal, [theory[2], other_theory[2]]], 0.0)).sum(axis=1)
    least = np.sqrt(np.maximum(np.maximum(np.abs(value[1:]), error[1:]), np.finfo(float).tiny))
    unit = np.concatenate([np.ones_like(value[:1]), np.maximum(roots, least)])
    limit = float(stdtrit(off.shape[2] - 1, 1 - 1e-3 / (2 * value.size)))  # one study in 1000: Student, Bonferroni
    return Change(value / unit, error / unit, limit * error / unit)


class Row:
    """One setting: its time and its errors; moments of a compiled engine are those of the same setting on NumPy."""

    def __init__(self, sensor: Sensor, setting: FrameSetting) -> None:
        kit, whole = sensor.kit, setting._replace(tolerance_dn=None)
        turns = [kit[f"turn {k + 1} of {TURNS}, frames of every setting"] for k in range(TURNS)]
        self.setting, self.first_s = setting, float(kit[f"first frame: {setting.name}"])
        self.turns_ns = [1e9 * turn[setting.name] / (LARGE[0] * LARGE[1]) for turn in turns]
        self.ns = spread(self.turns_ns)
        self.faster = ratio(*([turn[one.name] for turn in turns] for one in (REFERENCE, setting)))
        self.saved = spread(1 - turn[setting.name] / turn[whole.name] for turn in turns)  # of the whole chain's time
        self.pixels: dict[str, float] = {} if setting.sampler == GENERATOR else kit[f"pixels: {setting.name}"]
        host = (one._replace(engine="numpy") for one in (setting, REFERENCE, whole))
        mine, reference, uncut = (kit[f"moments: {one.name}"] for one in host)
        theory, of_whole = sensor.plan(setting.tolerance_dn)["moments"], sensor.plan(None)["moments"]
        self.change = change(mine, reference, theory, of_whole)
        self.of_plan = change(mine, uncut, theory, of_whole)  # from the whole chain in the same precision
        self.theory = change(mine, theory, theory, theory)  # from the moments of its own stages
        self.error_dn = max(*self.change.worst[:2], LEAST_DN)  # the largest change, or what can be told


class Results:
    """Rows of the settings that are here, plans by tolerance, and laws: name of a setting → mean → law."""

    def __init__(self, sensor: Sensor) -> None:
        self.absent = {engine: why for engine, why in sensor.kit["engines"].items() if why is not None}
        self.rows = {one: Row(sensor, one) for one in sensor.settings}
        self.plans = {dn: sensor.plan(dn) for dn in TOLERANCES_DN}
        key, whole = "Poisson law, mean {:g}: {}".format, [one.name for one in self.rows if one.tolerance_dn is None]
        self.laws = {name: {mean: sensor.kit[key(mean, name)] for mean in MEANS} for name in whole}
        self.front = [[*self.rows][i] for i in pareto([(row.ns.median, row.error_dn) for row in self.rows.values()])]

    def recommended(self, dn: float) -> Row:
        """The fastest own setting whose frames keep the tolerance; of those below its upper quartile the nearest."""
        fit = [
            row
            for one, row in self.rows.items()
            if one.sampler in OWN and (one.tolerance_dn is None or one.tolerance_dn <= dn) and row.change.within(dn)
            if one.precision == "float64" or self.plans[dn]["precision"] == "float32"
        ]
        fastest = min(fit, key=lambda row: row.ns.median)
        equal = [row for row in fit if row.ns.median <= fastest.ns.high]
        return min(equal, key=lambda row: (row.change.worst[0], row.ns.median))

    def requirements(self) -> Iterator[tuple[str, float, float]]:
        """What the package says of itself: what it is about, what was found, and the limit of that."""
        for one, row in self.rows.items():
            if one.sampler == QUANTILE and one.tolerance_dn is None:  # where the law is farthest off
                laws = [law for mean, law in self.laws[one.name].items() if mean <= VARIATION_UP_TO]
                worst = max(laws, key=lambda law: law["variation"] - law["resolution"])
                what = f"total variation up to a mean of {VARIATION_UP_TO:g}, {one.name}"
                yield what, worst["variation"], VARIATION + worst["resolution"]
            if one.engine == "drjit":
                yield f"the bytes of NumPy float32, {one.name}: share of pixels", row.pixels["share_of_numpy"], 0.0
        if self.plans[min(self.plans)]["precision"] == "float32":
            pixels = self.rows[SINGLE].pixels
            yield "share of pixels that float32 moves", pixels["share_of_pixels"], SHARE
            yield "largest step that float32 makes [DN]", pixels["largest_dn"], LARGEST_DN
        for dn in self.plans:  # at the level where it is nearest to its limit, in the plan's own precision
            of_plan = next(row.of_plan for one, row in self.rows.items() if one.tolerance_dn == dn)
            off, chance = np.abs(of_plan.value_dn).ravel(), of_plan.chance_dn.ravel()
            place = np.argmax(off - chance)
            what = f"measured change that the plan for {dn:g} DN makes [DN]"
            yield what, float(off[place]), dn + float(chance[place])
