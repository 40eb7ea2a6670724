"""Frames of one camera under one scene's light, made in many settings: their pixels, their moments, their theory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.signals import Photons
from ...sensor.camera import Camera
from ...sensor.chain import chain
from ...sensor.noise_budget import stage_name
from ...sensor.plan import Plan, plan
from ...sensor.run import Run, run_chain
from ...sensor.theory import final_moments
from .samplers import EXACT, QUANTILE, Setting

LARGE = (1024, 1024)
"""Pixels of the frames that are timed and compared pixel by pixel: 1.05 Mpx, however small the render."""

SMALL = (128, 128)
"""Pixels of the frames whose moments are measured, on each device."""

DEVICES = 32
"""Devices (serial numbers) of the moments: each has patterns of its own, so their spread is the standard error."""

LEVELS = 5
"""Groups of equally many pixels, from the darkest to the brightest, whose moments are looked at."""

REFERENCE = Setting("numpy", "float64", EXACT)
"""What all others are compared with: the whole chain, every law exact."""


@dataclass(eq=False)
class Chains:
    """A camera, an exposure and a scene's light; what was made of them stays."""

    camera: Camera
    exposure: Exposure
    photons: Photons
    _plans: dict[float, Plan] = field(default_factory=dict)
    _theory: dict[float | None, Moments] = field(default_factory=dict)

    def plan(self, tolerance_dn: float) -> Plan:
        """As :func:`mitsuba_sensor.plan` makes it for the scene."""
        if tolerance_dn not in self._plans:
            self._plans[tolerance_dn] = plan(self.camera, self.exposure, self.photons, tolerance_dn)
        return self._plans[tolerance_dn]

    def stages(self, tolerance_dn: float | None) -> tuple[Any, ...]:
        """What that plan left of the chain; None: the whole chain."""
        return chain(self.camera) if tolerance_dn is None else self.plan(tolerance_dn).stages

    @cached_property
    def large(self) -> Photons:
        """The scene's light on the frames that are timed."""
        return filled(self.photons, LARGE)

    @cached_property
    def small(self) -> Photons:
        """The scene's light on the frames whose moments are measured."""
        return filled(self.photons, SMALL)

    @cached_property
    def reference_frame(self) -> NDArray[np.int64]:
        """What all frames (H, W) are compared with [DN]."""
        return self.frame(REFERENCE)

    def frames(self, setting: Setting, count: int) -> Iterator[NDArray[Any]]:
        """Frames (H, W) of the large window [DN], one after the other; close it to let the threads go."""
        stages, window = self.stages(setting.tolerance_dn), SensorWindow(1, LARGE, backend=setting.backend())
        dtype = np.min_scalar_type(stages[-1].highest)
        run = Run(stages, self.large, Frame(self.exposure, window))
        for sinks in run.frames(0, count, lambda _: {"digital": np.empty(LARGE, dtype)}):
            yield sinks["digital"]

    def frame(self, setting: Setting) -> NDArray[np.int64]:
        """The first of them."""
        (only,) = self.frames(setting, 1)
        return only.astype(np.int64)

    def theory(self, tolerance_dn: float | None) -> Moments:
        """Moments of every pixel of the small window [DN]."""
        if tolerance_dn not in self._theory:
            _, m = final_moments(self.stages(tolerance_dn), self.small, Frame(self.exposure, SensorWindow(0, SMALL)))
            mean, temporal, fixed = (np.broadcast_to(x, SMALL) for x in (m.mean, m.temporal, m.spatial))
            self._theory[tolerance_dn] = replace(m, mean=mean, temporal=temporal, spatial=fixed)
        return self._theory[tolerance_dn]

    @cached_property
    def groups(self) -> list[NDArray[np.intp]]:
        """The pixels of each light level: places in the flattened small window."""
        return np.array_split(np.argsort(self.theory(None).mean, axis=None, kind="stable"), LEVELS)

    def by_level(self, values: Any) -> list[float]:
        """The mean over the pixels of each level."""
        return [float(np.mean(np.ravel(values)[group])) for group in self.groups]


def filled(photons: Photons, shape: tuple[int, int]) -> Photons:
    """The same light on a window of another size, each pixel that of the nearest; without the render's variance."""
    rows, columns = (
        np.linspace(0, there - 1, here).round().astype(int)
        for there, here in zip(photons.mean.shape[:2], shape, strict=True)
    )
    mean = np.ascontiguousarray(photons.mean[rows][:, columns])
    return replace(photons, mean=mean, variance_e2=None, origin=(0, 0))


def difference(chains: Chains, setting: Setting) -> dict[str, float]:
    """How far one large frame is from the reference's with equal words.

    share_of_pixels : that differ at all.  largest_dn, rms_dn : of the difference.
    share_of_numpy : of the pixels that differ from NumPy float32 in the same setting; 0 for that itself and float64.
    """
    frame = chains.frame(setting)
    off = frame - chains.reference_frame
    twin = chains.frame(replace(setting, engine="numpy")) if setting.compiled else frame
    return {
        "share_of_pixels": float(np.mean(off != 0)),
        "largest_dn": float(np.abs(off).max()),
        "rms_dn": float(np.sqrt(np.mean(off.astype(np.float64) ** 2))),
        "share_of_numpy": float(np.mean(frame != twin)),
    }


def predicted(chains: Chains, tolerance_dn: float | None) -> dict[str, Any]:
    """Theory of each light level [DN], and what the whole chain changes at most in any pixel if it is cut so [DN]."""
    m, whole = chains.theory(tolerance_dn), chains.theory(None)
    roots = [(np.sqrt(getattr(m, part)), np.sqrt(getattr(whole, part))) for part in ("temporal", "spatial")]
    worst = [float(np.max(np.abs(one - other))) for one, other in ((m.mean, whole.mean), *roots)]
    return {
        "mean_dn": chains.by_level(m.mean),
        "temporal_dn2": chains.by_level(m.temporal),
        "spatial_dn2": chains.by_level(m.spatial),
        "worst_pixel_dn": dict(zip(("mean", "temporal", "fixed"), worst, strict=True)),
    }


def measured(chains: Chains, setting: Setting) -> dict[str, list[list[float]]]:
    """Mean, temporal and fixed variance of frames by device and light level, on the host.

    Each device makes two frames with seeds of their own. Half the squared difference is the temporal variance, the
    product of the distances from the theoretical mean the fixed one. Equal words in all settings make the differences
    between settings far better known than the values.
    """
    stages, backend, expected = (
        chains.stages(setting.tolerance_dn),
        setting.backend(),
        chains.theory(setting.tolerance_dn),
    )
    found: dict[str, list[list[float]]] = {"mean_dn": [], "temporal_dn2": [], "spatial_dn2": []}
    for serial in range(1, DEVICES + 1):
        window = SensorWindow(serial, SMALL, backend=backend)
        one, other = (
            np.asarray(run_chain(stages, chains.small, Frame(chains.exposure, window, seed)), dtype=np.float64)
            for seed in (2 * serial, 2 * serial + 1)
        )
        found["mean_dn"].append(chains.by_level(0.5 * (one + other)))
        found["temporal_dn2"].append(chains.by_level(0.5 * (one - other) ** 2))
        found["spatial_dn2"].append(chains.by_level((one - expected.mean) * (other - expected.mean)))
    return found


def planned(chains: Chains, tolerance_dn: float) -> dict[str, Any]:
    """What the plan leaves out, and the precision that it asks for."""
    found = chains.plan(tolerance_dn)
    kept = {stage_name(stage) for stage in found.stages}
    return {
        "left_out": [name for stage in found.whole if (name := stage_name(stage)) not in kept],
        "stages": len(found.whole),
        "precision": found.precision,
    }


def plan_settings(tolerance_dn: float, precision: str, engines: list[str]) -> list[Setting]:
    """What the product offers for a plan: in float64 NumPy alone, in float32 every engine."""
    if precision == "float64":
        return [Setting("numpy", precision, EXACT, tolerance_dn)]
    return [Setting(engine, precision, QUANTILE, tolerance_dn) for engine in engines]
