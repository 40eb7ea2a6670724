"""A virtual test bench: the bias, dark, flat-field and gradient frames of a camera that a laboratory takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..camera.figures import refuse_readouts
from ..core import Exposure, InputError
from ..expose import Sensor
from ..lab.frames.bench import Bench
from ..lab.frames.stack import Stack
from ..stages.effects.dark_current import mean_dark_e
from .rendered_field import Field, field_at

Array = NDArray[np.float64]
MOST_SIDE = 1024
"""Side of the part of a larger sensor that is measured: 1 Mpx, whose standard deviations are within 0.1 %."""

FLAT_S = 0.01
"""Exposure time of the flat fields; the light varies (EMVA 1288 R4 5.3, method with constant exposure time)."""

LEVELS = (
    0.005,
    0.01,
    0.02,
    0.04,
    *np.arange(0.08, 0.95, 0.06),
    0.93,
    0.96,
    0.99,
    1.02,
    1.06,
    1.12,
)
"""Of the flat fields, over saturation."""

MANY, SOME, FEW = 32, 8, 4
"""Frames of the stacks whose pixels are looked at, of dark times and temperatures, of the other levels."""

GRADIENT_FRAMES, GRADIENT_ROWS = 64, 256
"""Of the paper's photon transfer curve: 64 frames of a gradient (Konnik & Welsh 2014, section 4.2)."""

DARK_SHARE, LONGEST_S = 0.1, 600.0
"""The longest dark exposure fills this share of the well, unless it takes longer than the paper's dark frames [s]."""

DARK_TIMES, WARMER_K = (0.1, 0.25, 0.5, 0.75, 1.0), (-15.0, -7.5, 7.5)
"""Of the longest dark exposure; and temperatures beside the first one."""


BLIND = 0.02
"""Of the QE of the filter that sees most: what sees less is not brought to saturation."""


class Setup(NamedTuple):
    """How the bench is used.

    temperature_k : of the sensor [K].  wavelength_nm : of the light; None: where the camera sees best.
    serial, seed : of the chip and of all temporal noise.
    side : rows and columns in the middle of a larger sensor that are measured.
    """

    temperature_k: float = 298.15
    wavelength_nm: float | None = None
    serial: int = 1
    seed: int = 1
    side: int = MOST_SIDE


@dataclass(frozen=True)
class Shot:
    """One stack to take: mean photons per pixel (a number or (H, W)), exposure time [s], temperature [K], frames."""

    kind: str
    photons: float | Array
    exposure_s: float
    temperature_k: float
    frames: int


def virtual_bench(
    camera: Camera,
    setup: Setup,
    field: Field | None = None,
    report: Callable[[int, int], None] | None = None,
) -> Bench:
    """All stacks of this camera.

    Of a sensor with more pixels than that of the setup its middle.
    field : of light that was rendered; without it the light is exact.
    report : called with the stacks that are taken, and all of them.
    Raises InputError for a camera that sees nothing at the wavelength.
    """
    refuse_readouts(camera, "the bench measures one of them")
    wavelength_nm = (
        best_wavelength_nm(camera) if setup.wavelength_nm is None else setup.wavelength_nm
    )
    light = field_at(camera, wavelength_nm) if field is None else field
    shots = list(_shots(camera, setup, light))
    sensor, taken = Sensor(camera, serial=setup.serial), dict[str, list[Stack]]()
    for number, shot in enumerate(shots, start=1):
        stack = _taken(sensor, shot, setup, setup.seed + number, light)
        taken.setdefault(shot.kind, []).append(stack)
        if report is not None:
            report(number, len(shots))
    stacks = {kind: tuple(some) for kind, some in taken.items()}
    return Bench(stacks["bias"], stacks["dark"], stacks["flat"], stacks["scene"], wavelength_nm)


def best_wavelength_nm(camera: Camera) -> float:
    """The datasheet's own, else where the filter that sees most sees most [nm]."""
    if camera.quantum_efficiency.reference_nm is not None:
        return float(camera.quantum_efficiency.reference_nm)
    points = np.array(camera.quantum_efficiency.wavelengths_nm)
    return float(points[camera.qe(points).max(axis=0).argmax()])


def saturating_photons(camera: Camera, light: Field) -> Array:
    """Mean photons per pixel that fill the well behind each filter, increasing; filters that hardly see it aside."""
    qe = light.efficiency
    if not qe.any():
        raise InputError(
            f"{camera.name} sees nothing at {light.wavelengths_nm[0]:g} nm; give a wavelength from "
            f"{camera.band_nm[0]:g} to {camera.band_nm[1]:g} nm."
        )
    return np.unique(camera.pixel.full_well_e / qe[qe > BLIND * qe.max()])


def _shots(camera: Camera, setup: Setup, light: Field) -> Iterator[Shot]:
    kelvin, shape = setup.temperature_k, bench_shape(camera, setup.side)
    yield Shot("bias", 0.0, 0.0, kelvin, MANY)
    yield Shot("dark", 0.0, FLAT_S, kelvin, MANY)
    wells = saturating_photons(camera, light)
    levels = np.unique(np.round(np.outer(wells, LEVELS), 6))
    halves = {float(levels[np.abs(levels - 0.5 * well).argmin()]) for well in wells}
    for level in levels:
        yield Shot(
            "flat", float(level), FLAT_S, kelvin, MANY if float(level) in halves else FEW
        )
    longest_s = _longest_dark_s(camera, kelvin)
    for share in DARK_TIMES:
        yield Shot("dark", 0.0, share * longest_s, kelvin, SOME)
    for warmer_k in WARMER_K:
        for share in (DARK_TIMES[0], DARK_TIMES[-1] / 2):
            yield Shot("dark", 0.0, share * longest_s, kelvin + warmer_k, FEW)
    ramp = np.linspace(0.0, 1.1 * wells[0], shape[1])
    yield Shot(
        "scene",
        np.broadcast_to(ramp, (min(GRADIENT_ROWS, shape[0]), shape[1])),
        FLAT_S,
        kelvin,
        GRADIENT_FRAMES,
    )


def _longest_dark_s(camera: Camera, temperature_k: float) -> float:
    rate = float(mean_dark_e(camera, Exposure(1.0, temperature_k)))
    return (
        min(DARK_SHARE * camera.pixel.full_well_e / rate, LONGEST_S) if rate > 0 else LONGEST_S
    )


def bench_shape(camera: Camera, side: int) -> tuple[int, int]:
    """Rows and columns that are measured."""
    return min(camera.sensor.rows, side), min(camera.sensor.columns, side)


def _taken(sensor: Sensor, shot: Shot, setup: Setup, seed: int, light: Field) -> Stack:
    camera = sensor.camera
    shape = bench_shape(camera, setup.side)
    level = np.asarray(shot.photons, np.float64)
    photons = np.broadcast_to(level, level.shape or shape)[..., None] * light.shares
    frames = sensor.expose(
        photons,
        Exposure(shot.exposure_s, shot.temperature_k),
        wavelengths_nm=light.wavelengths_nm,
        origin=middle_of_sensor(camera, shape),
        frames=shot.frames,
        seed=seed,
    )
    return Stack(
        frames.digital,
        shot.exposure_s,
        shot.photons,
        shot.temperature_k,
        bits=camera.adc.bits,
        tile=mosaic(camera),
        source=f"{shot.kind} of {shot.exposure_s:g} s at {shot.temperature_k:g} K",
    )


def mosaic(camera: Camera) -> tuple[tuple[str, ...], ...]:
    """Names of the colour filters as they lie in frames of this camera; empty where all have one."""
    if len(camera.filter_names) == 1:
        return ()
    return tuple(tuple(camera.filter_names[number] for number in row) for row in camera.tile)


def middle_of_sensor(camera: Camera, shape: tuple[int, int]) -> tuple[int, int]:
    """First row and column of a window of this shape in the middle, at the beginning of a tile."""
    rows, columns = shape
    first = _middle(camera.sensor.rows, rows, len(camera.tile))
    return first, _middle(camera.sensor.columns, columns, len(camera.tile[0]))


def _middle(whole: int, part: int, step: int) -> int:
    """First pixel of the middle part, at the beginning of a tile."""
    return (whole - part) // 2 // step * step
