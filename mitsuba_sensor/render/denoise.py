"""Denoised photoelectrons: what every colour filter detects, by Open Image Denoise, where it is better than the render.

The network sees the two halves of the passes apart, as photoelectrons behind each filter, once as they are and once
divided by the reflectance of the surfaces. render/combine.py then takes from each as much as the halves prove right.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
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
    """Photoelectrons behind each filter.

    even, odd : (H, W, F) means of the even and the odd passes.  variance : (H, W, F) of the mean of all passes.
    share : of the even passes in all of them.
    """

    even: Float64Array
    odd: Float64Array
    variance: Float64Array
    share: float


class Denoised(NamedTuple):
    """mean, variance : (H, W, F) photoelectrons behind each filter and their expected squared error.  even, odd :
    (H, W, F) of both halves with the same weights.  record : what was done, for the metadata."""

    mean: Image
    variance: Image
    even: Image
    odd: Image
    record: Mapping[str, object]


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
    candidates = [_candidates(half, guides) for half in (halves.even, halves.odd)]
    mean, variance, first, second = (np.empty_like(halves.even, np.float32) for _ in range(4))
    raw_weights, shifts = [], []
    for number in range(halves.even.shape[2]):
        of_filter = ([image[..., number] for image in half] for half in candidates)
        even, odd = (_with_residuals(half, guides, number) for half in of_filter)
        found = combine(even, odd, halves.variance[..., number], halves.share)
        mean[..., number], variance[..., number] = found.mean, found.variance
        first[..., number], second[..., number] = found.even, found.odd
        raw_weights.append(found.raw_weight.mean())
        shifts.append(abs(found.shift))
    record = {
        "by": f"Open Image Denoise (pyoidn {metadata.version('pyoidn')})",
        "guided": guides is not None,
        "raw_weight": float(np.mean(raw_weights)),
        "sum_corrected_by": float(max(shifts)),
    }
    return Denoised(mean, variance, first, second, record)


def _candidates(half: Float64Array, guides: Guides | None) -> list[Image]:
    """(H, W, F) each: a half as it is, denoised, and where there are guides denoised without its reflectance."""
    if guides is None:
        return [half, smoothed(half, None, None)]
    albedo = guides.reflectance.mean(axis=-1)
    reflectance = np.maximum(guides.reflectance, DARKEST_REFLECTANCE)
    white = np.ones_like(albedo)
    return [
        half,
        smoothed(half, albedo, guides.normal),
        reflectance * smoothed(half / reflectance, white, guides.normal),
    ]


def _with_residuals(half: list[Image], guides: Guides | None, number: int) -> list[Image]:
    """The candidates of one filter, with what the last one lost."""
    reflectance = 1.0 if guides is None else np.maximum(guides.reflectance[..., number], DARKEST_REFLECTANCE)
    return [*half[:-1], *with_residuals(half[0], half[-1], reflectance)]


def smoothed(
    image: Float64Array, albedo: NDArray[np.float32] | None, normal: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """The denoised image (H, W, F), never negative.  albedo : (H, W).  normal : (H, W, 3)."""
    count, colours = image.shape[2], np.arange(-(-image.shape[2] // COLOURS) * COLOURS)
    scale = float(image.mean()) or 1.0
    layers = np.ascontiguousarray(image[..., np.minimum(colours, count - 1)] / scale, np.float32)
    guides = {}
    if albedo is not None and normal is not None:
        grey = np.repeat(albedo[..., None], COLOURS, axis=-1)
        guides = {"albedo": np.ascontiguousarray(grey, np.float32), "normal": np.ascontiguousarray(normal, np.float32)}
    parts = [
        _filtered({"color": np.ascontiguousarray(layers[..., k : k + COLOURS]), **guides})
        for k in range(0, len(colours), COLOURS)
    ]
    return np.maximum(np.concatenate(parts, axis=-1)[..., :count], 0.0) * np.float32(scale)


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
