"""Equal passes and their sums: mean and variance (Welford) of what each channel of the film detects, bad values."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from ..light.bands import Bands, of_own_filter
from ..load.weight_noise import without_weight_noise
from ..samples import clean, hashed_seed

if TYPE_CHECKING:
    from ..load.scene import Scene
    from ..motion.moving_scene import MovingScene

VALUES_AT_ONCE = 2**15  # that stay in a processor's cache
USUAL = (1e-9, 1e9)
"""Radiance whose squares float32 holds, with a wide margin on both sides."""

ROUNDING = 1e-6  # of the light: what a float32 film loses is no noise
ONE_PASS = 0.75  # of the squared deviations of all passes

Electrons = tuple[Float64Array, Float64Array]
"""Mean photoelectrons of each pixel, and the expected squared error of that mean, (H, W) each."""


class Welford:
    """Mean of equal passes and their sum of squared deviations, (H, W, C) float32 each: of few passes float32 loses
    less than the film does."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.mean, self.squares = np.zeros(shape, np.float32), np.zeros(shape, np.float32)

    def add(self, rows: slice, values: NDArray[np.float32], number: int) -> None:
        """Add some rows of the pass with this number, from 1."""
        delta = values - self.mean[rows]
        self.mean[rows] += delta * np.float32(1 / number)
        delta *= delta
        delta *= np.float32(1 - 1 / number)
        self.squares[rows] += delta

    def variance(self, passes: int) -> NDArray[np.float32]:
        """Return the variance of the mean of so many passes; 0 of a single one."""
        return self.squares / np.float32(max(passes * (passes - 1), 1))


class Passes:
    """What a film detected in the passes so far.

    count, samples : passes, and samples per pixel of each (in all groups of bands).
    bands, filters : sums of the bands [W m⁻² sr⁻¹], empty where only colour filters are rendered, and of the filters
        [e-]; both divided by ``unit``.
    even : sum of the passes 0, 2, 4, … behind the filters, for the denoiser.
    infinite : (H, W) where a pass was infinite.  negative, non_finite : values that were set to 0.  lost : those that
        were NaN or −∞.
    per_radiance : (H, W) photoelectrons behind a filter for what the film has in its channel.
    """

    def __init__(
        self,
        bands: Bands,
        per_radiance: Float64Array,
        tile: NDArray[np.intp],
        origin: tuple[int, int],
    ) -> None:
        shape, self._first_filter = per_radiance.shape, bands.first_filter
        self._channels = len(bands) + bands.filters
        self.per_radiance, self._tile, self._origin = per_radiance, tile, origin
        self.bands = Welford((*shape, self._first_filter))
        self.filters = Welford((*shape, self._channels - self._first_filter))
        self.even = np.zeros_like(self.filters.mean)
        self._brightest, self.infinite = np.zeros(shape, np.float32), np.zeros(shape, bool)
        self.unit, self.count, self.samples = 1.0, 0, 0
        self.negative = self.non_finite = self.lost = 0

    def add(self, radiance: NDArray[np.float32], first: int) -> None:
        """Add some rows of the pass with the number ``count``, (rows, W, channels); the array is written over.

        first : number of the first row.  Behind the channels there may be the noise of the weights of the rays.
        """
        if self.count == 1 and self.unit == 1.0:
            brightest = float(radiance.max(initial=0.0, where=np.isfinite(radiance)))
            self.unit = 1.0 if USUAL[0] < brightest < USUAL[1] or not brightest else brightest
        step = max(VALUES_AT_ONCE // max(radiance[0].size, 1), 1)
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # of fireflies, whose square is infinite
            for start in range(0, len(radiance), step):
                some = radiance[start : start + step]
                self._add_rows(slice(first + start, first + start + len(some)), some)

    def _add_rows(self, rows: slice, radiance: NDArray[np.float32]) -> None:
        values, excess = radiance[..., : self._channels], radiance[..., self._channels :]
        if not (values.min() >= 0 and np.isfinite(values.sum())):
            self._clean(rows, values)
        if self.unit != 1.0:
            values /= np.float32(self.unit)
        of_filters = values[..., self._first_filter :]
        if excess.size:
            without_weight_noise(of_filters, excess)
        if self._first_filter:
            self.bands.add(rows, values[..., : self._first_filter], self.count)
        self.filters.add(rows, of_filters, self.count)
        if self.count % 2:
            self.even[rows] += of_filters
        here = self._brightest[rows]
        np.maximum(here, self.own(of_filters, rows.start), out=here, casting="same_kind")

    def _clean(self, rows: slice, values: NDArray[np.float32]) -> None:
        """Make NaN, −∞ and negative values 0, and count them; of +∞ remember the pixel, which saturates."""
        cleaned, infinite, negative, non_finite = clean(values)
        values[...] = cleaned
        self.infinite[rows] |= infinite.any(axis=-1)
        self.negative, self.non_finite = self.negative + negative, self.non_finite + non_finite
        self.lost += non_finite - int(infinite.sum())

    def own(self, per_filter: NDArray[np.floating], first_row: int = 0) -> Float64Array:
        """Return what each pixel has behind its own filter, (H, W), of values (H, W, F)."""
        row, column = self._origin
        return of_own_filter(per_filter, self._tile, (row + first_row, column))

    def electrons(self) -> Electrons:
        """Return mean and variance of the passes behind each pixel's own filter."""
        factor = self.per_radiance * self.unit
        mean = self.own(self.filters.mean) * factor  # of a control variate: maybe below 0
        variance = self.own(self.filters.variance(self.count)) * factor**2
        return np.maximum(mean, 0.0), variance

    def halves(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the mean photoelectrons of the even passes and of the odd ones, (H, W, F) each, of two or more."""
        factor = (self.per_radiance * self.unit).astype(np.float32)[..., None]
        first = (self.count + 1) // 2
        even = self.even / np.float32(first)
        odd = (self.filters.mean * np.float32(self.count) - self.even) / np.float32(
            self.count - first
        )
        return np.maximum(even, 0) * factor, np.maximum(odd, 0) * factor

    def firefly_fraction(self) -> float:
        """Return the share of the lit pixels that owe three quarters of the squared deviations to one bright pass."""
        mean, squares = self.own(self.filters.mean), self.own(self.filters.squares)
        lit = (mean > 0) & ~self.infinite
        alone = (self._brightest - mean) ** 2 > ONE_PASS * squares
        noisy = squares > (ROUNDING * mean) ** 2
        return float((alone & noisy)[lit].mean()) if lit.any() else 0.0


def radiance_of(
    scene: Scene | MovingScene,
    bands: Bands,
    groups: tuple[slice, ...],
    seed: int,
    samples: int,
    rows: tuple[int, int],
) -> NDArray[np.float32]:
    """Return a pass of some rows, the groups of bands one after the other, (rows, columns, B + filters).

    A single group has the wavelengths of all bands, to which the scene is restricted before.
    """
    if len(groups) == 1:
        return folded([scene.render(seed, samples, rows)], groups, bands)

    def of_group(number: int) -> NDArray[np.float32]:
        scene.restrict_wavelengths(*bands.ends_of(groups[number]))
        return scene.render(hashed_seed(seed, number, 0), samples, rows)

    return folded((of_group(number) for number in range(len(groups))), groups, bands)


def folded(
    images: Iterable[NDArray[np.float32]], groups: tuple[slice, ...], bands: Bands
) -> NDArray[np.float32]:
    """Renders of groups of bands → (H, W, B + filters). images : (H, W, channels of the film), one for each group."""
    parts, filters = list[NDArray[np.float32]](), np.zeros(1, np.float32)
    count, sets = len(bands), len(bands.groups)
    if sets == 1:
        (image,) = images
        return image
    for number, (group, image) in enumerate(zip(groups, images, strict=True)):
        parts.append(image[..., group])
        of_groups = image[..., count:].reshape(*image.shape[:2], sets, bands.filters)
        filters = filters + np.asarray(
            of_groups.sum(axis=2) if len(groups) < sets else of_groups[:, :, number]
        )
    return np.concatenate([*parts, filters], axis=-1)
