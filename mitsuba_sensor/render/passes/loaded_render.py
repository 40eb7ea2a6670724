"""Light of a loaded scene from the sums of its passes: error bars, denoising, statistics and notes."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Caution, Exposure, Float64Array
from ...core.heap import trim_heap
from ...optics.f_number_law import solid_angle_sr
from ...optics.image_record import image_record
from ...optics.intrinsics import aperture_f_number
from ...optics.veiling_glare import glare_sentence, veiling_glare_of
from ...optics.waveform import Waveform
from ...sensor.metering import Metering
from ...theory.input_noise import input_noise
from ..denoise.denoise import PASSES_MIN, PIXELS_MIN, Denoised, denoise, is_noisy
from ..denoise.guides import Guides, detected_quarters, rays_for, trace_guides
from ..denoise.network import is_installed
from ..light.bands import Bands, in_band_factor
from ..light.brightness import with_brightness
from ..light.illuminant import rendered_for
from ..light.irradiance import Irradiance
from ..light.photons import electrons_per_irradiance
from ..light.statistics import (
    POOLED,
    NoiseRatios,
    RenderStatistics,
    pooled,
    relative_errors,
    sum_error,
    summary_of,
    why_not_trusted,
)
from ..lint.spectrum_checks import with_notes_of_shares
from ..load.scene import Scene
from ..motion.moving_scene import MovingScene, pose_m
from ..options import RenderOptions
from ..samples import SAMPLER
from ..scene.light_groups import LightGroup
from ..scene.motion import Motion
from ..scene.parsed_scene import ParsedScene
from ..variants import mitsuba
from .passes import Electrons, Passes
from .stop_criterion import End, StopCriterion

GUIDE_SEED = 1


@dataclass(frozen=True, eq=False)
class LoadedRender:
    """A loaded scene with its camera and bands, and the light of its passes.

    metering : how the exposure is found; None if it was given.  metered : True if it is known. Otherwise it is one
        second, and each light has its own (``exposure_of``).
    light_groups : rendered separately; empty if all light is rendered together.  groups : number of light groups of
        which this is one, which may be black; 0 for all light.
    one_exposure : True if only one exposure is rendered, even if the camera's readouts follow each other.
    group_scenes, waveforms : by name of the group, if something moves; the scenes serve later frames.
    """

    parsed: ParsedScene
    scene: Scene | MovingScene
    camera: Camera
    exposure: Exposure
    bands: Bands
    options: RenderOptions
    motion: Motion = field(default_factory=Motion)
    metering: Metering | None = None
    metered: bool = False
    light_groups: tuple[LightGroup, ...] = ()
    groups: int = 0
    one_exposure: bool = False
    group_scenes: dict[str, Scene] = field(default_factory=dict)
    waveforms: Mapping[str, Waveform] = field(default_factory=dict)

    @property
    def at_rest(self) -> Scene:
        """The scene without its motion."""
        return self.scene if isinstance(self.scene, Scene) else self.scene.scene

    @property
    def begin_s(self) -> float:
        """Start of the frame on the time axis of the motion [s]."""
        return 0.0 if isinstance(self.scene, Scene) else self.scene.begin_s

    @property
    def unit_m(self) -> float:
        """Metres per unit of the scene."""
        return self.parsed.settings.metres(self.options["scene_unit"]) or 1.0

    @cached_property
    def _solid_angle(self) -> Float64Array:
        return solid_angle_sr(self.scene.view, self.camera)

    def noise_ratio(self, exposure: Exposure, light: Electrons) -> Float64Array:
        """Return the render variance over the sensor variance, (H, W).  light : for the exposure of the render."""
        longer = exposure.time_s / self.exposure.time_s if self.exposure.time_s else 1.0
        noise = input_noise(self.camera, exposure)
        return noise.ratio(light[0] * longer, light[1] * longer**2)

    def _noise_ratios(
        self, exposure: Exposure, light: Electrons, passes: Passes, count: int
    ) -> NoiseRatios:
        """Return the noise ratios of the lit pixels.  count : passes that measured the variance; many if pooled."""
        lit = (light[0] > 0) & ~passes.infinite
        return summary_of(self.noise_ratio(exposure, light), lit, count)

    def _with_glare(self, light: Electrons) -> Electrons:
        """Return the photoelectrons after the veiling glare of the lens."""
        glare = veiling_glare_of(self.camera, self.scene.view)
        if glare is None:
            return light
        origin = self.scene.view.crop_offset[::-1]
        return glare.of_electrons(*light, self.camera.filter_index(light[0].shape, origin))

    def _is_to_be_denoised(self, passes: Passes, before: NoiseRatios) -> bool:
        """Return True if denoising was requested, or was not ruled out and the render ends above the sensor's noise.

        Few passes or pixels, and noise that no camera sees, are never denoised.
        """
        asked = self.options["denoise"]
        if asked is None:
            asked = before["noise_ratio_p95"] * max(self.groups, 1) > 1 and is_installed()
        periods = self.camera.sensor.polarizer_periods
        enough = passes.infinite.size >= PIXELS_MIN * np.prod(periods)
        return bool(
            asked and enough and passes.count >= PASSES_MIN and is_noisy(*passes.electrons())
        )

    def _denoised(self, passes: Passes) -> Denoised:
        """Return the denoised photoelectrons of each filter, guided by traced rays except in scalar variants."""
        height, guides = self.scene.view.crop_size[1], None
        if not mitsuba().variant().startswith("scalar"):
            weights = electrons_per_irradiance(self.camera, self.exposure, self.bands)
            sums = passes.bands if self.bands.first_filter else passes.filters
            spectrum = (
                sums.mean.mean(axis=(0, 1), dtype=np.float64)
                * self.bands.scale[: len(self.bands)]
            )
            typical_nm = detected_quarters(weights, spectrum, self.bands.wavelengths_nm)
            rays = rays_for(passes.count * passes.samples)

            def make(seed: int, rows: tuple[int, int]) -> NDArray[np.float32]:
                return trace_guides(self.at_rest, typical_nm, seed, rays, rows)

            if isinstance(self.scene, Scene):
                values = make(GUIDE_SEED, (0, height))
            else:
                values = self.scene.averaged(make, GUIDE_SEED, (0, height))
            guides = Guides(values[..., :-3], values[..., -3:])
        trim_heap()
        variance = passes.filters.variance(passes.count) * passes.factor**2
        share = ((passes.count + 1) // 2) / passes.count
        periods = self.camera.sensor.polarizer_periods
        return denoise(passes.halves(), variance, share, guides, periods)

    def _light(
        self,
        passes: Passes,
        raw: Electrons,
        denoised: Denoised | None,
        statistics: RenderStatistics,
        keep: bool = False,
    ) -> Irradiance:
        """Return the irradiance of the passes.  keep : True if their sums are needed afterwards."""
        before, infinite = passes.electrons(), passes.infinite
        weights = electrons_per_irradiance(self.camera, self.exposure, self.bands)
        light: Electrons = before[0], np.asarray(pooled(before[0], before[1], passes.count))
        of_filters = None if denoised is None else passes.filters.mean * passes.factor
        data, error = raw_bands(passes, self.bands, self._solid_angle, keep)
        if denoised is not None and of_filters is not None:
            error_before = relative_errors(*light, infinite)
            light = _own_electrons(passes, denoised)
            gain = np.divide(
                light[0], before[0], out=np.zeros_like(before[0]), where=before[0] > 0
            )
            relative = gain, error_before, relative_errors(*light, infinite)
            agree_with_filters(data, error, weights, of_filters, denoised, relative)
        glare = veiling_glare_of(self.camera, self.scene.view)
        if glare is not None:
            light = self._with_glare(light)
            if denoised is None:
                light = light[0], np.asarray(pooled(raw[0], raw[1], passes.count), np.float64)
            glare.add_to_bands(data, error)
        data[infinite] = error[infinite] = np.inf
        names = self.camera.filter_names if self.bands.kind == "channels" else None
        return Irradiance(
            data,
            self.bands.wavelengths_nm,
            self.bands.bandwidths_nm,
            error,
            relative_errors(*light, infinite),
            statistics,
            filters=names,
            response=self.bands.response,
            polarizers=self.at_rest.polarizers,
            origin=self.scene.view.crop_offset[::-1],
            in_band=in_band_of(passes, light[0], data, weights) if self.bands.filters else None,
            pass_error=relative_errors(light[0], raw[1], infinite),
        )

    def _described(
        self,
        light: Irradiance,
        passes: Passes,
        exposure: Exposure,
        raw: Electrons,
        denoised: Denoised | None,
        began: float,
    ) -> Irradiance:
        """Return the light with its origin, its noise in this exposure, brightness and notes."""
        ratios, record = self._noise_ratios(exposure, raw, passes, passes.count), None
        if denoised is not None:
            record = {
                **denoised.record,
                "guided": self.parsed.variant.backend != "scalar",
                "raw_noise_ratio_median": ratios["noise_ratio_median"],
                "raw_noise_ratio_p95": ratios["noise_ratio_p95"],
            }
            smooth = self._with_glare(_own_electrons(passes, denoised))
            ratios = self._noise_ratios(exposure, smooth, passes, POOLED)
        statistics = replace(
            light.statistics,
            seconds=time.monotonic() - began,
            denoised=record,
            metering=None if self.metering is None else self.metering.record(exposure),
            **ratios,
        )
        origin = rendered_for(self.at_rest, self.camera, exposure, self.parsed.serial(None))
        light = replace(light, statistics=statistics, rendered_for=origin)
        if self.groups:  # notes on their sum follow
            return light
        light = with_notes_of_shares(light, self.camera, self.at_rest.findings)
        return with_brightness(light, self)

    def _statistics(
        self, passes: Passes, stop: StopCriterion, end: End, ratios: NoiseRatios, raw: Electrons
    ) -> RenderStatistics:
        """Return the statistics of a render before it is denoised and metered."""
        samples, fireflies = passes.count * passes.samples, passes.firefly_fraction()
        doubt = why_not_trusted(passes.count, fireflies, passes.lost)
        notes = [*self.scene.notes]
        if self.parsed.settings.is_default_camera:
            notes.append(
                f"rendered for {self.camera.name}, because neither you nor the scene named a camera (camera=)"
            )
        notes += self.parsed.settings.unused_note(self.camera)
        if self.camera.lens.veiling_glare > 0:
            notes.append(glare_sentence(self.camera))
        if (
            self.options["denoise"] is None
            and ratios["noise_ratio_p95"] > 1
            and not is_installed()
        ):
            notes.append(
                "not denoised: Open Image Denoise is not installed; pip install pyoidn"
            )
        notes += stop.notes(end, samples)
        notes += [Caution(doubt)] if doubt else []
        notes += [self.parsed.variant.hint] if self.parsed.variant.hint else []
        view = self.scene.view
        pose = pose_m(self.at_rest, self.motion, self.unit_m, self.begin_s)
        return RenderStatistics(
            passes=passes.count,
            samples_per_pixel=samples,
            seconds=0.0,
            variant=self.parsed.variant.name,
            sampler=SAMPLER,
            spectral=self.bands.kind,
            **ratios,
            noise_ratio_asked=stop.goal if stop.reached == "noise_ratio" else None,
            ended_by=end,
            reliable=not doubt,
            firefly_fraction=fireflies,
            negative=passes.negative,
            non_finite=passes.non_finite,
            notes=tuple(notes),
            facts=tuple(
                str(finding) for finding in self.at_rest.findings if finding.level == "fact"
            ),
            scene_sha256=self.scene.sha256,
            aperture_f_number=aperture_f_number(view, self.camera),
            intrinsics=image_record(view, self.camera),
            camera_to_world=pose.tolist(),
            sum_error=sum_error(*raw),
            motion=self.scene.time_sampling(),
        )


BANDS_AT_ONCE = 4
VALUES_AT_ONCE = 2**18  # pixels × bands: 2 MiB for each intermediate array
SLOPE_MIN = 1e-6  # of the trace: filters that are nearly equal cannot be distinguished

Float32Bands = NDArray[np.float32]


def _own_electrons(passes: Passes, denoised: Denoised) -> Electrons:
    """Return the denoised photoelectrons and their variance for each pixel's own filter, shape (H, W) each."""
    mean, variance = (passes.of_own_filter(x) for x in (denoised.mean, denoised.variance))
    return mean, variance


def raw_bands(
    passes: Passes, bands: Bands, solid_angle_sr: Float64Array, keep: bool
) -> tuple[Float32Bands, Float32Bands]:
    """Return the undenoised irradiance of each band and its standard errors, shape (H, W, B) each.

    keep : True if the sums of the passes are needed afterwards. Otherwise they are overwritten, to save memory.
    """
    sums = passes.bands if bands.first_filter else passes.filters
    data, error = (sums.mean.copy(), sums.squares.copy()) if keep else (sums.mean, sums.squares)
    of_mean = max(passes.count * (passes.count - 1), 1)
    for first in range(0, len(bands), BANDS_AT_ONCE):
        block = slice(first, min(first + BANDS_AT_ONCE, len(bands)))
        scale = solid_angle_sr[..., None] * (passes.unit * bands.scale[block])
        scale = scale.astype(np.float32)
        mean, squares = np.maximum(data[..., block], 0), error[..., block]
        variance = pooled(mean, squares / np.float32(of_mean), passes.count)
        data[..., block], error[..., block] = mean * scale, np.sqrt(variance) * scale
    return data, error


def agree_with_filters(
    data: Float32Bands,
    error: Float32Bands,
    weights: Float64Array,
    raw: NDArray[np.floating],
    denoised: Denoised,
    relative: tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]],
) -> None:
    """Scale bands and standard errors, shape (H, W, B), in place: each filter detects the denoised photoelectrons.

    weights : (F, B) photoelectrons for 1 W m⁻² nm⁻¹ in each band.  raw : (H, W, F) photoelectrons of the passes.
    relative : (H, W) denoised over raw photoelectrons, and the relative standard errors of raw and denoised ones. The
    error of a band beyond the error of the raw photoelectrons is its own, and denoising does not remove it.
    """
    spectrum = data.mean(axis=(0, 1), dtype=np.float64)
    step = max(VALUES_AT_ONCE // max(data[0].size, 1), 1)
    for first in range(0, len(data), step):
        rows = slice(first, first + step)
        before = data[rows].astype(np.float64)
        flat = in_band_factor(before @ weights.T, raw[rows])
        after = bands_of_filters(before, weights, denoised.mean[rows] * flat, spectrum)
        gain, of_raw, of_denoised = (
            np.nan_to_num(x[rows, :, None], posinf=0.0) for x in relative
        )
        own = np.maximum(error[rows].astype(np.float64) ** 2 - (of_raw * before) ** 2, 0.0)
        data[rows], error[rows] = after, np.sqrt(gain**2 * own + (of_denoised * after) ** 2)


def bands_of_filters(
    bands: Float64Array,
    weights: Float64Array,
    electrons: NDArray[np.floating],
    spectrum: Float64Array,
) -> Float64Array:
    """Return the bands, shape (H, W, B), scaled smoothly over wavelength so that each filter detects ``electrons``
    (H, W, F).

    All bands are scaled by the ratio of the sums of electrons. A band's second factor, 1 + Σ λ_g s_g with the response
    s_g of filter g and a peak of 1, corrects the single filters; it is never negative.
    spectrum : (B,) of pixels without light.
    """
    before = (bands @ weights.T).sum(axis=-1)
    dark = ~(before > 0)
    if dark.any():
        bands = np.where(dark[..., None], spectrum, bands)
        before = (bands @ weights.T).sum(axis=-1)
    bands = (
        bands * (electrons.sum(axis=-1) / np.maximum(before, np.finfo(float).tiny))[..., None]
    )
    if len(weights) == 1:
        return np.asarray(bands)
    shape = weights / np.maximum(weights.max(axis=1, keepdims=True), np.finfo(float).tiny)
    slope = np.einsum("fb,gb,hwb->hwfg", weights, shape, bands)
    least = SLOPE_MIN * np.trace(slope, axis1=-2, axis2=-1) + np.finfo(float).tiny
    slope += least[..., None, None] * np.eye(len(weights))
    factors = np.linalg.solve(slope, (electrons - bands @ weights.T)[..., None])[..., 0]
    return np.asarray(bands * np.maximum(1 + factors @ shape, 0.0))


def in_band_of(
    passes: Passes, electrons: Float64Array, data: Float32Bands, weights: Float64Array
) -> NDArray[np.float32]:
    """Return the photoelectrons over those of spectra that are flat within each band, shape (H, W)."""
    factor = np.empty(electrons.shape, np.float32)
    step = max(VALUES_AT_ONCE // max(data[0].size, 1), 1)
    for first in range(0, len(data), step):
        rows = slice(first, first + step)
        flat = passes.of_own_filter(data[rows] @ weights.T, first)
        factor[rows] = in_band_factor(electrons[rows], flat)
    return factor
