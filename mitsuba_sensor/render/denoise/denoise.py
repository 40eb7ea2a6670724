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
        """The same for who needs mean and variance only."""
        nothing = np.empty(0, np.float32)
        return self._replace(even=nothing, odd=nothing)


def is_noisy(mean: Float64Array, variance: Float64Array) -> bool:
    """Whether a camera may see this noise in more than a hundredth of the lit pixels. Elsewhere a filter adds about as
    much error as it removes.  mean, variance : (H, W) photoelectrons, and the variance of that mean."""
    lit = mean > 0
    return bool(
        np.count_nonzero(variance[lit] > LEAST_NOISE * mean[lit] ** 2)
        > LEAST_NOISY * np.count_nonzero(lit)
    )


def denoise(halves: Halves, guides: Guides | None) -> Denoised:
    """guides : None where no rays were traced for them; the network then sees the photoelectrons alone."""
    normal = None if guides is None else guides.normal
    with Network(halves.variance(0).shape, normal) as network:
        filtered = [
            _filtered_half(network, half, guides, 2 * k)
            for k, half in enumerate((halves.even, halves.odd))
        ]
    shape = filtered[0][0].shape
    mean, variance, first, second = (np.empty(shape, np.float32) for _ in range(4))
    raw_weights, shifts = [], []
    for number in range(shape[2]):
        even, odd = (
            _candidates(half, images, guides, number)
            for half, images in zip((halves.even, halves.odd), filtered, strict=True)
        )
        found = combine(even, odd, halves.variance(number), halves.share)
        mean[..., number], variance[..., number] = found.mean, found.variance
        first[..., number], second[..., number] = found.even, found.odd
        raw_weights.append(found.raw_weight.mean(dtype=np.float64))
        shifts.append(abs(found.shift))
        del even, odd, found  # they need not wait for those of the next filter
    record = {
        "by": name(),
        "guided": guides is not None,
        "raw_weight": float(np.mean(raw_weights)),
        "sum_corrected_by": float(max(shifts)),
    }
    return Denoised(mean, variance, first, second, record)


def _filtered_half(
    network: Network, half: Callable[[], Image], guides: Guides | None, turn: int
) -> list[NDArray[np.float32]]:
    """(H, W, F) each: a half denoised, and where there are guides denoised without its reflectance, too.  turn : of the
    first; the second is turned once more."""
    if guides is None:
        return [smoothed(network, half(), 1.0, turn)]
    divided = _divisor(guides)
    np.divide(half(), divided, out=divided)
    found = smoothed(network, divided, 1.0, turn + 1)
    del divided
    found *= _divisor(guides)
    return [smoothed(network, half(), guides.reflectance.mean(axis=-1), turn), found]


def _divisor(guides: Guides) -> NDArray[np.float32]:
    return np.maximum(guides.reflectance, DARKEST_REFLECTANCE)


def _candidates(
    half: Callable[[], Image], filtered: list[Image], guides: Guides | None, number: int
) -> list[Image]:
    """Of one filter, (H, W) each: the raw half, the filtered ones, and these with what the last one lost."""
    reflectance = (
        1.0
        if guides is None
        else np.maximum(guides.reflectance[..., number], DARKEST_REFLECTANCE)
    )
    raw = half()[..., number].astype(np.float64)
    *others, last = (image[..., number] for image in filtered)
    return [raw, *others, *with_residuals(raw, last, reflectance)]


def smoothed(
    network: Network, image: Image, albedo: NDArray[np.float32] | float, turn: int
) -> NDArray[np.float32]:
    """The denoised image (H, W, F), never negative: three channels at a time, over their mean.  albedo, turn : see
    :meth:`network.Network.filtered`."""
    count, scale = image.shape[2], np.float32(image.mean(dtype=np.float64) or 1.0)
    found, colours = (
        np.empty(image.shape, np.float32),
        np.empty((*image.shape[:2], COLOURS), np.float32),
    )
    for k in range(0, count, COLOURS):
        for c in range(COLOURS):
            np.divide(image[..., min(k + c, count - 1)], scale, out=colours[..., c])
        found[..., k : k + COLOURS] = network.filtered(colours, albedo, turn)[..., : count - k]
    np.maximum(found, 0.0, out=found)
    found *= scale
    return found
