"""The sensor with one stage off at a time, and with all that the plan leaves out: in theory, in frames, in seconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.backend import Backend
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.sensor_window import SensorWindow
from ...core.signals import Photons
from ...sensor.camera import Camera
from ...sensor.chain import chain
from ...sensor.digital import IntegralNonlinearity
from ...sensor.electrons import FullWell
from ...sensor.noise_budget import stage_name
from ...sensor.plan import INDISPENSABLE, Plan, plan, without
from ...sensor.run import choose_backend, run_chain
from ...sensor.theory import final_moments, hidden_well
from ...sensor.volts import NonlinearSenseNode, NonlinearSourceFollower

WHOLE, PLAN = "whole chain", "the plan"

DEVICES = 64
"""Devices (serials) whose frames are measured: independent values, from whose spread the standard errors come."""

WORST = 0.01
"""Share of the pixels that are "the worst": those in which theory says that a chain moves most. One pixel alone has one
fixed pattern per device, and its variance would be known to a sixth at best."""

FEWEST_PIXELS = 16
"""That are the worst of a small picture."""

LOOKED_AT = 8
"""Frames, each of a device of its own, whose pixels are compared one by one with those of the whole chain."""

QUANTITIES = ("mean", "temporal σ", "fixed σ")
CURVED = (NonlinearSenseNode, NonlinearSourceFollower, IntegralNonlinearity)
NAMES = ("mean_dn", "temporal_dn2", "spatial_dn2")
"""Of the quantities as they are averaged: variances, not their roots."""

THEORY, EQUAL_WORDS = "sensor: theory", "sensor: equal words"
"""Keys of the journal."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Replicas:
    """What is repeated. frames : of each device.  seed, serial : of the first frame and of the first device."""

    frames: int
    seed: int
    serial: int

    def key(self, case: str) -> str:
        """Under which the frames of a chain are kept."""
        return f"sensor: {DEVICES} devices from {self.serial}, {self.frames} frames each, seed {self.seed}: {case}"


def case_names(camera: Camera) -> list[str]:
    """The chains that are looked at: the whole one, without each stage that may go, and the plan's."""
    return [WHOLE, *(stage_name(s) for s in chain(camera) if not isinstance(s, INDISPENSABLE)), PLAN]


@dataclass(eq=False)
class Ablation:
    """A camera, an exposure and a scene's light. light : gives the photons when they are first asked for."""

    camera: Camera
    exposure: Exposure
    light: Callable[[], Photons]
    tolerance_dn: float
    replicas: Replicas

    @cached_property
    def photons(self) -> Photons:
        """Mean photons of every pixel, taken as exact."""
        return replace(self.light(), variance_e2=None)

    @cached_property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of the picture."""
        return self.photons.mean.shape[:2]  # type: ignore[no-any-return]

    @cached_property
    def plan(self) -> Plan:
        """As :func:`mitsuba_sensor.plan` makes it for this light."""
        return plan(self.camera, self.exposure, self.photons, self.tolerance_dn)

    @cached_property
    def cases(self) -> dict[str, tuple[Any, ...]]:
        """Every chain, by its name."""
        whole = self.plan.whole
        off = {stage_name(s): without(whole, {s}) for s in whole if not isinstance(s, INDISPENSABLE)}
        return {WHOLE: whole, **off, PLAN: self.plan.stages}

    @property
    def backend(self) -> Backend:
        """NumPy in the precision that the plan asks for."""
        return choose_backend("numpy", self.plan.precision, 0)

    @cached_property
    def expected(self) -> dict[str, Array]:
        """Mean, temporal and fixed variance of every pixel by chain, (3, pixels) [DN, DN², DN²]."""
        frame = Frame(self.exposure, SensorWindow(0, self.shape, self.photons.origin))
        found = {}
        for case, stages in self.cases.items():
            m = final_moments(stages, self.photons, frame)[1]
            found[case] = np.array([np.broadcast_to(x, self.shape).ravel() for x in (m.mean, m.temporal, m.spatial)])
        return found

    def moved(self, case: str) -> Array:
        """By how far theory says that mean, temporal σ and fixed σ of every pixel move, (3, pixels) [DN]."""
        one, other = self.expected[WHOLE], self.expected[case]
        return np.abs(np.concatenate([one[:1] - other[:1], np.sqrt(one[1:]) - np.sqrt(other[1:])]))

    @cached_property
    def groups(self) -> dict[str, NDArray[np.intp]]:
        """Pixels whose averages are looked at: all, and by chain those that it moves most, the worst last."""
        pixels = self.expected[WHOLE].shape[1]
        count = min(max(int(WORST * pixels), FEWEST_PIXELS), pixels)
        found = {WHOLE: np.arange(pixels)}
        for case in list(self.cases)[1:]:
            moved = self.moved(case)
            most = moved[int(np.argmax(moved.max(axis=1)))]
            found[case] = np.argsort(most, kind="stable")[-count:]
        return found

    def theory(self) -> dict[str, Any]:
        """What the plan says, and the moments of every chain, averaged over groups of pixels."""
        cases: dict[str, Any] = {WHOLE: {"moments": self._averages(WHOLE, self.expected[WHOLE])}}
        for case in list(self.cases)[1:]:
            moved = self.moved(case)
            row, place = np.unravel_index(int(np.argmax(moved)), moved.shape)
            cases[case] = {
                "moments": self._averages(case, self.expected[case]),
                "worst_dn": float(moved[row, place]), "of": QUANTITIES[int(row)],
                "pixel": [int(x) for x in np.unravel_index(int(place), self.shape)],
                "worst_pixels": len(self.groups[case]),
            }  # fmt: skip
        return {
            "plan": [asdict(effect) for effect in self.plan.effects], "precision": self.plan.precision,
            "pixels": len(self.groups[WHOLE]), "limits": self._limits(), "cases": cases,
        }  # fmt: skip

    def _limits(self) -> list[str]:
        """Where the theory of this chain is known to be approximate."""
        whole = self.plan.whole
        found = ["counts are taken for a normal law where full well or converter cut them"]
        well = hidden_well(whole, Frame(self.exposure, SensorWindow(0, (1, 1))))
        if well is None and any(isinstance(stage, FullWell) for stage in whole):
            found.append(
                "full well and converter cut one after the other, and the second cut takes what is left of the "
                "first for a normal law"
            )
        if any(isinstance(stage, CURVED) for stage in whole):
            found.append("curved stages are taken to second order in the noise")
        return found

    def _averages(self, case: str, values: Array) -> dict[str, dict[str, float]]:
        """Of (3, pixels) over all pixels and the chain's worst; of the whole chain over the worst of every chain."""
        groups = self.groups if case == WHOLE else {WHOLE: self.groups[WHOLE], case: self.groups[case]}
        return {
            group: dict(zip(NAMES, (float(x) for x in values[:, pixels].mean(axis=1)), strict=True))
            for group, pixels in groups.items()
        }

    def equal_words(self) -> dict[str, dict[str, float]]:
        """Pixels of each chain's frames beside those of the whole chain that were drawn with the same words.

        share_of_pixels : that differ at all.  rms_dn, largest_dn : of the difference.
        """
        off: dict[str, list[Array]] = {case: [] for case in list(self.cases)[1:]}
        for number in range(LOOKED_AT):
            window, light = self._device(number)
            frames = {
                case: self._frame(stages, light, window, self.replicas.seed + number)
                for case, stages in self.cases.items()
            }
            for case, found in off.items():
                step = np.abs(frames[WHOLE] - frames[case])
                found.append(np.array([np.mean(step > 0), np.mean(step**2), step.max()]))
        return {
            case: {
                "share_of_pixels": float(np.mean([x[0] for x in found])),
                "rms_dn": float(np.sqrt(np.mean([x[1] for x in found]))),
                "largest_dn": float(np.max([x[2] for x in found])),
            }
            for case, found in off.items()
        }

    def measured(self, case: str) -> dict[str, dict[str, list[float]]]:
        """Mean, temporal and fixed variance of frames, averaged over groups of pixels: one value per device.

        Every frame is the first one of a seed of its own, so that blinking pixels are independent too. The fixed
        variance is the squared distance of the mean over the frames from its theory, less what the noise adds to it.
        """
        stages, count = self.cases[case], self.replicas.frames
        found: dict[str, dict[str, list[float]]] = {}
        for number in range(DEVICES):
            window, light = self._device(number)
            total, squares = np.zeros(self.shape), np.zeros(self.shape)
            for k in range(count):
                codes = self._frame(stages, light, window, self.replicas.seed + number * count + k)
                total += codes
                squares += codes**2  # whole numbers: exact
            mean, temporal = total / count, (squares - total**2 / count) / (count - 1)
            fixed = (mean.ravel() - self.expected[case][0]) ** 2 - temporal.ravel() / count
            for group, values in self._averages(case, np.array([mean.ravel(), temporal.ravel(), fixed])).items():
                lists = found.setdefault(group, {name: [] for name in NAMES})
                for name, value in values.items():
                    lists[name].append(value)
        return found

    def _device(self, number: int) -> tuple[SensorWindow, Any]:
        """One of the devices, and the electrons that it detects: as far as there, all chains are one."""
        window = SensorWindow(
            (self.replicas.serial + number) % 2**64, self.shape, self.photons.origin, backend=self.backend
        )
        return window, self.plan.whole[0](self.photons, Frame(self.exposure, window))

    def _frame(self, stages: tuple[Any, ...], light: Any, window: SensorWindow, seed: int) -> Array:
        """The first frame of a seed from electrons that are detected already, (H, W) [DN]."""
        frame = Frame(self.exposure, window, seed % 2**64)
        return np.asarray(run_chain(stages[1:], light, frame), dtype=np.float64)
