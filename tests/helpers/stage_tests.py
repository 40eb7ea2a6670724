"""Shared tests of a stage: samples against its moments, equal bytes on both float32 backends, crops, neutral values.

A test file of an effect, or of a stage of one's own, inherits :class:`StageTests` and says which stage and camera::

    class TestBanding(StageTests):
        stage = Banding
        camera = BASE.with_stage(Banding(0.001), after="reset_noise")
        without = BASE
        neutral = (Banding(0.0),)
        shape = TALL

Everything is seeded. A comparison of a sample with its moments asks for agreement within 5 standard errors, estimated
from the spread of 64 blocks of the window: chance fails one in 200 000 comparisons (P(|t₆₃| > 5) = 5e-6).
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

import mitsuba_sensor as ms
from helpers.marks import exhaustive
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.sensor.run import choose_backend
from mitsuba_sensor.stages.chain import chain

WIDE, TALL, SQUARE = (2, 100_000), (100_000, 2), (480, 480)
"""Windows with many columns, with many rows, or with neighbours both ways (for maps that correlate). 200 000 pixels in
3 frames: 5 standard errors are 1.1 % of a temporal and 2.2 % of a column variance (0.6 and 1.1 % of a σ)."""

FRAMES = (0, 100, 200)
"""So far apart that an RTS pixel has forgotten its state: 0.8^100 = 2e-10."""

EXPOSURE = ms.Exposure(0.1)
CORNER, PART = (3, 5), (9, 11)
"""First pixel and shape of the crop; odd, so that a colour filter mosaic begins with another filter."""

EXACT = {"float64": 1e-9, "float32": 3e-7}
"""Relative error of what is not random at all: of the closed forms, and of a float32."""

ENGINES = ("float64", exhaustive("numpy"), exhaustive("drjit"))
"""In float32 the quick tests have a camera with every effect, whose bytes are those of NumPy on Dr.Jit."""

Signal = Any
Sampled = tuple[NDArray[Any], ...]


@functools.cache
def backend_of(name: str) -> Backend:
    """float64, numpy (float32) or drjit; a skip where this machine has no LLVM."""
    if name == "drjit" and (problem := backend_problem("llvm")):
        pytest.skip(problem)
    return {"float64": NUMPY_FLOAT64, "numpy": NUMPY_FLOAT32}.get(name) or choose_backend(
        name, "float32", 0
    )


def photons(camera: ms.Camera, level: float, shape: tuple[int, int]) -> ms.Photons:
    """Uniform light that fills ``level`` of the well of the most sensitive filter, at the camera's own wavelength."""
    section = camera.quantum_efficiency
    electrons_per_photon = (
        camera.qe([section.reference_nm]).max() * (section.quantum_yield or (1.0,))[0]
    )
    return ms.Photons(np.full(shape, level * camera.pixel.full_well_e / electrons_per_photon))


def dark_to_saturation(camera: ms.Camera, shape: tuple[int, int]) -> ms.Photons:
    """Light from 0 to 1.1 full wells: half of the pixels below 1/8 of the well."""
    ramp = np.linspace(0.0, 1.1, shape[0] * shape[1]).reshape(shape) ** 3
    return ms.Photons(photons(camera, 1.0, shape).mean * ramp)


def apply(stage: Any, signal: Signal, frame: ms.Frame) -> Signal:
    """The signal behind the stage."""
    return stage.sample(signal, frame)


def arrays_of(signal: Signal, frame: ms.Frame) -> Sampled:
    """What the stage hands on, as NumPy arrays (H, W): light and dark electrons apart."""
    parts = (signal.light, signal.dark) if isinstance(signal, ms.Electrons) else (signal,)
    return tuple(np.array(frame.window.backend.to_numpy(part, frame.window)) for part in parts)


@dataclass(frozen=True)
class Step:
    """A stage, its samples in each of FRAMES in float64, (3, H, W), and the moments that it states."""

    stage: Any
    samples: NDArray[np.float64]
    theory: ms.Moments


@functools.cache
def frames_of(name: str, shape: tuple[int, int]) -> tuple[ms.Frame, ...]:
    """The same three frames of one camera for every case: they remember their random bits, half of the time."""
    window = SensorWindow(7, shape, backend=backend_of(name))
    return tuple(ms.Frame(EXPOSURE, window, 5, index) for index in FRAMES)


def steps(camera: ms.Camera, light: ms.Photons, engine: str) -> Iterator[Step]:
    """Every stage that does something, as far as all state moments; one that hands on what it got states those."""
    shape = light.mean.shape[:2]
    frames = frames_of(engine, shape)
    signals: list[Signal] = [light] * len(frames)
    moments = ms.Moments(light, 0.0, 0.0, frames_of("float64", shape)[0])
    for stage in chain(camera):
        if type(stage).moments is ms.Stage.moments:
            return
        before, signals = (
            signals,
            [
                apply(stage, signal, frame)
                for signal, frame in zip(signals, frames, strict=True)
            ],
        )
        previous, moments = moments, stage.moments(moments)
        if all(new is old for new, old in zip(signals, before, strict=True)):
            assert same(previous, moments), f"{stage} changes no signal, but the moments"
            continue
        samples = [
            sum(arrays_of(signal, frame)) for signal, frame in zip(signals, frames, strict=True)
        ]
        yield Step(stage, np.array(samples, np.float64), moments)


def same(a: ms.Moments, b: ms.Moments) -> bool:
    """Whether mean and both variances are equal to the last bit."""
    pairs = [(getattr(a, part), getattr(b, part)) for part in ("mean", "temporal", "spatial")]
    return all(
        np.array_equal(*np.broadcast_arrays(np.asarray(x), np.asarray(y))) for x, y in pairs
    )


def blocks(x: Any, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Averages over 64 blocks of the window."""
    whole = np.broadcast_to(x, shape)
    if shape[0] == shape[1]:
        side = shape[0] // 8
        return whole[: 8 * side, : 8 * side].reshape(8, side, 8, side).mean(axis=(1, 3)).ravel()
    long = whole if shape[0] < shape[1] else whole.T
    return long[:, : long.shape[1] // 64 * 64].reshape(len(long), 64, -1).mean(axis=(0, 2))


def assert_agrees(
    what: str, deviation: Any, scale: float, shape: tuple[int, int], exact: float
) -> None:
    """The deviation averages to 0 within 5 standard errors, and ``exact`` of ``scale``."""
    parts = blocks(deviation, shape)
    error = 5 * parts.std(ddof=1) / 8 + exact * scale
    assert abs(parts.mean()) <= error, (
        f"{what}: off by {parts.mean():.4g} ± {error:.2g} of {scale:.4g}"
    )


def assert_step_agrees(step: Step, engine: str) -> None:
    """Mean, temporal and spatial variance of the samples behind a stage against its moments."""
    x, theory, shape = step.samples, step.theory, step.samples.shape[1:]
    mean, temporal, off = x.mean(axis=0), x.var(axis=0, ddof=1), x.mean(axis=0) - theory.mean
    exact = EXACT["float64" if engine == "float64" else "float32"]
    size = float(np.max(theory.mean))
    variance = float(np.mean(theory.temporal) + np.mean(theory.spatial)) + exact * size**2
    spatial = off**2 - temporal / len(x)
    assert np.isfinite(mean).all()
    assert_agrees(f"mean after {step.stage}", off, size, shape, exact)
    assert_agrees(
        f"temporal variance after {step.stage}",
        temporal - theory.temporal,
        variance,
        shape,
        exact,
    )
    assert_agrees(
        f"spatial variance after {step.stage}", spatial - theory.spatial, variance, shape, exact
    )


def behind_every_stage(
    camera: ms.Camera, light: ms.Photons, frame: ms.Frame
) -> dict[str, Sampled]:
    """What each stage hands on in one frame, by the name of its class."""
    signal: Signal = light
    out = {}
    for stage in chain(camera):
        signal = apply(stage, signal, frame)
        out[type(stage).__name__] = arrays_of(signal, frame)
    return out


def assert_equal(one: Sampled, other: Sampled) -> None:
    """Bit for bit."""
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


class StageTests:
    """What every stage must pass.

    stage : its class.  camera : one whose chain holds it.  without : the same camera with the effect off, or the
        fields of the camera that switch it off; None where no camera can do without it.
    neutral : stages of this class that do nothing.  level, shape : light of the statistics [full wells], window.
    """

    stage: ClassVar[type]
    camera: ClassVar[ms.Camera]
    without: ClassVar[ms.Camera | dict[str, Any] | None] = None
    neutral: ClassVar[tuple[Any, ...]] = ()
    level: ClassVar[float] = 0.3
    shape: ClassVar[tuple[int, int]] = WIDE
    to_saturation: ClassVar[tuple[int, int]] = (37, 91)

    def __init_subclass__(cls) -> None:
        """Only what a stage can be asked is collected."""
        if cls.without is None:
            cls.test_switched_off_it_leaves_the_random_numbers_of_every_other_stage = None  # type: ignore[assignment]
        if not cls.neutral:
            cls.test_a_neutral_value_changes_nothing = None  # type: ignore[assignment]

    @pytest.mark.parametrize("engine", ENGINES)
    def test_its_samples_have_the_moments_that_it_states(self, engine: str) -> None:
        """Behind the stage and behind every one after it that states moments."""
        backend_of(engine)
        behind = False
        for step in steps(self.camera, photons(self.camera, self.level, self.shape), engine):
            behind |= isinstance(step.stage, self.stage)
            if behind:
                assert_step_agrees(step, engine)
        assert behind, (
            f"no {self.stage.__name__} in the chain of this camera, or it does nothing"
        )

    def test_numpy_in_float32_and_drjit_give_the_same_bytes(self) -> None:
        """Behind every stage, from darkness to saturation, in two frames."""
        light = dark_to_saturation(self.camera, self.to_saturation)
        for index in (0, 3):
            one, other = (
                behind_every_stage(self.camera, light, self.frame_on(backend_of(engine), index))
                for engine in ("numpy", "drjit")
            )
            for name, values in one.items():
                assert_equal(values, other[name])

    @pytest.mark.parametrize("engine", ENGINES)
    def test_a_crop_of_a_frame_is_the_frame_of_the_crop(self, engine: str) -> None:
        """Behind the stage; frame 3 alone is frame 3 after others, too."""
        light, backend = dark_to_saturation(self.camera, self.to_saturation), backend_of(engine)
        rows, columns = (
            slice(start, start + size) for start, size in zip(CORNER, PART, strict=True)
        )
        window = SensorWindow(7, self.to_saturation, (100, 40), backend=backend)
        for index in (1, 3):
            whole = behind_every_stage(self.camera, light, ms.Frame(EXPOSURE, window, 5, index))
        part = SensorWindow(7, PART, (100 + CORNER[0], 40 + CORNER[1]), backend=backend)
        cropped = behind_every_stage(
            self.camera, ms.Photons(light.mean[rows, columns]), ms.Frame(EXPOSURE, part, 5, 3)
        )
        name = self.stage.__name__
        assert_equal(cropped[name], tuple(values[rows, columns] for values in whole[name]))

    def test_switched_off_it_leaves_the_random_numbers_of_every_other_stage(self) -> None:
        """Each other stage, given the same signal, does the same to the last bit whether this one is there or not."""
        without = (
            self.camera.replace(**self.without)
            if isinstance(self.without, dict)
            else self.without
        )
        camera, rest = (
            one.replace(**{"adc.black_level_dn": 64.0}) for one in (self.camera, without)
        )
        others = {type(stage): stage for stage in chain(rest)}
        signal: Signal = dark_to_saturation(camera, self.to_saturation)
        frame, other = (self.frame_on(NUMPY_FLOAT64, 3) for _ in range(2))
        for stage in chain(camera):
            after = apply(stage, signal, frame)
            if not isinstance(stage, self.stage):
                assert_equal(
                    arrays_of(after, frame),
                    arrays_of(apply(others[type(stage)], signal, other), other),
                )
            signal = after

    def test_a_neutral_value_changes_nothing(self) -> None:
        """Bit for bit: the signal, and the moments."""
        position = [isinstance(stage, self.stage) for stage in chain(self.camera)].index(True)
        signal: Signal = dark_to_saturation(self.camera, self.to_saturation)
        frame = self.frame_on(NUMPY_FLOAT64, 0)
        moments = ms.Moments(signal, 0.0, 0.0, frame)
        for stage in chain(self.camera)[:position]:
            signal, moments = apply(stage, signal, frame), stage.moments(moments)
        for stage in self.neutral:
            assert_equal(
                arrays_of(apply(stage, signal, frame), frame), arrays_of(signal, frame)
            )
            assert same(stage.moments(moments), moments)

    def frame_on(self, backend: Backend, index: int) -> ms.Frame:
        """A new frame of a new window, which remembers nothing."""
        return ms.Frame(
            EXPOSURE, SensorWindow(7, self.to_saturation, (100, 40), backend=backend), 5, index
        )
