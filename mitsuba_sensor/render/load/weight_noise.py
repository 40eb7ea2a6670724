"""The noise that the weights of displaced rays add to the photoelectrons, measured during the render.

The wavelengths of a ray have weights with the mean 1, see displaced_rays.py. The signal of a pixel behind filter f has
the factor 1 + d_f, where d_f is the mean over its rays and wavelengths of (w − 1)·response(λ)/pdf(λ), over the integral
of the response. d_f has the mean 0, and in uniform light it is the only noise. With a level L from other pixels, which
is independent of the rays of this pixel, I_f − L·d_f has the mean of I_f and less noise (a control variate).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core import Array
from ...core.llvm import drjit
from ..light.bands import Bands
from ..variants import MitsubaObject, mitsuba
from .displaced_rays import DisplacedRays
from .lens_sensor import Samples, sensor_class

Render: TypeAlias = Callable[[MitsubaObject], NDArray[np.float32]]
COLUMNS_MIN = 3
STEPS = 4096  # of the integral of a response


class WeightCounter:
    """Renders with rays whose weights are summed for each pixel.

    rays : displaced rays.  responses : of the filters, Mitsuba spectra.  ends_nm : of the wavelengths.
    """

    def __init__(
        self,
        rays: DisplacedRays,
        responses: Sequence[Mapping[str, object]],
        ends_nm: tuple[float, float],
    ) -> None:
        mi, dr = mitsuba(), drjit()
        self._rays, self._sensors = rays, dict[int, MitsubaObject]()
        self._responses = [mi.load_dict(dict(response)) for response in responses]
        integrals = [_integral(response, ends_nm) for response in self._responses]
        self._inverse = [dr.opaque(mi.Float, 1 / integral) for integral in integrals]
        self._sums: Array = None

    def rendered(
        self, sensor: MitsubaObject, samples: int, render: Render
    ) -> NDArray[np.float32]:
        """Return the image of a sensor followed by d_f of the pixels, shape (rows, columns, channels + filters).

        samples : rays of each pixel.
        """
        number = id(sensor)
        if number not in self._sensors:
            self._sensors[number] = sensor_class(mitsuba().variant())(sensor, self)
        columns, rows = (int(count) for count in sensor.film().crop_size())
        count = len(self._responses)
        self._sums = drjit().zeros(mitsuba().Float, columns * rows * count)
        image = render(self._sensors[number])
        means = np.array(self._sums).reshape(rows, columns, count) / np.float32(samples)
        return np.concatenate([image, means], axis=-1)

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """Return the ray of the inner sensor, and its weight."""
        mi, dr = mitsuba(), drjit()
        ray, weight = sensor.inner_ray(samples, active)
        _, _, on_film, _ = samples
        size, corner = sensor.crop()
        column = dr.clip(dr.floor(on_film.x - corner.x), 0, size.x - 1)
        row = dr.clip(dr.floor(on_film.y - corner.y), 0, size.y - 1)
        pixel = mi.UInt32(row) * mi.UInt32(size.x) + mi.UInt32(column)
        at = dr.zeros(mi.SurfaceInteraction3f)
        at.wavelengths, excess = self._rays.excess
        density = sensor.film().sensor_response_function().eval(at)  # times its weight
        excess = dr.select(density > 0, excess / density, 0.0)
        for number, response in enumerate(self._responses):
            share = dr.mean(excess * response.eval(at)) * self._inverse[number]
            place_in_sums = pixel * len(self._responses) + number
            dr.scatter_add(self._sums, share, place_in_sums, mi.Bool(active))
        return ray, weight


def weight_counter(sensor: MitsubaObject, bands: Bands) -> WeightCounter | None:
    """Return the counter for a sensor with displaced rays and the colour filters of a film; None if rays have no
    weights, in scalar variants, and if groups of bands are rendered separately."""
    rays, filters = getattr(sensor, "lens", None), bands.responses[bands.first_filter :]
    if mitsuba().variant().startswith("scalar") or not isinstance(rays, DisplacedRays):
        return None
    if not rays.has_weights or not filters or len(bands.groups) > 1:
        return None
    return WeightCounter(rays, filters, bands.ends_nm)


def _integral(response: MitsubaObject, ends_nm: tuple[float, float]) -> float:
    """Return ∫ response dλ, or a tiny number for a response of 0."""
    mi = mitsuba()
    step_nm = (ends_nm[1] - ends_nm[0]) / STEPS
    at = drjit().zeros(mi.SurfaceInteraction3f, STEPS)
    middles_nm = ends_nm[0] + step_nm * (np.arange(STEPS) + 0.5)
    at.wavelengths = mi.UnpolarizedSpectrum(mi.Float(middles_nm))
    values = np.array(response.eval(at)[0], dtype=float)
    return max(float(values.sum()) * step_nm, float(np.finfo(np.float32).tiny))


def without_weight_noise(values: NDArray[np.floating], excess: NDArray[np.float32]) -> None:
    """Subtract the noise of the weights in place; single values may become negative.

    values : pixels of a pass, shape (…, W, filters).  excess : their d_f.  The level of a pixel is the smaller one of
        its
    two neighbours in the row, which excludes bright edges and fireflies.
    """
    if values.shape[-2] < COLUMNS_MIN:
        return
    right, left = np.roll(values, -1, axis=-2), np.roll(values, 1, axis=-2)
    right[..., -1, :], left[..., 0, :] = values[..., -2, :], values[..., 1, :]
    values -= np.minimum(left, right) * excess
