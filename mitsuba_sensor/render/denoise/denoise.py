"""Denoised photoelectrons: what every colour filter detects, by Open Image Denoise, where it is better than the render.

The network sees the two halves of the passes apart, as photoelectrons behind each filter, once as they are and once
divided by the reflectance of the surfaces, each time turned another way, so that its errors differ and their mean has
less. render/denoise/combine.py then takes from each as much as the halves prove right.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from .combine import Image, combine, with_residuals
from .guides import DARKEST_REFLECTANCE, Guides
from .network import COLOURS, Network, name

LEAST_PASSES = 4  # two in each half, so that their variance is known
LEAST_PIXELS = 13 * 13  # the neighbourhood from which the weights are estimated
LEAST_NOISE = 1e-6  # relative variance that a camera may see: a tenth of the shot noise of 100 000 electrons
LEAST_NOISY = 0.01  # of the lit pixels; small things before an even sky are to be denoised too


class Halves(NamedTuple):
    """Photoelectrons behind each filter; each array is made when it is needed, for so long as it is needed.

    even, odd : functions that return (H, W, F) means of the even and the odd passes.  variance : function of the number
        of a filter that returns (H, W), of the mean of all passes.  share : of the even passes in all of them.
    """

    even: Callable[[], Image]
    odd: Callable[[], Image]
    variance: Callable[[int], Float64Array]
    share: float


class Denoised(NamedTuple):
    """mean, variance : (H, W, F) photoelectrons behind each filter and their expected squared error.  even, odd :
    (H, W, F) of both halves with the same weights.  record : what was done, for the metadata."""

    mean: Image
    variance: Image
    even: Image
    odd: Image
    record: Mapping[str, object]

    def without_halves(self) -> Denoised:
        """Mean and variance, without the halves, whose memory is given back."""
        nothing = np.empty(0, np.float32)
        return self._replace(even=nothing, odd=nothing)


def is_noisy(mean: Float64Array, variance: Float64Array) -> bool:
    """Whether a camera may see this noise in more than a hundredth of the lit pixels. Elsewhere a filter adds about as
    much error as it removes.  mean, variance : (H, W) photoelectrons, and the variance of that mean."""
    lit = mean > 0
    noisy = np.count_nonzero(variance[lit] > LEAST_NOISE * mean[lit] ** 2)
    return bool(noisy > LEAST_NOISY * np.count_nonzero(lit))


def denoise(halves: Halves, guides: Guides | None) -> Denoised:
    """Mean and variance of the photoelectrons, denoised where that is better.

    guides : None where no rays were traced for them; the network then sees the photoelectrons alone.
    """
    normal = None if guides is None else guides.normal
    with Network(halves.variance(0).shape, normal) as network:
        filtered_even = _filter_half(network, halves.even, guides, 0)
        filtered_odd = _filter_half(network, halves.odd, guides, 2)
    shape = filtered_even[0].shape
    mean, variance, first, second = (np.empty(shape, np.float32) for _ in range(4))
    raw_weights, shifts = [], []
    for number in range(shape[2]):
        even = _candidates(halves.even, filtered_even, guides, number)
        odd = _candidates(halves.odd, filtered_odd, guides, number)
        combined = combine(even, odd, halves.variance(number), halves.share)
        mean[..., number], variance[..., number] = combined.mean, combined.variance
        first[..., number], second[..., number] = combined.even, combined.odd
        raw_weights.append(combined.raw_weight.mean(dtype=np.float64))
        shifts.append(abs(combined.shift))
        del even, odd, combined  # they need not wait for those of the next filter
    record = {
        "by": name(),
        "guided": guides is not None,
        "raw_weight": float(np.mean(raw_weights)),
        "sum_corrected_by": float(max(shifts)),
    }
    return Denoised(mean, variance, first, second, record)


def _filter_half(
    network: Network, half: Callable[[], Image], guides: Guides | None, turn: int
) -> list[NDArray[np.float32]]:
    """(H, W, F) each: a half denoised, and where there are guides denoised without its reflectance, too.  turn : of the
    first; the second is turned once more."""
    if guides is None:
        return [smoothed(network, half(), 1.0, turn)]
    divided = _divisor(guides)
    np.divide(half(), divided, out=divided)
    without_reflectance = smoothed(network, divided, 1.0, turn + 1)
    del divided
    without_reflectance *= _divisor(guides)
    whole = smoothed(network, half(), guides.reflectance.mean(axis=-1), turn)
    return [whole, without_reflectance]


def _divisor(guides: Guides) -> NDArray[np.float32]:
    """The reflectance that light is divided by, (H, W, F)."""
    return np.maximum(guides.reflectance, DARKEST_REFLECTANCE)


def _candidates(
    half: Callable[[], Image],
    filtered: list[NDArray[np.float32]],
    guides: Guides | None,
    number: int,
) -> list[Image]:
    """Candidates of one filter, (H, W) each: the raw half, the filtered ones, and these with what the last one lost."""
    reflectance: Image | float = 1.0
    if guides is not None:
        reflectance = np.maximum(guides.reflectance[..., number], DARKEST_REFLECTANCE)
    raw = half()[..., number].astype(np.float64)
    *others, last = (image[..., number] for image in filtered)
    return [raw, *others, *with_residuals(raw, last, reflectance)]


def smoothed(
    network: Network, image: Image, albedo: NDArray[np.float32] | float, turn: int
) -> NDArray[np.float32]:
    """The denoised image (H, W, F), never negative: three channels at a time, over their mean.  albedo, turn : see
    :meth:`network.Network.filtered`."""
    count, scale = image.shape[2], np.float32(image.mean(dtype=np.float64) or 1.0)
    smooth = np.empty(image.shape, np.float32)
    colours = np.empty((*image.shape[:2], COLOURS), np.float32)
    for k in range(0, count, COLOURS):
        for c in range(COLOURS):
            np.divide(image[..., min(k + c, count - 1)], scale, out=colours[..., c])
        filtered = network.filtered(colours, albedo, turn)
        smooth[..., k : k + COLOURS] = filtered[..., : count - k]
    np.maximum(smooth, 0.0, out=smooth)
    smooth *= scale
    return smooth
