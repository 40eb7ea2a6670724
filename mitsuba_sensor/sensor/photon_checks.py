"""Checks of mean photons and of the bands that they are in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..camera.fingerprint import polarizer_fingerprint
from ..core import InputError, Photons, numbers

if TYPE_CHECKING:
    from ..camera.camera import Camera


def check_lengths(bands: NDArray[np.float64] | None) -> None:
    """Raise InputError for a wavelength that is no length."""
    if bands is not None and (wrong := bands[~(np.isfinite(bands) & (bands > 0))]).size:
        raise InputError(
            f"wavelengths_nm holds {wrong[0]}; every band needs a positive, finite length in nm."
        )


def checked_widths(values: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """One positive, finite width for each band [nm]. Raises InputError."""
    widths = numbers("photons.bandwidths_nm", values, "one width per band in nm")
    if widths.shape != shape or not (np.isfinite(widths) & (widths > 0)).all():
        raise InputError(
            "photons.bandwidths_nm must hold one positive, finite width in nm per band; or leave it out."
        )
    return widths


def check_light(photons: Photons) -> None:
    """Raise InputError as :func:`check_photons`, which needs all of them at once only to say where they are wrong."""
    if not all(strip.mean.min() >= 0 for strip in photons.strips()):
        check_photons(photons.mean)


def check_photons(mean: NDArray[np.float64]) -> None:
    """Raise InputError for NaN or negative photons, with how many there are and where the first one is."""
    if (
        not mean.min() >= 0
    ):  # NaN if any of them is: one pass over the photons, of which there may be many
        kind, bad = ("NaN", np.isnan(mean)) if np.isnan(mean).any() else ("negative", mean < 0)
        raise InputError(
            f"photons is {kind} in {int(bad.sum())} place(s), first at {first_place(bad)}; a mean number of photons is "
            "0 or more: clamp or correct them before expose()."
        )


def check_polarizers(polarizers: str | None, camera: Camera) -> None:
    """Raise InputError for light behind the polarisers of another camera.  polarizers : fingerprint of its own."""
    if polarizers not in (None, polarizer_fingerprint(camera)):
        has = "none"
        if camera.sensor.polarizers is not None:
            has = "others"
        raise InputError(
            f"the light was rendered behind the polarisers of another camera, and {camera.name} has {has}; render it "
            "for this camera."
        )


def first_place(bad: NDArray[np.bool_]) -> tuple[int, ...]:
    """Index of the first one."""
    return tuple(int(i) for i in np.argwhere(bad)[0])


def check_kept(keep: tuple[str, ...], light: Photons) -> None:
    """Raise InputError where photons are to be kept of light of which only the photoelectrons are known."""
    if light.detected and "photons" in keep:
        raise InputError(
            "keep names 'photons', and of this light only the photoelectrons are known; keep 'photoelectrons', or "
            "render bands (spectral='cube')."
        )


def checked_channels(mean: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Mean photoelectrons behind each colour filter, (H, W, F), of those or of each pixel behind its own, (H, W)."""
    filters = len(camera.quantum_efficiency.curves)
    layers = mean
    if mean.ndim == 2:
        layers = np.broadcast_to(mean[..., None], (*mean.shape, filters))
    check_channels(layers.shape, camera)
    return layers


def check_channels(shape: tuple[int, ...], camera: Camera) -> None:
    """Raise InputError unless these are channels of this camera."""
    filters = len(camera.quantum_efficiency.curves)
    if len(shape) != 3 or shape[2] != filters or camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"photons has shape {shape} and is detected already; it must be (H, W), or (H, W, {filters}), one layer "
            "per colour filter, of a camera without quantum_yield: render it again for this camera."
        )
