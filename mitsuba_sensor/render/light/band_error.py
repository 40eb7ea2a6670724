"""Error of the photoelectrons of a camera that the light was not rendered for: what a band's own spectrum would change.

Such a camera's electrons assume a flat spectrum within each band. How far it is from flat is estimated from the
neighbouring bands; a band that stands out from them may be a line, anywhere within the band.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Doubt, Float64Array
from ...core.band_average import band_integrals
from .irradiance import Irradiance, is_exact

TOLERATED = 1e-3  # of the electrons of a filter: what no note names
DOUBTFUL = 0.01  # the same, from where on Python warns
BLOCKS = 8  # along each side of the picture: their means have little of the render's noise
DIMMEST = 0.01  # of a filter's mean electrons: darker blocks do not count
STANDS_OUT = (
    1.5  # times the mean of its neighbours: two bands with a line on their common edge have 2
)
WIDTHS_NM = (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5)
STEPS = 64  # of a band, over which the responses are averaged


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
    """Return the error of ``collect(light, camera, …)``; 0 where the camera's own filters were rendered."""
    names = camera.filter_names
    if is_exact(light, camera):
        return BandError(names[0], 0.0, 0.0)
    widths = np.asarray(light.bandwidths_nm, dtype=np.float64)[:, None]
    places = (np.arange(STEPS) + 0.5) / STEPS - 0.5  # within a band
    nm = np.asarray(light.wavelengths_nm, dtype=np.float64)[:, None] + widths * places
    detected = np.atleast_2d(camera.qe(nm.ravel()) * nm.ravel()).reshape(-1, *nm.shape) * widths
    flat = detected.mean(axis=-1)  # (F, B), as all of a filter and band
    sloped = np.abs((detected * places).mean(axis=-1))
    extreme = np.abs(detected - flat[..., None]).max(axis=-1)
    spectra = _blocks(light)
    electrons = spectra @ flat.T
    seen = electrons > DIMMEST * electrons.mean(axis=0)
    if not seen.any():
        return BandError(names[0], 0.0, 0.0)
    lines = spectra[:, None] * extreme  # (N, F, B)
    slopes, stand_out = (one[:, None] for one in _departures(spectra))
    usual = np.where(stand_out, lines, np.minimum(slopes * sloped, lines))
    changes = np.stack([usual.sum(axis=-1), lines.sum(axis=-1)])
    relative = np.divide(changes, electrons, out=np.zeros_like(changes), where=seen)
    largest, most = relative.max(axis=1)
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
    """Return sums of the spectra of parts of the picture, (N, B); pixels of infinite light do not count."""
    data = light.data
    if not np.isfinite(data.sum()):
        data = np.where(np.isfinite(data).all(axis=2, keepdims=True), data, np.float32(0))
    for axis, count in enumerate(data.shape[:2]):
        first = np.arange(min(count, BLOCKS)) * count // min(count, BLOCKS)
        data = np.add.reduceat(data, first, axis=axis, dtype=np.float64)
    return np.asarray(data.reshape(-1, data.shape[2]))


def _departures(spectra: Float64Array) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Return |s| of E(x) − Ē = s·x, x = (λ − λ_c)/Δλ, and which bands stand out, (N, B) each."""
    if spectra.shape[1] < 2:
        return spectra, np.ones(spectra.shape, bool)
    ends = ((0, 1), (-1, -2))
    first, last = (np.maximum(2 * spectra[:, [a]] - spectra[:, [b]], 0.0) for a, b in ends)
    whole = np.concatenate([first, spectra, last], axis=1)
    below, above = whole[:, :-2], whole[:, 2:]
    slope = np.maximum(np.abs(above - spectra), np.abs(spectra - below))
    return slope, spectra > STANDS_OUT * (above + below) / 2
