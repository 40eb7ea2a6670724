"""The light from which photons were collected, and its shortcomings for a frame.

Render noise is compared with sensor noise. For a camera other than that of the render, the spectrum within each band is
assumed to be flat; its departure from flat is estimated from the neighbouring bands, and a band that stands out may be
a line anywhere within the band.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import SET_BY_SCENE, Camera
from ...camera.fingerprint import pixel_fingerprint, unused_note
from ...core import Caution, Doubt, Float64Array
from ...core.band_average import band_integrals
from ...sensor.frames import RawFrames
from ...theory.input_noise import input_noise
from .irradiance import Irradiance, is_exact
from .statistics import POOLED, POOLED_PASSES_MIN, summary_of


@dataclass(frozen=True, eq=False)
class CollectedLight:
    """Light from which photons were collected.

    light : without standard errors of its bands, which need as much memory as the light and which no note uses.
    per_frame : True if each frame has a separate render, whose noise is part of the frame's noise.
    """

    light: Irradiance
    per_frame: bool = False
    _band_errors: dict[str, BandError] = field(default_factory=dict)

    @classmethod
    def of(cls, light: Irradiance, per_frame: bool = False) -> CollectedLight:
        """Return the record of a light."""
        no_errors = np.empty((0, 0, 0), np.float32)
        return cls(replace(light, standard_error=no_errors, raw=None), per_frame)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the light."""
        return self.light.notes

    def band_error(self, camera: Camera) -> BandError:
        """Return the error of the photoelectrons of this camera."""
        key = pixel_fingerprint(camera)
        if key not in self._band_errors:
            self._band_errors[key] = band_error(self.light, camera)
        return self._band_errors[key]

    def notes_for(self, camera: Camera) -> tuple[str, ...]:
        """Return notes on the bands, the lens and the ignored camera fields of light rendered for another camera."""
        notes = [*notes_of_bands(self.light, camera, self.band_error(camera))]
        known = self.light.rendered_for
        if known is None or known.camera is None:
            return tuple(notes)
        before = known.camera
        if before.lens != camera.lens:
            notes.append(
                Doubt(
                    f"the light has passed the lens of {before.name} (f/{before.lens.f_number:g}), so the lens of "
                    f"{camera.name} (f/{camera.lens.f_number:g}) is not used; render it for this camera"
                )
            )
        # The lens fields of the scene are used: the light came through them.
        of_scene = [name for name, source in before.sources.items() if source == SET_BY_SCENE]
        names = [name for name in of_scene if not name.startswith("lens.")]
        return (*notes, *unused_note(names, before, camera))

    def render_noise(self, frames: RawFrames) -> tuple[dict[str, float], tuple[str, ...]]:
        """Return the render noise in these frames, see :func:`render_noise`, and notes on it."""
        noise = render_noise(self.light, frames)
        return noise, () if self.per_frame else tuple(noise_note(self.light, noise, frames))


NOTE_ERROR = 1e-3  # of the electrons of a filter, above which a note is written
DOUBT_ERROR = 0.01  # of the electrons of a filter, above which Python warns
BLOCKS = 8  # along each side of the image; their means have little render noise
DARK_FRACTION = 0.01  # of a filter's mean electrons; darker blocks are ignored
LINE_FACTOR = 1.5  # times the mean of its neighbours; bands beside a line on their edge have 2
WIDTHS_NM = (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5)
STEPS = 64  # of a band, over which the responses are averaged


class BandError(NamedTuple):
    """Relative errors of the photoelectrons of a filter, in the part of the image where they are largest.

    worst_filter : the filter with the largest error.
    error_estimate : error if spectra within bands follow their neighbours and bands that stand out are lines, without
        cancellation between bands.
    largest_error : error if all light of each band is at its worst wavelength, the largest possible error.
    """

    worst_filter: str
    error_estimate: float
    largest_error: float


def band_error(light: Irradiance, camera: Camera) -> BandError:
    """Return the error of ``collect(light, camera, …)``; 0 if the camera's own filters were rendered."""
    names = camera.filter_names
    if is_exact(light, camera):
        return BandError(names[0], 0.0, 0.0)
    widths = np.asarray(light.bandwidths_nm, dtype=np.float64)[:, None]
    places = (np.arange(STEPS) + 0.5) / STEPS - 0.5  # within a band
    nm = np.asarray(light.wavelengths_nm, dtype=np.float64)[:, None] + widths * places
    detected = np.atleast_2d(camera.qe(nm.ravel()) * nm.ravel()).reshape(-1, *nm.shape) * widths
    flat = detected.mean(axis=-1)  # (F, B)
    sloped = np.abs((detected * places).mean(axis=-1))
    extreme = np.abs(detected - flat[..., None]).max(axis=-1)
    spectra = _blocks(light)
    electrons = spectra @ flat.T
    seen = electrons > DARK_FRACTION * electrons.mean(axis=0)
    if not seen.any():
        return BandError(names[0], 0.0, 0.0)
    lines = spectra[:, None] * extreme  # (N, F, B)
    slopes, stand_out = (x[:, None] for x in _departures(spectra))
    likely = np.where(stand_out, lines, np.minimum(slopes * sloped, lines))
    changes = np.stack([likely.sum(axis=-1), lines.sum(axis=-1)])
    relative = np.divide(changes, electrons, out=np.zeros_like(changes), where=seen)
    largest, most = relative.max(axis=1)
    worst = int(np.argmax(largest))
    return BandError(names[worst], float(largest[worst]), float(most.max()))


def notes_of_bands(light: Irradiance, camera: Camera, error: BandError) -> Iterator[str]:
    """Yield the errors of light that was rendered for another camera, or by another program."""
    exact = is_exact(light, camera)
    if not exact:
        yield from band_note(light, error)
    if not exact or light.rendered_for is None:
        yield from unseen_note(light, camera)


def band_note(light: Irradiance, error: BandError) -> Iterator[str]:
    """Yield the error that another camera's bands cause, and a sufficient bandwidth; nothing for a small error."""
    if error.error_estimate <= NOTE_ERROR:
        return
    width_nm = float(np.max(light.bandwidths_nm))
    # The error is proportional to the square of the width.
    narrow = width_nm * (NOTE_ERROR / error.error_estimate) ** 0.5
    enough = next((nm for nm in WIDTHS_NM if nm <= narrow), None)
    why, remedy = "this light was not rendered for this camera", "render it for this camera"
    narrower = f", or with bandwidth_nm={enough:g}"
    if light.rendered_for is None:
        why = "the spectrum within the bands of this light is unknown"
        remedy, narrower = "give narrower bands", f", e.g. of {enough:g} nm"
    note = (
        f"{why}: in bands of {width_nm:g} nm the {error.worst_filter} electrons are off by about "
        f"{100 * error.error_estimate:.1f} %, by at most {100 * error.largest_error:.0f} %; "
        f"{remedy}{narrower if enough is not None else ''}"
    )
    yield Doubt(note) if error.error_estimate > DOUBT_ERROR else note


def unseen_note(light: Irradiance, camera: Camera) -> Iterator[str]:
    """Yield the fraction that the camera detects outside the rendered bands; nothing for a small fraction."""
    if len(light.wavelengths_nm) == 1:  # as requested
        return
    low, high = (light.wavelengths_nm + side * light.bandwidths_nm for side in (-0.5, 0.5))
    first = np.array([min(low.min(), camera.band_nm[0])])
    last = np.array([max(high.max(), camera.band_nm[1])])
    points = np.array(camera.quantum_efficiency.wavelengths_nm)
    inside, total = (
        band_integrals(lambda nm: camera.qe(nm) * nm, points, *edges).sum(axis=1)
        for edges in ((low, high), (first, last))
    )
    unseen = 1 - np.divide(inside, total, out=np.ones_like(inside), where=total > 0)
    if unseen.max() <= NOTE_ERROR:
        return
    name, share = camera.filter_names[int(np.argmax(unseen))], float(unseen.max())
    beyond = f"beyond {low.min():g} to {high.max():g} nm"
    detects = (
        f"where the {name} pixels of this camera detect {100 * share:.1f} % of a flat spectrum"
    )
    if light.rendered_for is None:
        note = f"this light has nothing {beyond}, {detects}"
    else:
        note = f"nothing was rendered {beyond}, {detects}; render it for this camera"
    yield Doubt(note) if share > DOUBT_ERROR else note


def _blocks(light: Irradiance) -> Float64Array:
    """Return sums of the spectra of blocks of the image, shape (N, B), without pixels of infinite light."""
    data = light.data
    if not np.isfinite(data.sum()):
        data = np.where(np.isfinite(data).all(axis=2, keepdims=True), data, np.float32(0))
    for axis, count in enumerate(data.shape[:2]):
        first = np.arange(min(count, BLOCKS)) * count // min(count, BLOCKS)
        data = np.add.reduceat(data, first, axis=axis, dtype=np.float64)
    return np.asarray(data.reshape(-1, data.shape[2]))


def _departures(spectra: Float64Array) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Return |s| of E(x) − Ē = s·x with x = (λ − λ_c)/Δλ, and True for bands that stand out, shape (N, B) each."""
    if spectra.shape[1] < 2:
        return spectra, np.ones(spectra.shape, bool)
    ends = ((0, 1), (-1, -2))
    first, last = (np.maximum(2 * spectra[:, [a]] - spectra[:, [b]], 0.0) for a, b in ends)
    whole = np.concatenate([first, spectra, last], axis=1)
    below, above = whole[:, :-2], whole[:, 2:]
    slope = np.maximum(np.abs(above - spectra), np.abs(spectra - below))
    return slope, spectra > LINE_FACTOR * (above + below) / 2


SHARE_ALL = 0.995  # of the variance; larger fractions would be printed as 100 %
RENDER_NOISE_MAX = 0.1  # of the sensor's variance: 5 % more noise in the frame


def render_noise(light: Irradiance, frames: RawFrames) -> dict[str, float]:
    """Return the render variance over the temporal variance of the sensor, both as electrons at the input, for the
    exposure of these frames.

    share_of_variance_median : fraction of the noise variance of a typical lit pixel in one frame.
    above_sensor : fraction of the lit pixels with more render noise than sensor noise.
    """
    electrons, passes = frames.detected.mean_e, light.statistics.passes
    with np.errstate(invalid="ignore"):
        variance_e2 = light.relative_error * electrons
        variance_e2 *= variance_e2
    ratio = input_noise(frames.camera, frames.first.exposure).ratio(electrons, variance_e2)
    del variance_e2
    lit = np.isfinite(electrons) & np.isfinite(ratio) & (electrons > 0)
    known = POOLED if passes >= POOLED_PASSES_MIN else passes
    summary = summary_of(np.where(np.isfinite(electrons), ratio, np.inf), electrons > 0, known)
    median = summary["noise_ratio_median"]
    return {
        "over_sensor_median": median,
        "over_sensor_p95": summary["noise_ratio_p95"],
        "over_sensor_max": summary["noise_ratio_max"],
        "share_of_variance_median": median / (1 + median) if np.isfinite(median) else 1.0,
        "above_sensor": float((ratio[lit] > 1).mean()) if lit.any() else 0.0,
    }


def noise_note(
    light: Irradiance, noise: Mapping[str, float], frames: RawFrames
) -> Iterator[str]:
    """Yield a note if render noise exceeds a tenth of the sensor's variance.  noise : from :func:`render_noise`."""
    share = noise["share_of_variance_median"]
    if not noise["over_sensor_median"] > RENDER_NOISE_MAX:
        return
    again, known = "render again", light.rendered_for
    if known is not None:  # a noise ratio belongs to its camera and exposure
        shared = known.shared_with(frames.camera, frames.first.exposure, None)
        if new := [name for name in ("camera", "exposure") if name not in shared]:
            again += f" for this {' and '.join(new)}"
    fraction = f"{100 * share:.0f} %" if share < SHARE_ALL else "nearly all"
    samples = light.statistics.samples_per_pixel
    yield Caution(
        f"{fraction} of the noise variance of a typical pixel is the render's, not the camera's; "
        f"{again} with more samples (spp= above {samples}, or noise_ratio={RENDER_NOISE_MAX:g})"
    )
