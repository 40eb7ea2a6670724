"""What photons remember of the light that they were collected from, and what it lacks for a frame.

Render noise is compared with the sensor's. The photoelectrons of a camera that the light was not rendered for assume a
flat spectrum within each band; how far it is from flat is estimated from the neighbouring bands, and a band that stands
out from them may be a line, anywhere within the band.
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
    """Light that photons were collected from.

    light : without standard errors of its bands, which are as large as the light itself and which no note needs.
    per_frame : whether each frame has a render of its own, whose noise is a part of the frame's.
    """

    light: Irradiance
    per_frame: bool = False
    _band_errors: dict[str, BandError] = field(default_factory=dict)

    @classmethod
    def of(cls, light: Irradiance, per_frame: bool = False) -> CollectedLight:
        """Remember this light."""
        return cls(
            replace(light, standard_error=np.empty((0, 0, 0), np.float32), raw=None), per_frame
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the light itself."""
        return self.light.notes

    def band_error(self, camera: Camera) -> BandError:
        """The error of the photoelectrons of this camera."""
        key = pixel_fingerprint(camera)
        if key not in self._band_errors:
            self._band_errors[key] = band_error(self.light, camera)
        return self._band_errors[key]

    def notes_for(self, camera: Camera) -> tuple[str, ...]:
        """What light that was rendered for another camera lacks for this one, and whose lens it came through."""
        return (
            *notes_of_bands(self.light, camera, self.band_error(camera)),
            *self._lens_note(camera),
            *self._scene_note(camera),
        )

    def _lens_note(self, camera: Camera) -> Iterator[str]:
        """Where the camera has another lens than the one that the light is behind already."""
        known = self.light.rendered_for
        own = None if known is None else known.camera
        if own is not None and own.lens != camera.lens:
            yield Doubt(
                f"the light is behind the lens of {own.name} (f/{own.lens.f_number:g}) already, and the lens of "
                f"{camera.name} (f/{camera.lens.f_number:g}) is not used; render it for this camera"
            )

    def _scene_note(self, camera: Camera) -> list[str]:
        """Where the scene had set fields of its camera, and another one was named. Its lens is used: the light came
        through it."""
        known = self.light.rendered_for
        own = None if known is None else known.camera
        if own is None:
            return []
        of_scene = [name for name, source in own.sources.items() if source == SET_BY_SCENE]
        names = [name for name in of_scene if not name.startswith("lens.")]
        return unused_note(names, own, camera)

    def render_noise(self, frames: RawFrames) -> tuple[dict[str, float], tuple[str, ...]]:
        """What the render's noise means in these frames, see :func:`render_noise`, and the notes on it."""
        noise = render_noise(self.light, frames)
        return noise, () if self.per_frame else tuple(noise_note(self.light, noise, frames))


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


ALL = 0.995  # of the variance: more would be called 100 %
LITTLE_NOISE = 0.1  # of the sensor's variance: 5 % more noise in the frame


def render_noise(light: Irradiance, frames: RawFrames) -> dict[str, float]:
    """Return the variance of the render over the sensor's own temporal variance, both as electrons at the input.

    It is that of this exposure; the render statistics have the same for the exposure of the render.
    share_of_variance_median : of the noise of a lit pixel in one frame, the render's part.  above_sensor : share of the
    lit pixels in which the render's variance is the larger one.
    """
    electrons, passes = frames.detected.mean_e, light.statistics.passes
    with np.errstate(invalid="ignore"):
        variance_e2 = light.relative_error * electrons
        variance_e2 *= variance_e2
    ratio = input_noise(frames.camera, frames.first.exposure).ratio(electrons, variance_e2)
    del variance_e2
    lit = np.isfinite(electrons) & np.isfinite(ratio) & (electrons > 0)
    known = POOLED if passes >= POOLED_PASSES_MIN else passes
    found = summary_of(np.where(np.isfinite(electrons), ratio, np.inf), electrons > 0, known)
    median = found["noise_ratio_median"]
    return {
        "over_sensor_median": median,
        "over_sensor_p95": found["noise_ratio_p95"],
        "over_sensor_max": found["noise_ratio_max"],
        "share_of_variance_median": median / (1 + median) if np.isfinite(median) else 1.0,
        "above_sensor": float((ratio[lit] > 1).mean()) if lit.any() else 0.0,
    }


def noise_note(
    light: Irradiance, noise: Mapping[str, float], frames: RawFrames
) -> Iterator[str]:
    """Yield how much of a typical pixel's variance is the render's, where it is more than a tenth of the sensor's.

    noise : what :func:`render_noise` returned of them.
    """
    share = noise["share_of_variance_median"]
    if not noise["over_sensor_median"] > LITTLE_NOISE:
        return
    goal, known = f"--noise-ratio {LITTLE_NOISE:g}", light.rendered_for
    if known is not None:  # a noise ratio is that of its own camera and exposure
        shared = known.shared_with(frames.camera, frames.first.exposure, None)
        if new := [name for name in ("camera", "exposure") if name not in shared]:
            goal = f"a render for this {' and '.join(new)} with {goal}"
    said = f"{share:.0%}" if share < ALL else "nearly all"
    samples = light.statistics.samples_per_pixel
    yield Caution(
        f"{said} of the noise variance of a typical pixel is the render's, not the camera's; render with more "
        f"samples than {samples} (--spp), or {goal}"
    )
