"""The share of the photoelectrons of a camera that is detected where data of the scene end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Caution
from ..light.irradiance import Irradiance
from ..light.photons import photons_per_irradiance
from .finding import Finding, largest_share
from .spectra import Range

TOLERATED = 1e-3  # of the photoelectrons of a filter


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
        ends = f"{low_nm:.5g} to {high_nm:.5g} nm".removeprefix("0 to ")
        return (
            f"up to {self.share:.1%} of the photoelectrons of the {self.filter} pixels depend on "
            f"light beyond {ends.replace('to inf nm', 'nm and more')}, where {self.why}"
        )


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
    spectrum = light.data.mean(axis=(0, 1), dtype=np.float64)
    if not np.isfinite(spectrum).all():  # a copy of the data
        spectrum = light.data.mean(axis=(0, 1), dtype=np.float64, where=np.isfinite(light.data))
    exposure = light.rendered_for.exposure
    photons = photons_per_irradiance(camera, exposure, centres_nm, widths_nm) * spectrum
    electrons = np.atleast_2d(camera.qe(centres_nm, widths_nm)) * photons
    for (low_nm, high_nm), reasons in ending.items():
        is_beyond = (centres_nm - widths_nm / 2 < low_nm) | (
            centres_nm + widths_nm / 2 > high_nm
        )
        name, share = largest_share(camera, electrons, is_beyond)
        if share > TOLERATED:
            beyond_e = electrons[camera.filter_names.index(name), is_beyond].sum()
            mean_dn = float(beyond_e) * camera.system_gain_dn_per_e
            yield ElectronShare(", ".join(reasons), (low_nm, high_nm), name, share, mean_dn)
