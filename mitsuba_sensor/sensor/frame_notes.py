"""Notes on an exposure: possible problems of camera, window, light and temperature."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..camera.camera import Camera
from ..camera.sensor_size import size_note
from ..core import Doubt, Frame, Photons
from ..stages.polarizers import mean_transmittance
from ..stages.usual_range import temperature_note
from .detection import Detected
from .metering import clipped_note

OUTSIDE_MIN = {True: 0.01, False: 0.99}
"""Fraction of the photons outside a QE curve that is a doubt, for a curve that is cut off or that ends near 0."""
MICROMETRES_MAX = 20.0
"""Smaller wavelengths are micrometres: no QE curve has such a wavelength in nm."""
CUT_OFF = 0.01
"""A curve that ends above this fraction of its peak probably continues in the datasheet."""


def exposure_notes(camera: Camera, light: Detected, first: Frame) -> tuple[str, ...]:
    """Return all notes on an exposure except those on the light itself and its noise; no frame is computed.

    light : light on the window of ``first``, the first frame.
    """
    source = light.photons.source
    return (
        *camera.notes,
        *size_note(first.window.shape, first.window.origin, camera),
        *_outside_note(light.photons, camera),
        *_wavelength_note(light.photons, camera),
        *clipped_note(light, camera, first),
        *_bias_note(light.photons, first),
        *_lag_note(light.photons, camera, first),
        *_unpolarized_note(light.photons, camera),
        *temperature_note(first.exposure.temperature_k),
        *(() if source is None else source.notes_for(camera)),
    )


def _bias_note(photons: Photons, first: Frame) -> Iterator[str]:
    """Note an exposure time of 0 for the light of a scene."""
    if photons.source is not None and first.exposure.time_s == 0:
        yield "the exposure time is 0 s, so no light is collected: this is a bias frame"


def _lag_note(photons: Photons, camera: Camera, first: Frame) -> Iterator[str]:
    """Note unknown light before the first frame of a camera with image lag."""
    if camera.quantum_efficiency.image_lag and not photons.by_readout:
        yield (
            f"image_lag has no effect in frame {first.index}, because the light before it is assumed to be the same; "
            'use fps with changing light, or photons with by_readout={"before": ms.Photons(…)}'
        )


def _unpolarized_note(photons: Photons, camera: Camera) -> Iterator[str]:
    """Note light of unknown polarisation on a camera with polarisers."""
    if camera.sensor.polarizers is None or photons.polarizers is not None or photons.detected:
        return
    passed = mean_transmittance(camera)
    shares = f"{passed.min():.3g}"
    if passed.max() > passed.min():
        shares += f" to {passed.max():.3g}"
    yield f"the light is assumed to be unpolarised: the polarisers of {camera.name} pass {shares} of it"


def _outside_note(photons: Photons, camera: Camera) -> Iterator[str]:
    """Note photons in bands outside the QE curve."""
    outside = outside_qe(photons, camera)
    share, wavelengths_nm = outside["share_of_photons"], outside["wavelengths_nm"]
    if not share:
        return
    points = camera.quantum_efficiency.wavelengths_nm
    first_nm, last_nm = min(wavelengths_nm), max(wavelengths_nm)
    bands = f"a band at {first_nm:g} nm"
    if len(wavelengths_nm) > 1:
        bands = f"{len(wavelengths_nm)} bands from {first_nm:g} to {last_nm:g} nm"
    note = (
        f"{100 * share:.3g} % of the photons are in {bands} and not detected, because the QE curve of {camera.name} "
        f"covers {points[0]:g} to {points[-1]:g} nm"
    )
    if last_nm < MICROMETRES_MAX:
        note += f"; wavelengths are in nm: {last_nm:g} µm are {1000 * last_nm:g}"
    ends_low, ends_high = _is_cut_off(camera)
    cut_off = bool((ends_low and first_nm < points[0]) or (ends_high and last_nm > points[-1]))
    yield Doubt(note) if share > OUTSIDE_MIN[cut_off] else note


def _wavelength_note(photons: Photons, camera: Camera) -> Iterator[str]:
    """Note the wavelength that is assumed for photons without one behind colour filters."""
    reference_nm = camera.quantum_efficiency.reference_nm
    is_known = photons.detected or photons.wavelengths_nm is not None
    if is_known or reference_nm is None or len(camera.filter_names) == 1:
        return
    efficiencies = camera.qe([reference_nm])[:, 0]
    named = zip(camera.filter_names, efficiencies, strict=True)
    of_filters = ", ".join(f"{name} {100 * qe:.3g} %" for name, qe in named)
    yield Doubt(
        f"photons without a wavelength are assumed to have {reference_nm:g} nm, where the QE of {camera.name} is "
        f"{of_filters}; give wavelengths_nm, or photoelectrons as ms.Photons(electrons, detected=True)"
    )


def _is_cut_off(camera: Camera) -> tuple[bool, bool]:
    """Return whether the QE is far from 0 at the start and at the end of its curves."""
    curves = np.array(list(camera.quantum_efficiency.curves.values()))
    least = CUT_OFF * curves.max()
    return bool(curves[:, 0].max() > least), bool(curves[:, -1].max() > least)


def outside_qe(photons: Photons, camera: Camera) -> dict[str, Any]:
    """Return the bands outside the QE curve, where nothing is detected, and their fraction of all photons."""
    points, bands = camera.quantum_efficiency.wavelengths_nm, photons.wavelengths_nm
    if bands is None:
        outside = np.zeros(1, bool)
    else:
        outside = (bands < points[0]) | (bands > points[-1])
    if bands is None or photons.detected or not outside.any():
        return {"wavelengths_nm": [], "share_of_photons": 0.0}
    strips = (
        np.atleast_3d(strip.mean) for strip in photons.strips()
    )  # together they may be most of the memory
    finite = np.sum([mean.sum(axis=(0, 1), where=np.isfinite(mean)) for mean in strips], axis=0)
    share = 0.0
    if finite.sum():
        share = float(finite[outside].sum() / finite.sum())
    return {"wavelengths_nm": bands[outside].tolist(), "share_of_photons": share}
