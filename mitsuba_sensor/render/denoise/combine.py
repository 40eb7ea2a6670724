"""Combination of an unbiased estimate with filtered ones, by weights from two independent halves, with error bars.

Each half is filtered in several ways. A filtered half minus the other half, raw, is the filter's own error plus noise
of known variance; averaged over a neighbourhood, squares and products of these differences are the covariance matrix
of the errors of all candidates, free of bias (as in dual-buffer cross-validation, Rousselle et al. 2012, doi
10.1145/2366145.2366214). The weights that minimise the expected squared error, between 0 and 1, follow in closed form.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array

RADIUS_PX = 6  # of the neighbourhood of the weights
BAR_RADIUS_PX = 12  # of the neighbourhood whose mean squared error an error bar knows
BAR_APART, BAR_MOVED, BAR_RAW, BAR_TYPICAL = 0.16, 0.06, 1.1, 0.06
"""Weights of the signs of error at the pixel itself."""
BAR_POWER, BAR_SCALE = 0.65, 1.34
"""With these |z| < 1 holds in 0.67 to 0.75 of the pixels, |z| < 2 in 0.90 to 0.95."""
RESIDUAL_RADII_PX = (1, 3, 8)
"""Over which a filtered picture gets its mean difference from the raw one back."""
MOST_SIGMA = 4.0  # raw standard errors by which the result may differ from the raw pixel
MOST_BAR_SIGMA = 5.0  # raw standard errors that an error bar may have
LEAST = 0.02  # of the raw variance: no candidate's squared error is known to be less
LEAST_BAR = 0.03
"""Of the raw variance: no neighbourhood's mean squared error is known to be less."""
TYPICAL_PX = 5  # side of the window whose median variance a pixel has at least
PIXELS_AT_ONCE = 2**17  # 36 float64 maps of products, and as many means over boxes: 75 MB
ROUNDING = 1e-6  # of the light: what a float32 film loses is no noise that could be denoised
SMALLEST = 1e-150  # its square is a number still
OCTAVES = 2  # between the levels of brightness whose pixels have the raw sums
DARKEST_LEVEL = 1 / 16  # of the median of the lit pixels: all that is darker belongs together
HALO_ROWS = BAR_RADIUS_PX + RADIUS_PX
"""Rows beyond which no pixel matters: for the bars, and for the weights around those."""


Image: TypeAlias = NDArray[np.floating]  # float64, or float32 of what came out of a filter


class Combined(NamedTuple):
    """mean, variance : (H, W) result and its expected squared error.  even, odd : (H, W) the same weights applied to
    each half.  raw_weight : (H, W) of the unbiased estimate.  shift : light that was moved to have the sums of the raw
    mean, over all light.  Maps are float32, but for the mean."""

    mean: Float64Array
    variance: Image
    even: Image
    odd: Image
    raw_weight: Image
    shift: float


def box(image: Image, radius_px: int) -> Float64Array:
    """Mean over (2r + 1)² pixels; beyond the picture its mirror image."""
    from scipy.ndimage import uniform_filter  # takes a quarter of a second to import

    return np.asarray(uniform_filter(image, 2 * radius_px + 1, mode="reflect"))


def with_residuals(raw: Image, filtered: Image, reflectance: Image | float) -> list[Image]:
    """The filtered picture, and the same plus its difference from the raw one averaged over boxes: of what falls on the
    surfaces where their reflectance is known."""
    candidates = [filtered]
    rest = (raw - filtered) / reflectance
    for radius_px in RESIDUAL_RADII_PX:
        corrected = filtered + reflectance * box(rest, radius_px)
        candidates.append(corrected.astype(filtered.dtype, copy=False))
    return candidates


def combine(
    even: list[Image], odd: list[Image], variance: Float64Array, share: float = 0.5
) -> Combined:
    """The combination of least expected squared error.

    even, odd : candidates of both halves, (H, W) each, the first one raw.  variance : (H, W) of the raw mean of both.
    share : of the even half in that mean.  The sum over the picture is that of the raw mean, and so is that over the
        pixels of about one brightness.
    """
    raw = share * even[0] + (1 - share) * odd[0]
    scale, (rows, columns) = _scale(raw, variance), variance.shape
    step = max(PIXELS_AT_ONCE // columns, 1)
    mean, spread = np.empty(variance.shape), np.empty(variance.shape)
    bars, first_half, second_half, raw_weight = (
        np.empty(variance.shape, np.float32) for _ in range(4)
    )
    maps: tuple[Image, ...] = mean, bars, spread, first_half, second_half, raw_weight
    for first in range(0, rows, step):
        last, top = min(first + step, rows), max(first - HALO_ROWS, 0)
        strip = slice(top, min(last + HALO_ROWS, rows))
        strip_even, strip_odd = [x[strip] for x in even], [x[strip] for x in odd]
        parts = _combine_strip(strip_even, strip_odd, variance[strip], scale[strip], share)
        for whole, part in zip(maps, parts, strict=True):
            whole[first:last] = part[first - top : last - top]
    missing = _missing_light(raw, mean, spread)
    shift = float(np.abs(missing).sum()) / (float(raw.sum()) or 1.0)
    return Combined(
        np.maximum(mean + missing, 0.0), bars, first_half, second_half, raw_weight, shift
    )


def _missing_light(raw: Float64Array, mean: Float64Array, spread: Float64Array) -> Float64Array:
    """(H, W) what the mean lacks of the raw sums over the pixels of each brightness, shared out in proportion to
    ``spread``: what a filter takes from a lamp does not go to the walls. Between the levels of brightness a pixel
    belongs to both neighbours, so that its own noise hardly decides where."""
    lit = mean[mean > 0]
    usual = float(np.median(lit)) if lit.size else 1.0
    level = np.log2(np.maximum(mean / usual, DARKEST_LEVEL)) / OCTAVES
    missing = np.zeros_like(mean)
    for k in range(int(np.floor(level.min())), int(level.max()) + 2):
        belongs = np.maximum(1 - np.abs(level - k), 0.0)
        total = float((belongs * spread).sum())
        if total > 0:
            missing += belongs * spread * (float((belongs * (raw - mean)).sum()) / total)
    return missing


def _combine_strip(
    even: list[Image],
    odd: list[Image],
    variance: Float64Array,
    scale: Float64Array,
    share: float,
) -> tuple[Float64Array, ...]:
    """Mean and variance of some rows, how the sum's difference is shared out there, both halves, the raw weight."""
    raw = share * even[0] + (1 - share) * odd[0]
    errors = _error_products(even, odd, variance, scale, share)
    weights = _least_squares(np.array([[box(x, RADIUS_PX) for x in row] for row in errors]))
    first, second = _weighted_sum(weights, even), _weighted_sum(weights, odd)
    typical = np.maximum(variance, _median(variance))
    limit = MOST_SIGMA * np.sqrt(typical)
    mean = np.clip(share * first + (1 - share) * second, raw - limit, raw + limit)
    own = np.einsum("jhw,jkhw,khw->hw", weights, errors, weights)
    # A box behind a firefly has its rounding, of any sign.
    apart = np.maximum(box((first - second) ** 2, 1), 0)
    signs = BAR_APART * apart + BAR_MOVED * (mean - raw) ** 2
    signs += BAR_RAW * weights[0] ** 2 * variance + BAR_TYPICAL * typical
    near = np.maximum(scale * box(variance / scale, RADIUS_PX), ROUNDING * typical + SMALLEST)
    most = MOST_BAR_SIGMA**2 * typical
    neighbourhood = np.clip(scale * box(own, BAR_RADIUS_PX), LEAST_BAR * near, most)
    bars = np.minimum(_bars(signs, neighbourhood, near), most)
    spread = np.clip(scale * box(own, RADIUS_PX), LEAST_BAR * near, typical)
    return mean, bars, spread, first, second, weights[0]


def _weighted_sum(weights: Float64Array, images: list[Image]) -> Float64Array:
    """Sum over the candidates, (J, H, W) weights and J images."""
    total: Float64Array = weights[0] * images[0]
    for weight, image in zip(weights[1:], images[1:], strict=True):
        total += weight * image
    return total


def _bars(signs: Float64Array, neighbourhood: Float64Array, raw: Float64Array) -> Float64Array:
    """Squared error bars from what shows at a pixel and from the mean squared error around it.

    The mean over a neighbourhood has no bias, but knows nothing of the pixel; halves apart, a mean moved away from the
    raw pixel and the raw pixel's own share show at the pixel, but miss what both halves have wrong. Their geometric
    mean follows both. The further it is below the raw variance, the fewer pixels make it: therefore a power above one
    half. The numbers were found with nine scenes and references of 32768 samples.
    """
    return np.asarray(BAR_SCALE * raw * (signs / raw * (neighbourhood / raw)) ** BAR_POWER)


def _scale(raw: Float64Array, variance: Float64Array) -> Float64Array:
    """(H, W) the variance thereabouts, in which errors of different pixels are comparable; never 0."""
    level = np.maximum(box(raw, 2), 0.01 * raw.mean())
    usual = float(variance.mean()) / max(float(level.mean()), SMALLEST)
    least = 1e-6 * usual * level + (ROUNDING * level) ** 2 + SMALLEST
    return np.asarray(box(variance, 1) + 0.1 * box(variance, 8) + least)


def _error_products(
    even: list[Image],
    odd: list[Image],
    variance: Float64Array,
    scale: Float64Array,
    share: float,
) -> Float64Array:
    """(J, J, H, W) unbiased estimates of the products of the errors of the candidates' means, over ``scale``."""
    count = len(even)
    noise = variance * (0.5 / share + 0.5 / (1 - share))  # of a half, on average
    products = np.empty((count, count, *variance.shape))
    pairs = list(zip(even, odd, strict=True))
    crossed = [(e - odd[0], o - even[0]) for e, o in pairs]
    apart = [e - o for e, o in pairs]
    for j in range(count):
        for k in range(j, count):
            (even_j, odd_j), (even_k, odd_k) = crossed[j], crossed[k]
            product = 0.5 * (even_j * even_k + odd_j * odd_k) - noise
            # Two halves have half the noise.
            product = (product - 0.25 * apart[j] * apart[k]) / scale
            products[j, k] = products[k, j] = product
    products[0, 0] = variance / scale
    return products


def _least_squares(matrix: Float64Array, sweeps: int = 3) -> Float64Array:
    """Weights (J, H, W), none negative, with a sum of 1, that minimise wᵀMw for M (J, J, H, W): from the best single
    candidate weight moves between pairs, by the exact minimum along each pair."""
    count = len(matrix)
    for j in range(1, count):
        matrix[j, j] = np.maximum(matrix[j, j], LEAST * matrix[0, 0])
    best = np.argmin([matrix[j, j] for j in range(count)], axis=0)
    weights = (np.arange(count)[:, None, None] == best).astype(float)
    for _ in range(sweeps):
        for j in range(count):
            for k in range(j + 1, count):
                slope = np.einsum("khw,khw->hw", matrix[k] - matrix[j], weights)
                curve = matrix[j, j] + matrix[k, k] - 2 * matrix[j, k]
                moved = np.where(curve > 0, slope / np.where(curve > 0, curve, 1.0), 0.0)
                moved = np.clip(moved, -weights[j], weights[k])
                weights[j] += moved
                weights[k] -= moved
    return np.asarray(weights)


def _median(variance: Float64Array) -> Float64Array:
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(variance, TYPICAL_PX, mode="reflect"))
