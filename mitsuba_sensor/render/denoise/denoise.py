"""Denoised photoelectrons of each colour filter, weighted by errors that two halves of a render measure.

Open Image Denoise filters each half of the passes, with albedo and normals. A filtered half minus the other raw half is
the filter's error plus noise of known variance. Averages over a neighbourhood give unbiased squared errors of the raw
and the filtered mean and their product (as in dual-buffer cross-validation, Rousselle et al. 2012, doi
10.1145/2366145.2366214), and so the weight with the least expected squared error.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from .guides import Guides
from .network import COLOURS, Network, name

PASSES_MIN = 4  # two in each half
PIXELS_MIN = 13 * 13  # the neighbourhood from which the weights are estimated
VISIBLE_VARIANCE = (
    1e-6  # relative to the squared light: a tenth of the shot noise of 100 000 electrons
)
VISIBLE_FRACTION = 0.01  # of the lit pixels; small objects before an even sky are also denoised
RADIUS_PX = 6  # neighbourhood of the weights
BAR_RADIUS_PX = 12  # neighbourhood of the mean squared error in an error bar
BAR_APART, BAR_MOVED, BAR_RAW, BAR_TYPICAL = 0.16, 0.06, 1.1, 0.06
"""Weights of the signs of error at the pixel itself."""
BAR_POWER, BAR_SCALE = 0.65, 1.34
"""From nine scenes and references of 32768 samples: |z| < 1 holds for 0.67 to 0.75 of the pixels."""
MOVED_SIGMAS = 4.0  # raw standard errors by which the result may differ from the raw pixel
BAR_SIGMAS = 5.0  # raw standard errors that an error bar may have
FILTER_ERROR_MIN = (
    0.02  # of the raw variance: a smaller squared error of the filter cannot be measured
)
BAR_MIN = 0.03  # of the raw variance
TYPICAL_PX = 5  # side of the window whose median variance is a pixel's least variance
ROUNDING = 1e-6  # of the light: losses of a float32 film, which are not noise
SMALLEST = 1e-150  # its square is above 0
OCTAVES = 2  # between the brightness levels that keep their raw sums
LEVEL_MIN = 1 / 16  # of the median of the lit pixels: all darker pixels are one level

Phase = tuple[slice, slice]


class Denoised(NamedTuple):
    """Denoised light.

    mean, variance : (H, W, F) photoelectrons of each filter and their expected squared error.
    raw_weight : mean weight of the render.  shift : largest fraction of the light that was moved to keep the raw sums.
    """

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    raw_weight: float
    shift: float

    @property
    def record(self) -> dict[str, object]:
        """Description for the metadata."""
        return {"by": name(), "raw_weight": self.raw_weight, "sum_corrected_by": self.shift}


def is_noisy(mean: Float64Array, variance: Float64Array) -> bool:
    """Return True if a camera may see this noise in more than 1 % of the lit pixels. Otherwise a filter adds about as
    much error as it removes.

    mean, variance : (H, W) photoelectrons, and the variance of that mean.
    """
    lit = mean > 0
    noisy = np.count_nonzero(variance[lit] > VISIBLE_VARIANCE * mean[lit] ** 2)
    return bool(noisy > VISIBLE_FRACTION * np.count_nonzero(lit))


def denoise(
    halves: tuple[NDArray[np.float32], NDArray[np.float32]],
    variance: NDArray[np.float32],
    share: float,
    guides: Guides | None,
    periods: tuple[int, int] = (1, 1),
) -> Denoised:
    """Return the photoelectrons of each filter, denoised to the degree that reduces their error.

    halves : (H, W, F) means of the even and the odd passes.  variance : (H, W, F) of the mean of all passes.
    share : fraction of even passes.  guides : None if no rays were traced.
    periods : rows and columns after which polarisers repeat. The pixels of each polariser are filtered as a separate
        image, because the network mistakes differences between polarisers for texture or noise.
    """
    mean, error2 = np.empty_like(variance), np.empty_like(variance)
    weights, shifts = [], []
    for phase in _phases(periods):
        albedo = None if guides is None else guides.albedo[phase]
        normal = None if guides is None else guides.normal[phase]
        even, odd = (np.ascontiguousarray(half[phase]) for half in halves)
        with Network(even.shape[:2], normal) as network:
            smooth = [_filtered(network, half, albedo) for half in (even, odd)]
        for number in range(even.shape[2]):
            first, second, smooth_first, smooth_second = (
                x[..., number].astype(np.float64) for x in (even, odd, *smooth)
            )
            of_mean = variance[phase][..., number].astype(np.float64)
            combined = combine(first, second, smooth_first, smooth_second, of_mean, share)
            mean[*phase, number], error2[*phase, number] = combined.mean, combined.variance
            weights.append(combined.raw_weight)
            shifts.append(abs(combined.shift))
    return Denoised(mean, error2, float(np.mean(weights)), float(max(shifts)))


def _phases(periods: tuple[int, int]) -> Iterator[Phase]:
    """Yield rows and columns of the pixels at each position in a tile that repeats after ``periods``."""
    for row, column in np.ndindex(periods):
        yield slice(row, None, periods[0]), slice(column, None, periods[1])


def _filtered(
    network: Network, image: NDArray[np.float32], albedo: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """Return the filtered image (H, W, F): three colour filters at a time, relative to their mean."""
    scale, smooth = np.float32(image.mean(dtype=np.float64) or 1.0), np.empty_like(image)
    for first in range(0, image.shape[2], COLOURS):
        numbers = np.minimum(np.arange(first, first + COLOURS), image.shape[2] - 1)
        colours = None if albedo is None else albedo[..., numbers]
        filtered = network.filtered(image[..., numbers] / scale, colours)
        smooth[..., first : first + COLOURS] = filtered[..., : image.shape[2] - first]
    return np.maximum(smooth, 0.0) * scale


class Combined(NamedTuple):
    """Weighted mean of raw and filtered light.

    mean, variance : (H, W) result and its expected squared error.  raw_weight : mean weight of the raw mean.
    shift : fraction of the light that was moved to keep the sums of the raw mean.
    """

    mean: Float64Array
    variance: Float64Array
    raw_weight: float
    shift: float


def combine(
    even: Float64Array,
    odd: Float64Array,
    smooth_even: Float64Array,
    smooth_odd: Float64Array,
    variance: Float64Array,
    share: float = 0.5,
) -> Combined:
    """Return the weighted mean (H, W) of raw and filtered halves with the least expected squared error, and error bars.

    variance : of the raw mean of both halves.  share : weight of the even half in that mean. The sums of the raw mean
    over the image and over each brightness level are kept.
    """
    raw = share * even + (1 - share) * odd
    scale = _scale(raw, variance)
    own, squared, product = (
        x / scale for x in _error_products(even, odd, smooth_even, smooth_odd, variance, share)
    )
    near = _box(own, RADIUS_PX)
    weight = _weight(near, _box(squared, RADIUS_PX), _box(product, RADIUS_PX))
    error = (1 - weight) ** 2 * own + 2 * weight * (1 - weight) * product + weight**2 * squared
    del own, squared, product
    typical = np.maximum(variance, _median(variance))
    limit = MOVED_SIGMAS * np.sqrt(typical)
    mean = raw + weight * (share * smooth_even + (1 - share) * smooth_odd - raw)
    mean = np.clip(mean, raw - limit, raw + limit)
    near = np.maximum(scale * near, ROUNDING * typical + SMALLEST)
    apart = even - odd
    apart += weight * (smooth_even - smooth_odd - apart)
    # After a firefly, a box keeps a rounding error of either sign.
    signs = BAR_APART * np.maximum(_box(apart**2, 1), 0)
    signs += BAR_MOVED * (mean - raw) ** 2
    signs += BAR_RAW * (1 - weight) ** 2 * variance + BAR_TYPICAL * typical
    del apart, limit
    most = BAR_SIGMAS**2 * typical
    around = np.clip(scale * _box(error, BAR_RADIUS_PX), BAR_MIN * near, most)
    bars = np.minimum(_bars(signs, around, near), most)
    spread = np.clip(scale * _box(error, RADIUS_PX), BAR_MIN * near, typical)
    missing = _missing_light(raw, mean, spread)
    shift = float(np.abs(missing).sum()) / (float(raw.sum()) or 1.0)
    return Combined(np.maximum(mean + missing, 0.0), bars, float(1 - weight.mean()), shift)


def _error_products(
    even: Float64Array,
    odd: Float64Array,
    smooth_even: Float64Array,
    smooth_odd: Float64Array,
    variance: Float64Array,
    share: float,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return unbiased estimates of the squared errors of the raw and of the filtered mean, and of their product."""
    of_half = variance * (0.5 / share + 0.5 / (1 - share))  # noise, on average
    apart, raw_apart = smooth_even - smooth_odd, even - odd
    first, second = smooth_even - odd, smooth_odd - even
    product = 0.5 * raw_apart * (first - second) - of_half - 0.25 * raw_apart * apart
    # Two halves have half the noise of one.
    squared = 0.5 * (first**2 + second**2) - of_half - 0.25 * apart**2
    return variance, squared, product


def _weight(raw: Float64Array, smooth: Float64Array, product: Float64Array) -> Float64Array:
    """Return the weight of the filtered mean, 0 to 1, that minimises the squared error of the weighted mean."""
    smooth = np.maximum(smooth, FILTER_ERROR_MIN * raw)
    curve = raw - 2 * product + smooth
    best = np.divide(raw - product, curve, out=(smooth < raw).astype(float), where=curve > 0)
    return np.asarray(np.clip(best, 0.0, 1.0))


def _bars(signs: Float64Array, around: Float64Array, raw: Float64Array) -> Float64Array:
    """Return squared error bars from signs of error at a pixel and the mean squared error around it.

    The mean over a neighbourhood is unbiased, but ignores the pixel. The signs (difference of the halves, distance from
    the raw pixel, remaining raw noise) belong to the pixel, but miss errors that both halves share. The geometric mean
    follows both. Its power is above one half because fewer pixels contribute if it is far below the raw variance.
    """
    return np.asarray(BAR_SCALE * raw * (signs / raw * (around / raw)) ** BAR_POWER)


def _missing_light(raw: Float64Array, mean: Float64Array, spread: Float64Array) -> Float64Array:
    """Return the light (H, W) to add for the raw sums of each brightness level, distributed like ``spread``: light that
    the filter took from a lamp does not go to the walls.

    A pixel between two levels belongs partly to both, so its noise barely decides between them.
    """
    lit = mean[mean > 0]
    usual = float(np.median(lit)) if lit.size else 1.0
    level = np.log2(np.maximum(mean / usual, LEVEL_MIN)) / OCTAVES
    missing = np.zeros_like(mean)
    for k in range(int(np.floor(level.min())), int(level.max()) + 2):
        belongs = np.maximum(1 - np.abs(level - k), 0.0)
        total = float((belongs * spread).sum())
        if total > 0:
            missing += belongs * spread * (float((belongs * (raw - mean)).sum()) / total)
    return missing


def _scale(raw: Float64Array, variance: Float64Array) -> Float64Array:
    """Return the variance around each pixel (H, W), a unit that makes errors of pixels comparable; never 0."""
    level = np.maximum(_box(raw, 2), 0.01 * raw.mean())
    usual = float(variance.mean()) / max(float(level.mean()), SMALLEST)
    least = 1e-6 * usual * level + (ROUNDING * level) ** 2 + SMALLEST
    return np.asarray(_box(variance, 1) + 0.1 * _box(variance, 8) + least)


def _box(image: Float64Array, radius_px: int) -> Float64Array:
    """Return means over (2r + 1)² pixels; the image is mirrored at its borders."""
    from scipy.ndimage import uniform_filter  # takes a quarter of a second to import

    return np.asarray(uniform_filter(image, 2 * radius_px + 1, mode="reflect"))


def _median(variance: Float64Array) -> Float64Array:
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(variance, TYPICAL_PX, mode="reflect"))
