"""Rays through a lens, from the sensor to the scene, with the same lines for NumPy and Dr.Jit.

The lens's own frame has its axis along z, towards the scene; every surface is met in a frame whose origin is its own
vertex, so that float32 carries numbers of the size of the lens only. Lengths are in mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core.arrays import maximum, sqrt
from .glass import AIR, D_NM, Glass, glass_behind

if TYPE_CHECKING:
    from ..sensor.lens_datasheet import PrescriptionSection

NEWTON_STEPS = 6  # to a general asphere, from its conic: quadratic convergence, float64 in four or five


class Ray(NamedTuple):
    """Points and unit directions, by component; ``alive`` where nothing has stopped it."""

    x: Any
    y: Any
    z: Any
    dx: Any
    dy: Any
    dz: Any
    unvignetted: Any


@dataclass(frozen=True)
class Surface:
    """One surface, seen from the sensor.

    curvature : 1/radius [1/mm], positive if the centre is towards the scene.  gap : to the next surface towards the
    scene [mm].  conic, aspheric : the sag is that of the conic plus Σ aspheric[k]·r^(2k + 4).  beyond : the medium
    towards the scene.
    """

    curvature: float
    conic: float
    aspheric: tuple[float, ...]
    semi_diameter: Any
    gap: float
    beyond: Glass
    stop: bool


def surfaces_of(prescription: PrescriptionSection, scale: float) -> tuple[Surface, ...]:
    """The surfaces of a prescription, all lengths times ``scale``, from the sensor to the scene, its stop wide open."""
    listed = prescription.surfaces
    found = []
    for number, surface in reversed(list(enumerate(listed))):
        before = listed[number - 1] if number else None
        found.append(
            Surface(
                curvature=0.0 if surface.radius_mm is None else -1 / (surface.radius_mm * scale),
                conic=surface.conic,
                aspheric=tuple(-a / scale ** (2 * k + 3) for k, a in enumerate(surface.aspheric)),
                semi_diameter=surface.semi_diameter_mm * scale,
                gap=before.thickness_mm * scale if before else 0.0,
                beyond=glass_behind(before) if before else AIR,
                stop=surface.stop,
            )
        )
    return tuple(found)


def to_stop(surfaces: tuple[Surface, ...]) -> tuple[Surface, ...]:
    """The surfaces between the sensor and the stop, and the stop."""
    return surfaces[: next(number for number, surface in enumerate(surfaces) if surface.stop) + 1]


def stopped_down(surfaces: tuple[Surface, ...], stop_radius: Any) -> tuple[Surface, ...]:
    """The same with another opening of the stop [mm]."""
    return tuple(replace(s, semi_diameter=stop_radius) if s.stop else s for s in surfaces)


def trace(surfaces: tuple[Surface, ...], ray: Ray, wavelength_nm: Any = D_NM) -> Ray:
    """Follow rays that start in air before the last vertex (z < 0) until they leave the first surface.

    wavelength_nm : of every ray, or one for all. The points that come back lie on the first surface, with z from the
    last vertex; a ray that missed, was stopped or totally reflected is not alive and its numbers mean nothing.
    """
    medium, index, length = AIR, 1.0, 0.0
    for surface in surfaces:
        ray = _meet(surface, ray)
        if surface.beyond != medium:
            beyond = surface.beyond.index(wavelength_nm)
            ray = _refract(surface, ray, index / beyond)
            medium, index = surface.beyond, beyond
        ray = ray._replace(z=ray.z - surface.gap)
        length += surface.gap
    return ray._replace(z=ray.z + length)


def _meet(surface: Surface, ray: Ray) -> Ray:
    """Where the rays meet the surface, if they do within its clear aperture (Welford 1986, section 4.3 and 4.6)."""
    x, y, z, dx, dy, dz, unvignetted = ray
    away = -z / dz
    x, y, z = x + away * dx, y + away * dy, 0.0
    if surface.curvature:
        c = surface.curvature
        f, g = c * (x * x + y * y), dz - c * (x * dx + y * dy)
        root = g * g - c * f * (1.0 + surface.conic * dz * dz if surface.conic else 1.0)
        unvignetted = unvignetted & (root > 0.0)
        away = f / (g + _root(root))
        x, y, z = x + away * dx, y + away * dy, away * dz
    if surface.aspheric:
        x, y, z = _to_asphere(surface, x, y, z, dx, dy, dz)
    return Ray(x, y, z, dx, dy, dz, unvignetted & (x * x + y * y <= surface.semi_diameter * surface.semi_diameter))


def _to_asphere(surface: Surface, x: Any, y: Any, z: Any, dx: Any, dy: Any, dz: Any) -> tuple[Any, Any, Any]:
    """On from the conic to the asphere, by Newton's method along the ray."""
    for _ in range(NEWTON_STEPS):
        sag, slope = _sag(surface, x * x + y * y)
        away = (sag - z) / (dz - 2.0 * slope * (x * dx + y * dy))
        x, y, z = x + away * dx, y + away * dy, z + away * dz
    return x, y, z


def _sag(surface: Surface, square: Any) -> tuple[Any, Any]:
    """z of the surface at r², and its derivative by r²."""
    c = surface.curvature
    root = _root(1.0 - (1.0 + surface.conic) * c * c * square) + 1e-9  # where a conic ends no ray is alive
    sag, slope, power = c * square / (1.0 + root), 0.5 * c / root, square
    for k, a in enumerate(surface.aspheric):
        slope, power = slope + (k + 2) * a * power, power * square
        sag = sag + a * power
    return sag, slope


def _refract(surface: Surface, ray: Ray, ratio: Any) -> Ray:
    """Snell's law, ratio = n/n′: d′ = ratio·d + (cos θ′ − ratio·cos θ)·normal."""
    x, y, z, dx, dy, dz, unvignetted = ray
    nx, ny, nz = _normal(surface, x, y, z)
    cosine = dx * nx + dy * ny + dz * nz
    square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    bend = _root(square) - ratio * cosine
    return Ray(
        x, y, z, ratio * dx + bend * nx, ratio * dy + bend * ny, ratio * dz + bend * nz, unvignetted & (square > 0.0)
    )


def _normal(surface: Surface, x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    """Unit normal, towards the scene."""
    c = surface.curvature
    if surface.aspheric:
        slope = _sag(surface, x * x + y * y)[1]
        nx, ny, nz = -2.0 * slope * x, -2.0 * slope * y, 1.0
    else:
        nx, ny, nz = -c * x, -c * y, 1.0 - c * (1.0 + surface.conic) * z
        if not surface.conic:
            return nx, ny, nz
    size = 1.0 / _root(nx * nx + ny * ny + nz * nz)
    return nx * size, ny * size, nz * size


def _root(x: Any) -> Any:
    """√x, and 0 below 0."""
    return math.sqrt(max(x, 0.0)) if isinstance(x, float) else sqrt(maximum(x, 0.0))  # one ray at a time: no NumPy
