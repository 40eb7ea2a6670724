"""The sensor with one stage off at a time, and with all that the plan leaves out: in theory, in frames, in seconds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from ...core import Exposure, Photons
from ...lab.statistics.estimators import Spread, as_normal, spread, standard_error, z_limit
from ...render.light.irradiance import Irradiance
from ...render.light.photons import collect
from ...sensor.camera import Camera
from ...sensor.plan import plan
from ...sensor.run import choose_backend
from ...sensor.stage import Chain, sample, without
from .. import frames
from ..frames import QUANTITIES, Illuminated, Replicas
from ..kit import Array, Kit, Step, Subject, Task, Values, in_turns
from ..page import Mark

WHOLE, PLAN, DETECTION = "whole chain", "the plan", "detection"
SENSORS = 64  # serial numbers whose frames are measured: independent values, from whose spread the standard errors come
THEORY, EQUAL_BITS = "moments of every pixel", "frames with equal random bits"  # names of measurements, and of frames:
FRAMES_OF = f"frames of {SENSORS} sensors: "
WORST, FEWEST_PIXELS = 0.01, 16  # share of the pixels, or so many, that are the worst: of one, no variance is known
LOOKED_AT = 8  # frames, each of a sensor of its own, whose pixels are compared one by one with those of the whole chain
SHAPE = {"numpy": (256, 512), "drjit": (1024, 1024)}  # of timed frames: one strip of NumPy's, enough for a kernel
TURNS = {"numpy": 15, "drjit": 7}  # in each of which every chain makes frames
RARE = 2.0  # events, the standard error where none was seen: of 3 · 2 expected, none is seen in 1 of 400 cases, 3 σ
NUMPY_NS, DRJIT_NS, CALL_S, KERNEL_S = 120.0, 12.0, 1.5e-3, 3.0  # at first: per pixel and frame; a chain, a kernel


class Comparison(NamedTuple):
    """One quantity of one chain, over all pixels or the worst, less that of the whole chain [DN]."""

    case: str
    quantity: str
    predicted_dn: float = 0.0
    measured_dn: float = 0.0
    error_dn: float = 0.0
    z: float = 0.0  # standard errors from the prediction, as a normal law counts that are as unlikely as Student's t


class Chains:
    """Every chain of a camera under some light, taken as exact: whole, without a stage, planned; and what theory says.

    worst : how far any pixel moves at most [DN], and of what.  groups : all pixels; by chain those that move most."""

    def __init__(self, camera: Camera, exposure: Exposure, photons: Photons, tolerance_dn: float) -> None:
        self.plan = plan(camera, exposure, photons, tolerance_dn)
        whole = self.plan.whole
        off = {stage.label: without(whole, {stage}) for stage in whole if not stage.required}
        self.stages: dict[str, Chain] = {WHOLE: whole, **off, PLAN: self.plan.stages}
        self.light = Illuminated(photons, camera, exposure, choose_backend("numpy", self.plan.precision, 0))
        self.expected = {case: frames.expected_moments(s, photons, exposure) for case, s in self.stages.items()}
        self.worst: dict[str, Values] = {WHOLE: {}}
        self.groups = {WHOLE: np.arange(self.expected[WHOLE][0].size)}
        for case in list(self.stages)[1:]:
            every = np.abs(frames.in_dn(self.expected[WHOLE], self.expected[case])).reshape(3, -1)
            row = int(np.argmax(every.max(axis=1)))
            self.worst[case] = {"worst_dn": float(every[row].max()), "of": QUANTITIES[row]}
            count = max(int(WORST * every[row].size), FEWEST_PIXELS)
            self.groups[case] = np.argsort(every[row], kind="stable")[-count:]

    def theory(self) -> Values:
        """What the plan says, the moments of every chain averaged over groups of pixels, and how exact theory is."""
        limits = ["the noise behind the count is taken for a normal law, or for a mixture of some"]
        if any(stage.curved for stage in self.plan.whole):
            limits.append("curved stages are taken to second order in that noise")
        effects, sizes = [asdict(effect) for effect in self.plan.effects], {k: len(x) for k, x in self.groups.items()}
        averages = {case: frames.averages(moments, self.groups) for case, moments in self.expected.items()}
        cases = {case: {"moments": found, **self.worst[case]} for case, found in averages.items()}
        return {"plan": effects, "sizes": sizes, "limits": limits, "cases": cases}


class SensorAblation:
    """A camera under the light of a scene, and what a kit measures of its chains."""

    def __init__(
        self, kit: Kit, subject: Subject, light: Callable[[], Irradiance], tolerance_dn: float, replicas: Replicas
    ) -> None:
        self.kit, self._subject, self._light = kit, subject, light
        self._tolerance_dn, self._replicas = tolerance_dn, replicas
        self.names = [WHOLE, *(s.label for s in subject.camera.stages if not s.required), PLAN]
        self.engines = [engine for engine in SHAPE if frames.problem_of(engine) is None]

    def steps(self, pixels: int) -> Iterator[Step]:
        """All measurements of so many pixels."""
        frame_s = CALL_S + 1e-9 * NUMPY_NS * pixels
        yield Step(THEORY, 1.0, lambda: self.chains.theory())
        yield Step(EQUAL_BITS, LOOKED_AT * len(self.names) * frame_s, self._equal_bits)
        seconds = self._replicas.sensors * self._replicas.frames * frame_s
        yield from (Step(FRAMES_OF + case, seconds, partial(self._frames, case)) for case in self.names)
        for engine in self.engines:
            cases = self.names if engine == "numpy" else [WHOLE, PLAN]  # where each chain has to be compiled
            each_s = 1e-9 * math.prod(SHAPE[engine]) * (TURNS[engine] + 1)
            each_s *= NUMPY_NS if engine == "numpy" else frames.FRAMES_A_TURN * DRJIT_NS
            seconds = len(cases) * (each_s + (engine != "numpy") * KERNEL_S)
            yield Step(f"seconds, {engine}", seconds, partial(self._nanoseconds, engine, cases))

    @cached_property
    def photons(self) -> Photons:
        """Mean photons of every pixel, taken as exact."""
        return replace(collect(self._light(), self._subject.camera, self._subject.exposure), variance_e2=None)

    @cached_property
    def chains(self) -> Chains:
        """Every chain under that light."""
        return Chains(self._subject.camera, self._subject.exposure, self.photons, self._tolerance_dn)

    def _equal_bits(self) -> dict[str, dict[str, float]]:
        """Pixels of each chain's frames beside those of the whole chain that were drawn with the same random bits."""
        light, stages = self.chains.light, self.chains.stages
        stacks: dict[str, list[Array]] = {case: [] for case in self.names}
        for number in range(LOOKED_AT):
            sensor = light.sensor(self._replicas.serial + number)
            start = light.electrons(stages[WHOLE], sensor)
            for case, stack in stacks.items():
                stack.append(light.frame(stages[case], start, sensor, self._replicas.seed + number))
        whole = np.array(stacks.pop(WHOLE))
        return {case: frames.pixel_difference(np.array(stack), whole) for case, stack in stacks.items()}

    def is_whole(self, case: str) -> bool:
        """Whether theory and every frame that was looked at say that the chain is the whole one: nothing to measure."""
        looked, theory = self.kit[EQUAL_BITS], self.kit[THEORY]["cases"]
        return case != WHOLE and theory[case]["worst_dn"] == 0 and looked[case]["share_of_pixels"] == 0

    def _frames(self, case: str) -> Values | None:
        """Moments of frames over groups of pixels; None where the chain is the whole one."""
        if self.is_whole(case):
            return None
        stages, expected = self.chains.stages[case], self.chains.expected[case]
        return self.chains.light.measured_moments(stages, self._replicas, expected, self.chains.groups)

    def _nanoseconds(self, engine: str, cases: list[str]) -> dict[str, list[float]]:
        """Per pixel of each chain behind the detection, turn by turn; on NumPy also of the detection."""
        whole, shape, light = self.chains.plan.whole, SHAPE[engine], self.chains.light
        if engine == "numpy":
            light = replace(light, photons=frames.resized(self.photons, shape))
            sensor = light.sensor(1)
            start, frame, chains = light.electrons(whole, sensor), light.first(sensor), self.chains.stages
            tasks: dict[str, Task] = {case: partial(sample, chains[case][1:], start, frame) for case in cases}
            tasks[DETECTION] = partial(sample, whole[:1], light.photons, frame)
        elif self.chains.plan.precision == "float32":  # the same behind every filter: a cube would fill memory
            mean = frames.resized(Photons(np.asarray(light.electrons(whole, light.sensor(1)).light)), shape).mean
            filters = len(self._subject.camera.filter_names)
            detected = Photons(np.repeat(mean[..., None], filters, axis=2), detected=True)
            light = replace(light, photons=detected, backend=choose_backend(engine, "float32", 0))
            tasks = {case: frames.Stream(self.chains.stages[case], light).turn for case in cases}
        else:  # in float64, which a compiled engine has not
            return {}
        turns = in_turns(tasks, TURNS[engine])
        return {name: [1e9 * one_s / math.prod(shape) for one_s in seconds] for name, seconds in turns.items()}


class SensorResults:
    """All that was measured about the sensor, compared; turns : ns per pixel.  furthest : with the largest |z|."""

    def __init__(self, ablation: SensorAblation) -> None:
        self._ablation, kit, names = ablation, ablation.kit, ablation.names
        self.theory: Values = kit[THEORY]
        self.looked: Values = kit[EQUAL_BITS]
        self.changes = {case: [self._compare(case, WHOLE, of) for of in QUANTITIES] for case in names}  # all pixels
        self.worst = {case: self._compare(case, case, self.theory["cases"][case]["of"]) for case in names[1:]}
        self.turns: dict[str, Values] = {one: x for one in ablation.engines if (x := kit[f"seconds, {one}"])}
        every = [*(one for row in self.changes.values() for one in row), *self.worst.values()]
        self.compared = [one for one in every if one.error_dn > 0]
        self.limit = z_limit(len(self.compared))
        self.furthest = max(self.compared, key=lambda one: abs(one.z), default=Comparison(WHOLE, QUANTITIES[0]))
        self.agree = abs(self.furthest.z) <= self.limit
        self.left_out = [effect["stage"] for effect in self.theory["plan"] if not effect["kept"]]

    def saved(self, engine: str, case: str, share: bool = False) -> Spread:
        """What leaving out saves, over the turns [ns/pixel], or as a share of the whole chain's time."""
        pairs = zip(self.turns[engine][WHOLE], self.turns[engine][case], strict=True)
        return spread((whole - other) / (whole if share else 1.0) for whole, other in pairs)

    def mark(self, compared: Sequence[Comparison]) -> Mark:
        """Nothing changes; theory and frames disagree; they agree."""
        if all(one.error_dn == 0 for one in compared):
            return "dim"
        return "bad" if max(abs(one.z) for one in compared) > self.limit else "good"

    def _compare(self, case: str, group: str, of: str) -> Comparison:
        """Variances are compared, because they average; to DN they come by the predicted σ: Δσ = ΔV/(σ + σ′)."""
        if self._ablation.is_whole(case):
            return Comparison(case, of)
        row, kit, whole = QUANTITIES.index(of), self._ablation.kit, self.theory["cases"][WHOLE]["moments"][group]
        now, before = self.theory["cases"][case]["moments"][group][row], 0.0 if case == WHOLE else whole[row]
        predicted_dn = now - before if row == 0 else math.sqrt(now) - math.sqrt(before)
        measured, other = (kit[FRAMES_OF + one][group] for one in (case, WHOLE))
        found, unseen = measured[row], False
        if case != WHOLE:
            found, unseen = found - other[row], np.array_equal(measured[:2], other[:2])
        error = standard_error(found)
        if unseen or error == 0:  # the next event may be a whole line of a sensor, which shares a pattern
            sigma = math.sqrt(sum(whole[1:]))
            step = 1.0 if row == 0 else 1.0 + 2.0 * sigma  # what a pixel that reads one code more adds
            error = RARE * step / (len(found) * math.sqrt(self.theory["sizes"][group]))
        off = float(found.mean()) - (now - before)
        roots = math.sqrt(now) + math.sqrt(now if case == WHOLE else before)
        unit = 1.0 if row == 0 else max(roots, math.sqrt(error))  # an unresolved variance has no resolved root
        z = as_normal(off / error, len(found) - 1)
        return Comparison(case, of, predicted_dn, predicted_dn + off / unit, error / unit, z)
