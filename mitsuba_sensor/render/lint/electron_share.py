"""The share of the photoelectrons of a camera that is detected where data of the scene end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Caution, Float64Array
from ..light.irradiance import Irradiance
from ..light.photons import photons_per_irradiance
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


class ElectronShare(NamedTuple):
    """The photoelectrons that are detected where data of the scene end.

    why : what is true of the scene there.  data_nm : the wavelengths with data.
    filter : the colour filter with the largest share.  share : of its photoelectrons, at most.
    dn : the same in the frame, as a mean of all pixels [DN].
    """

    why: str
    data_nm: Range
    filter: str
    share: float
    dn: float

    def __str__(self) -> str:
        low_nm, high_nm = self.data_nm
        ends = f"{low_nm:.5g} to {high_nm:.5g} nm"
        if low_nm == 0:
            ends = f"{high_nm:.5g} nm"
        elif math.isinf(high_nm):
            ends = f"the range from {low_nm:.5g} nm on"
        electrons_of = (
            f"up to {self.share:.1%} of the photoelectrons of the {self.filter} pixels"
        )
        mean = f"on average {self.dn:.3g} DN"
        return f"{electrons_of}, {mean}, rest on light beyond {ends}, where {self.why}"


def with_notes_of_shares(
    light: Irradiance, camera: Camera, findings: Iterable[Finding]
) -> Irradiance:
    """The light of a camera with :func:`electron_shares` in its statistics and among its notes."""
    shares = tuple(electron_shares(light, camera, findings))
    statistics = replace(
        light.statistics,
        notes=(*light.statistics.notes, *(Caution(share) for share in shares)),
        beyond_data=tuple(share._asdict() for share in shares),
    )
    return replace(light, statistics=statistics)


def electron_shares(
    light: Irradiance, camera: Camera, findings: Iterable[Finding]
) -> Iterator[ElectronShare]:
    """For data of a scene that end inside the bands: how many photoelectrons are detected beyond.

    Bands that reach beyond count whole. It is the most that can rest on what was assumed there.
    """
    ending: dict[Range, list[str]] = {}
    for finding in findings:
        if finding.data_nm is not None and finding.beyond not in ending.get(
            finding.data_nm, ()
        ):
            ending.setdefault(finding.data_nm, []).append(finding.beyond)
    if not ending or light.filters is not None or light.rendered_for is None:
        return  # filters are no bands
    centres_nm = np.asarray(light.wavelengths_nm, dtype=np.float64)
    widths_nm = np.asarray(light.bandwidths_nm, dtype=np.float64)
    photons = photons_per_irradiance(
        camera, light.rendered_for.exposure, centres_nm, widths_nm
    ) * _mean_spectrum(light.data)
    electrons = np.atleast_2d(camera.qe(centres_nm, widths_nm)) * photons
    for (low_nm, high_nm), reasons in ending.items():
        is_beyond = (centres_nm - widths_nm / 2 < low_nm) | (
            centres_nm + widths_nm / 2 > high_nm
        )
        name, share = _largest_share(camera, electrons, is_beyond)
        if share > TOLERATED:
            beyond_e = electrons[camera.filter_names.index(name), is_beyond].sum()
            mean_dn = float(beyond_e) * camera.system_gain_dn_per_e
            yield ElectronShare(", ".join(reasons), (low_nm, high_nm), name, share, mean_dn)


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
