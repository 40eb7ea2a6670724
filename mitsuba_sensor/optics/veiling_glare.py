"""Veiling glare: light that the surfaces and the barrel of a lens scatter over the whole image.

    E'(p) = (1 − g)·E(p) + g·Σ_q s(p − q)·E(q)/S(q),    S(q) = Σ_p s(p − q)

g is the scattered fraction of the light; s is the glare spread function of ISO 9358 without its peak: constant, or
1/(1 + (r/w)²) at the distance r on the sensor. S keeps the light of every pixel in the image, so the sum is conserved:
light scattered out of the image is assumed to equal light scattered in from the unrendered scene around it. ISO's
veiling glare index is the relative signal of a small black patch in a uniform field: g, if the field fills the image
and s is constant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..core import Array, Float64Array, InputError

if TYPE_CHECKING:
    from ..camera.camera import Camera
    from .intrinsics import View

Image = NDArray[np.floating]


class VeilingGlare:
    """The glare of an image.

    fraction : g.  shape : (H, W).  half_width_px : w in rows and columns; None for a constant s.
    """

    def __init__(
        self,
        fraction: float,
        shape: tuple[int, int],
        half_width_px: tuple[float, float] | None = None,
    ) -> None:
        self._fraction, self._shape = fraction, shape
        self._size = [scipy.fft.next_fast_len(2 * count - 1, real=True) for count in shape]
        self._spread: Array | None = None
        self._squared_spread: Array | None = None
        if half_width_px is not None:
            spread = _inverse_square(self._size, half_width_px)
            self._spread, self._squared_spread = (
                scipy.fft.rfft2(values) for values in (spread, spread**2)
            )
        self._total = self._around(np.ones(shape), self._spread)  # S
        self._reach = self._around(1 / self._total, self._spread)

    def add_to_bands(self, mean: NDArray[np.float32], error: NDArray[np.float32]) -> None:
        """Replace bands and their standard errors, shape (H, W, B), by their values with glare."""
        seen = self._of_pixels(np.ones(self._shape, bool))
        for band in range(mean.shape[2]):
            light = mean[..., band].astype(float), error[..., band].astype(float) ** 2
            mean[..., band], variance = self._behind(*light, seen)
            error[..., band] = np.sqrt(variance)

    def of_electrons(
        self, mean: Float64Array, variance: Float64Array, filters: NDArray[np.intp]
    ) -> tuple[Float64Array, Float64Array]:
        """Return photoelectrons with glare and the variance of this mean, shape (H, W) each.

        filters : colour filter number of each pixel; the glare of a filter follows from the pixels with this filter.
        """
        new_mean, new_variance = np.empty(self._shape), np.empty(self._shape)
        for number in np.unique(filters):
            mask = filters == number
            light = self._behind(mean, variance, self._of_pixels(mask))
            new_mean[mask], new_variance[mask] = (values[mask] for values in light)
        return new_mean, new_variance

    def _of_pixels(self, seen: NDArray[np.bool_]) -> _Shares:
        share = np.where(seen, 1 / self._total, 0.0)
        return _Shares(share, self._reach / self._around(share, self._spread))

    def _behind(
        self, mean: Image, variance: Image, seen: _Shares
    ) -> tuple[Float64Array, Float64Array]:
        """Return mean and variance with glare of the seen pixels, from these pixels only."""
        scattered, (share, scale) = self._fraction, seen
        glare = scale * self._around(share * mean, self._spread)
        squares = scale**2 * self._around(share**2 * variance, self._squared_spread)
        weight = (1 - scattered) ** 2 + 2 * scattered * (1 - scattered) * scale * share
        kept = (1 - scattered) * mean
        return kept + scattered * glare, weight * variance + scattered**2 * squares

    def _around(self, values: Float64Array, spread: Array | None) -> Float64Array:
        """Return Σ_q spread(p − q)·values(q) at each p.  spread : its transform; None for a spread of 1."""
        rows, columns = self._shape
        if spread is None:
            return np.full(self._shape, values.sum())
        transform = scipy.fft.rfft2(values, self._size) * spread
        sums = scipy.fft.irfft2(transform, self._size)[:rows, :columns]
        return np.asarray(np.maximum(sums, 0.0))  # rounding


class _Shares(NamedTuple):
    """share : 1/S of the seen pixels, 0 elsewhere.  scale : from their glare to the glare of all pixels."""

    share: Float64Array
    scale: Float64Array


def _inverse_square(size: list[int], half_width_px: tuple[float, float]) -> Float64Array:
    """Return 1/(1 + (r/w)²) around the first pixel of a periodic array."""
    row, column = (
        scipy.fft.fftfreq(count, 1 / count) / width
        for count, width in zip(size, half_width_px, strict=True)
    )
    return np.asarray(1 / (1 + row[:, None] ** 2 + column**2))


def veiling_glare_of(camera: Camera, view: View) -> VeilingGlare | None:
    """Return the glare of the camera's lens, or None. Raises InputError for a crop, which lacks the other light."""
    lens = camera.lens
    if lens.veiling_glare == 0:
        return None
    if view.crop_size != view.size:
        crop, film = (f"{columns} × {rows}" for columns, rows in (view.crop_size, view.size))
        raise InputError(
            f"lens.veiling_glare is {lens.veiling_glare:g} and needs the whole image, but the film renders a crop of "
            f"{crop} of {film} pixels; remove the crop, or set lens.veiling_glare to 0."
        )
    return VeilingGlare(lens.veiling_glare, view.size[::-1], half_width_px(camera))


def half_width_px(camera: Camera) -> tuple[float, float] | None:
    """Return lens.glare_width_mm in rows and columns of the camera; None for uniform glare."""
    width_mm, pixel = camera.lens.glare_width_mm, camera.pixel
    if width_mm is None:
        return None
    return width_mm * 1e3 / pixel.pitch_y_um, width_mm * 1e3 / pixel.pitch_x_um


def glare_sentence(camera: Camera) -> str:
    """Return a note on the fraction of glare and its limits."""
    lens, how = camera.lens, "uniformly over the image"
    if lens.glare_width_mm is not None:
        how = f"over the image, halved at {lens.glare_width_mm:g} mm"
    fraction = f"{100 * lens.veiling_glare:.3g} % of the light is veiling glare, spread {how}"
    return f"{fraction}; light sources outside the image cause none (lens.veiling_glare)"
