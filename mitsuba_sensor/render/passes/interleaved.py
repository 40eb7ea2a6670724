"""Several passes in one launch of a kernel, on a film on which the passes of a pixel lie side by side.

Each launch has a fixed cost of some milliseconds, in which a small picture could have another pass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...core import Array
from ...core.llvm import drjit
from ..light.bands import response_film
from ..scene.lens_sensor import Samples, sensor_class
from ..variants import MitsubaObject, mitsuba

MOST_IN_FLIGHT = 2**21  # samples of several passes: 95 MB
MOST_VALUES = 2**22  # pixels × channels of their film: 16 MB


def most_interleaved(pixels: int, channels: int, samples: int) -> int:
    """How many passes of so many samples per pixel fit on one film, at least 1.  Not for scalar variants, which trace
    the rays of a sensor like this in Python."""
    if mitsuba().variant().startswith("scalar"):
        return 1
    return max(min(MOST_IN_FLIGHT // (pixels * samples), MOST_VALUES // (pixels * channels)), 1)


def interleaved(
    sensor: MitsubaObject,
    responses: Sequence[Mapping[str, object]],
    count: int,
    size: tuple[int, int],
) -> MitsubaObject:
    """A sensor that sees each pixel of another one's crop of this size (columns, rows) ``count`` times, side by side.

    responses : of the channels of its film.
    """
    film = response_film(responses, {"width": size[0] * count, "height": size[1]})
    return sensor_class(mitsuba().variant())(sensor, InterleavedPasses(count, size), film)


class InterleavedPasses:
    """Rays of a film on which each pixel of another sensor's crop lies ``count`` times side by side.

    A point that rounding moves to the neighbouring pixel of the film is still within the same pixel of the crop, or
    where it was, across its edge.
    """

    def __init__(self, count: int, size: tuple[int, int]) -> None:
        mi, dr = mitsuba(), drjit()
        self._share = dr.opaque(
            mi.Float, 1 / count
        )  # data of the kernel, so that it serves all numbers and sizes
        self._columns, self._rows = (dr.opaque(mi.Float, float(n)) for n in size)

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """The other sensor's ray through the same point of the pixel, and its weight."""
        mi, dr = mitsuba(), drjit()
        time, wavelength, on_film, aperture = samples
        number = dr.floor(on_film.x)
        x = dr.floor((number + 0.5) * self._share) + (on_film.x - number)
        place = mi.Point2f(x / self._columns, on_film.y / self._rows)
        ray, weight = sensor.inner.sample_ray(time, wavelength, place, aperture, active)
        return ray, weight
