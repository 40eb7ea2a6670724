"""The share of the photoelectrons of a camera that is detected where data of the scene end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Float64Array
from ..light.irradiance import Irradiance
from .finding import Finding, Range

STEP_NM = 1.0
TOLERATED = 1e-3  # of the photoelectrons of a filter


def share_of_flat_light(camera: Camera, band_nm: Range, data_nm: Range) -> str:
    """What a camera detects of a spectrum that is flat in the bands and 0 outside, where there are no
    data: the end of a sentence."""
    low_nm, high_nm = band_nm
    count = max(round((high_nm - low_nm) / STEP_NM), 1)
    edges_nm = np.linspace(low_nm, high_nm, count + 1)
    centres_nm = (edges_nm[1:] + edges_nm[:-1]) / 2
    is_beyond = (centres_nm < data_nm[0]) | (centres_nm > data_nm[1])
    name, share = _largest_share(
        camera, np.atleast_2d(camera.qe(centres_nm)) * centres_nm, is_beyond
    )
    return f", and the {name} pixels detect {share:.1%} of a flat spectrum beyond"


def with_notes_of_shares(
    light: Irradiance, camera: Camera, findings: Iterable[Finding]
) -> Irradiance:
    """The light of a camera with :func:`notes_of_shares` among its notes."""
    notes = (*light.statistics.notes, *notes_of_shares(light, camera, findings))
    return replace(light, statistics=replace(light.statistics, notes=notes))


def notes_of_shares(
    light: Irradiance, camera: Camera, findings: Iterable[Finding]
) -> Iterator[str]:
    """For data of a scene that end inside the bands: how many photoelectrons are detected beyond.

    Bands that reach beyond count whole. It is the most that can rest on what was assumed there.
    """
    ending = [finding.data_nm for finding in findings if finding.data_nm is not None]
    if not ending or light.filters is not None:  # filters are no bands
        return
    centres_nm = np.asarray(light.wavelengths_nm, dtype=np.float64)
    widths_nm = np.asarray(light.bandwidths_nm, dtype=np.float64)
    power = _mean_spectrum(light.data) * widths_nm
    electrons = np.atleast_2d(camera.qe(centres_nm, widths_nm)) * centres_nm * power
    for low_nm, high_nm in dict.fromkeys(ending):
        is_beyond = (centres_nm - widths_nm / 2 < low_nm) | (
            centres_nm + widths_nm / 2 > high_nm
        )
        name, share = _largest_share(camera, electrons, is_beyond)
        if share > TOLERATED:
            electrons_of = f"up to {share:.1%} of the photoelectrons of the {name} pixels"
            beyond = (
                f"light beyond {low_nm:.5g} to {high_nm:.5g} nm, where data of the scene end"
            )
            yield f"{electrons_of} rest on {beyond}"


def _mean_spectrum(data: NDArray[np.float32]) -> Float64Array:
    """Mean of the pixels, (B,), infinite light left out; without a copy of the data."""
    mean = np.asarray(data.mean(axis=(0, 1), dtype=np.float64))
    if np.isfinite(mean).all():
        return mean
    return np.asarray(data.mean(axis=(0, 1), dtype=np.float64, where=np.isfinite(data)))


def _largest_share(
    camera: Camera, electrons: Float64Array, is_beyond: NDArray[np.bool_]
) -> tuple[str, float]:
    """The filter with the largest share of electrons, (F, B), in some bands, (B,); and that share."""
    total = electrons.sum(axis=1)
    beyond = electrons[:, is_beyond].sum(axis=1)
    shares = np.divide(beyond, total, out=np.zeros_like(total), where=total > 0)
    return camera.filter_names[int(np.argmax(shares))], float(shares.max())
