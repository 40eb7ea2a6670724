"""Test of a user's stage: check_stage()."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from ..camera.camera import Camera
from ..camera.camera_file import AnyCamera, camera_of
from ..camera.figures import refuse_readouts
from ..core import (
    Array,
    Electrons,
    Exposure,
    Float64Array,
    Frame,
    InputError,
    SensorWindow,
    check_types,
    require,
)
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend
from ..core.llvm import backend_problem
from ..sensor.run import choose_backend
from ..stages.effects.dark_current import mean_dark_e
from ..stages.stage import UNITS, Stage, place_of, total
from .report import error_of_root

PAIRS, SIDE_PX, FRAMES = 16, 64, 2**20
"""Pairs of sensor units, side of their windows [px], and range of frame numbers. Two frame numbers are drawn at random
for each unit, which reveals an effect of any period."""

ERRORS = 5.0
"""Allowed deviation in standard errors; a right stage exceeds it with probability 2e-4 (Student's t, 16 pairs)."""

LEVELS = {"dim": 0.02, "bright": 0.3}
"""Input signals, as fractions of the full well."""

Stated: TypeAlias = float | Callable[[float], float] | None
QUANTITIES = ("mean", "temporal σ", "spatial σ")


class StageFigure(NamedTuple):
    """A measured number of a stage, in its unit.

    signal : name of the input signal.  error : standard error.  stated : value that the user stated, or None.
    """

    signal: str
    quantity: str
    measured: float
    error: float
    stated: float | None


@dataclass(frozen=True)
class StageCheck:
    """Measurements of :func:`check_stage`; ``print(check.explain())`` shows them as a table."""

    stage: str
    unit: str
    figures: tuple[StageFigure, ...]

    def explain(self) -> str:
        """Return a table for people."""
        lines = [
            f"{self.stage}: reproducible, equal in a crop and on every engine, always finite [{self.unit}]",
            f"{'signal':<8}{'quantity':<12}{'measured':>12}{'±':>10}{'stated':>12}",
        ]
        for one in self.figures:
            stated = "" if one.stated is None else f"{one.stated:.5g}"
            numbers = f"{one.measured:>12.5g}{one.error:>10.2g}{stated:>12}"
            lines.append(f"{one.signal:<8}{one.quantity:<12}{numbers}".rstrip())
        return "\n".join(lines)


def check_stage(
    stage: Stage,
    *,
    camera: AnyCamera,
    after: str | None = None,
    exposure: Exposure | None = None,
    mean: Stated = None,
    temporal: Stated = None,
    spatial: Stated = None,
) -> StageCheck:
    """Sample a stage and test what the rest of the package relies on.

    ::

        print(ms.check_stage(Hum(1e-4), camera=camera, after="reset_noise", temporal=1e-4).explain())

    stage : your stage, or a stage of the camera.
    after : key of the stage before it, as for ``camera.with_stage``; None for a stage in the chain of this camera.
    exposure : time and temperature. Default: 0.1 s.
    mean, temporal, spatial : your statement of the mean after the stage, of the σ of one pixel from frame to frame, and
        of its σ from sensor unit to sensor unit: a number, or a function of the input signal [unit of the stage].
    A repeated frame must be equal. A crop of a frame must equal the frame of the crop, except ``reach_px`` pixels at
    its edges. Compiled engines must give the bytes of NumPy in float32, and all signals must be finite. Means and σ of
    a uniform signal are measured with standard errors; statements must agree within 5 of them.
    Raises InputError if a test fails.
    """
    camera = camera_of(camera)
    exposure = Exposure(0.1) if exposure is None else exposure
    check_types(camera, exposure)
    refuse_readouts(camera, "a stage is tested in one readout")
    chain = camera.stages if after is None else camera.with_stage(stage, after=after).stages
    place = place_of(stage, chain) if any(stage is one for one in chain) else 0
    name, figures = type(stage).__name__, list[StageFigure]()
    if place == 0 or stage.domain == "DN":
        raise InputError(
            f"{name} is not between the first and the last stage of {camera.name}; give its place, e.g. "
            "after='dark_current', or pass one of camera.stages[1:-1]."
        )
    gain = math.prod(one.nominal_gain for one in chain[1:place])
    dark_e, are_electrons = (
        mean_dark_e(camera, exposure),
        chain[place - 1].domain == "electrons",
    )
    trial = Trial(stage, camera, exposure, are_electrons, gain * dark_e)
    lights = [gain * share * camera.pixel.full_well_e for share in LEVELS.values()]
    trial.check_samples(lights[-1])
    for level, light, found in zip(LEVELS, lights, trial.measured(lights), strict=True):
        for quantity, said, (number, error) in zip(
            QUANTITIES, (mean, temporal, spatial), found, strict=True
        ):
            stated = said(light + trial.dark) if callable(said) else said
            if stated is not None:
                what = f"in {UNITS[stage.domain]}, or a function that returns one, e.g. 1e-4"
                stated = require(f"the stated {quantity}", stated, -1e30, 1e30, what)
            power = 1 if quantity == QUANTITIES[0] else 2  # variances are measured, not σ
            root = number if power == 1 else math.sqrt(max(number, 0.0))
            of_root = error if power == 1 else error_of_root(root**2, error)
            figures.append(StageFigure(level, quantity, root, of_root, stated))
            if stated is not None:
                rounding = 1e-6 * abs(stated) ** power + abs(1e-9 * found[0][0]) ** power
                if not abs(number - stated**power) <= ERRORS * error + rounding:
                    raise InputError(
                        f"{name} has the {quantity} {root:.6g} ± {of_root:.2g} {UNITS[stage.domain]} in a {level} "
                        f"signal, but {stated:.6g} is stated; correct sample(), or the statement."
                    )
    return StageCheck(name, UNITS[stage.domain], tuple(figures))


@dataclass(frozen=True, eq=False)
class Trial:
    """A uniform signal through one stage.

    are_electrons : True if the input is Electrons.  dark : dark part of the signal, in its unit.
    """

    stage: Stage
    camera: Camera
    exposure: Exposure
    are_electrons: bool
    dark: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a window."""
        sensor = self.camera.sensor
        return min(SIDE_PX, sensor.rows), min(SIDE_PX, sensor.columns)

    def window(
        self,
        backend: Backend,
        serial: int,
        origin: tuple[int, int],
        shape: tuple[int, int] | None = None,
    ) -> SensorWindow:
        """Return a window of one sensor unit."""
        size = shape or self.shape
        return SensorWindow(serial, size, origin, backend=backend, camera=self.camera.name)

    def sample(self, frame: Frame, light: float, pattern: bool = False) -> Float64Array:
        """Return the signal after the stage in one frame, shape (H, W). Raises InputError unless it is finite.

        pattern : True for an input that differs from pixel to pixel.
        """
        window = frame.window
        backend = window.backend
        uneven = np.sin(1.7 * window.rows[:, None] + 2.3 * window.columns) if pattern else 0.0
        parts = (
            backend.from_numpy(np.full(window.shape, x) * (1 + 0.1 * uneven), window)
            for x in (light, self.dark)
        )
        signal: Array = Electrons(*parts) if self.are_electrons else sum(parts)
        output = backend.to_numpy(total(self.stage.sample(signal, frame)), window)
        found = np.array(np.broadcast_to(output, window.shape), np.float64)
        if not np.isfinite(found).all():
            raise InputError(
                f"{type(self.stage).__name__} returns NaN or infinity in frame {frame.index} at {window.origin}; let "
                "its sample return numbers."
            )
        return found

    def check_samples(self, light: float) -> None:
        """Raise InputError if a repeated frame, a crop or another engine gives other numbers."""
        name, (rows, columns), sensor = (
            type(self.stage).__name__,
            self.shape,
            self.camera.sensor,
        )
        row, column = sensor.rows - rows, sensor.columns - columns

        def made(
            backend: Backend = NUMPY_FLOAT32, top: int = 0, left: int = 0, index: int = 5
        ) -> Float64Array:
            shape = rows - top, columns - left
            window = self.window(backend, 1, (row + top, column + left), shape)
            return self.sample(Frame(self.exposure, window, 1, index), light, pattern=True)

        whole = made()
        made(index=6)
        if not np.array_equal(whole, made()):
            raise InputError(
                f"{name} gives another frame when the same frame is asked again; take random numbers only from frame "
                "and frame.window, and keep nothing between calls."
            )
        edge, top, left = self.stage.reach_px, rows // 3, columns // 4
        crop = made(top=top, left=left)
        if not np.array_equal(whole[top + edge :, left + edge :], crop[edge:, edge:]):
            raise InputError(
                f"{name}: the frame of a crop is not the crop of the frame; use frame.window.rows and columns, take "
                "random numbers only from frame and frame.window, and set reach_px to the distance of the farthest "
                "neighbour that affects a pixel."
            )
        if backend_problem("llvm"):
            return
        compiled = made(choose_backend("drjit", "float32", 0))
        if not np.array_equal(whole, compiled):
            raise InputError(
                f"{name}: engine drjit differs from numpy by up to {np.max(np.abs(whole - compiled)):.3g}; take "
                "numbers from frame.number(…) and arrays from frame.window.backend.from_numpy(…, frame.window)."
            )

    def measured(self, lights: Sequence[float]) -> Iterator[list[tuple[float, float]]]:
        """Yield mean, temporal and spatial variance with standard errors in each light, from two frames of each of two
        sensor units."""
        edge, random = self.stage.reach_px, np.random.default_rng(1)
        sensor = np.array([self.camera.sensor.rows, self.camera.sensor.columns])
        free = sensor - np.array(self.shape, dtype=int)
        inside = tuple(
            slice(edge, n - edge) if n > 2 * edge else slice(None) for n in self.shape
        )
        found = np.empty((PAIRS, len(lights), 3))
        for pair in range(PAIRS):
            row, column = random.integers(free + 1).tolist()
            indices = random.integers(FRAMES, size=2).tolist()
            chips = [
                self.window(NUMPY_FLOAT64, 2 * pair + chip, (row, column)) for chip in (0, 1)
            ]
            frames = [
                Frame(self.exposure, chip, chip.serial, index)
                for chip in chips
                for index in indices
            ]
            for number, light in enumerate(lights):
                a, b, c, d = (self.sample(frame, light)[inside] for frame in frames)
                found[pair, number] = (
                    np.mean(a + b + c + d) / 4,
                    np.mean((a - b) ** 2 + (c - d) ** 2) / 4,
                    np.mean((a - c) * (b - d)) / 2,
                )
        errors = found.std(axis=0, ddof=1) / math.sqrt(PAIRS)
        for numbers, own in zip(found.mean(axis=0).tolist(), errors.tolist(), strict=True):
            yield list(zip(numbers, own, strict=True))
