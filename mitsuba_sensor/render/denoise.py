"""Denoised photoelectrons: what every colour filter detects, by Open Image Denoise, where it is better than the render.

The network sees the two halves of the passes apart, as photoelectrons behind each filter, once as they are and once
divided by the reflectance of the surfaces. render/combine.py then takes from each as much as the halves prove right.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from importlib import metadata
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Float64Array, InputError
from .combine import Image, combine, with_residuals
from .guides import Guides
from .options import RenderOptions

DARKEST_REFLECTANCE = 0.02  # what is darker is not divided by its own
COLOURS = 3  # channels of the images that the network takes
MOST_MEMORY_MB = 400  # of the network, about: it goes through larger pictures in tiles, which takes longer
LEAST_PASSES = 4  # two in each half, so that their variance is known
LEAST_PIXELS = 13 * 13  # the neighbourhood from which the weights are estimated


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


def library() -> ModuleType:
    """The module pyoidn. Raises InputError if it is not installed."""
    try:
        return importlib.import_module("pyoidn")
    except ImportError:
        remedy = "pip install pyoidn, or leave denoise out"
        raise InputError(f"denoise needs Open Image Denoise, which this machine has not; {remedy}.") from None


def is_installed() -> bool:
    """Whether Open Image Denoise can be loaded."""
    try:
        library()
    except InputError:
        return False
    return True


def denoised_if_possible(options: RenderOptions) -> RenderOptions:
    """The options with ``denoise`` where it is not decided and Open Image Denoise is installed."""
    return {**options, "denoise": True} if options["denoise"] is None and is_installed() else options


def denoise(halves: Halves, guides: Guides | None) -> Denoised:
    """guides : None where no rays were traced for them; the network then sees the photoelectrons alone."""
    filtered = [_filtered_halves(half, guides) for half in (halves.even, halves.odd)]
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
        "by": f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})",
        "guided": guides is not None,
        "raw_weight": float(np.mean(raw_weights)),
        "sum_corrected_by": float(max(shifts)),
    }
    return Denoised(mean, variance, first, second, record)


def _filtered_halves(half: Callable[[], Image], guides: Guides | None) -> list[Image]:
    """(H, W, F) each: a half denoised, and where there are guides denoised without its reflectance, too."""
    if guides is None:
        return [smoothed(_layers(half()), None, None)]
    albedo = guides.reflectance.mean(axis=-1)
    plain = smoothed(_layers(half()), albedo, guides.normal)
    albedo.fill(1.0)
    found = smoothed(_layers(half() / _divisor(guides)), albedo, guides.normal)
    found *= _divisor(guides)
    return [plain, found]


def _divisor(guides: Guides) -> NDArray[np.float32]:
    return np.maximum(guides.reflectance, DARKEST_REFLECTANCE)


def _candidates(half: Callable[[], Image], filtered: list[Image], guides: Guides | None, number: int) -> list[Image]:
    """Of one filter, (H, W) each: the raw half, the filtered ones, and these with what the last one lost."""
    reflectance = 1.0 if guides is None else np.maximum(guides.reflectance[..., number], DARKEST_REFLECTANCE)
    raw = half()[..., number].astype(np.float64)
    *others, last = (image[..., number] for image in filtered)
    return [raw, *others, *with_residuals(raw, last, reflectance)]


class Layers(NamedTuple):
    """What the network sees of an image: (H, W, F), F rounded up to whole pictures of three colours, over its mean.

    scale : that mean.  images : F.
    """

    values: NDArray[np.float32]
    scale: float
    images: int


def _layers(image: Image) -> Layers:
    count, scale = image.shape[2], float(image.mean(dtype=np.float64)) or 1.0
    values = np.empty((*image.shape[:2], -(-count // COLOURS) * COLOURS), np.float32)
    for k in range(values.shape[2]):
        values[..., k] = image[..., min(k, count - 1)] / scale
    return Layers(values, scale, count)


def smoothed(
    layers: Layers, albedo: NDArray[np.float32] | None, normal: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """The denoised image (H, W, F), never negative.  albedo : (H, W).  normal : (H, W, 3)."""
    guides = {}
    if albedo is not None and normal is not None:
        grey = np.repeat(albedo[..., None], COLOURS, axis=-1)
        guides = {"albedo": np.ascontiguousarray(grey, np.float32), "normal": np.ascontiguousarray(normal, np.float32)}
    for k in range(0, layers.values.shape[2], COLOURS):
        part = layers.values[..., k : k + COLOURS]
        part[...] = _filtered({"color": np.ascontiguousarray(part), **guides})
    found = np.maximum(layers.values[..., : layers.images], 0.0)
    found *= np.float32(layers.scale)
    return found


def _filtered(images: Mapping[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """What the network makes of these images, (H, W, 3) each; of large ones in tiles that overlap, with the same
    result. Its memory is given back, which the library's own function does not do."""
    oidn, found = library(), np.empty_like(images["color"])
    with oidn.Device() as processor:
        processor.commit()
        with oidn.Filter(processor) as network:
            for name, image in {**images, "output": found}.items():
                network.set_image(name, image, oidn.OIDN_FORMAT_FLOAT3)
            network.set_bool("hdr", True)
            network.set_bool("cleanAux", len(images) > 1)
            network.set_int("maxMemoryMB", MOST_MEMORY_MB)
            network.commit()
            network.execute()
        if (problem := processor.get_error()) is not None:
            raise RuntimeError(f"Open Image Denoise: {problem}")
    return found
