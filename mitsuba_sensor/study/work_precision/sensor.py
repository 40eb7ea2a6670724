"""Error of the sensor's frames against their time: engine × precision × sampler × tolerance of the plan, measured."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import require
from ...core.exposure import Exposure
from ...core.signals import Photons
from ...sensor.camera import Camera
from ...sensor.chain import chain
from ...sensor.checks import as_photons
from ...sensor.plan import Plan, plan
from ..frames import (
    FRAMES_A_TURN,
    Illuminated,
    Replicas,
    Stages,
    Stream,
    averages,
    expected_moments,
    in_dn,
    pixel_difference,
    problem_of,
    resized,
)
from ..kit import Kit, Step, one_turn
from ..statistics import Array
from .samplers import EXACT, GAUSSIAN, GENERATOR, MEAN_ONLY, QUANTILE, REFERENCE, Setting, drawn_law

ENGINES = ("numpy", "drjit", "cuda")
TOLERANCES_DN = (0.0, 0.02, 0.2, 1.0, 5.0)  # of the plans that are tried
MEANS = (0.01, 0.1, 1.0, 10.0, 100.0, 1e4, 1e6)  # of the Poisson laws that are compared [events]
TURNS = 9  # in each of which every setting makes frames
LARGE = (1024, 1024)
"""Pixels of the frames that are timed and compared pixel by pixel: 1.05 Mpx, however small the render."""
SMALL = (128, 128)  # pixels of the frames whose moments are measured, on each sensor
REPLICAS = Replicas(sensors=32, frames=2, seed=2)
"""Each sensor has fixed patterns of its own, so the spread between them is the standard error."""
LEVELS = 5  # groups of equally many pixels, from the darkest to the brightest, whose moments are averaged
EXPECTED_NS = {"numpy float64": 450.0, "numpy float32": 120.0, "drjit float32": 15.0, "cuda float32": 2.0}
BAND_NS, OPENING_S, SHORT_S = 3.0, 0.5, 0.1
"""For the estimate before anything is measured, on two cores of an AMD EPYC: per pixel of each engine; per pixel and
band, where NumPy detects the light anew for every frame; of a stream's kernel and maps; of theory or one law."""


@dataclass(eq=False)
class Sensor:
    """A camera, an exposure and a scene's light, and what a kit measures of them.

    photons : mean photons of the scene, as :func:`collect` makes them; a render's variance in them is left out.
    Raises InputError for photons that ``expose`` would refuse and for a negative tolerance.
    """

    kit: Kit
    camera: Camera
    exposure: Exposure
    photons: Photons
    tolerances_dn: Sequence[float] = TOLERANCES_DN
    _streams: dict[str, Stream] = field(default_factory=dict)
    _made: dict[Any, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.photons = as_photons(self.photons, self.camera)
        for tolerance_dn in self.tolerances_dn:
            require("tolerances_dn", float(tolerance_dn), 0.0, float("inf"), "e.g. 0.02")

    def measure(self) -> None:
        """All that is not measured yet; what is timed comes first, while no other work has warmed a kernel."""
        self.kit.take([Step("engines", 0.1, lambda: {engine: problem_of(engine) for engine in ENGINES})])
        self.kit.take(Step(f"plan: {dn:g} DN", 0.1, partial(self._planned, dn)) for dn in self.tolerances_dn)
        try:
            self.kit.take([*self._timing(), *self._errors(), *self._laws()])
        finally:
            while self._streams:
                self._streams.popitem()[1].close()

    @property
    def settings(self) -> list[Setting]:
        """Every engine and sampler with the whole chain, then every plan: in float64 that is NumPy's alone."""
        here = [engine for engine, problem in self.kit["engines"].items() if problem is None]
        own = [Setting(engine, "float32", sampler) for sampler in (QUANTILE, GAUSSIAN, MEAN_ONLY) for engine in here]
        found = [REFERENCE, *own, Setting("numpy", "float32", GENERATOR)]
        for dn in self.tolerances_dn:
            if self.kit[f"plan: {dn:g} DN"]["precision"] == "float64":
                found.append(Setting("numpy", "float64", EXACT, dn))
            else:
                found += [Setting(engine, "float32", QUANTILE, dn) for engine in here]
        return found

    def _timing(self) -> Iterator[Step]:
        settings = self.settings
        for setting in settings:
            yield Step(f"first frame: {setting.name}", OPENING_S + self._seconds(setting), partial(self.first, setting))
        turn_s = sum((FRAMES_A_TURN if one.compiled else 1) * self._seconds(one) for one in settings)
        for turn in range(TURNS):
            yield Step(f"turn {turn + 1} of {TURNS}, frames of every setting", turn_s, partial(self.turn, turn))

    def _errors(self) -> Iterator[Step]:
        """Frames against the reference: pixels with equal random bits, moments, and what theory says of them."""
        settings = self.settings
        for dn in dict.fromkeys(setting.tolerance_dn for setting in settings):
            yield Step(theory_key(dn), SHORT_S, partial(self.theory, dn))
        for setting in settings:
            if setting.sampler != GENERATOR:  # its counts do not come from the same bits
                yield Step(f"pixels: {setting.name}", 2 * self._seconds(setting), partial(self.pixels, setting))
            if not setting.compiled:
                frames = REPLICAS.sensors * REPLICAS.frames * SMALL[0] * SMALL[1] / (LARGE[0] * LARGE[1])
                yield Step(f"moments: {setting.name}", frames * self._seconds(setting), partial(self.moments, setting))

    def _laws(self) -> Iterator[Step]:
        for setting in self.settings:
            for mean in MEANS if setting.tolerance_dn is None else ():
                measure: Callable[[], Any] = partial(drawn_law, setting, mean)
                yield Step(f"Poisson law, mean {mean:g}: {setting.name}", SHORT_S, measure)

    def _seconds(self, setting: Setting) -> float:
        """Expected of one large frame."""
        bands = 0 if self.photons.mean.ndim == 2 or setting.compiled else self.photons.mean.shape[2]
        ns = EXPECTED_NS[f"{setting.engine} {setting.precision}"] + BAND_NS * bands
        return 1e-9 * ns * LARGE[0] * LARGE[1]

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """What ``make`` gives, made once."""
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def stages(self, tolerance_dn: float | None) -> Stages:
        """What a plan left of the chain; None: the whole chain."""
        return chain(self.camera) if tolerance_dn is None else self._plan(tolerance_dn).stages

    def _plan(self, tolerance_dn: float) -> Plan:
        make = partial(plan, self.camera, self.exposure, self.photons, tolerance_dn)
        found: Plan = self.once(("plan", tolerance_dn), make)
        return found

    def _planned(self, tolerance_dn: float) -> dict[str, Any]:
        """What the plan leaves out, and the precision that it asks for."""
        found = self._plan(tolerance_dn)
        kept = {stage.label for stage in found.stages}
        left_out = [name for stage in found.whole if (name := stage.label) not in kept]
        return {"left_out": left_out, "stages": len(found.whole), "precision": found.precision}

    def illuminated(self, setting: Setting, shape: tuple[int, int]) -> Illuminated:
        """The scene's light on a window of this size, for the setting's engine."""
        photons = self.once(("light", shape), partial(resized, self.photons, shape))
        return Illuminated(photons, self.exposure, setting.backend())

    def _stream(self, setting: Setting) -> Stream:
        return self.illuminated(setting, LARGE).stream(self.stages(setting.tolerance_dn))

    def first(self, setting: Setting) -> float:
        """Seconds until the first frame: light, maps and, unless Dr.Jit has it already, the kernel."""
        start = time.perf_counter()
        self._streams[setting.name] = self._stream(setting)
        next(self._streams[setting.name])
        return time.perf_counter() - start

    def turn(self, number: int) -> dict[str, float]:
        """Seconds of a frame of each setting."""
        for setting in self.settings:
            if setting.name not in self._streams:  # resumed: its first frame was timed before
                self.first(setting)
        return one_turn({setting.name: self._streams[setting.name].turn for setting in self.settings}, number)

    def frame(self, setting: Setting) -> NDArray[Any]:
        """The first large frame (H, W) [DN]."""
        stream = self._stream(setting)
        try:
            return next(stream)
        finally:
            stream.close()

    def pixels(self, setting: Setting) -> dict[str, float]:
        """One frame against the reference's; share_of_numpy : of the pixels that differ from NumPy float32."""
        frame, reference = self.frame(setting), self.once("reference", partial(self.frame, REFERENCE))
        twin = self.frame(replace(setting, engine="numpy")) if setting.compiled else frame
        return {**pixel_difference(frame, reference), "share_of_numpy": float(np.mean(frame != twin))}

    def _expected(self, tolerance_dn: float | None) -> Array:
        photons = self.once(("light", SMALL), partial(resized, self.photons, SMALL))
        make = partial(expected_moments, self.stages(tolerance_dn), photons, self.exposure)
        found: Array = self.once(("theory", tolerance_dn), make)
        return found

    @cached_property
    def groups(self) -> dict[str, NDArray[np.intp]]:
        """The pixels of each light level: places in the flattened small window."""
        order = np.argsort(self._expected(None)[0], axis=None, kind="stable")
        return {f"level {k + 1}": group for k, group in enumerate(np.array_split(order, LEVELS))}

    def theory(self, tolerance_dn: float | None) -> dict[str, Any]:
        """Moments of each light level, and what leaving stages out changes at most in any pixel [DN]."""
        expected = self._expected(tolerance_dn)
        worst_dn = float(np.abs(in_dn(expected, self._expected(None))).max())
        return {"levels": averages(expected, self.groups), "worst_pixel_dn": worst_dn}

    def moments(self, setting: Setting) -> dict[str, dict[str, list[float]]]:
        """Of frames on the host, by light level and moment, one value per sensor.

        Equal random bits in all settings make the differences between settings far better known than the values.
        """
        stages, expected = self.stages(setting.tolerance_dn), self._expected(setting.tolerance_dn)
        return self.illuminated(setting, SMALL).measured_moments(stages, REPLICAS, expected, self.groups)


def theory_key(tolerance_dn: float | None) -> str:
    """Under which the moments in theory of a plan, or of the whole chain, are kept."""
    return "theory: " + ("whole chain" if tolerance_dn is None else f"plan {tolerance_dn:g} DN")
