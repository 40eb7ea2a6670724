"""Error of the photoelectrons of a camera that the light was not rendered for: what a band's own spectrum would change.

Such a camera's electrons assume a flat spectrum within each band. How far it is from flat is estimated from the
neighbouring bands; a band that stands out from them may be a line, anywhere within the band.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Doubt, Float64Array
from ...core.band_average import band_integrals
from .irradiance import Irradiance, is_exact

TOLERATED, DOUBTFUL = (
    1e-3,
    0.01,
)  # of the electrons of a filter: what no note names, from where on Python warns
BLOCKS = 8  # along each side of the picture: their means have little of the render's noise
DIMMEST = 0.01  # of a filter's mean electrons: darker blocks do not count
STANDS_OUT = (
    1.5  # times the mean of its neighbours: two bands with a line on their common edge have 2
)
WIDTHS_NM = (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5)
STEPS = 64  # of a band, in search of the wavelength of a line that would change most


class BandError(NamedTuple):
    """Relative errors of the photoelectrons of a filter, in the part of the picture where they are largest.

    worst_filter : that filter.
    error_estimate : if the spectrum within a band runs as its neighbours say, and bands that stand out are lines;
        without cancellation between bands.
    largest_error : if all light of a band were at the wavelength of its own that changes most: the largest possible.
    """

    worst_filter: str
    error_estimate: float
    largest_error: float


def band_error(light: Irradiance, camera: Camera) -> BandError:
    """The error of ``collect(light, camera, …)``; 0 where the camera's own filters were rendered."""
    names = camera.filter_names
    if is_exact(light, camera):
        return BandError(names[0], 0.0, 0.0)
    spectra, widths = _blocks(light), np.asarray(light.bandwidths_nm, dtype=np.float64)
    flat, sloped, curved, extreme = _moments(
        camera, np.asarray(light.wavelengths_nm, dtype=np.float64), widths
    )
    electrons = spectra @ flat.T
    seen = electrons > DIMMEST * electrons.mean(axis=0)
    if not seen.any():
        return BandError(names[0], 0.0, 0.0)
    lines = spectra[:, None] * extreme  # (N, F, B), as all below
    slopes, curvatures, stand_out = (one[:, None] for one in _departures(spectra))
    smooth = np.minimum(slopes * np.abs(sloped) + curvatures * np.abs(curved), lines)
    changes = np.where(stand_out, lines, smooth).sum(axis=-1), lines.sum(axis=-1)
    per_electron = np.divide(1.0, electrons, out=np.zeros_like(electrons), where=seen)
    largest, most = (np.max(change * per_electron, axis=0) for change in changes)
    worst = int(np.argmax(largest))
    return BandError(names[worst], float(largest[worst]), float(most.max()))


def notes_of_bands(light: Irradiance, camera: Camera, error: BandError) -> Iterator[str]:
    """What light that was rendered for another camera, or by another program, lacks for this one."""
    exact = is_exact(light, camera)
    if not exact:
        yield from band_note(light, error)
    if not exact or light.rendered_for is None:
        yield from unseen_note(light, camera)


def band_note(light: Irradiance, error: BandError) -> Iterator[str]:
    """What the bands of another camera's light cost this one, and which bandwidth would do; nothing if it is little."""
    if error.error_estimate <= TOLERATED:
        return
    width_nm = float(np.max(light.bandwidths_nm))
    narrow = (
        width_nm * (TOLERATED / error.error_estimate) ** 0.5
    )  # the error goes with the square of the width
    enough = next((nm for nm in WIDTHS_NM if nm <= narrow), None)
    why, remedy = "this light was not rendered for this camera", "render it for this camera"
    narrower = f", or with --bandwidth-nm {enough:g}"
    if light.rendered_for is None:
        why, remedy = (
            "the spectrum within the bands of this light is not known",
            "give narrower bands",
        )
        narrower = f", e.g. of {enough:g} nm"
    said = (
        f"{why}: in bands of {width_nm:g} nm the {error.worst_filter} electrons are off by about "
        f"{error.error_estimate:.1%}, by at most {error.largest_error:.0%}; "
        f"{remedy}{narrower if enough is not None else ''}"
    )
    yield Doubt(said) if error.error_estimate > DOUBTFUL else said


def unseen_note(light: Irradiance, camera: Camera) -> Iterator[str]:
    """What the camera detects beyond the bands, where nothing was rendered; nothing if it is little."""
    low, high = (
        light.wavelengths_nm - light.bandwidths_nm / 2,
        light.wavelengths_nm + light.bandwidths_nm / 2,
    )
    ends = (
        np.array([min(low.min(), camera.band_nm[0])]),
        np.array([max(high.max(), camera.band_nm[1])]),
    )
    points = np.array(camera.quantum_efficiency.wavelengths_nm)
    inside, all_of_it = (
        band_integrals(lambda nm: camera.qe(nm) * nm, points, *edges).sum(axis=1)
        for edges in ((low, high), ends)
    )
    unseen = 1 - np.divide(inside, all_of_it, out=np.ones_like(inside), where=all_of_it > 0)
    if (
        len(light.wavelengths_nm) == 1 or unseen.max() <= TOLERATED
    ):  # one band is as it was asked for
        return
    name, share = camera.filter_names[int(np.argmax(unseen))], float(unseen.max())
    beyond = f"beyond {low.min():g} to {high.max():g} nm"
    detects = f"where the {name} pixels of this camera detect {share:.1%} of a flat spectrum"
    if light.rendered_for is None:
        said = f"this light has nothing {beyond}, {detects}"
    else:
        said = f"nothing was rendered {beyond}, {detects}; render it for this camera"
    yield Doubt(said) if share > DOUBTFUL else said


def _blocks(light: Irradiance) -> Float64Array:
    """Mean spectra of parts of the picture, (N, B); pixels of infinite light do not count."""
    height, width, _ = light.data.shape
    row_edges, column_edges = (
        np.linspace(0, n, min(n, BLOCKS) + 1).astype(int) for n in (height, width)
    )
    means = []
    for rows, columns in itertools.product(pairwise(row_edges), pairwise(column_edges)):
        part = light.data[slice(*rows), slice(*columns)]
        mean = part.mean(axis=(0, 1), dtype=np.float64)
        if not np.isfinite(mean).all():
            finite = np.isfinite(part).all(axis=2, keepdims=True)
            mean = np.where(finite, part, 0.0).mean(axis=(0, 1), dtype=np.float64)
        means.append(mean)
    return np.array(means)


def _departures(spectra: Float64Array) -> tuple[Float64Array, Float64Array, NDArray[np.bool_]]:
    """|s| and |c| of E(x) − Ē = s·x + c·(x² − 1/12), x = (λ − λ_c)/Δλ, and which bands stand out, (N, B) each."""
    if spectra.shape[1] < 2:
        return spectra, spectra, np.ones(spectra.shape, bool)
    first, last = (
        np.maximum(2 * spectra[:, [a]] - spectra[:, [b]], 0.0) for a, b in ((0, 1), (-1, -2))
    )
    whole = np.concatenate([first, spectra, last], axis=1)
    below, above = whole[:, :-2], whole[:, 2:]
    slope = np.maximum(np.abs(above - spectra), np.abs(spectra - below))
    return (
        slope,
        np.abs(above - 2 * spectra + below) / 2,
        spectra > STANDS_OUT * (above + below) / 2,
    )


def _moments(
    camera: Camera, centres_nm: Float64Array, widths_nm: Float64Array
) -> tuple[Float64Array, ...]:
    """∫ QE·λ·(1, x, x² − 1/12) dλ over each band, and Δλ·max |QE·λ − mean|, (F, B) each."""
    points = np.array(camera.quantum_efficiency.wavelengths_nm)
    low, high = centres_nm - widths_nm / 2, centres_nm + widths_nm / 2

    def of_band(k: int) -> list[Float64Array]:
        def times(power: int, less: float) -> Float64Array:
            def curves(nm: Float64Array) -> Float64Array:
                return np.asarray(
                    camera.qe(nm) * nm * (((nm - centres_nm[k]) / widths_nm[k]) ** power - less)
                )

            return band_integrals(curves, points, low[[k]], high[[k]])[:, 0]

        flat, nm = times(0, 0.0), np.linspace(low[k], high[k], STEPS + 1)
        farthest = np.abs(camera.qe(nm) * nm * widths_nm[k] - flat[:, None]).max(axis=1)
        return [flat, times(1, 0.0), times(2, 1 / 12), farthest]

    found = np.array([of_band(k) for k in range(centres_nm.size)])  # (B, 4, F)
    return tuple(np.moveaxis(found, 0, 2))
