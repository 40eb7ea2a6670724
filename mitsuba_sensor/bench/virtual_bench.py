"""A virtual test bench: the bias, dark, flat-field and gradient frames that a laboratory takes of a camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..camera.figures import refuse_readouts
from ..core import Exposure, InputError
from ..expose import Sensor
from ..lab.frames.bench import Bench
from ..lab.frames.stack import Stack
from ..optics.f_number_law import transmittance
from ..render.light.photons import collect
from ..render.passes.prepared import render
from ..stages.effects.dark_current import mean_dark_e

Array = NDArray[np.float64]
SIDE_MAX_PX = 1024
"""Largest measured side of a sensor: 1 Mpx give standard deviations within 0.1 %."""
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
"""Light of the flat fields over saturation."""
PIXEL_FRAMES, DARK_FRAMES, LEVEL_FRAMES = 32, 8, 4
"""Frames of stacks whose single pixels are measured, of each dark exposure time, and of every other stack."""
GRADIENT_FRAMES, GRADIENT_ROWS = 64, 256
"""Frames of a gradient for the paper's photon transfer curve (Konnik & Welsh 2014, section 4.2)."""
DARK_SHARE, DARK_MAX_S = 0.1, 600.0
"""The longest dark exposure fills this fraction of the well, but lasts no longer than the paper's dark frames [s]."""
DARK_TIMES, DARK_STEPS_K = (0.1, 0.25, 0.5, 0.75, 1.0), (-15.0, -7.5, 7.5)
"""Dark exposure times over the longest one, and further temperatures relative to the first one [K]."""
QE_MIN = 0.02
"""Filters with a smaller fraction of the highest QE are not brought to saturation."""
RADIANCE = 1e-3
"""Rendered radiance L at all wavelengths [W m⁻² sr⁻¹ nm⁻¹]."""
FILM_PX, FILM_SPP = 64, 64
"""Side of the rendered film and its samples: the mean has a render noise of 2e-4 if one sample has 0.1."""


class Field(NamedTuple):
    """The light of a bench.

    shares : photons that arrive in each band over all photons that the laboratory computes, (B,).
    wavelengths_nm : centres of the bands, (B,).  efficiency : QE of each colour filter for this light, (F,).
    """

    shares: Array
    wavelengths_nm: Array
    efficiency: Array


class Setup(NamedTuple):
    """Settings of a bench.

    temperature_k : sensor temperature [K].  wavelength_nm : of the light; None for the wavelength of highest QE.
    serial, seed : of the sensor unit and of all temporal noise.
    side : rows and columns measured in the middle of a larger sensor.
    """

    temperature_k: float = 298.15
    wavelength_nm: float | None = None
    serial: int = 1
    seed: int = 1
    side: int = SIDE_MAX_PX


class Shot(NamedTuple):
    """One stack to take: mean photons per pixel (a number or (H, W)), exposure time [s], temperature [K], frames."""

    kind: str
    photons: float | Array
    exposure_s: float
    temperature_k: float
    frames: int


def field_at(camera: Camera, wavelength_nm: float) -> Field:
    """Return exactly known light of one wavelength."""
    return Field(np.ones(1), np.array([wavelength_nm]), camera.qe([wavelength_nm])[:, 0])


def rendered_field(camera: Camera) -> Field:
    """Render a flat spectrum through a telecentric lens; shares are relative to E = πLT/(4N²).

    The mean over a small film stands for the sensor: the light is uniform, and each pixel has its own render noise.
    """
    film = {"type": "specfilm", "width": FILM_PX, "height": FILM_PX, "rfilter": {"type": "box"}}
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {"type": "orthographic", "film": film, "sampler": {"type": "multijitter"}},
        "emitter": {"type": "constant", "radiance": {"type": "uniform", "value": RADIANCE}},
    }
    second = Exposure(1.0)
    light = render(scene, camera, second, spp=FILM_SPP, denoise=False)
    photons = collect(light, camera, second)
    mean = np.asarray(photons.mean, np.float64).mean(axis=(0, 1))
    centres, widths = np.asarray(photons.wavelengths_nm), photons.bandwidths_nm
    even = math.pi * RADIANCE * transmittance(camera, centres) / (4 * camera.lens.f_number**2)
    computed = collect(
        even[None, None], camera, second, wavelengths_nm=centres, bandwidths_nm=widths
    ).total[0, 0]
    return Field(mean / computed, centres, camera.qe(centres, widths) @ (mean / mean.sum()))


def virtual_bench(
    camera: Camera,
    setup: Setup,
    field: Field | None = None,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> Bench:
    """Take all stacks of a camera.

    field : the light; exactly known light of the wavelength if omitted.
    report : called with the number of stacks taken and their total.
    Raises InputError for a camera that does not detect the wavelength.
    """
    refuse_readouts(camera, "the bench measures one of them")
    wavelength_nm = setup.wavelength_nm or best_wavelength_nm(camera)
    light = field or field_at(camera, wavelength_nm)
    shots = list(_shots(camera, setup, light))
    sensor = Sensor(camera, serial=setup.serial)
    stacks: dict[str, list[Stack]] = {"bias": [], "dark": [], "flat": [], "scene": []}
    for number, shot in enumerate(shots, start=1):
        stacks[shot.kind].append(_taken(sensor, shot, setup, setup.seed + number, light))
        report(number, len(shots))
    biases, darks, flats, scenes = map(tuple, stacks.values())
    return Bench(biases, darks, flats, scenes, wavelength_nm)


def best_wavelength_nm(camera: Camera) -> float:
    """Return the datasheet's reference wavelength, else the wavelength of highest QE [nm]."""
    if camera.quantum_efficiency.reference_nm is not None:
        return float(camera.quantum_efficiency.reference_nm)
    points = np.array(camera.quantum_efficiency.wavelengths_nm)
    return float(points[camera.qe(points).max(axis=0).argmax()])


def saturating_photons(camera: Camera, light: Field) -> Array:
    """Return the mean photons per pixel that fill the well under each filter, ascending.

    Filters that barely detect the light are skipped.
    """
    qe = light.efficiency
    if not qe.any():
        raise InputError(
            f"{camera.name} detects no light at {light.wavelengths_nm[0]:g} nm; give a wavelength from "
            f"{camera.band_nm[0]:g} to {camera.band_nm[1]:g} nm."
        )
    return np.unique(camera.pixel.full_well_e / qe[qe > QE_MIN * qe.max()])


def _shots(camera: Camera, setup: Setup, light: Field) -> Iterator[Shot]:
    kelvin, (rows, columns) = setup.temperature_k, bench_shape(camera, setup.side)
    yield Shot("bias", 0.0, 0.0, kelvin, PIXEL_FRAMES)
    yield Shot("dark", 0.0, FLAT_S, kelvin, PIXEL_FRAMES)
    wells = saturating_photons(camera, light)
    levels = np.unique(np.round(np.outer(wells, LEVELS), 6))
    halves = {float(levels[np.abs(levels - 0.5 * well).argmin()]) for well in wells}
    for level in levels.tolist():
        frames = PIXEL_FRAMES if level in halves else LEVEL_FRAMES
        yield Shot("flat", level, FLAT_S, kelvin, frames)
    rate = float(mean_dark_e(camera, Exposure(1.0, kelvin)))
    longest_s = DARK_MAX_S
    if rate > 0:
        longest_s = min(DARK_SHARE * camera.pixel.full_well_e / rate, DARK_MAX_S)
    for share in DARK_TIMES:
        yield Shot("dark", 0.0, share * longest_s, kelvin, DARK_FRAMES)
    for step_k in DARK_STEPS_K:
        for share in (DARK_TIMES[0], DARK_TIMES[-1] / 2):
            yield Shot("dark", 0.0, share * longest_s, kelvin + step_k, LEVEL_FRAMES)
    ramp = np.linspace(0.0, 1.1 * wells[0], columns)
    gradient = np.broadcast_to(ramp, (min(GRADIENT_ROWS, rows), columns))
    yield Shot("scene", gradient, FLAT_S, kelvin, GRADIENT_FRAMES)


def bench_shape(camera: Camera, side: int) -> tuple[int, int]:
    """Return the measured rows and columns."""
    return min(camera.sensor.rows, side), min(camera.sensor.columns, side)


def _taken(sensor: Sensor, shot: Shot, setup: Setup, seed: int, light: Field) -> Stack:
    camera, level = sensor.camera, np.asarray(shot.photons, np.float64)
    shape = bench_shape(camera, setup.side)
    frames = sensor.expose(
        np.broadcast_to(level, level.shape or shape)[..., None] * light.shares,
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
    """Return the names of the colour filters as a tile; empty for a monochrome camera."""
    if len(camera.filter_names) == 1:
        return ()
    return tuple(tuple(camera.filter_names[number] for number in row) for row in camera.tile)


def middle_of_sensor(camera: Camera, shape: tuple[int, int]) -> tuple[int, int]:
    """Return the first row and column of a window in the middle of the sensor, at the corner of a tile."""
    sizes = zip((camera.sensor.rows, camera.sensor.columns), shape, strict=True)
    tile = len(camera.tile), len(camera.tile[0])
    row, column = (
        (whole - part) // 2 // step * step
        for (whole, part), step in zip(sizes, tile, strict=True)
    )
    return row, column
