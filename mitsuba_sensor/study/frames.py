"""Frames of one camera under one scene's light: their moments in theory and measured, their pixels, their seconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons, Exposure, Frame, Photons, SensorWindow
from ..core.backend import Backend
from ..core.llvm import backend_problem, drjit
from ..sensor.camera import Camera
from ..sensor.detection import detect
from ..sensor.run import FrameRunner
from ..sensor.stage import Chain, converter_of, sample
from ..sensor.theory import Theory
from ..sensor.uncounted import theory_of
from .kit import Array, Numbers

QUANTITIES = ("mean", "temporal σ", "spatial σ")
BACKENDS = {"drjit": "llvm", "cuda": "cuda"}  # compiled engine → back end of Dr.Jit
FRAMES_A_TURN = 8  # of a compiled engine, which traces a frame while it computes the one before

Groups = Mapping[str, NDArray[np.intp]]  # indices of pixels in the flattened window


def problem_of(engine: str) -> str | None:
    """Why this engine is not on this machine, or None where it is."""
    return backend_problem(BACKENDS[engine]) if engine in BACKENDS else None


def resized(photons: Photons, shape: tuple[int, int]) -> Photons:
    """The same light on a window of another size, each pixel that of the nearest; without the render's variance."""
    sizes = zip(photons.mean.shape[:2], shape, strict=True)
    rows, columns = (np.linspace(0, there - 1, here).round().astype(int) for there, here in sizes)
    mean = np.ascontiguousarray(photons.mean[rows][:, columns])
    return replace(photons, mean=mean, variance_e2=None, in_band=None, origin=(0, 0))


def expected_moments(stages: Chain, photons: Photons, exposure: Exposure, rounded: bool = True) -> Array:
    """Mean, temporal and spatial variance of every pixel in theory, (3, H, W) [DN, DN², DN²], or before rounding."""
    shape = photons.mean.shape[0], photons.mean.shape[1]
    frame = Frame(exposure, SensorWindow(0, shape, photons.origin))
    light, theory = detect(photons, stages[0], frame).mean_e, _theory(tuple(stages), exposure)
    if rounded:
        return np.array(theory.digital(light.ravel())).reshape(3, *shape)
    converter = converter_of(stages)
    volts, gain = np.array(theory.behind(theory.stages[-2], light.ravel())).reshape(3, -1), converter.gain_dn_per_v
    analogue = volts * np.array([[gain], [gain**2], [gain**2]]) + np.array([[converter.black_level_dn], [0.0], [0.0]])
    return np.asarray(analogue.reshape(3, *shape))


@lru_cache(maxsize=8)  # settings of a study share their sensor
def _theory(stages: Chain, exposure: Exposure) -> Theory:
    return theory_of(stages, Frame(exposure, SensorWindow(0, (1, 1))))


def in_dn(moments: Array, other: Array) -> Array:
    """Change of mean, temporal σ and spatial σ from the other moments to these, (3, …) [DN]."""
    return np.concatenate([moments[:1] - other[:1], np.sqrt(moments[1:]) - np.sqrt(other[1:])])


def averages(moments: Array, groups: Groups) -> dict[str, Array]:
    """Mean and variances (3, H, W) of pixels, averaged over groups of them, (3,) each."""
    return {name: moments.reshape(3, -1)[:, pixels].mean(axis=1) for name, pixels in groups.items()}


class Replicas(NamedTuple):
    """Sensors of serial numbers ``serial``, ``serial`` + 1, …, and the frames of each: at least 2, of own seeds."""

    sensors: int
    frames: int
    seed: int
    serial: int = 1


@dataclass(frozen=True, eq=False)
class Illuminated:
    """A scene's light on a camera. photons : mean photons per pixel.  backend : who does the arithmetic."""

    photons: Photons
    camera: Camera
    exposure: Exposure
    backend: Backend

    def sensor(self, serial: int) -> SensorWindow:
        """The window of one sensor."""
        rows, columns = self.photons.mean.shape[:2]
        shape, origin, serial = (rows, columns), self.photons.origin, serial % 2**64
        return SensorWindow(serial, shape, origin, backend=self.backend, camera=self.camera.name)

    def electrons(self, stages: Chain, sensor: SensorWindow) -> Electrons:
        """Mean electrons that a sensor detects, from which frames of the stages behind the first one can start."""
        return stages[0].sample(self.photons, self.first(sensor))  # type: ignore[no-any-return]

    def first(self, sensor: SensorWindow, seed: int = 1) -> Frame:
        """Frame 0 of a sensor and seed."""
        return Frame(self.exposure, sensor, seed % 2**64, gain=self.camera.gain or "")

    def frame(self, stages: Chain, start: Electrons, sensor: SensorWindow, seed: int) -> Array:
        """The first frame of a seed, (H, W) [DN]; start : detected electrons."""
        codes = sample(stages[1:], start, self.first(sensor, seed))
        return np.asarray(codes, dtype=np.float64)

    def measured_moments(self, stages: Chain, replicas: Replicas, expected: Array, groups: Groups) -> dict[str, Array]:
        """Moments of frames averaged over groups of pixels, (3, sensors) each; every frame has a seed of its own."""
        count, found = replicas.frames, []
        for number in range(replicas.sensors):
            sensor = self.sensor(replicas.serial + number)
            start, total, squares = self.electrons(stages, sensor), np.zeros(sensor.shape), np.zeros(sensor.shape)
            for k in range(count):
                codes = self.frame(stages, start, sensor, replicas.seed + number * count + k)
                total += codes
                squares += codes**2  # whole numbers: exact
            mean, temporal = total / count, (squares - total**2 / count) / (count - 1)
            spatial = (mean - expected[0]) ** 2 - temporal / count  # from theory, less what the noise adds
            found.append(averages(np.array([mean, temporal, spatial]), groups))
        return {name: np.stack([values[name] for values in found], axis=1) for name in groups}


class Stream:
    """Frames of one sensor, kept going from turn to turn, so that maps and kernels are made once."""

    def __init__(self, stages: Chain, light: Illuminated) -> None:
        sensor, dtype = light.sensor(1), np.min_scalar_type(converter_of(stages).highest)
        first = light.first(sensor)
        run = FrameRunner(stages, detect(light.photons, stages[0], first), first)
        self._frames = run.frames(0, 2**31, lambda _: {"digital": np.empty(sensor.shape, dtype)})
        self._compiled = light.backend.compiled

    def __next__(self) -> Numbers:
        """The next frame, (H, W) [DN]."""
        return next(self._frames)["digital"]

    def turn(self) -> int:
        """The frames of one turn of a timing; how many. A kernel's work is waited for before another's turn."""
        count = FRAMES_A_TURN if self._compiled else 1
        for _ in range(count):
            next(self)
        if self._compiled:
            drjit().sync_thread()
        return count


def pixel_difference(frame: Numbers, reference: Numbers) -> dict[str, float]:
    """How far frames are from others drawn with equal random bits: share of pixels; rms and largest step [DN]."""
    step = np.abs(frame.astype(np.float64) - reference)
    rms_dn = float(np.sqrt(np.mean(step**2)))
    return {"share_of_pixels": float(np.mean(step > 0)), "largest_dn": float(step.max()), "rms_dn": rms_dn}
