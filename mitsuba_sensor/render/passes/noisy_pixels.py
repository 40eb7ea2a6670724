"""More samples for the noisiest pixels, such as edges of a lamp, where each frame has a render of its own.

Beside every pass a film is rendered that has only these pixels, each as often as it needs, through the scene's own
sensor. Which they are is known from a render before, so from other samples than those of the frames: nothing is biased.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core import Array, Float64Array
from ...core.llvm import drjit
from ..light.bands import response_film, take_wavelengths_of
from ..scene.lens_sensor import Samples, sensor_class
from ..variants import MitsubaObject, mitsuba
from .passes import MOST_IN_FLIGHT, hashed_seed

STREAM = 3  # of their seeds
GROWTH = 2**0.25  # from one number of samples that is considered to the next
MOST_TIMES = 256  # the samples of the other pixels; what a pixel needs beyond is missing
Render: TypeAlias = Callable[
    [MitsubaObject, int, int], NDArray[np.float32]
]  # of a sensor, with seed and samples


def fewest_samples(needed: Float64Array, least: float) -> tuple[float, NDArray[np.intp]]:
    """How many samples all pixels get, at least ``least``, and how many times more each of them, (H, W), so that every
    pixel has as many as it needs with the fewest in all.

    needed : samples of each pixel, (H, W).
    """
    samples, best = least, (math.inf, least, np.zeros(needed.shape, np.intp))
    while samples < best[0]:  # more than the best total cannot be better
        times = np.clip(np.ceil(needed / samples) - 1, 0, MOST_TIMES - 1).astype(np.intp)
        if times.sum() <= times.size:  # a pass has to fit into memory
            best = min(
                best,
                (samples * (1 + float(times.mean())), samples, times),
                key=lambda one: one[0],
            )
        samples *= GROWTH
    return best[1:]


@dataclass(frozen=True, eq=False)
class NoisyPixels:
    """times : (H, W) of the crop, how many times more each pixel is rendered in a pass.  responses : of the channels of
    the film."""

    times: NDArray[np.intp]
    responses: Sequence[Mapping[str, object]]
    _lists: dict[tuple[int, int], list[tuple[MitsubaObject, NDArray[np.intp]]]] = field(
        default_factory=dict
    )

    @property
    def note(self) -> str:
        """What is done, in one line."""
        share, most = np.mean(self.times > 0), 1 + self.times.max()
        cost = 1 + sum(_sizes(int(self.times.sum()), MOST_IN_FLIGHT)) / self.times.size
        pixels = f"{100 * share:.2g}% of the pixels, the noisiest, have up to {most} times the samples"
        return f"{pixels}: × {cost:.3g} in all"

    def averaged(
        self,
        image: NDArray[np.float32],
        sensor: MitsubaObject,
        rows: tuple[int, int],
        seed: int,
        samples: int,
        render: Render,
    ) -> NDArray[np.float32]:
        """A pass over rows [first, last) of the crop, in which the noisy pixels are means of all their samples."""
        if not (times := self.times[slice(*rows)]).any():
            return image
        sums, counts = (
            image.reshape(-1, image.shape[-1]).astype(np.float64),
            np.ones(times.size),
        )
        for number, (listed, pixels) in enumerate(
            self._listed(sensor, rows, max(MOST_IN_FLIGHT // samples, 1))
        ):
            take_wavelengths_of(sensor.film(), listed.film())
            values = render(listed, hashed_seed(seed, STREAM, number), samples)
            np.add.at(sums, pixels, values.reshape(len(pixels), -1))
            counts += np.bincount(pixels, minlength=counts.size)
        return np.asarray((sums / counts[:, None]).astype(np.float32).reshape(image.shape))

    def _listed(
        self, sensor: MitsubaObject, rows: tuple[int, int], most: int
    ) -> list[tuple[MitsubaObject, NDArray[np.intp]]]:
        """Sensors that see the noisy pixels of these rows, and the numbers of these: as many as fill films of at most
        ``most`` pixels (more of the noisiest)."""
        if rows in self._lists:
            return self._lists[rows]
        times, found = self.times[slice(*rows)], []
        pixels = np.repeat(np.arange(times.size), times.ravel())
        sizes, make = _sizes(pixels.size, most), sensor_class(mitsuba().variant())
        pixels = np.resize(
            pixels[np.argsort(-times.ravel()[pixels], kind="stable")], sum(sizes)
        )
        for size, end in zip(sizes, np.cumsum(sizes), strict=True):
            columns, part = 2 ** (size.bit_length() // 2), pixels[end - size : end]
            film = response_film(self.responses, {"width": columns, "height": size // columns})
            found.append(
                (make(sensor, ListedPixels(part, times.shape[::-1], columns), film), part)
            )
        return self._lists.setdefault(rows, found)


def _sizes(count: int, most: int) -> list[int]:
    """Powers of two with a sum of at least ``count``, and at most a third more: a pixel is found again from its place
    on a film whose sides are powers of two without rounding, and films of one size share a compiled kernel."""
    if count == 0:
        return []
    size = 2 ** (min(count, most).bit_length() - 1)
    full, rest = divmod(count, size)
    return [size] * full + (
        [2 ** max((rest - 1).bit_length(), size.bit_length() - 3)] if rest else []
    )


class ListedPixels:
    """Rays of a film whose pixels are pixels of another sensor's crop, in any order and number.

    pixels : their numbers, row by row.  shape : columns and rows of that crop.  columns : of the film.
    """

    def __init__(self, pixels: NDArray[np.intp], shape: tuple[int, ...], columns: int) -> None:
        mi, dr = mitsuba(), drjit()
        self._column, self._row = (
            mi.Float((part).astype(np.float32))
            for part in (pixels % shape[0], pixels // shape[0])
        )
        self._size, self._columns = tuple(dr.opaque(mi.Float, float(n)) for n in shape), columns

    def sample(
        self, sensor: MitsubaObject, samples: Samples, active: Array
    ) -> tuple[MitsubaObject, Array]:
        """The other sensor's ray through the same point of the pixel, and its weight."""
        mi, dr = mitsuba(), drjit()
        time, wavelength, on_film, aperture = samples
        column, row = dr.floor(on_film.x), dr.floor(on_film.y)
        number = mi.UInt32(row) * self._columns + mi.UInt32(column)
        x = dr.gather(mi.Float, self._column, number, active) + (on_film.x - column)
        y = dr.gather(mi.Float, self._row, number, active) + (on_film.y - row)
        place = mi.Point2f(x / self._size[0], y / self._size[1])
        ray, weight = sensor.inner.sample_ray(time, wavelength, place, aperture, active)
        return ray, weight
