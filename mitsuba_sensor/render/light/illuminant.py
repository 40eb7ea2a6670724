"""The illuminant of a scene: the mean spectrum of its emitters at the surfaces that the sensor sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...camera.camera import Camera
from ...core import Exposure, first_given
from ...core.llvm import drjit
from ...core.signals import Illuminant
from ..variants import MitsubaObject, mitsuba
from .irradiance import RenderedFor

if TYPE_CHECKING:
    from ..load.scene import Scene

POINTS, SCALAR_POINTS = 2048, 16  # of the image, at each wavelength
STEP_NM, AT_ONCE = 1.0, 4  # between the wavelengths; a spectrum of Mitsuba holds four
AVERAGED = 5  # wavelengths in a band of the result, so lines keep their power
LOWEST_NM, HIGHEST_NM = 360.0, 1100.0  # a camera that detects more extends the range
WHOLE_NM = STEP_NM * AT_ONCE * AVERAGED
NUMBERS = 6  # random numbers of a point: place, pupil, and emitter, two each
SEED = 3


def rendered_for(
    scene: Scene, camera: Camera, exposure: Exposure, serial: int | None
) -> RenderedFor:
    """Return camera, exposure and serial number of a light, with the illuminant if the camera has colour filters."""
    illuminant = (
        illuminant_of(scene, camera.band_nm[1]) if len(camera.filter_names) > 1 else None
    )
    return RenderedFor(
        None if camera.added else camera, exposure, first_given(serial, 1), illuminant
    )


def illuminant_of(scene: Scene, highest_nm: float = HIGHEST_NM) -> Illuminant | None:
    """Return the power in bands of 5 nm, to at least 1100 nm, in a unit that the light groups of a scene share; None if
    no emitter reaches a visible surface.

    Direct light without shadows. Surfaces that colour the light, e.g. a red wall, belong to the scene.
    """
    mi, dr = mitsuba(), drjit()

    def seen(numbers: Sequence[MitsubaObject]) -> MitsubaObject:
        """Return the surface at a place of the image, through a place of the pupil."""
        column, row, *pupil, _, _ = numbers
        ray, _ = scene.sensor.sample_ray(0.0, 0.5, mi.Point2f(column, row), mi.Point2f(*pupil))
        return scene.mitsuba_scene.ray_intersect(mi.Ray3f(ray))

    def thrown(hit: MitsubaObject, numbers: Sequence[Any], nm: Sequence[Any]) -> MitsubaObject:
        """Return the irradiance of a surface by one part of an emitter over its probability, at four wavelengths."""
        hit.wavelengths = mi.UnpolarizedSpectrum(*nm)
        sample, radiance = scene.mitsuba_scene.sample_emitter_direction(
            hit, mi.Point2f(*numbers[-2:]), False
        )
        radiance = mi.unpolarized_spectrum(radiance)
        return dr.select(hit.is_valid(), radiance * dr.abs(dr.dot(hit.n, sample.d)), 0.0)

    steps = math.ceil((max(highest_nm, HIGHEST_NM) - LOWEST_NM) / WHOLE_NM)
    wavelengths_nm = LOWEST_NM + np.arange(0, steps * WHOLE_NM, STEP_NM) + 0.5 * STEP_NM
    quarters = wavelengths_nm.reshape(-1, AT_ONCE)
    scalar = mi.variant().startswith("scalar")
    points = np.random.default_rng(SEED).random((SCALAR_POINTS if scalar else POINTS, NUMBERS))
    if scalar:
        hits = [(seen(p), p) for p in points.tolist()]  # the same at all wavelengths
        radiance = np.array(
            [[list(thrown(*hit, nm)) for hit in hits] for nm in quarters.tolist()], np.float32
        )
    else:
        # Made from lists: each alignment of NumPy's arrays would compile another kernel.
        drawn = [dr.tile(mi.Float(numbers.tolist()), len(quarters)) for numbers in points.T]
        nm = [dr.repeat(mi.Float(nm.tolist()), len(points)) for nm in quarters.T]
        found = np.array(thrown(seen(drawn), drawn, nm))
        radiance = np.moveaxis(found.reshape(AT_ONCE, len(quarters), len(points)), 0, -1)
    bands = radiance.mean(axis=1).reshape(-1, AVERAGED).mean(axis=1)
    if not (np.isfinite(bands).all() and bands.sum() > 0):
        return None
    return Illuminant(wavelengths_nm.reshape(-1, AVERAGED).mean(axis=1), bands)
