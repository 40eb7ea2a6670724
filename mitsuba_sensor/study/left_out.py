"""``study left-out``: each stage of the sensor and each feature of the render off in turn, beside the seconds saved."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from ..core.checks import check_types
from ..core.errors import InputError, require, require_seed
from ..core.exposure import Exposure
from ..core.signals import Photons
from ..render.irradiance import Irradiance, RenderOptions
from ..render.photons import collect
from ..render.requirements import render_requirements
from ..render.stop_criterion import StopCriterion
from ..sensor.chain import gain_dn_per_e
from .ablation import render_page as render_ablation_page
from .ablation import stages_page as ablation_page
from .ablation.features import ERROR_BARS, TRUTH, Subject
from .ablation.render import WHOLE_RENDERS, change_without
from .ablation.seconds import FRAMES_A_TURN, SHAPE, TURNS, nanoseconds, seconds_key
from .ablation.stages import DEVICES, EQUAL_WORDS, LOOKED_AT, PLAN, THEORY, WHOLE, Ablation, Replicas, case_names
from .ablation.stages_results import gather, is_whole
from .page import Progress, Study
from .sensor.samplers import problem_of
from .timing import Step, take_steps

if TYPE_CHECKING:
    from ..sensor.camera import Camera

FRAMES = 24
"""Of each of the devices: 1536 frames of each chain."""

SPP = 32
"""Samples per pixel of each render. Most of their noise is in both pictures that are compared."""

FEWEST_PASSES = 4
"""Two in each half, so that both have a standard error."""

SCENE, NEEDS = "render: scene", "render: needs"
"""Keys of the journal: what the scene has, and what the plan says of its render."""

NUMPY_NS, DRJIT_NS, SAMPLE_NS, CALL_S, COMPILE_S = 120.0, 12.0, 4000.0, 1.5e-3, 3.0
"""Per pixel and frame, per light path (30 bands), per call of a chain, per kernel of Mitsuba or Dr.Jit, on two cores of
an AMD EPYC: for the estimate before anything is measured."""


def left_out(
    scene: str | os.PathLike[str],
    camera: Camera,
    exposure: Exposure,
    *,
    tolerance_dn: float = 0.02,
    frames: int = FRAMES,
    spp: int = SPP,
    seed: int = 1,
    serial: int = 1,
    parameters: Mapping[str, Any] | None = None,
    variant: str | None = None,
    scene_unit: str | float | None = None,
    columns: int | None = None,
    done: MutableMapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Study:
    """What each stage and each feature does to the picture, in theory and in frames, and what it costs.

    scene, camera, exposure, parameters, variant, scene_unit, columns : as for :func:`render.irradiance.render`.
    tolerance_dn : of the plan [DN].  spp : samples per pixel of every render.
    frames : of each of the 64 devices, at least 2.  seed, serial : of the first frame and the first device.
    done : what is measured already, by key; new measurements are added.
    Raises InputError.
    """
    check_types(camera, exposure)
    require("tolerance_dn", tolerance_dn, 0.0, float("inf"), "digital numbers, e.g. 0.02")
    if require_seed("frames", frames) < 2:
        raise InputError(f"frames is {frames}; a device needs at least 2 frames to show its temporal noise (e.g. 16).")
    replicas = Replicas(frames, require_seed("seed", seed), require_seed("serial", serial))
    options = RenderOptions(spp=spp, parameters=parameters, variant=variant, scene_unit=scene_unit, columns=columns)
    budget = options.budget()
    if budget.passes < FEWEST_PASSES:
        raise InputError(f"spp is {spp}; the study compares halves of the passes: ask for at least {FEWEST_PASSES}.")
    work = Work(Subject(scene, camera, exposure, options), replicas, tolerance_dn, budget)
    journal: MutableMapping[str, Any] = {} if done is None else done
    work.take(journal, progress or (lambda seconds, expected, words: None))
    return _study(work, journal)


@dataclass(frozen=True, eq=False)
class Work:
    """All that is to be measured. budget : passes of each render."""

    subject: Subject
    replicas: Replicas
    tolerance_dn: float
    budget: StopCriterion

    @cached_property
    def light(self) -> Irradiance:
        """One render of the scene."""
        return self.subject.job.irradiance(self.replicas.seed, self.budget, lambda step: None, time.monotonic())

    @cached_property
    def ablation(self) -> Ablation:
        """The sensor under that light."""
        subject = self.subject
        return Ablation(subject.camera, subject.exposure, self._photons, self.tolerance_dn, self.replicas)

    def _photons(self) -> Photons:
        return collect(self.light, self.subject.camera, self.subject.exposure)

    @property
    def engines(self) -> tuple[str, ...]:
        """Those that are timed: NumPy, and Dr.Jit on LLVM where it works."""
        return tuple(engine for engine in SHAPE if problem_of(engine) is None)

    def take(self, done: MutableMapping[str, Any], progress: Progress) -> None:
        """Measure what is not in ``done``."""
        progress(0.0, 60.0, "loading the scene")
        if SCENE not in done:
            columns, rows = self.subject.job.scene.view.crop_size
            here, missing = self.subject.features()
            done[SCENE] = {"features": here, "missing": missing, "columns": columns, "rows": rows}
        take_steps(list(self._steps(done)), done, progress)

    def _steps(self, done: Mapping[str, Any]) -> Iterator[Step]:
        pixels = done[SCENE]["columns"] * done[SCENE]["rows"]
        frame_s, render_s = CALL_S + 1e-9 * NUMPY_NS * pixels, self._render_s(pixels)
        cases = case_names(self.subject.camera)
        key, found = self.replicas.key, self.ablation
        yield Step(NEEDS, COMPILE_S + render_s, "rendering the scene", self._needs)
        yield Step(THEORY, 1.0, "moments of every pixel", found.theory)
        yield Step(EQUAL_WORDS, LOOKED_AT * len(cases) * frame_s, "frames with equal words", found.equal_words)
        for case in cases:
            words = f"frames of {DEVICES} devices: {case if case in (WHOLE, PLAN) else f'without {case}'}"
            yield Step(key(case), DEVICES * self.replicas.frames * frame_s, words, partial(self._frames, done, case))
        for engine in self.engines:
            yield Step(
                seconds_key(engine), _turns_s(engine, len(cases)), f"seconds, {engine}", self._time(engine, cases)
            )
        seconds = {TRUTH: 1.0, ERROR_BARS: COMPILE_S + 2 * (WHOLE_RENDERS + 1) * render_s}
        for feature in done[SCENE]["features"]:
            measure = partial(change_without, self.subject, feature, self.budget, self.replicas.seed)
            expected_s = seconds.get(feature, COMPILE_S + 2 * render_s)
            yield Step(feature_key(feature, self.replicas), expected_s, f"render: {feature}", measure)

    def _render_s(self, pixels: int) -> float:
        return self.budget.passes * (CALL_S + 1e-9 * SAMPLE_NS * pixels * self.budget.samples)

    def _needs(self) -> list[dict[str, Any]]:
        subject = self.subject
        k = gain_dn_per_e(subject.camera)
        needs = render_requirements(self.light, subject.camera, subject.exposure, k, self.tolerance_dn)
        return [asdict(need) for need in needs]

    def _frames(self, done: Mapping[str, Any], case: str) -> Any:
        """None where theory and frames say that the chain is the whole one."""
        return None if case != WHOLE and is_whole(done, case) else self.ablation.measured(case)

    def _time(self, engine: str, cases: list[str]) -> Any:
        """Every chain on NumPy; where each has to be compiled, the whole one and the plan's."""
        return partial(nanoseconds, self.ablation, engine, cases if engine == "numpy" else [WHOLE, PLAN])


def feature_key(feature: str, replicas: Replicas) -> str:
    """Under which a feature of the render is kept."""
    return f"render: seed {replicas.seed}: {feature}"


def _turns_s(engine: str, cases: int) -> float:
    """Expected for the timing of so many chains; a compiled engine has two, each with a kernel."""
    pixels, turns = SHAPE[engine][0] * SHAPE[engine][1], TURNS[engine] + 1
    if engine == "numpy":
        return 1e-9 * NUMPY_NS * pixels * turns * (cases + 1)
    return 2 * (COMPILE_S + 1e-9 * DRJIT_NS * pixels * turns * FRAMES_A_TURN)


def _study(work: Work, done: Mapping[str, Any]) -> Study:
    """All that there is to say, from the journal alone."""
    subject, replicas = work.subject, work.replicas
    sensor = ablation_page.page(gather(done, replicas, work.engines), replicas, work.tolerance_dn)
    features = [(name, done[feature_key(name, replicas)]) for name in done[SCENE]["features"]]
    render = render_ablation_page.page(features, done[SCENE]["missing"], done[NEEDS], work.tolerance_dn)
    size = f"{done[SCENE]['columns']} × {done[SCENE]['rows']}"
    name = os.path.splitext(os.path.basename(os.fspath(subject.scene)))[0]
    return Study(
        "left-out",
        f"What {name} and {subject.camera.name} can do without ({size} pixels, {subject.exposure.time_s:g} s, "
        f"{subject.exposure.temperature_k:g} K)",
        (*sensor.findings, *render.findings),
        sensor.passed and render.passed,
        (*sensor.parts, *render.parts),
        {
            "scene": os.fspath(subject.scene), "camera": subject.camera.name, "exposure": asdict(subject.exposure),
            "tolerance_dn": work.tolerance_dn, "replicas": {"devices": DEVICES, **asdict(replicas)},
            "spp": work.budget.asked, **sensor.data, **render.data,
        },
    )  # fmt: skip
