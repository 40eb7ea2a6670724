"""The fraction of the photoelectrons of a camera that is detected where data of the scene end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Caution
from ..light.irradiance import Irradiance
from ..light.photons import photons_per_irradiance
from .finding import Finding, largest_share
from .spectra import Range

SHARE_MIN = 1e-3  # of the photoelectrons of a filter; less is not reported


class ElectronShare(NamedTuple):
    """The photoelectrons that are detected where data of the scene end.

    why : assumption about the scene there.  data_nm : the wavelengths with data.
    filter : the colour filter with the largest fraction.  share : largest possible fraction of its photoelectrons.
    dn : mean over all pixels of the frame [DN].
    """

    why: str
    data_nm: Range
    filter: str
    share: float
    dn: float

    def note(self, findings: Iterable[Finding]) -> str:
        """Return the sentence on this fraction.  findings : notes of the scene that it replaces."""
        low_nm, high_nm = self.data_nm
        ends = f"{low_nm:.5g} to {high_nm:.5g} nm".removeprefix("0 to ")
        note = (
            f"up to {self.share:.1%} of the photoelectrons of the {self.filter} pixels depend on "
            f"light beyond {ends.replace('to inf nm', 'nm and more')}, where {self.why}"
        )
        places = "; ".join(dict.fromkeys(finding.where for finding in findings))
        remedies = (finding.remedy for finding in findings)
        return "; ".join([f"{note} ({places})" if places else note, *dict.fromkeys(remedies)])


def with_notes_of_shares(
    light: Irradiance, camera: Camera, findings: Iterable[Finding]
) -> Irradiance:
    """Return the light with its :class:`ElectronShare` values in the statistics and among its notes. They replace the
    notes on the same data of the scene, which only know how much of a flat spectrum the camera detects there."""
    ending: dict[Range, list[Finding]] = {}
    for finding in findings:
        if finding.data_nm is not None:
            ending.setdefault(finding.data_nm, []).append(finding)
    if not ending or light.filters is not None or light.rendered_for is None:
        return light  # filters are no bands
    notes, shares = [*light.statistics.notes], list[ElectronShare]()
    for data_nm, of_range in ending.items():
        share = _electron_share(light, camera, data_nm, of_range)
        replaced = [finding for finding in of_range if not finding.is_serious]
        notes = [note for note in notes if note not in {one.as_note for one in replaced}]
        if share.share > SHARE_MIN:
            shares.append(share)
            notes.append(Caution(share.note(replaced)))
    beyond_data = tuple(share._asdict() for share in shares)
    statistics = replace(light.statistics, notes=tuple(notes), beyond_data=beyond_data)
    return replace(light, statistics=statistics)


def _electron_share(
    light: Irradiance, camera: Camera, data_nm: Range, findings: Sequence[Finding]
) -> ElectronShare:
    """Return how many photoelectrons are detected outside a range at most: bands that reach beyond it count whole."""
    assert light.rendered_for is not None
    centres_nm = np.asarray(light.wavelengths_nm, dtype=np.float64)
    widths_nm = np.asarray(light.bandwidths_nm, dtype=np.float64)
    spectrum = light.data.mean(axis=(0, 1), dtype=np.float64)
    if not np.isfinite(spectrum).all():  # a copy of the data
        spectrum = light.data.mean(axis=(0, 1), dtype=np.float64, where=np.isfinite(light.data))
    exposure = light.rendered_for.exposure
    photons = photons_per_irradiance(camera, exposure, centres_nm, widths_nm) * spectrum
    electrons = np.atleast_2d(camera.qe(centres_nm, widths_nm)) * photons
    low_nm, high_nm = data_nm
    is_beyond = (centres_nm - widths_nm / 2 < low_nm) | (centres_nm + widths_nm / 2 > high_nm)
    name, share = largest_share(camera, electrons, is_beyond)
    beyond_e = electrons[camera.filter_names.index(name), is_beyond].sum()
    why = ", ".join(dict.fromkeys(finding.beyond for finding in findings))
    return ElectronShare(
        why, data_nm, name, share, float(beyond_e) * camera.system_gain_dn_per_e
    )
