"""Renders a loaded scene in passes, until a stop criterion is met, into mean and variance per pixel and band.

Every pass has a hashed seed. Passes are combined in float64, because Mitsuba's film accumulates in float32, which loses
1e-8 per sample; their spread gives the variance of the result. Large films are cut into strips of rows, so that no pass
has more than a few million samples in memory.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..core import Exposure, Float64Array
from ..optics.f_number_law import solid_angle_sr
from ..sensor.camera import Camera
from ..sensor.input_noise import input_noise
from .bands import Bands
from .moving_scene import MovingScene
from .passes import Welford, clean, hashed_seed, row_strips
from .photons import electrons_per_irradiance
from .scene import Scene
from .statistics import firefly_fraction, median_bias
from .stop_criterion import End, Progress, RenderProgress, StopCriterion

Map = Float64Array
Criterion = Callable[[Map, Map, int], float]


class RowStrip:
    """Accumulated passes of some rows: per band, and as photoelectrons of each pixel behind its own filter.

    even : sum of the passes 0, 2, 4, … per band, or None.  brightest : largest photoelectrons of any pass, (H, W).
    """

    def __init__(self, rows: slice, columns: int, bands: int, halves: bool) -> None:
        shape = (rows.stop - rows.start, columns)
        self.rows = rows
        self.bands, self.electrons = Welford((*shape, bands)), Welford(shape)
        self.brightest, self.infinite = np.zeros(shape), np.zeros(shape, bool)
        self.even = np.zeros((*shape, bands), np.float32) if halves else None

    def add(self, irradiance: Float64Array, electrons: Float64Array) -> None:
        """Add one pass; both arrays are overwritten."""
        if self.even is not None and self.bands.count % 2 == 0:
            self.even += irradiance
        np.maximum(self.brightest, electrons, out=self.brightest)
        self.bands.add(irradiance)
        self.electrons.add(electrons)


class ProgressMeter:
    """Times a render of some strips of rows, forecasts its end, and reports to ``progress``."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._started = progress, time.monotonic()
        self._value, self._left_s, self._expected = np.nan, np.nan, 0

    def begin(self, strips: int) -> None:
        """Passes of so many strips start now."""
        self._strips, self._began = strips, time.monotonic()

    def times(self, passes: int) -> tuple[float, float]:
        """Seconds since the render started, and per pass since :meth:`begin`."""
        now = time.monotonic()
        return now - self._started, (now - self._began) / max(passes, 1)

    def forecast(self, budget: StopCriterion, passes: int, value: float) -> None:
        """So many passes are done, and the criterion has this value."""
        seconds, per_pass = self.times(passes)
        self._expected = budget.expected(passes, value, seconds, per_pass)
        self._value, self._left_s = value, (self._expected - passes) * per_pass if passes else np.nan
        self.report(passes * self._strips)

    def report(self, strips: int) -> None:
        """So many strips of all passes are done."""
        (seconds, _), expected = self.times(1), self._expected * self._strips
        self._progress(RenderProgress(strips, expected, self._value, seconds, self._left_s))


class Renderer:
    """Renders one scene for one camera, exposure and set of bands.

    passes, samples, groups : of the last render; samples per pixel, pass and group of bands.
    negative, non_finite : its values that were set to 0.  halves : whether to keep two half-sets of the passes.
    """

    def __init__(
        self, scene: Scene | MovingScene, camera: Camera, exposure: Exposure, bands: Bands, halves: bool = False
    ) -> None:
        (columns, rows), (column, row) = scene.view.crop_size, scene.view.crop_offset
        self.scene, self.bands, self._halves = scene, bands, halves
        self._weights = electrons_per_irradiance(camera, exposure, bands)
        self._filters = np.asarray(camera.filter_index((rows, columns), (row, column)))
        self._tile_columns = len(camera.tile[0])
        self._solid_angle, self._scale = solid_angle_sr(scene.view, camera), bands.transmission / bands.bandwidths_nm
        self._noise = input_noise(camera, exposure)
        self.negative = self.non_finite = self.passes = self.samples = 0

    def run(self, seed: int, budget: StopCriterion, progress: Progress, criterion: Criterion | None = None) -> End:
        """Render until ``budget`` is used up or its goal is met; returns which. criterion : function of
        :meth:`noise_estimate` that the goal is for; by default the median noise ratio."""
        measure, meter = criterion or self.median_ratio, ProgressMeter(progress)
        self.groups = self.bands.groups if budget.grouped else (slice(0, len(self.bands)),)
        self._begin(budget.samples, meter)
        meter.forecast(budget, 0, np.nan)
        while True:
            self._pass(seed, meter)
            value = measure(*self.noise_estimate())
            meter.forecast(budget, self.passes, value)
            if budget.sized:
                if end := budget.finished(self.passes, value, *meter.times(self.passes)):
                    return end
                continue
            budget = budget.sized_by(value, meter.times(1)[0])
            if budget.samples != self.samples:  # passes of different sizes cannot be combined: start again
                self._begin(budget.samples, meter)

    def _begin(self, samples: int, meter: ProgressMeter) -> None:
        """Empty strips for passes of so many samples per pixel."""
        columns, count = self.scene.view.crop_size[0], len(self.bands)
        rows = row_strips(self.scene.view.crop_size, count, samples)
        self.strips = [RowStrip(slice(*edges), columns, count, self._halves) for edges in rows]
        self.samples, self.passes, self.negative, self.non_finite = samples, 0, 0, 0
        meter.begin(len(rows))

    def _pass(self, seed: int, meter: ProgressMeter) -> None:
        """One pass of all strips."""
        for s, strip in enumerate(self.strips):
            if s:
                meter.report(self.passes * len(self.strips) + s)
            rows = strip.rows
            radiance = clean(self._radiance(hashed_seed(seed, s, self.passes), (rows.start, rows.stop)))
            self.negative += radiance.negative
            self.non_finite += radiance.non_finite
            if radiance.infinite is not None:
                strip.infinite |= radiance.infinite.any(axis=-1)
            irradiance = radiance.values
            irradiance *= self._solid_angle[rows, :, None] * self._scale
            per_filter = irradiance @ self._weights.T
            electrons = np.take_along_axis(per_filter, self._filters[rows, :, None], axis=-1)[..., 0]
            strip.add(irradiance, electrons)
        self.passes += 1

    def _radiance(self, seed: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """One pass of some rows, the groups of bands one after the other, (rows, columns, bands)."""
        if len(self.groups) == 1:
            if self.bands.kind == "cube":
                self.scene.restrict_wavelengths(*self.bands.ends_nm)
            return np.asarray(self.scene.render(seed, self.samples, rows))
        parts = []
        for number, group in enumerate(self.groups):
            self.scene.restrict_wavelengths(self.bands.edges_nm[group.start], self.bands.edges_nm[group.stop])
            parts.append(self.scene.render(hashed_seed(seed, number, 0), self.samples, rows)[..., group])
        return np.concatenate(parts, axis=-1)

    @property
    def samples_per_pixel(self) -> int:
        """Light paths per pixel of the last render, of all passes and groups."""
        return self.passes * self.samples * len(self.groups)

    def electrons(self) -> tuple[Float64Array, Float64Array]:
        """Mean photoelectrons of one exposure, and the variance of that mean, (H, W) each."""
        parts = [strip.electrons for strip in self.strips]
        return np.concatenate([e.mean for e in parts]), np.concatenate([e.variance_of_mean for e in parts])

    def noise_ratios(self) -> Float64Array:
        """Render variance over sensor variance of every pixel, (H, W); infinite where the irradiance is."""
        infinite = np.concatenate([strip.infinite for strip in self.strips])
        return np.where(infinite, np.inf, self._noise.ratio(*self.electrons()))

    def firefly_fraction(self) -> float:
        """See :func:`statistics.RenderStatistics.firefly_fraction`."""
        totals = [np.where(s.infinite, np.inf, s.electrons.mean * s.electrons.count) for s in self.strips]
        return firefly_fraction(np.concatenate([s.brightest for s in self.strips]), np.concatenate(totals))

    def noise_estimate(self) -> tuple[Map, Map, int]:
        """Mean photoelectrons, the variance of that mean, (H, W) each, and its degrees of freedom. That of a single
        pass is half the squared difference of neighbours behind one filter, correct where the image is smooth."""
        mean, variance = self.electrons()
        if self.passes > 1 or mean.shape[1] <= self._tile_columns:
            return mean, variance, max(self.passes - 1, 1)
        right, left = mean[:, self._tile_columns :], mean[:, : -self._tile_columns]
        return right, 0.5 * (right - left) ** 2, 1

    def median_ratio(self, mean_e: Map, variance_e2: Map, freedom: int) -> float:
        """Median noise ratio of the lit pixels, corrected for the bias of a median of few degrees of freedom (χ²)."""
        ratio = self._noise.ratio(mean_e, variance_e2)[mean_e > 0]
        return float(np.median(ratio)) * median_bias(freedom + 1) if ratio.size else 0.0

    def result(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Mean and standard error per band, (H, W, B), and relative standard error of the electrons, (H, W). A pixel
        with an infinite band is infinite in all. Strips are freed as they are copied, to save memory."""
        columns, rows = self.scene.view.crop_size
        data = np.empty((rows, columns, len(self.bands)), np.float32)
        error, relative = np.empty_like(data), np.empty((rows, columns), np.float32)
        for strip in self.strips:
            infinite = strip.infinite
            data[strip.rows], error[strip.rows] = strip.bands.mean, np.sqrt(strip.bands.variance_of_mean)
            data[strip.rows][infinite] = error[strip.rows][infinite] = np.inf
            positive = np.maximum(strip.electrons.mean, np.finfo(float).tiny)
            relative[strip.rows] = np.where(infinite, np.inf, np.sqrt(strip.electrons.variance_of_mean) / positive)
            strip.bands = Welford((0,))
        return data, error, relative

    def halves(self) -> tuple[Float64Array, Float64Array]:
        """Means of the even and of the odd passes, (H, W, B) each: two independent renders of half the samples."""
        first = (self.passes + 1) // 2
        even = np.concatenate([strip.even for strip in self.strips if strip.even is not None])  # halves=True
        total = np.concatenate([strip.bands.mean * self.passes for strip in self.strips])
        return even / first, (total - even) / (self.passes - first)
