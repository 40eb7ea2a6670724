"""The lamps of the charts: one narrow lamp for each colour filter, at the wavelength where that sees most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import saturation_e
from ...core.types import Float64Array
from .light import NARROW_NM
from .setting import Bands, levels_of_filters
from .transfer import Transfer, transfer_of


def lamps_nm(camera: Camera) -> list[float]:
    """Where each colour filter sees most [nm], each wavelength once."""
    points = np.array(camera.quantum_efficiency.wavelengths_nm, np.float64)
    peaks = points[camera.qe(points).argmax(axis=1)]
    return sorted(set(peaks.tolist()))


def rendered_nm(camera: Camera) -> list[float]:
    """The lamps whose light is rendered: without diffraction the light of all lamps has one shape."""
    if camera.lens.diffraction:
        return lamps_nm(camera)
    return lamps_nm(camera)[:1]


def bands_of_lamps(camera: Camera) -> Bands:
    """A narrow band about each lamp."""
    centres = np.array(lamps_nm(camera))
    return Bands(centres, np.full(centres.shape, NARROW_NM))


def photons_of_shapes(
    camera: Camera, shapes: Sequence[Float64Array], share: float
) -> Float64Array:
    """Mean photons of all lamps (H, W, B): equally many electrons of each where it is seen best.

    shapes : light (H, W, 1) of each lamp, or of one for all.  share : of the saturation of the filter that sees most,
    where shapes are 1.
    """
    joined = np.concatenate(shapes, axis=-1)
    return np.asarray(joined * even_photons(camera, share))


def even_photons(camera: Camera, share: float) -> Float64Array:
    """Mean photons of all lamps (B,) that give the filter that sees most this share of its saturation."""
    bands = bands_of_lamps(camera)
    most_e = camera.qe(*bands).max(axis=0)
    total = levels_of_filters(camera, 1 / most_e, bands).max()
    return np.asarray(share * saturation_e(camera) / total / most_e)


def transfers_of_filters(camera: Camera) -> dict[str, Transfer]:
    """The transfer of the light of all lamps behind each colour filter, where that has a closed form.

    By the name of the filter, which is empty for a camera that has one only.
    """
    bands = bands_of_lamps(camera)
    electrons = levels_of_filters(camera, np.diag(even_photons(camera, 1.0)), bands)
    transfers = {}
    for number, name in enumerate(camera.filter_names):
        transfer = transfer_of(camera, bands.wavelengths_nm, electrons[:, number])
        if transfer is not None:
            transfers[name if len(camera.filter_names) > 1 else ""] = transfer
    return transfers
