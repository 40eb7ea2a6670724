"""A lens that rays are traced through, from the sensor to the scene: surface by surface, or by its ray transfer.

Rays start at z < 0 and z is 0 at the reference plane: the last vertex of surfaces, the pass plane of a ray transfer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from ..core import Array
from .paraxial import cardinal_points, surfaces_at_f_number
from .ray_trace import D_NM, Ray, Surface, stopped_down, surfaces_to_stop, trace
from .ray_transfer import ray_transfer

if TYPE_CHECKING:
    from ..camera.lens_datasheet import LensSection

WINDOW = 1.5  # of the last clear aperture: where a slanting ray that hits it may cross the plane of its vertex


class TracedLens(Protocol):
    """What images are made through."""

    def with_stop(self, radius: Array) -> TracedLens:
        """The same lens with another radius of the stop [mm]."""

    def trace(self, ray: Ray, wavelength_nm: Array = D_NM) -> Ray:
        """What becomes of rays from the sensor on the side of the scene."""

    def unvignetted(self, ray: Ray, wavelength_nm: Array = D_NM) -> Array:
        """Whether they get there."""

    def miss_stop(self, ray: Ray) -> Array:
        """How far from the middle of the stop rays in the plane of x and z cross its plane, along x [mm]."""

    def reach(self, distance: float, highest: float) -> float:
        """No ray from below an image height passes the reference plane farther from the axis [mm].

        distance : from the film to the reference plane.
        """


@dataclass(frozen=True)
class SequentialSurfaces:
    """The surfaces of a prescription, from the sensor to the scene."""

    surfaces: tuple[Surface, ...]

    def with_stop(self, radius: Array) -> SequentialSurfaces:
        """The same lens with another radius of the stop [mm]."""
        return SequentialSurfaces(stopped_down(self.surfaces, radius))

    def trace(self, ray: Ray, wavelength_nm: Array = D_NM) -> Ray:
        """What becomes of rays from the sensor when they leave the first surface."""
        return trace(self.surfaces, ray, wavelength_nm)

    def unvignetted(self, ray: Ray, wavelength_nm: Array = D_NM) -> Array:
        """Whether no aperture stops them."""
        return trace(self.surfaces, ray, wavelength_nm).unvignetted

    def miss_stop(self, ray: Ray) -> Array:
        """x in the plane of the stop [mm]."""
        return trace(surfaces_to_stop(self.surfaces), ray).x

    def reach(self, distance: float, highest: float) -> float:
        """That of the last surface."""
        return WINDOW * float(self.surfaces[0].semi_diameter)


def traced_lens(lens: LensSection) -> TracedLens:
    """The lens of a camera, scaled and stopped down to its f-number."""
    assert lens.prescription is not None
    if lens.prescription.ray_transfer is None:
        return SequentialSurfaces(surfaces_at_f_number(lens))
    points = cardinal_points(lens)
    transfer = ray_transfer(lens.prescription.ray_transfer, points.scale)
    return replace(transfer, exit_pupil=points.exit_pupil, stop_radius=points.stop_radius)
