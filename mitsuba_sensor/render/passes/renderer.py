"""Renders a loaded scene in passes, until a stop criterion is met, into mean and variance per pixel and band.

Every pass has a hashed seed. Passes are combined in float64, because Mitsuba's film accumulates in float32, which loses
1e-8 per sample; their spread gives the variance of the result. Large films are cut into strips of rows, so that no pass
has more than a few million samples in memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Exposure, Float64Array
from ...core.heap import trim_heap
from ...optics.f_number_law import solid_angle_sr
from ...optics.veiling_glare import veiling_glare_of
from ...theory.input_noise import InputNoise, input_noise
from ..denoise.denoise import (
    LEAST_PASSES,
    Denoised,
    Halves,
    is_noisy,
)
from ..denoise.filter_bands import VALUES_AT_ONCE, bands_of
from ..denoise.guides import Guides, detected_quarters, most_rays, noise_share, traced
from ..denoise.mosaic import denoise_each, least_pixels, tile_of
from ..light.bands import Bands
from ..light.film_channels import electrons_of_film, radiance_of
from ..light.own_filter import in_band_factor, of_own_filter
from ..light.photons import electrons_per_irradiance
from ..motion.moving_scene import MovingScene
from ..scene.scene import Scene
from ..scene.weight_noise import without_weight_noise
from ..variants import mitsuba
from .denoise_choice import DenoiseChoice
from .estimate import Estimate
from .noise_goals import MedianNoiseRatio, SensorNoise
from .passes import clean, hashed_seed, row_strips
from .pooled import pooled, relative_errors
from .row_strip import BandSums, Kept, RowStrip, mean_spectrum
from .statistics import firefly_fraction
from .stop_criterion import End, Progress, ProgressMeter, StopCriterion

Map = Float64Array
Criterion = Callable[[Map, Map, int], float]
Electrons = tuple[Map, Map]  # mean, and expected squared error of the mean


class Renderer:
    """Renders one scene for one camera, exposure and set of bands.

    passes, samples, groups : of the last render; samples per pixel, pass and group of bands.
    seconds_per_sample : of one sample in every pixel, without the first pass, which compiles.
    negative, non_finite : its values that were set to 0.  lost : those of them that were NaN or −∞.
    guide_rays : per pixel, of the guides that were traced last.
    denoised : what :meth:`denoise` made of the last render, else None.
    choice : whether to denoise, of a forecast; None where it is decided.
    beside_e : mean photoelectrons of the other light groups in the same pixels, (H, W) or (1, 1): they make shot noise.
    """

    def __init__(
        self,
        scene: Scene | MovingScene,
        camera: Camera,
        exposure: Exposure,
        bands: Bands,
        keep: Kept = Kept.SPREAD,
    ) -> None:
        (columns, rows), self._tile = scene.view.crop_size, tile_of(camera)
        self.scene, self.bands = scene, bands
        self._weights = electrons_per_irradiance(camera, exposure, bands)
        self._periods = camera.sensor.polarizer_periods
        can_be_denoised = columns * rows >= least_pixels(self._periods) and self._weights.any()
        self._keep = keep if can_be_denoised else Kept.SPREAD
        self.can_denoise = Kept.HALVES in self._keep
        self._film_weights = electrons_of_film(camera, exposure, bands)
        self._solid_angle, self._scale = solid_angle_sr(scene.view, camera), bands.scale
        self._camera, self._exposure, self.seconds_per_sample = camera, exposure, 0.0
        self._glare = veiling_glare_of(camera, scene.view)
        self.negative = self.non_finite = self.lost = self.passes = self.samples = 0
        self.beside_e: Map = np.zeros((1, 1))
        self.guide_rays = 0
        self.strips: list[RowStrip] = []
        self._fireflies: float | None = None
        self.choice: DenoiseChoice | None = None
        self.denoised: Denoised | None = None
        self._filtered: Denoised | None = None  # of the passes so far, if that was done already

    def run(
        self,
        seed: int,
        budget: StopCriterion,
        progress: Progress,
        criterion: Criterion | SensorNoise | None = None,
    ) -> End:
        """Render until ``budget`` is used up or its goal is met; returns which. criterion : function of
        :meth:`noise_estimate` that the goal is for, by default the median noise ratio; or what ends the render, too."""
        measure: Criterion = MedianNoiseRatio(
            self, denoised=self.can_denoise and budget.goal is not None
        )
        noise, meter = None, ProgressMeter(progress)
        if isinstance(criterion, SensorNoise):
            noise = criterion
        elif criterion is not None:
            measure = criterion
        self._guides: Guides | None = None
        self.groups = self.bands.groups if budget.grouped else (slice(0, len(self.bands)),)
        self._begin(budget.samples, meter)
        meter.passed(budget.most, 0, np.nan)
        while True:
            most = self.scene.most_together(self.samples) if len(self.strips) == 1 else 1
            self._passes(seed, meter, budget.together(most))
            value = measure(*self.noise_estimate())
            meter.passed(budget.most, self.passes, value)
            self.seconds_per_sample = meter.later_pass_s / (self.samples * len(self.groups))
            with meter.not_counted():
                reached = noise is not None and noise.is_reached(meter.report_denoising)
            if noise is not None:
                budget = replace(budget, passes=noise.most_passes(budget.passes))
            if reached:
                meter.passed(self.passes, self.passes, value)
                return "sensor_noise"
            if budget.sized:
                if end := budget.finished(self.passes, value, *meter.times(self.passes)):
                    return end
                continue
            budget = budget.sized_by(value, meter.times(1)[0])
            if (
                budget.samples != self.samples
            ):  # passes of different sizes cannot be combined: start again
                self._begin(budget.samples, meter)

    def _begin(self, samples: int, meter: ProgressMeter) -> None:
        """Empty strips for passes of so many samples per pixel."""
        (columns, height), count = self.scene.view.crop_size, len(self.bands)
        rows = row_strips((columns, height), count, samples)
        filters = len(self._weights) if self.can_denoise else 1
        self._sums = BandSums((height, columns, count), self._keep)
        self.strips = [RowStrip(slice(*edges), self._sums, filters) for edges in rows]
        self.samples, self.passes, self.negative, self.non_finite, self.lost = (
            samples,
            0,
            0,
            0,
            0,
        )
        self.denoised = self._filtered = self._fireflies = None
        meter.begin(len(rows))

    def _passes(self, seed: int, meter: ProgressMeter, count: int) -> None:
        """So many passes of all strips, several only of a single strip."""
        self._filtered = None
        if isinstance(self.scene, MovingScene):
            self.scene.begin_pass(seed, self.passes)
        for s, strip in enumerate(self.strips):
            if s:
                meter.report(self.passes * len(self.strips) + s)
            wanted = hashed_seed(seed, s, self.passes), self.samples, strip.ends, count
            radiance = radiance_of(self.scene, self.bands, self.groups, *wanted)
            strip.begin(count)
            step = max(VALUES_AT_ONCE // radiance[0].size, 1)
            for first in range(0, len(radiance), step):
                some = radiance[first : first + step]
                by_pass = some.reshape(len(some), -1, count, some.shape[-1]).transpose(
                    2, 0, 1, 3
                )
                self._add(strip, first, by_pass)
        self.passes += count

    def _add(self, strip: RowStrip, first: int, radiance: NDArray[np.float32]) -> None:
        """Some rows of passes, (passes, rows, W, channels).  first : the first one's number in the strip."""
        channels = len(self.bands) + self.bands.filters
        found, start = clean(radiance[..., :channels]), strip.rows.start + first
        rows = slice(start, start + radiance.shape[1])
        self.negative += found.negative
        self.non_finite += found.non_finite
        if found.infinite is not None:
            self.lost += found.non_finite - int(found.infinite.sum())
            strip.infinite[first : first + radiance.shape[1]] |= found.infinite.any(
                axis=(0, -1)
            )
        irradiance = found.values
        if radiance.shape[-1] > channels:
            of_filters = irradiance[..., self.bands.first_filter :]
            without_weight_noise(of_filters, radiance[..., channels:])
        irradiance *= self._solid_angle[rows, :, None] * self._scale
        per_filter = irradiance @ self._film_weights.T
        own = np.stack([self._own(one, rows) for one in per_filter])
        strip.add(
            first,
            irradiance[..., : len(self.bands)],
            per_filter if self.can_denoise else own[..., None],
            own,
        )

    @cached_property
    def noise(self) -> InputNoise:
        """The camera's own, in this exposure."""
        return input_noise(self._camera, self._exposure)

    @property
    def samples_per_pixel(self) -> int:
        """Light paths per pixel of the last render, of all passes and groups."""
        return self.passes * self.samples * len(self.groups)

    def _own(self, per_filter: NDArray[np.floating], rows: slice = slice(None)) -> Float64Array:
        """(H, W, F) as each pixel's own filter has it, (H, W)."""
        column, row = self.scene.view.crop_offset
        return of_own_filter(per_filter, self._tile, (row + (rows.start or 0), column))

    def electrons(self) -> Electrons:
        """Mean photoelectrons of one exposure, and the expected squared error of that mean, (H, W) each: denoised where
        that was done, else the mean of the passes and its variance; behind the veiling glare."""
        return self._behind_glare(self._electrons_before_glare())

    def _electrons_before_glare(self) -> Electrons:
        if self.denoised is None:
            return self._raw_electrons()
        return self._own(self.denoised.mean), self._own(self.denoised.variance)

    def _behind_glare(self, electrons: Electrons) -> Electrons:
        """What a lens with veiling glare makes of the electrons of all pixels."""
        if self._glare is None:
            return electrons
        origin = self.scene.view.crop_offset[::-1]
        filters = self._camera.filter_index(electrons[0].shape, origin)
        return self._glare.of_electrons(*electrons, filters)

    def pass_error(self, raw: Electrons, denoised: bool) -> NDArray[np.float32]:
        """(H, W) standard error of the photoelectrons by the spread of the passes, over the light.  raw : electrons
        before denoising.  denoised : whether the light is."""
        mean = self.electrons()[0] if denoised else raw[0]
        return relative_errors(mean, raw[1], self.infinite())

    def _raw_electrons(self) -> Electrons:
        """Mean of the passes and its variance behind each pixel's own filter, (H, W) each."""
        parts = [(strip.electrons, strip.rows) for strip in self.strips]
        variance = np.concatenate([self._own(e.variance_of_mean, rows) for e, rows in parts])
        mean = np.concatenate([self._own(e.mean, rows) for e, rows in parts])
        return np.maximum(mean, 0.0, out=mean), variance  # of a control variate

    def denoise(self, last: bool = False) -> None:
        """Denoise what was rendered so far; from now on :meth:`electrons` and :meth:`result` are the denoised light.
        Of few passes or pixels, where nothing is detected and where no camera would see the noise, they stay as they
        are.  last : no pass follows, and what only passes need is forgotten, to save memory."""
        if self._filtered is None:
            self._filtered = self._denoise_passes(last)
        self.denoised = self._filtered
        if last and self.denoised is not None:
            self._filtered = None
            self._fireflies, self._guides = self.firefly_fraction(), None
            for strip in self.strips:
                strip.finish()

    def denoised_electrons(self) -> Electrons | None:
        """What :meth:`electrons` would be if no pass followed, or None where nothing is denoised."""
        self.denoise()
        light = None if self.denoised is None else self.electrons()
        self.denoised = None
        return light

    def _denoise_passes(self, last: bool) -> Denoised | None:
        if (
            self.passes < LEAST_PASSES
            or not self.can_denoise
            or not is_noisy(*self._raw_electrons())
        ):
            return None
        share = ((self.passes + 1) // 2) / self.passes
        even, odd = (partial(self._half, share, odd) for odd in (False, True))
        with self._sums.on_disk():
            if not mitsuba().variant().startswith("scalar"):
                guides = self._traced_guides(
                    slice(0, self.scene.view.crop_size[1]), self._guides
                )
                self._guides = guides.without_noise() if last else guides
                del guides
            trim_heap()
            halves = Halves(even, odd, self._variance_of, share)
            return denoise_each(halves, self._guides, self._periods)

    def denoises(self) -> bool:
        """Whether no forecast is against denoising the light."""
        return self.choice is None or self.choice.denoises()

    def denoised_rows(self, rows: slice) -> Electrons:
        """What :meth:`electrons` of some rows would be, if the picture had no others and were denoised."""
        share = ((self.passes + 1) // 2) / self.passes
        even, odd = (partial(self._half, share, odd, rows) for odd in (False, True))
        guides = None
        if not mitsuba().variant().startswith("scalar"):
            guides = self._traced_guides(rows, None)
        halves = Halves(even, odd, partial(self._variance_of, rows=rows), share)
        found = denoise_each(halves, guides, self._periods)
        mean, variance = self._raw_electrons()
        mean[rows] = self._own(found.mean, rows)
        variance[rows] = self._own(found.variance, rows)
        mean, variance = self._behind_glare((mean, variance))
        return mean[rows], variance[rows]

    def _half(self, share: float, odd: bool, rows: slice = slice(None)) -> NDArray[np.float32]:
        """Mean photoelectrons of the even passes or the others, (H, W, F) of these rows."""
        found = np.concatenate([s.even_e for s in self.strips if s.even_e is not None])
        found /= share * self.passes
        for strip in self.strips if odd else []:
            here = found[strip.rows]
            here[...] = (strip.electrons.mean - share * here) / (1 - share)
        return np.asarray(np.maximum(found[rows], 0))

    def _variance_of(self, number: int, rows: slice = slice(None)) -> Map:
        """Variance of the mean photoelectrons behind one filter."""
        parts = [strip.electrons.variance_of_mean[..., number] for strip in self.strips]
        return np.concatenate(parts)[rows]

    def release(self) -> None:
        """Forget the last render; what it returned stays."""
        if self.strips:
            del self._sums
        self.strips, self.denoised, self._filtered, self._guides = [], None, None, None
        trim_heap()

    def _traced_guides(self, rows: slice, known: Guides | None) -> Guides:
        """Those that are known, if any, and more rays as needed, of some rows."""
        mean, variance = (image[rows] for image in self._raw_electrons())
        spectrum, nm = mean_spectrum(self.strips), self.bands.wavelengths_nm
        typical_nm = detected_quarters(self._weights, spectrum, nm)  # of each filter, (F, 4)
        guides = traced(
            partial(self.scene.guides, typical_nm, (rows.start, rows.stop)),
            most_rays(self.samples_per_pixel),
            lambda noise: noise_share(self._own(noise, rows), mean, variance),
            known,
        )
        self.guide_rays = guides.rays
        return guides

    def infinite(self) -> NDArray[np.bool_]:
        """(H, W) where the irradiance is infinite."""
        return np.concatenate([strip.infinite for strip in self.strips])

    def firefly_fraction(self) -> float:
        """See :func:`statistics.RenderStatistics.firefly_fraction`."""
        if self._fireflies is not None:
            return self._fireflies
        mean, variance = self._raw_electrons()
        mean[self.infinite()] = np.inf
        squares = variance * self.passes * (self.passes - 1)
        return firefly_fraction(
            np.concatenate([s.brightest for s in self.strips]), mean, squares
        )

    def noise_estimate(self) -> tuple[Map, Map, int]:
        """Mean photoelectrons, the variance of that mean, (H, W) each, and its degrees of freedom. That of a single
        pass is half the squared difference of neighbours behind one filter, correct where the image is smooth."""
        mean, variance = self._behind_glare(self._raw_electrons())
        if self.passes > 1 or mean.shape[1] <= (step := self._tile.shape[1]):
            return mean, variance, max(self.passes - 1, 1)
        right, left = mean[:, step:], mean[:, :-step]
        return right, 0.5 * (right - left) ** 2, 1

    def result(self, keep: bool = False) -> Estimate:
        """What was rendered and, where that was done, denoised. A pixel with an infinite band is infinite in all.
        Unless asked to ``keep`` them, the sums of the bands are written over, to save memory."""
        shape = (*self.scene.view.crop_size[::-1], len(self.bands))
        data, error = (
            (np.empty(shape, np.float32), np.empty(shape, np.float32))
            if keep
            else self._sums.reused()
        )
        mean, variance = self.electrons()
        if self.denoised is None:
            variance = pooled(mean, variance, self.passes)
        relative = relative_errors(mean, variance, self.infinite())
        del variance
        trim_heap()
        self._write_bands(data, error, relative)
        in_band = self._in_band(mean, data) if self.bands.filters else None
        if not keep and self.denoised is not None:
            self.denoised = self.denoised.without_halves()
        trim_heap()
        return Estimate(data, error, relative, in_band)

    def _write_bands(
        self,
        data: NDArray[np.float32],
        error: NDArray[np.float32],
        relative: NDArray[np.float32],
    ) -> None:
        """The bands (H, W, B) and their standard errors.  relative : standard error of the photoelectrons, (H, W)."""
        if self._glare is not None:
            relative = relative_errors(*self._electrons_before_glare(), self.infinite())
        for strip in self.strips:
            mean, deviation = bands_of(strip, self.denoised, self._weights, relative)
            data[strip.rows], error[strip.rows] = np.maximum(mean, 0), deviation
        if self._glare is not None:
            self._glare.add_to_bands(data, error)
        infinite = self.infinite()
        data[infinite] = error[infinite] = np.inf

    def _in_band(self, mean_e: Map, data: NDArray[np.float32]) -> NDArray[np.float32]:
        """(H, W) photoelectrons over those of spectra that are flat within each band."""
        factor = np.empty(mean_e.shape, np.float32)
        for strip in self.strips:
            here = strip.rows
            flat = self._own(data[here] @ self._weights.T, here)
            factor[here] = in_band_factor(mean_e[here], flat)
        return factor
