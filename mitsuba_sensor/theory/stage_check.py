"""Compares the ``moments`` of a stage with its ``sample`` at random places of the sensor: check_stage().

The stage is sampled on windows at random places of the sensor, with two frames of each of 64 chips. Each chip is
independent of the others, so that their spread gives the standard error of every average.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

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
    Moments,
    Photons,
    SensorWindow,
    check_types,
)
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend, normals
from ..core.llvm import backend_problem
from ..sensor.run import choose_backend
from ..stages.propagate import propagate
from ..stages.stage import UNITS, Chain, Stage, total

CHIPS = 64
FRAMES = (0, 100_000)  # so far apart that a telegraph signal has forgotten its state
STANDARD_ERRORS = (
    5.0  # by chance: 5 in a million (Student's t of 64 chips); 1.2e-4 of variances of 4 columns
)
SHAPES = ((64, 64), (2048, 4), (4, 2048))  # neighbours both ways, many rows, many columns
PLACES_OF_EACH_SHAPE = 2
ROUNDING = 1e-9  # of float64, relative
SMALLEST_ERROR = 1e-100  # of what has no noise
SIGNAL = "signal of check_stage"  # source of its random numbers
QUANTITIES = ("mean", "temporal variance", "spatial variance")


class Place(NamedTuple):
    """A window of the sensor, by its first pixel and its shape."""

    origin: tuple[int, int]
    shape: tuple[int, int]

    def __str__(self) -> str:
        (row, column), (rows, columns) = self
        return f"rows {row}-{row + rows - 1}, columns {column}-{column + columns - 1}"


class Level(NamedTuple):
    """A uniform signal that enters the stage, in its unit, and σ of its noise relative to its light."""

    name: str
    light: float
    dark: float
    are_electrons: bool
    temporal: float = 0.0
    spatial: float = 0.0

    def moments(self, frame: Frame) -> Moments:
        """Mean and variances of this signal."""
        variances = (self.temporal * self.light) ** 2, (self.spatial * self.light) ** 2
        if self.dark:
            light = Moments(self.light, *variances, frame)
        else:
            light = None
        return Moments(self.light + self.dark, *variances, frame, light)

    def sample(self, frame: Frame) -> Array:
        """This signal in one frame, in the precision of its backend."""
        window = frame.window
        light, dark = (
            window.backend.from_numpy(np.full(window.shape, part), window)
            for part in (self.light, self.dark)
        )
        if self.temporal:
            light = light * (1.0 + frame.number(self.temporal) * frame.normal(SIGNAL))
            light = light + frame.number(self.spatial * self.light) * window.fixed_map(
                SIGNAL, normals
            )
        if self.are_electrons:
            return Electrons(light, dark)
        return light + dark


class StageComparison(NamedTuple):
    """An average over the samples beside what ``moments`` says, in the unit of the stage or its square.

    signal : what entered.  where : rows and columns of the window.  error : standard error of ``sampled``.
    standard_errors : of the difference, beyond what float64 rounds.
    """

    signal: str
    quantity: str
    where: str
    expected: float
    sampled: float
    error: float
    standard_errors: float


@dataclass(frozen=True)
class StageCheck:
    """What :func:`check_stage` compared; ``print(check.explain())`` shows it as a table."""

    stage: str
    unit: str
    comparisons: tuple[StageComparison, ...]

    def explain(self) -> str:
        """A table for people: of each signal and quantity the window where the two differ most."""
        if not self.comparisons:
            return (
                f"{self.stage}: it has no moments, so there is nothing to compare with sample; a crop of its frame is "
                "the frame of the crop, and the engines agree"
            )
        numbers = f"{'moments':>12}{'sample':>12}{'±':>10}{'off':>6}"
        lines = [f"{self.stage}: moments fits sample [{self.unit}, {self.unit}²]"]
        lines.append(f"{'signal':<8}{'quantity':<19}{numbers}  most off [standard errors] at")
        worst: dict[tuple[str, str], StageComparison] = {}
        for row in sorted(self.comparisons, key=lambda row: row.standard_errors):
            worst[row.signal, row.quantity] = row
        for row in sorted(worst.values()):
            numbers = f"{row.expected:>12.5g}{row.sampled:>12.5g}{row.error:>10.2g}{row.standard_errors:>6.1f}"
            place = "nowhere"
            if row.standard_errors:
                place = row.where
            lines.append(f"{row.signal:<8}{row.quantity:<19}{numbers}  {place}")
        return "\n".join(lines)


def check_stage(
    stage: Stage,
    *,
    camera: AnyCamera,
    after: str | None = None,
    exposure: Exposure | None = None,
) -> StageCheck:
    """Compare the ``moments`` of a stage with its ``sample`` on windows at random places of the sensor.

    ::

        prnu = next(stage for stage in camera.stages if stage.label == "PRNU")
        print(ms.check_stage(prnu, camera=camera).explain())

    stage : one of yours, or one of the camera's own.  after : key of the stage in front of it, as for
        ``camera.with_stage``; None for a stage that is in the chain of this camera.
    exposure : time and temperature; None: 0.1 s.
    Mean, temporal and spatial variance may be 5 standard errors apart: chance fails about one right stage
    in 1000, one in 200 of those whose neighbouring columns or rows are coupled, and the same one each time.
    A crop of a frame must be the frame of the crop, but for ``reach_px`` pixels at its edges, which are not
    compared with moments either. Of a stage without moments nothing else is looked at. Where LLVM is there, the
    compiled engine must give the bytes that NumPy gives in float32. It takes a few seconds.
    Raises InputError where something does not fit: where, what ``moments`` says, and what ``sample`` does.
    """
    camera = camera_of(camera)
    exposure = Exposure(0.1) if exposure is None else exposure
    check_types(camera, exposure)
    refuse_readouts(camera, "a stage is checked in one of them")
    if after is None:
        chain = camera.stages
    else:
        chain = camera.with_stage(stage, after=after).stages
    place = next((number for number, one in enumerate(chain) if one is stage), 0)
    name = type(stage).__name__
    if place == 0 or stage.domain == "DN":
        raise InputError(
            f"{name} is not between the first and the last stage of {camera.name}; "
            "say where it stands, e.g. after='dark_current', or pass one of camera.stages[1:-1]."
        )
    levels, places = levels_behind(chain[:place], camera, exposure), random_places(camera)
    require_same_bytes(stage, levels[-1], places[1], exposure)
    rows: list[StageComparison] = []
    whole = [place for place in places if min(place.shape) > 2 * stage.reach_px]
    for window in whole if stage.has_moments else ():
        rows += compare_at(window, stage, levels, exposure, camera.name)
    worst = max(rows, key=lambda row: row.standard_errors, default=None)
    if worst is not None and worst.standard_errors > STANDARD_ERRORS:
        unit = UNITS[stage.domain] + ("" if worst.quantity == "mean" else "²")
        raise InputError(
            f"{name}: at {worst.where} of {camera.name} with a {worst.signal} signal, moments says that the "
            f"{worst.quantity} is {worst.expected:.6g} {unit}, and sample makes {worst.sampled:.6g} ± "
            f"{worst.error:.2g} {unit}; let moments say what sample does in the pixels of m.frame.window."
        )
    return StageCheck(name, UNITS[stage.domain], tuple(rows))


def levels_behind(front: Chain, camera: Camera, exposure: Exposure) -> tuple[Level, ...]:
    """A dim, a bright and a noisy signal, of 2 and 30 % of the full well, as they leave these stages."""
    levels = []
    for name, share, *noise in (("dim", 0.02), ("bright", 0.3), ("noisy", 0.3, 0.02, 0.03)):
        nm = camera.quantum_efficiency.reference_nm
        photons = share * camera.pixel.full_well_e / camera.qe([nm]).max()
        frame = Frame(exposure, SensorWindow(0, (8, 8), camera=camera.name))
        behind = propagate(front, Moments(Photons(np.full((8, 8), photons)), 0.0, 0.0, frame))
        signal = float(np.mean(behind.mean))
        if behind.light is None:
            light = signal
        else:
            light = float(np.mean(behind.light.mean))
        are_electrons = front[-1].domain == "electrons"
        dark = 0.0
        if are_electrons:
            dark = signal - light
        levels.append(Level(name, signal - dark, dark, are_electrons, *noise))
    return tuple(levels)


def random_places(camera: Camera) -> list[Place]:
    """The first pixels of the sensor, and random windows of each shape; the same for every stage."""
    random = np.random.default_rng(1)
    size = camera.sensor.rows, camera.sensor.columns
    places = [Place((0, 0), (min(64, size[0]), min(64, size[1])))]
    for rows, columns in SHAPES * PLACES_OF_EACH_SHAPE:
        shape = min(rows, size[0]), min(columns, size[1])
        row, column = (
            int(random.integers(whole - part + 1))
            for whole, part in zip(size, shape, strict=True)
        )
        places.append(Place((row, column), shape))
    return places


def frames_of_chip(
    place: Place, exposure: Exposure, serial: int, camera: str, backend: Backend
) -> list[Frame]:
    """Two frames of a window of one chip."""
    window = SensorWindow(serial, place.shape, place.origin, backend=backend, camera=camera)
    return [Frame(exposure, window, serial, index) for index in FRAMES]


def compare_at(
    place: Place, stage: Stage, levels: tuple[Level, ...], exposure: Exposure, camera: str
) -> Iterator[StageComparison]:
    """Mean and variances of every signal behind the stage in one window, but for pixels that lack a neighbour."""

    def inside(values: Array) -> Array:
        edge, (rows, columns) = stage.reach_px, place.shape
        whole = np.broadcast_to(values, place.shape)
        return whole[edge : rows - edge, edge : columns - edge]

    off = np.empty((len(levels), CHIPS, len(QUANTITIES)))
    expected = np.empty_like(off)
    for serial in range(CHIPS):
        frames = frames_of_chip(place, exposure, serial, camera, NUMPY_FLOAT64)
        for number, level in enumerate(levels):
            theory = stage.moments(level.moments(frames[0]))
            first, second = (
                inside(total(stage.sample(level.sample(frame), frame)) - theory.mean)
                for frame in frames
            )
            spatial = first * second - inside(theory.spatial)
            temporal = (first - second) ** 2 / 2 - inside(theory.temporal)
            off[number, serial] = [
                np.mean(first + second) / 2,
                np.mean(temporal),
                np.mean(spatial),
            ]
            expected[number, serial] = [
                np.mean(x) for x in (theory.mean, theory.temporal, theory.spatial)
            ]
    least_errors = errors_of_rare_events(
        stage, frames_of_chip(place, exposure, 0, camera, NUMPY_FLOAT64)[0]
    )
    for number, level in enumerate(levels):
        means, sizes = off[number].mean(axis=0), expected[number].mean(axis=0)
        spread = off[number].std(axis=0, ddof=1) / math.sqrt(CHIPS)
        errors = np.maximum(spread, least_errors)
        rounded = ROUNDING * np.abs([sizes[0], sizes[1] + sizes[2], sizes[1] + sizes[2]])
        rounded[1:] += (ROUNDING * sizes[0]) ** 2
        means, errors = (np.where(np.abs(x) <= rounded, 0.0, x) for x in (means, errors))
        apart = np.nan_to_num(np.abs(means), nan=math.inf) / np.fmax(errors, SMALLEST_ERROR)
        numbers = np.transpose([sizes, sizes + means, errors, apart])
        for quantity, row in zip(QUANTITIES, numbers.tolist(), strict=True):
            yield StageComparison(level.name, quantity, str(place), *row)


def errors_of_rare_events(stage: Stage, frame: Frame) -> Float64Array:
    """Standard errors of mean, temporal and spatial variance that the states of the pixels make, at least.

    Where few samples have an event, such as a radiation hit, or none has, their spread does not show how many might
    have had one. The fourth moment of the states does, and one event more or less.
    """
    noise = stage.pixel_noise(frame)
    if noise is None:
        return np.zeros(len(QUANTITIES))
    mean = sum(chance * own for chance, own, _ in noise.states)
    square: Array = 0.0
    fourth: Array = 0.0
    for chance, own, variance in noise.states:
        off_square = (own - mean) ** 2
        square = square + chance * (variance + off_square)
        fourth = fourth + chance * (3 * variance**2 + 6 * variance * off_square + off_square**2)
    variance, fourth_moment = float(np.mean(square)), float(np.mean(fourth))
    if variance == 0:
        return np.zeros(len(QUANTITIES))
    samples = CHIPS * math.prod(frame.window.shape)
    event_square = fourth_moment / variance
    cumulant = fourth_moment - 3 * variance**2
    by_chance = (
        math.sqrt(variance / (2 * samples)),
        math.sqrt((cumulant / 2 + 2 * variance**2) / samples),
        variance / math.sqrt(samples),
    )
    one_event = (
        math.sqrt(event_square) / (2 * samples),
        event_square / (2 * samples),
        event_square / samples,
    )
    return np.hypot(by_chance, one_event)


def require_same_bytes(stage: Stage, level: Level, place: Place, exposure: Exposure) -> None:
    """Raise InputError where a crop of a frame is not the frame of the crop, or the engines differ."""
    name, ((row, column), (rows, columns)) = type(stage).__name__, place
    top, left = rows // 3, columns // 3
    cropped = Place((row + top, column + left), (rows - top, columns - left))
    whole = sample_on(NUMPY_FLOAT32, stage, level, place, exposure)
    alone = sample_on(NUMPY_FLOAT32, stage, level, cropped, exposure)
    edge = stage.reach_px  # the light beyond the crop is not in it
    if not np.array_equal(whole[top + edge :, left + edge :], alone[edge:, edge:]):
        raise InputError(
            f"{name}: the frame of {cropped} is not the crop of the frame of {place}; let sample use "
            "frame.window.rows and columns, and random numbers of frame and frame.window alone, and reach_px say how "
            "far away the neighbours are that change a pixel."
        )
    if backend_problem("llvm"):
        return
    compiled = sample_on(choose_backend("drjit", "float32", 0), stage, level, place, exposure)
    if not np.array_equal(whole, compiled):
        raise InputError(
            f"{name}: engine drjit makes other numbers than numpy at {place}, up to "
            f"{np.max(np.abs(whole - compiled)):.3g} apart; take numbers from frame.number(…) and arrays from "
            "frame.window.backend.from_numpy(…, frame.window)."
        )


def sample_on(
    backend: Backend, stage: Stage, level: Level, place: Place, exposure: Exposure
) -> Float64Array:
    """One frame of this signal behind the stage, computed by this backend."""
    frame = frames_of_chip(place, exposure, 1, "", backend)[0]
    signal = total(stage.sample(level.sample(frame), frame))
    return np.array(backend.to_numpy(signal, frame.window), np.float64)
