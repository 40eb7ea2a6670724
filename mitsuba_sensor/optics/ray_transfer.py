"""Ray-transfer functions: polynomials from rays on the sensor side to rays on the scene side (ISET).

A ray crosses the input plane at the distance r from the axis with direction cosines dx, dy, in a frame rotated about
the axis so that this point lies on +y. Polynomials of r, dx and dy give its point and direction on the scene side in
the same frame. The ray passes if its point in the pass plane lies in an ellipse that depends on r, or in circles whose
centres move with r. Goossens et al. 2022, arXiv 2202.08880.

Lengths are in mm; z points to the scene and is 0 in the pass plane. Polynomials need float64: at degree 16, they sum
terms 100 000 times larger than the result.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..core import Array
from ..core.arrays import drjit_module, is_numpy, maximum, sqrt, where
from .ray_trace import D_NM, Ray

if TYPE_CHECKING:
    from ..camera.lens_datasheet import RayPolynomialSection, RayTransferSection

ON_AXIS_MM = 1e-12  # below this distance, r has no direction
NO_STOP_MM = 1e9


@dataclass(frozen=True)
class RayPolynomial:
    """Sum of coefficient·r^a·dx^b·dy^c.  terms : powers of r and dx → power of dy → coefficient."""

    terms: dict[tuple[int, int], dict[int, float]]

    def value(self, r: Array, dx: Array, dy: Array) -> Array:
        """Return the polynomial of NumPy or Dr.Jit arrays, or of numbers."""
        r_powers, dx_powers = [1.0], [1.0]
        total = 0.0 * r
        for (a, b), by_dy in self.terms.items():
            while len(r_powers) <= a:
                r_powers.append(r_powers[-1] * r)
            while len(dx_powers) <= b:
                dx_powers.append(dx_powers[-1] * dx)
            inner = 0.0
            for c in range(max(by_dy), -1, -1):
                inner = inner * dy + by_dy.get(c, 0.0)
            total = total + r_powers[a] * dx_powers[b] * inner
        return total

    def slope(self, r: int, dy: int) -> float:
        """Return the coefficient of r^r·dy^dy."""
        return self.terms.get((r, 0), {}).get(dy, 0.0)


def ray_polynomial(section: RayPolynomialSection) -> RayPolynomial:
    """Return the polynomial of a section of the camera file."""
    terms: dict[tuple[int, int], dict[int, float]] = {}
    powers = zip(section.powers_r, section.powers_dx, section.powers_dy, strict=True)
    for coefficient, (a, b, c) in zip(section.coefficients, powers, strict=True):
        by_dy = terms.setdefault((a, b), {})
        by_dy[c] = by_dy.get(c, 0.0) + coefficient
    return RayPolynomial(terms)


@dataclass(frozen=True)
class PassEllipses:
    """Ellipses at heights r in the input plane, interpolated linearly; rays above the last height do not pass."""

    heights: tuple[float, ...]
    centers: tuple[float, ...]
    radii_x: tuple[float, ...]
    radii_y: tuple[float, ...]

    def contains(self, r: Array, x: Array, y: Array) -> Array:
        """Return True for passing rays of height r with the point (x, y) in the pass plane."""
        hinges = [maximum(r - height, 0.0) for height in self.heights[:-1]]
        center, radius_x, radius_y = (
            _linear(self.heights, values, hinges)
            for values in (self.centers, self.radii_x, self.radii_y)
        )
        across, along = x / radius_x, (y - center) / radius_y
        return (across * across + along * along <= 1.0) & (r <= self.heights[-1])

    def reach(self, share: float, highest: float) -> float:
        """Return the farthest edge of all ellipses [mm]."""
        radii = np.maximum(self.radii_x, self.radii_y)
        return float(np.max(np.abs(self.centers) + radii))


def _linear(
    heights: tuple[float, ...], values: tuple[float, ...], hinges: list[Array]
) -> Array:
    """Return interpolated values.  hinges : max(r − height, 0) for all heights except the last."""
    slopes = np.diff(values) / np.diff(heights)
    total = values[0]
    for hinge, bend in zip(hinges, np.diff(slopes, prepend=0.0), strict=True):
        total = total + float(bend) * hinge
    return total


@dataclass(frozen=True)
class PassCircles:
    """Circles whose centres move with r; a ray must pass all circles."""

    radii: tuple[float, ...]
    sensitivities: tuple[float, ...]

    def contains(self, r: Array, x: Array, y: Array) -> Array:
        """Return True for rays in all circles."""
        inside = r >= 0.0
        for radius, sensitivity in zip(self.radii, self.sensitivities, strict=True):
            along = y - sensitivity * r
            inside = inside & (x * x + along * along <= radius * radius)
        return inside

    def reach(self, share: float, highest: float) -> float:
        """Return how far from the axis rays from below an image height pass [mm]: |y − s·r| ≤ R.

        share : position of the input plane between film and pass plane, as a fraction.
        """
        edges = []
        for radius, sensitivity in zip(self.radii, self.sensitivities, strict=True):
            moved = radius + abs(sensitivity) * (1 - share) * highest
            edges.append(moved / max(abs(1 - sensitivity * share), 1e-6))
        return min(edges)


@dataclass(frozen=True)
class RayTransfer:
    """A lens given by its ray transfer, with all lengths times ``scale``.

    outputs : name of the coordinate → polynomial.
    depth : distance from the input plane to the pass plane [mm in the file].
    length : distance from the pass plane to the first vertex.
    output_plane : distance from there to the output plane, towards the scene.
    exit_pupil : distance from the pass plane towards the sensor [mm].
    stop_radius : of the exit pupil when stopped down [mm].
    """

    outputs: dict[str, RayPolynomial]
    passes: PassEllipses | PassCircles
    uses_outdz: bool
    depth: float
    length: float
    output_plane: float
    scale: float
    exit_pupil: float = 0.0
    stop_radius: Array = NO_STOP_MM

    def with_stop(self, radius: Array) -> RayTransfer:
        """Return the lens with another stop radius [mm]."""
        return replace(self, stop_radius=radius)

    def unobscured(self) -> RayTransfer:
        """Return the lens itself; it has no central obscuration."""
        return self

    def trace(self, ray: Ray, wavelength_nm: Array = D_NM) -> Ray:
        """Trace rays that start before the pass plane, at the wavelength of the fit."""
        r, dx, dy, (ux, uy) = self._at_input(ray)
        out = {name: polynomial.value(r, dx, dy) for name, polynomial in self.outputs.items()}
        square = 1.0 - out["dx"] * out["dx"] - out["dy"] * out["dy"]
        dz = sqrt(maximum(square, 0.0))
        length = 1.0
        if self.uses_outdz:
            dz = out["dz"]
            length = sqrt(maximum(1.0 - square + dz * dz, 1e-12))
        sag = out["z"] - self.outputs["z"].slope(0, 0)
        points = (
            (out["x"] * uy + out["y"] * ux) * self.scale,
            (out["y"] * uy - out["x"] * ux) * self.scale,
            (self.length + self.output_plane + sag) * self.scale,
        )
        directions = (
            (out["dx"] * uy + out["dy"] * ux) / length,
            (out["dy"] * uy - out["dx"] * ux) / length,
            dz / length,
        )
        passes = self.unvignetted(ray) & ((square > 0.0) | self.uses_outdz)
        x, y, z, dx, dy, dz = (_like(number, ray.x) for number in (*points, *directions))
        return Ray(x, y, z, dx, dy, dz, passes)

    def unvignetted(self, ray: Ray, wavelength_nm: Array = D_NM) -> Array:
        """Return True for passing rays."""
        x, y = self._at_exit_pupil(ray)
        in_stop = x * x + y * y <= self.stop_radius * self.stop_radius
        return ray.unvignetted & self.passes.contains(*self._in_pass_plane(ray)) & in_stop

    def miss_stop(self, ray: Ray) -> Array:
        """Return x in the plane of the exit pupil [mm]."""
        return self._at_exit_pupil(ray)[0]

    def _at_exit_pupil(self, ray: Ray) -> tuple[Array, Array]:
        """Return x and y of rays in the plane of the exit pupil [mm]."""
        away = (-self.exit_pupil - ray.z) / ray.dz
        return ray.x + away * ray.dx, ray.y + away * ray.dy

    def reach(self, distance: float, highest: float) -> float:
        """Return how far from the axis rays from below an image height cross the pass plane [mm].

        distance : from the film to the pass plane.
        """
        share = 1.0 - self.depth * self.scale / distance
        lit = self.scale * self.passes.reach(share, highest / self.scale)
        edge = self.stop_radius * distance + highest * abs(self.exit_pupil)
        return float(min(lit, edge / (distance - self.exit_pupil)))

    def _at_input(self, ray: Ray) -> tuple[Array, Array, Array, tuple[Array, Array]]:
        """Return r, dx and dy of rays in the frame whose +y they cross, and the direction of r."""
        x, y, z, dx, dy, dz = (_double(number) for number in ray[:6])
        away = -self.depth - z / self.scale
        x, y = x / self.scale + away * dx / dz, y / self.scale + away * dy / dz
        r = sqrt(x * x + y * y)
        safe = maximum(r, ON_AXIS_MM)
        ux, uy = x / safe, where(r < ON_AXIS_MM, 1.0, y / safe)
        return r, dx * uy - dy * ux, dx * ux + dy * uy, (ux, uy)

    def _in_pass_plane(self, ray: Ray) -> tuple[Array, Array, Array]:
        """Return r of rays, and their points in the pass plane in the same frame."""
        r, dx, dy, _ = self._at_input(ray)
        per_z = self.depth / sqrt(maximum(1.0 - dx * dx - dy * dy, 1e-12))
        return r, dx * per_z, r + dy * per_z


def ray_transfer(section: RayTransferSection, scale: float) -> RayTransfer:
    """Return the lens of a section of the camera file, wide open."""
    outputs = {str(p.output): ray_polynomial(p) for p in section.polynomials}
    passes: PassEllipses | PassCircles = PassEllipses(
        section.pass_heights_mm or (),
        section.pass_centers_mm or (),
        section.pass_radii_x_mm or (),
        section.pass_radii_y_mm or (),
    )
    if section.pass_circle_radii_mm is not None:
        passes = PassCircles(
            section.pass_circle_radii_mm, section.pass_circle_sensitivities or ()
        )
    depth = section.pass_plane_mm
    return RayTransfer(
        outputs={"z": RayPolynomial({}), **outputs},
        passes=passes,
        uses_outdz=section.uses_outdz,
        depth=depth,
        length=section.thickness_mm + section.input_plane_mm - depth,
        output_plane=section.output_plane_mm,
        scale=scale,
    )


def _double(number: Array) -> Array:
    """Return a number in float64."""
    return number if is_numpy(number) else drjit_module().float64_array_t(type(number))(number)


def _like(number: Array, other: Array) -> Array:
    """Return a number in the precision of another."""
    return number if is_numpy(other) else type(other)(number)
