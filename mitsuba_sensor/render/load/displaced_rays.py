"""Point spread of lens and pixel: each ray starts from a film position that is displaced by a draw from the PSF.

The mean over the rays of a pixel then estimates

    E_pixel = ∫ pixel aperture ∫ PSF_λ(δ) E_λ(p + δ) dδ dp

without bias and without additional rays; outside of film or crop the rays see the scene. Rays start within the aperture
of the pixel, and in the cells of a measured sensitivity in proportion to the sensitivity. The wavelengths of a ray
share δ, which is drawn for the first of them. Each wavelength could have been the first, so wavelength k has the weight
PSF_k(δ)/mean_j PSF_j(δ) (balance heuristic), which leaves the sum of the weights unchanged; weight_noise.py removes
most of the noise that the weights add.

Off axis the pupil is an ellipse in direction cosines, and the spread has the inverse of its axes: cos³θ and cos θ along
and across the radius for a thin lens, and the ellipse of passing light for a sequential lens.

A pinhole does not use the two random numbers of the aperture. For a lens, two new numbers are a hash of all numbers of
the ray.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from ...camera.camera import Camera
from ...core import Array, Float64Array
from ...core.llvm import drjit
from ...optics.f_number_law import numerical_aperture
from ...optics.intrinsics import View
from ...optics.point_spread import point_spread_tables
from ..variants import MitsubaObject, mitsuba
from .lens_sensor import IN_PYTHON, NO_HEIGHT, Samples, sensor_class

SHARE_STEP = 2.0**-24  # of the energy: the last bit of a random number
DENSITY_MIN = 1e-12  # added to densities, so no ray has the density 0


class Pupil(Protocol):
    """The pupil as seen from a point of the film."""

    def numerical_apertures(self, place: Array) -> tuple[Array, Array]:
        """Return the numerical apertures along and across the radius, at a position on the full film [pixels]."""


class ThinPupil:
    """The pupil of a thin lens or pinhole, parallel to the film; constant for an orthographic sensor."""

    def __init__(self, camera: Camera, view: View) -> None:
        self._axis, self._scale = view.axis, _data(view.tangent_per_pixel)
        self._on_axis = _data(numerical_aperture(view, camera))

    def numerical_apertures(self, place: Array) -> tuple[Array, Array]:
        """Return NA·cos³θ and NA·cos θ."""
        x, y = (place.x - self._axis[0]) * self._scale, (place.y - self._axis[1]) * self._scale
        cosine = drjit().rsqrt(1 + x * x + y * y)
        return self._on_axis * cosine * cosine * cosine, self._on_axis * cosine


def with_displaced_rays(
    sensor: MitsubaObject, view: View, camera: Camera | None
) -> tuple[MitsubaObject, tuple[str, ...]]:
    """Return the sensor after the point spread of the camera's lens and pixel, and notes; unchanged without one."""
    if camera is None:
        return sensor, ()
    if not camera.lens.diffraction and camera.pixel.aperture_shape.is_full:
        return sensor, ()
    slow = mitsuba().variant().startswith("scalar") and not hasattr(sensor, "lens")
    pupil: Pupil = sensor.lens if view.sequential else ThinPupil(camera, view)
    rays = DisplacedRays(
        camera,
        view,
        pupil,
        diffraction=camera.lens.diffraction,
        aperture_is_free=not view.sequential and view.aperture_radius_m == 0,
        shared=not camera.lens.dispersion,
    )
    notes = (IN_PYTHON,) if slow else ()
    return sensor_class(mitsuba().variant())(sensor, rays), notes


class DisplacedRays:
    """Rays of another sensor from displaced positions.

    diffraction : True if the spread of the lens displaces rays; False if only the aperture of the pixel does.
    aperture_is_free : True if the other sensor does not use the two numbers for its aperture.
    shared : True if the wavelengths of a ray share its path; else only the first wavelength has a weight.
    excess : wavelengths [nm] and (w − 1)/pdf of the rays that were sampled last.
    """

    excess: tuple[Array, Array]

    def __init__(
        self,
        camera: Camera,
        view: View,
        pupil: Pupil,
        *,
        diffraction: bool,
        aperture_is_free: bool,
        shared: bool,
    ) -> None:
        self._axis, self._pupil, self._diffraction = view.axis, pupil, diffraction
        self._aperture_is_free, self._shared = aperture_is_free, shared
        aperture = camera.pixel.aperture_shape
        self._is_full, self._sides = aperture.is_full, [_data(side) for side in aperture.sides]
        self._cell_counts = len(aperture.cells[0]), len(aperture.cells)
        self._cells: MitsubaObject = None
        if not aperture.is_even:
            cells = np.array(aperture.cells, np.float32)
            self._cells = mitsuba().DiscreteDistribution2D(cells)
        self._pitch_nm = (camera.pixel.pitch_x_um * 1e3, camera.pixel.pitch_y_um * 1e3)
        tables = point_spread_tables(camera.lens.obstruction)
        self._radii, self._densities = _texture(tables.radii), _texture(tables.densities)
        self._inside, self._edge = _data(tables.inside), _data(tables.edge)
        self._beyond, self._tail = _data((1 - tables.inside) * tables.edge), _data(tables.tail)

    @property
    def has_weights(self) -> bool:
        """True if the wavelengths of a ray have separate weights."""
        return self._diffraction and self._shared

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """Return the ray of the inner sensor through the displaced position, and its weight per wavelength."""
        time, wavelength, place, aperture = samples
        start = place if self._is_full else self._in_aperture(place)
        if not self._diffraction:
            ray, weight = sensor.inner_ray((time, wavelength, start, aperture), active)
            return ray, weight
        mi, dr = mitsuba(), drjit()
        shares = self._random_numbers(samples)
        no_surface = dr.zeros(mi.SurfaceInteraction3f)
        lengths_nm, per_density = sensor.inner.sample_wavelengths(
            no_surface, wavelength, active
        )
        x_nm = lengths_nm[0] * self._radius(shares.x)
        displaced = self._displaced(start, x_nm, 2 * math.pi * shares.y)
        ray, weight = sensor.inner_ray((time, wavelength, displaced, aperture), active)
        if self._shared:
            balance = self._balance(x_nm, lengths_nm)
            self.excess = lengths_nm, (balance - 1) * mi.unpolarized_spectrum(per_density)
            weight = mi.Spectrum(mi.unpolarized_spectrum(weight) * balance)
        return ray, weight

    def _in_aperture(self, place: Array) -> Array:
        """Return the position within the aperture of the same pixel, drawn from its sensitivity."""
        dr, mi, (width, height) = drjit(), mitsuba(), self._sides
        column, row = dr.floor(place.x), dr.floor(place.y)
        x, y = place.x - column, place.y - row
        if self._cells is not None:
            cell, _, within = self._cells.sample(mi.Point2f(x, y))
            cells_x, cells_y = self._cell_counts
            x = (mi.Float(cell.x) + within.x) / cells_x
            y = (mi.Float(cell.y) + within.y) / cells_y
        start_x, start_y = column + 0.5 + (x - 0.5) * width, row + 0.5 + (y - 0.5) * height
        return type(place)(start_x, start_y)

    def _random_numbers(self, samples: Samples) -> Array:
        """Return two random numbers, for radius and direction of the displacement."""
        mi, (_, wavelength, place, aperture) = mitsuba(), samples
        if self._aperture_is_free:
            return aperture
        first, second = mi.sample_tea_32(_bits(place.x), _bits(place.y))
        first, second = mi.sample_tea_32(first ^ _bits(aperture.x), second ^ _bits(aperture.y))
        first, second = mi.sample_tea_32(first ^ _bits(wavelength), second)
        return mi.Point2f((first >> 8) * SHARE_STEP, (second >> 8) * SHARE_STEP)

    def _radius(self, share: Array) -> Array:
        """Return x of the circle that contains this fraction of the energy."""
        dr = drjit()
        inside = _at(self._radii, dr.minimum(share / self._inside, 1.0))
        left = dr.maximum(1.0 - share, SHARE_STEP)
        return dr.select(share < self._inside, inside, self._beyond / left)

    def _displaced(self, place: Array, x_nm: Array, angle: Array) -> Array:
        """Return the position moved by x·λ/(2π·NA) in a direction.  x_nm : x·λ."""
        dr, (pitch_x, pitch_y) = drjit(), self._pitch_nm
        from_x, from_y = place.x - self._axis[0], place.y - self._axis[1]
        height = dr.sqrt(from_x * from_x + from_y * from_y)
        on_axis, inverse = height < NO_HEIGHT, 1.0 / dr.maximum(height, NO_HEIGHT)
        ux = dr.select(on_axis, 1.0, from_x * inverse)
        uy = dr.select(on_axis, 0.0, from_y * inverse)
        along_na, across_na = self._pupil.numerical_apertures(place)
        radius = x_nm / (2 * math.pi)
        along, across = radius * dr.cos(angle) / along_na, radius * dr.sin(angle) / across_na
        dx, dy = along * ux - across * uy, along * uy + across * ux
        return type(place)(place.x + dx / pitch_x, place.y + dy / pitch_y)

    def _balance(self, x_nm: Array, lengths_nm: Array) -> Array:
        """Return the PSF of each wavelength over their mean."""
        dr, densities = drjit(), []
        for nm in lengths_nm:
            x = x_nm / nm
            near = _at(self._densities, dr.minimum(x / self._edge, 1.0))
            far = self._tail / dr.maximum(x * x * x, 1.0)
            densities.append((dr.select(x < self._edge, near, far) + DENSITY_MIN) / (nm * nm))
        mean = sum(densities) / len(densities)
        return mitsuba().UnpolarizedSpectrum(*(density / mean for density in densities))


def _data(number: float) -> Array:
    """Return a number as data of the kernel, so one kernel serves all values."""
    return drjit().opaque(mitsuba().Float, number)


def _texture(values: Float64Array) -> MitsubaObject:
    mi = mitsuba()
    return mi.Texture1f(mi.TensorXf(values.astype(np.float32)[:, None]), use_accel=False)


def _at(table: MitsubaObject, share: Array) -> Array:
    """Return a table, linear between its nodes, at a fraction of its length."""
    nodes = table.shape[0]
    return table.eval(share * ((nodes - 1) / nodes) + 0.5 / nodes)[0]


def _bits(number: Array) -> Array:
    """Return the 32 bits of a float."""
    if isinstance(number, float):
        return int(np.float32(number).view(np.uint32))
    dr = drjit()
    return dr.reinterpret_array(mitsuba().UInt32, dr.detach(number))
