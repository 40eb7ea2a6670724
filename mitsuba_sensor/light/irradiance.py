"""Render passes → spectral irradiance at the focal plane, with its Monte Carlo variance.

A render is at least eight passes with hashed seeds, combined in float64: Mitsuba's film adds up in float32, which
costs 1e-8 per sample, and the spread of the passes is the variance of the result. Large films are rendered in strips
of rows, so that no pass has more than a few million samples in flight.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..engine.checks import check_types
from ..engine.errors import InputError, require_seed
from ..engine.frame import Exposure
from .bands import Bands, choose_bands
from .optics import aperture_f_number, solid_angle_sr
from .passes import Cleaned, Welford, clean, hashed_seed, pass_plan, row_strips
from .photons import photons_per_irradiance
from .scene import SAMPLER, Scene, load_scene
from .variants import Variant, choose_variant, use

if TYPE_CHECKING:
    from ..sensor.camera import Camera

DEFAULT_SPP = 128
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Certificate:
    """How an irradiance came about, and how much of its noise is the renderer's.

    noise_ratio_* : render variance over shot variance of the detected electrons: median, 95th percentile and largest
        of all pixels. Above 1 the picture's noise is more the renderer's than the sensor's.
    negative, non_finite : values of single passes that were set to 0 (+inf is kept: it saturates its pixel).
    notes : what was replaced in the scene, what is black, hints.
    scene_sha256 : of the scene file, its includes and its parameters.
    aperture_f_number : what the scene's own thin-lens aperture means on this sensor, None where it has none. It makes
        the blur; the camera's f-number makes the light.
    """

    passes: int
    samples_per_pixel: int
    seconds: float
    variant: str
    sampler: str
    noise_ratio_median: float
    noise_ratio_p95: float
    noise_ratio_max: float
    negative: int
    non_finite: int
    notes: tuple[str, ...]
    scene_sha256: str
    aperture_f_number: float | None

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return {**asdict(self), "notes": list(self.notes)}


@dataclass(frozen=True, eq=False)
class Irradiance:
    """Spectral irradiance at the focal plane, and how sure it is.

    data : (H, W, B) mean over pixel and band [W m⁻² nm⁻¹]; float32, as in a file.
    wavelengths_nm, bandwidths_nm : (B,) centres and widths of the bands.
    standard_error : (H, W, B) of the Monte Carlo mean, same unit.
    relative_error : (H, W) relative standard error of the detected electrons of the camera that it was rendered for;
        kept beside ``standard_error`` because the bands of a pixel are correlated.
    """

    data: NDArray[np.float32]
    wavelengths_nm: NDArray[np.float64]
    bandwidths_nm: NDArray[np.float64]
    standard_error: NDArray[np.float32]
    relative_error: NDArray[np.float32]
    certificate: Certificate


def render(
    scene: str | os.PathLike[str],
    camera: Camera,
    exposure: Exposure,
    *,
    seed: int = 1,
    spp: int | None = None,
    wavelength_nm: float | None = None,
    bandwidth_nm: float = 10.0,
    parameters: Mapping[str, Any] | None = None,
    variant: str | None = None,
    progress: Progress | None = None,
) -> Irradiance:
    """Render a scene file into the irradiance on this camera's focal plane.

    spp : samples per pixel over all passes, 128 by default; the certificate has the number that the sampler made of it.
    wavelength_nm : one band about this wavelength; by default adjacent bands of ``bandwidth_nm`` over the camera's.
    parameters : values for the ``<default>`` names of the scene.
    variant : a spectral Mitsuba variant; by default the one already set, else the fastest that is safe.
    progress : called with (passes done, passes in all), also once before the first.
    Raises InputError for anything wrong with the arguments or the scene. Ctrl-C is obeyed between passes.
    """
    started = time.monotonic()
    check_types(camera, exposure)
    if not isinstance(scene, str | os.PathLike):
        raise InputError(f"scene is {scene!r}; pass the path of a scene file, e.g. 'scenes/cornell_box.xml'.")
    if not isinstance(parameters or {}, Mapping):
        raise InputError(f"parameters is {parameters!r}; pass a dict of the scene's <default> names and their values.")
    seed = require_seed("seed", seed)
    bands = choose_bands(camera, wavelength_nm, bandwidth_nm, "auto")
    passes, samples = pass_plan(DEFAULT_SPP if spp is None else spp)
    chosen = choose_variant(variant)
    use(chosen)
    loaded = load_scene(scene, bands, parameters or {})
    result = Exposer(loaded, camera, bands)
    result.run(seed, passes, samples, progress or (lambda done, total: None))
    if not result.data.any():
        why = f" ({result.non_finite} values were not finite)" if result.non_finite else ""
        remedy = "give it an emitter that lights what the sensor sees, with a spectrum there"
        raise InputError(
            f"scene {os.fspath(scene)!r} is black from {bands.low_nm:g} to {bands.high_nm:g} nm{why}; {remedy}."
        )
    certificate = Certificate(
        passes=passes,
        samples_per_pixel=passes * samples,
        seconds=time.monotonic() - started,
        variant=chosen.name,
        sampler=SAMPLER,
        **result.noise_ratios(exposure),
        negative=result.negative,
        non_finite=result.non_finite,
        notes=_notes(loaded, chosen, spp, passes * samples),
        scene_sha256=loaded.sha256,
        aperture_f_number=aperture_f_number(loaded.view, camera),
    )
    return Irradiance(
        result.data,
        bands.wavelengths_nm,
        bands.bandwidths_nm,
        result.standard_error,
        result.relative_error,
        certificate,
    )


def _notes(scene: Scene, variant: Variant, wanted: int | None, made: int) -> tuple[str, ...]:
    notes = list(scene.notes)
    if wanted is not None and made != wanted:
        notes.append(f"{wanted} samples per pixel asked for, {made} taken: equal passes, each a full grid")
    return (*notes, variant.hint) if variant.hint else tuple(notes)


class Exposer:
    """The arrays of a result, filled strip by strip."""

    def __init__(self, scene: Scene, camera: Camera, bands: Bands) -> None:
        (columns, rows), (column, row) = scene.view.crop_size, scene.view.crop_offset
        centres, self._widths = bands.wavelengths_nm, bands.bandwidths_nm
        self._scale = bands.transmission / bands.bandwidths_nm
        in_one_second = photons_per_irradiance(camera, Exposure(1.0), centres, self._widths)
        self._electrons_per_irradiance = np.atleast_2d(camera.qe(centres)) * in_one_second  # (filters, bands)
        self._filters = np.asarray(camera.filter_index((rows, columns), (row, column)))
        self._scene, self._solid_angle = scene, solid_angle_sr(scene.view, camera)
        self.data = np.zeros((rows, columns, len(centres)), np.float32)
        self.standard_error = np.zeros_like(self.data)
        self.relative_error = np.zeros((rows, columns), np.float32)
        self._electrons_per_s = np.zeros((rows, columns))
        self.negative = self.non_finite = 0

    def run(self, seed: int, passes: int, samples: int, progress: Progress) -> None:
        """Render all passes of all strips."""
        strips = row_strips(self._scene.view.crop_size, len(self._widths), samples)
        progress(0, passes * len(strips))
        for s, rows in enumerate(strips):
            shape = (rows[1] - rows[0], *self.data.shape[1:])
            bands, electrons, infinite = Welford(shape), Welford(shape[:2]), np.zeros(shape[:2], bool)
            for k in range(passes):
                radiance = clean(self._scene.render(hashed_seed(seed, s, k), samples, rows))
                irradiance = radiance.values
                irradiance *= self._solid_angle[slice(*rows), :, None] * self._scale
                bands.add(irradiance)
                electrons.add(self._detected(irradiance, slice(*rows)))
                infinite |= self._count(radiance)
                progress(s * passes + k + 1, passes * len(strips))
            self._put(slice(*rows), bands, electrons, infinite)

    def noise_ratios(self, exposure: Exposure) -> dict[str, float]:
        """Render variance over shot variance of the electrons that one exposure detects, over all finite pixels."""
        mean = self._electrons_per_s * exposure.time_s
        ratio = self.relative_error[np.isfinite(self.relative_error)].astype(np.float64) ** 2
        ratio = ratio * mean[np.isfinite(self.relative_error)]
        median, p95, most = np.percentile(ratio, (50, 95, 100)).tolist() if ratio.size else (0.0, 0.0, 0.0)
        return {"noise_ratio_median": median, "noise_ratio_p95": p95, "noise_ratio_max": most}

    def _detected(self, irradiance: NDArray[np.float64], rows: slice) -> NDArray[np.float64]:
        """Detected electrons per second, each pixel behind its own colour filter."""
        per_filter = irradiance @ self._electrons_per_irradiance.T
        return np.take_along_axis(per_filter, self._filters[rows, :, None], axis=-1)[..., 0]

    def _count(self, radiance: Cleaned) -> NDArray[np.bool_] | np.bool_:
        """Add up what was clamped; where a pixel has a band of +inf."""
        self.negative += radiance.negative
        self.non_finite += radiance.non_finite
        return np.False_ if radiance.infinite is None else np.asarray(radiance.infinite.any(axis=-1))

    def _put(self, rows: slice, bands: Welford, electrons: Welford, infinite: NDArray[np.bool_]) -> None:
        """Store one strip; a pixel with an infinite band is infinite in all."""
        self.data[rows] = np.where(infinite[..., None], np.inf, bands.mean)
        self.standard_error[rows] = np.where(infinite[..., None], np.inf, bands.standard_error)
        self._electrons_per_s[rows] = electrons.mean
        positive = np.maximum(electrons.mean, np.finfo(float).tiny)
        self.relative_error[rows] = np.where(infinite, np.inf, electrons.standard_error / positive)
