"""Sums of equal passes: mean and variance (Welford) of each channel of the film, invalid values, fireflies."""

from __future__ import annotations

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

VALUES_AT_ONCE = 2**15  # stay in a processor's cache
RADIANCE_MIN, RADIANCE_MAX = 1e-9, 1e9  # float32 holds its squares, with a wide margin
ROUNDING = 1e-6  # of the light: losses of a float32 film, which are not noise
ONE_PASS_FRACTION = 0.75  # of the squared deviations of all passes

Electrons = tuple[Float64Array, Float64Array]
"""Mean photoelectrons of each pixel, and the expected squared error of that mean, shape (H, W) each."""


class Welford:
    """Mean of equal passes and sum of their squared deviations, shape (H, W, C), in float32: with few passes, the film
    loses more than these sums."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.mean, self.squares = np.zeros(shape, np.float32), np.zeros(shape, np.float32)

    def add(self, rows: slice, values: NDArray[np.float32], number: int) -> None:
        """Add rows of pass ``number``, counted from 1."""
        delta = values - self.mean[rows]
        self.mean[rows] += delta * np.float32(1 / number)
        delta *= delta
        delta *= np.float32(1 - 1 / number)
        self.squares[rows] += delta

    def variance(self, passes: int) -> NDArray[np.float32]:
        """Return the variance of the mean of the passes; 0 for a single pass."""
        return self.squares / np.float32(max(passes * (passes - 1), 1))


class Passes:
    """Sums over the passes of a film.

    count, samples : passes, and samples per pixel of each (over all groups of bands).
    bands, filters : sums of the bands [W m⁻² sr⁻¹], empty if only colour filters are rendered, and of the colour
        filters; both divided by ``unit``.
    even : (H, W, F) sum of the passes 0, 2, 4, …, for the denoiser.
    infinite : (H, W) True if a pass was infinite.  negative, non_finite : number of values set to 0.  lost : number of
        NaN and −∞.
    per_radiance : (H, W) photoelectrons for 1 in the film's channel of a filter.
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
        """Add rows of pass ``count``, shape (rows, W, channels), and overwrite the array.

        first : number of the first row.  Channels after those of the film hold the noise of ray weights.
        """
        if self.count == 1 and self.unit == 1.0:
            brightest = float(radiance.max(initial=0.0, where=np.isfinite(radiance)))
            usual = RADIANCE_MIN < brightest < RADIANCE_MAX or not brightest
            self.unit = 1.0 if usual else brightest
        step = max(VALUES_AT_ONCE // max(radiance[0].size, 1), 1)
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # the square of a firefly is infinite
            for start in range(0, len(radiance), step):
                block = radiance[start : start + step]
                self._add_rows(slice(first + start, first + start + len(block)), block)

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
        brightest = self._brightest[rows]
        detected = self.of_own_filter(of_filters, rows.start)
        np.maximum(brightest, detected, out=brightest, casting="same_kind")

    def _clean(self, rows: slice, values: NDArray[np.float32]) -> None:
        """Set and count NaN, −∞ and negative values as 0; mark pixels of +∞, which saturate."""
        cleaned, infinite, negative, non_finite = clean(values)
        values[...] = cleaned
        self.infinite[rows] |= infinite.any(axis=-1)
        self.negative, self.non_finite = self.negative + negative, self.non_finite + non_finite
        self.lost += non_finite - int(infinite.sum())

    @property
    def factor(self) -> NDArray[np.float32]:
        """Photoelectrons for 1 in the sums of a filter, shape (H, W, 1)."""
        return (self.per_radiance * self.unit).astype(np.float32)[..., None]

    def of_own_filter(
        self, per_filter: NDArray[np.floating], first_row: int = 0
    ) -> Float64Array:
        """Return the value of each pixel's own filter, shape (H, W), from values (H, W, F)."""
        row, column = self._origin
        return of_own_filter(per_filter, self._tile, (row + first_row, column))

    def electrons(self) -> Electrons:
        """Return mean and variance of the mean for each pixel's own filter."""
        factor = self.per_radiance * self.unit
        mean = (
            self.of_own_filter(self.filters.mean) * factor
        )  # a control variate can be negative
        variance = self.of_own_filter(self.filters.variance(self.count)) * factor**2
        return np.maximum(mean, 0.0), variance

    def halves(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the mean photoelectrons of the even and of the odd passes, shape (H, W, F) each; needs two passes."""
        first = (self.count + 1) // 2
        sums = self.even, self.filters.mean * np.float32(self.count) - self.even
        counts = np.float32(first), np.float32(self.count - first)
        even, odd = (
            np.maximum(s / n, 0) * self.factor for s, n in zip(sums, counts, strict=True)
        )
        return even, odd

    def firefly_fraction(self) -> float:
        """Return the fraction of lit pixels whose brightest pass causes three quarters of their squared deviations."""
        mean = self.of_own_filter(self.filters.mean)
        squares = self.of_own_filter(self.filters.squares)
        lit = (mean > 0) & ~self.infinite
        one_pass = (self._brightest - mean) ** 2 > ONE_PASS_FRACTION * squares
        noisy = squares > (ROUNDING * mean) ** 2
        return float((one_pass & noisy)[lit].mean()) if lit.any() else 0.0


def radiance_of(
    scene: Scene | MovingScene,
    bands: Bands,
    groups: tuple[slice, ...],
    seed: int,
    samples: int,
    rows: tuple[int, int],
) -> NDArray[np.float32]:
    """Return a pass over rows, shape (rows, columns, B + filters).

    groups : bands that are rendered together, one render for each. For a single group, the scene's wavelengths must
        already be restricted to all bands.
    """
    parts, filters = list[NDArray[np.float32]](), np.zeros(1, np.float32)
    count, sets = len(bands), len(bands.groups)
    for number, group in enumerate(groups):
        if len(groups) == 1:
            image = scene.render(seed, samples, rows)
        else:
            scene.restrict_wavelengths(*bands.ends_of(group))
            image = scene.render(hashed_seed(seed, number, 0), samples, rows)
        if sets == 1:
            return image
        parts.append(image[..., group])
        of_sets = image[..., count:].reshape(*image.shape[:2], sets, bands.filters)
        of_group = of_sets.sum(axis=2) if len(groups) < sets else of_sets[:, :, number]
        filters = filters + np.asarray(of_group)
    return np.concatenate([*parts, filters], axis=-1)
