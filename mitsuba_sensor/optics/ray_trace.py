"""Sequential ray trace through a lens prescription, from the sensor to the scene, on NumPy or Dr.Jit.

The z axis is the optical axis, towards the scene. Each surface is intersected in a frame with its vertex as origin, so
float32 only holds numbers of the size of the lens. Lengths are in mm. The refractive index of a glass follows from
Sellmeier or Cauchy coefficients.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core import Array, Float64Array
from ..core.arrays import maximum, sqrt

if TYPE_CHECKING:
    from ..camera.lens_datasheet import PrescriptionSection, SurfaceSection

NEWTON_STEPS = 6
"""Newton steps from the conic to the asphere; float64 needs four or five."""
# Of the last clear aperture: slanting rays cross the plane of its vertex farther out.
WINDOW = 1.5
D_NM, F_NM, C_NM = 587.5618, 486.1327, 656.2725  # Fraunhofer lines (ISO 7944): He d, H F, H C


@dataclass(frozen=True)
class Glass:
    """n(λ) by Sellmeier's three terms, or by Cauchy's two terms from index and Abbe number.

    coefficients : B1 … B3, C1 … C3 [µm²] of n² − 1 = Σ B·λ²/(λ² − C); or A, B of n = A + B/λ².
    """

    coefficients: tuple[float, ...]

    def index(self, wavelength_nm: Array = D_NM) -> Array:
        """Return n at a wavelength [nm], with the same type."""
        square = wavelength_nm * wavelength_nm * 1e-6
        if len(self.coefficients) == 2:
            constant, slope = self.coefficients
            return constant + slope / square if slope else constant
        terms = zip(self.coefficients[:3], self.coefficients[3:], strict=True)
        return sqrt(1.0 + sum(b * square / (square - c) for b, c in terms))


AIR = Glass((1.0, 0.0))


def glass_behind(surface: SurfaceSection) -> Glass:
    """Return the glass after a surface of a prescription; without an Abbe number it has no dispersion.

    Cauchy's B follows from V = (n_d − 1)/(n_F − n_C), A from n_d. For Schott's N-BK7, the error is at most 0.0003 from
    400 to 700 nm and 0.002 at 1000 nm.
    """
    if surface.sellmeier is not None:
        return Glass(surface.sellmeier)
    if surface.abbe is None:
        return Glass((surface.index, 0.0))
    spread = (surface.index - 1) / surface.abbe
    slope = spread / ((F_NM * 1e-3) ** -2 - (C_NM * 1e-3) ** -2)
    return Glass((surface.index - slope / (D_NM * 1e-3) ** 2, slope))


class Ray(NamedTuple):
    """Points [mm] and unit directions, by component.  unvignetted : True if no aperture stopped the ray."""

    x: Array
    y: Array
    z: Array
    dx: Array
    dy: Array
    dz: Array
    unvignetted: Array


def ray_to(
    distance: float, height: Float64Array, radial: Float64Array, tangential: Float64Array
) -> Ray:
    """Return the ray from an image point at (height, 0), ``distance`` before a plane, to a point in the plane [mm]."""
    dx, dy = np.broadcast_arrays(radial - height, tangential)
    length = np.sqrt(dx * dx + dy * dy + distance * distance)
    return Ray(
        x=height + 0.0 * dx,
        y=0.0 * dy,
        z=-distance,
        dx=dx / length,
        dy=dy / length,
        dz=distance / length,
        unvignetted=np.ones(dx.shape, dtype=bool),
    )


@dataclass(frozen=True)
class Surface:
    """A surface, in the order from the sensor to the scene."""

    curvature: float  # 1/radius [1/mm], positive if the centre is towards the scene
    conic: float
    aspheric: tuple[float, ...]  # the sag is the conic's plus Σ aspheric[k]·r^(2k + 4)
    semi_diameter: Array
    gap: float  # to the next surface towards the scene [mm]
    beyond: Glass  # the medium on the scene side
    stop: bool
    obscuration: float = 0.0  # radius of an opaque disk in the middle [mm]


@dataclass(frozen=True)
class SequentialSurfaces:
    """A lens given by its surfaces, in the order from the sensor to the scene. z is 0 at its last vertex."""

    surfaces: tuple[Surface, ...]

    def with_stop(self, radius: Array) -> SequentialSurfaces:
        """Return the lens with another stop radius [mm]."""
        return SequentialSurfaces(
            tuple(replace(s, semi_diameter=radius) if s.stop else s for s in self.surfaces)
        )

    def unobscured(self) -> SequentialSurfaces:
        """Return the lens without central obscurations, which do not change ray paths."""
        return SequentialSurfaces(tuple(replace(s, obscuration=0.0) for s in self.surfaces))

    def trace(self, ray: Ray, wavelength_nm: Array = D_NM) -> Ray:
        """Trace rays from the air before the last vertex (z < 0) until they leave the first surface.

        wavelength_nm : one per ray, or one for all. The returned points lie on the first surface, with z from the last
        vertex. Values are undefined for rays that missed a surface, were vignetted or totally reflected.
        """
        medium, index, length = AIR, 1.0, 0.0
        for surface in self.surfaces:
            ray = _intersect(surface, ray)
            if surface.beyond != medium:
                beyond = surface.beyond.index(wavelength_nm)
                ray = _refract(surface, ray, index / beyond)
                medium, index = surface.beyond, beyond
            ray = ray._replace(z=ray.z - surface.gap)
            length += surface.gap
        return ray._replace(z=ray.z + length)

    def unvignetted(self, ray: Ray, wavelength_nm: Array = D_NM) -> Array:
        """Return True for rays that no aperture stops."""
        return self.trace(ray, wavelength_nm).unvignetted

    def miss_stop(self, ray: Ray) -> Array:
        """Return x of rays in the x-z plane where they cross the plane of the stop [mm]."""
        stop = next(number for number, surface in enumerate(self.surfaces) if surface.stop)
        return SequentialSurfaces(self.surfaces[: stop + 1]).trace(ray).x

    def reach(self, distance: float, highest: float) -> float:
        """Return the distance from the axis within which all rays cross the plane of the last vertex [mm]."""
        return WINDOW * float(self.surfaces[0].semi_diameter)


def lens_surfaces(prescription: PrescriptionSection, scale: float) -> SequentialSurfaces:
    """Return the surfaces of a prescription with lengths times ``scale``, and the stop wide open."""
    surfaces: list[Surface] = []
    gap, beyond = 0.0, AIR  # on the scene side of a surface
    for section in prescription.surfaces:
        radius_mm = section.radius_mm
        surface = Surface(
            curvature=0.0 if radius_mm is None else -1 / (radius_mm * scale),
            conic=section.conic,
            aspheric=tuple(-a / scale ** (2 * k + 3) for k, a in enumerate(section.aspheric)),
            semi_diameter=section.semi_diameter_mm * scale,
            gap=gap,
            beyond=beyond,
            stop=section.stop,
            obscuration=section.obscuration_mm * scale,
        )
        surfaces.append(surface)
        gap, beyond = section.thickness_mm * scale, glass_behind(section)
    return SequentialSurfaces(tuple(reversed(surfaces)))


def _intersect(surface: Surface, ray: Ray) -> Ray:
    """Return the intersections with the surface in its clear aperture (Welford 1986, sections 4.3 and 4.6)."""
    x, y, z, dx, dy, dz, unvignetted = ray
    away = -z / dz
    x, y, z = x + away * dx, y + away * dy, 0.0
    if surface.curvature:
        c = surface.curvature
        f, g = c * (x * x + y * y), dz - c * (x * dx + y * dy)
        bulge = 1.0 + surface.conic * dz * dz if surface.conic else 1.0
        root = g * g - c * f * bulge
        unvignetted = unvignetted & (root > 0.0)
        away = f / (g + _root(root))
        x, y, z = x + away * dx, y + away * dy, away * dz
    for _ in range(NEWTON_STEPS if surface.aspheric else 0):
        sag, slope = _sag(surface, x * x + y * y)
        away = (sag - z) / (dz - 2.0 * slope * (x * dx + y * dy))
        x, y, z = x + away * dx, y + away * dy, z + away * dz
    square = x * x + y * y
    inside = square <= surface.semi_diameter * surface.semi_diameter
    if surface.obscuration:
        inside &= square >= surface.obscuration * surface.obscuration
    return Ray(x, y, z, dx, dy, dz, unvignetted & inside)


def _sag(surface: Surface, square: Array) -> tuple[Array, Array]:
    """Return z of the surface at r², and its derivative by r²."""
    c = surface.curvature
    # Outside the edge of a conic, rays are vignetted.
    root = _root(1.0 - (1.0 + surface.conic) * c * c * square) + 1e-9
    sag, slope, power = c * square / (1.0 + root), 0.5 * c / root, square
    for k, a in enumerate(surface.aspheric):
        slope, power = slope + (k + 2) * a * power, power * square
        sag = sag + a * power
    return sag, slope


def _refract(surface: Surface, ray: Ray, ratio: Array) -> Ray:
    """Refract by Snell's law, ratio = n/n′: d′ = ratio·d + (cos θ′ − ratio·cos θ)·normal."""
    x, y, z, dx, dy, dz, unvignetted = ray
    c, conic = surface.curvature, surface.conic
    # The normal towards the scene; a unit vector for a sphere.
    nx, ny, nz = -c * x, -c * y, 1.0 - c * (1.0 + conic) * z
    if surface.aspheric:
        _, slope = _sag(surface, x * x + y * y)
        nx, ny, nz = -2.0 * slope * x, -2.0 * slope * y, 1.0
    if surface.aspheric or conic:
        size = 1.0 / _root(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx * size, ny * size, nz * size
    cosine = dx * nx + dy * ny + dz * nz
    square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    bend = _root(square) - ratio * cosine
    return ray._replace(
        dx=ratio * dx + bend * nx,
        dy=ratio * dy + bend * ny,
        dz=ratio * dz + bend * nz,
        unvignetted=unvignetted & (square > 0.0),
    )


def _root(x: Array) -> Array:
    """Return √x, and 0 below 0; scalar variants trace single rays as floats."""
    if isinstance(x, float):
        return math.sqrt(max(x, 0.0))
    return sqrt(maximum(x, 0.0))
