"""Forecast of what denoising and more samples bring in the same time, and the choice between them.

A trial denoises some rows of the render alone, or all of a small picture, which is kept if it is better. The error is
compared by the mean render noise of the lit pixels over the sensor's own, in which no pixel counts for more than the
95th percentile of the render that is not denoised: a few pixels of rare paths decide nothing. The time that denoising
takes is counted in samples, by constants, so that no clock decides: the same command chooses the same again, anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from ..denoise.denoise import LEAST_PASSES, is_noisy
from ..denoise.guides import FEWEST_RAYS
from .noise_goals import exposure_for
from .stop_criterion import FIRST_LOOK, RATIO_EXPONENT, StopCriterion

if TYPE_CHECKING:
    from .prepared import PreparedRender
    from .renderer import Electrons

COUNTED = 95.0  # percentile of the noise ratio, for more than which no pixel counts
LEAST_ROWS, LEAST_TRIED_PIXELS = 16, 4096
ROWS_OF_TRIAL = 32  # of so many rows one is tried
SMALL = 3  # times the rows of a trial: smaller pictures are tried as a whole
CALM = 0.25
"""Mean noise ratio below which denoising matters little to this sensor: no trial, unless it costs hardly anything."""
START_SAMPLES, NETWORK_SAMPLES, RAY_SAMPLES = 1e5, 30.0, 0.15
"""Samples that take as long as denoising: its start, the network for a pixel, a ray of its guides. In the middle of the
scenes of this package, of which a sample of a closed box takes ten times as long as one of a chart."""
LITTLE = 40.0  # a trial costs hardly anything where the samples take so many times as long


@dataclass(frozen=True)
class DenoiseForecast:
    """What denoising brings to a render, beside what samples bring in the same time.

    gain : squared error of the render over that of its denoised light, in the trial; None without a trial.
    noise : mean render noise over sensor noise, of the render without denoising.
    denoiser_samples : samples per pixel in the time that denoising takes after the trial.  samples : of the render.
    """

    gain: float | None
    noise: float
    denoiser_samples: float
    samples: float

    @property
    def needed(self) -> float:
        """What samples gain in the time of the denoiser; a variance falls as one over the samples."""
        return 1 + self.denoiser_samples / self.samples

    @property
    def denoises(self) -> bool:
        """Whether denoising is better than samples."""
        return self.gain is not None and self.gain >= self.needed

    def record(self) -> dict[str, float | None]:
        """What the render statistics say of it."""
        return {
            "gain": self.gain,
            "gain_of_samples": self.needed,
            "noise": self.noise,
            "denoiser_samples": self.denoiser_samples,
            "samples": self.samples,
        }

    def note(self) -> str:
        """Why the light is not denoised."""
        if self.gain is None:
            why = f"the render's noise is {self.noise:.2g} × the sensor's on average"
            return f"not denoised: {why}; --denoise does it anyway"
        why = f"a denoiser makes the variance {self.gain:.2g} times smaller, samples {self.needed:.2g} times"
        why = f"forecast: {why} in its time"
        return f"not denoised: samples are better here ({why}); --denoise does it anyway"


class DenoiseChoice:
    """Chooses once in a render, when it is first asked, whether the light is denoised.

    forecast : that was made; None before, and where no camera would see the noise.
    passes_instead : that take as long as the denoiser, where that is left out: whole looks at the sensor's
        noise, at most as many as there may be anyway.
    """

    def __init__(self, prepared: PreparedRender, stop: StopCriterion) -> None:
        self._prepared, self._stop = prepared, stop
        self._is_made, self.passes_instead = False, 0
        self.forecast: DenoiseForecast | None = None

    def denoises(self) -> bool:
        """Whether the light of the render is denoised; of few passes nobody can tell yet."""
        renderer = self._prepared.renderer
        if not self._is_made and renderer.passes >= LEAST_PASSES and renderer.can_denoise:
            self._is_made = True
            if is_noisy(*renderer.electrons()):
                self.forecast = self._make_forecast()
                self.passes_instead = self._passes_for(self.forecast)
        return self.forecast is None or self.forecast.denoises

    def record(self) -> dict[str, float | None] | None:
        """What the render statistics say of the forecast."""
        return None if self.forecast is None else self.forecast.record()

    def notes(self) -> list[str]:
        """Why the light is not denoised, if a forecast was against it."""
        if self.forecast is None or self.forecast.denoises:
            return []
        return [self.forecast.note()]

    def _passes_for(self, forecast: DenoiseForecast) -> int:
        if forecast.denoises:
            return 0
        renderer = self._prepared.renderer
        of_pass = renderer.samples * len(renderer.groups)
        passes = min(forecast.denoiser_samples / of_pass, self._stop.passes)
        return FIRST_LOOK * round(passes / FIRST_LOOK)

    def _make_forecast(self) -> DenoiseForecast:
        """From a trial, if it is worth its time."""
        renderer = self._prepared.renderer
        raw, rows = renderer.electrons(), self._tried_rows()
        self._exposure = exposure_for(self._prepared, raw[0][_lit(raw[0])])
        noise_ratio = self._noise_ratio(raw, slice(None))
        most = _most(noise_ratio)
        noise, pixels = _mean_below(noise_ratio, most), raw[0].size
        is_whole = raw[0][rows].size == pixels
        done, ends = renderer.samples_per_pixel, self._samples_at_end(noise_ratio, 1.0)
        trial_samples = _denoiser_samples(raw[0][rows].size, FEWEST_RAYS) / pixels
        if noise <= CALM and ends < LITTLE * trial_samples:
            denoiser_samples = _denoiser_samples(pixels, FEWEST_RAYS) / pixels
            return DenoiseForecast(None, noise, denoiser_samples, ends)
        denoised = renderer.denoised_electrons() if is_whole else renderer.denoised_rows(rows)
        assert denoised is not None
        before = _mean_below(self._noise_ratio((raw[0][rows], raw[1][rows]), rows), most)
        after = _mean_below(self._noise_ratio(denoised, rows), most)
        gain = before / max(after, np.finfo(float).tiny)
        ends = self._samples_at_end(noise_ratio, max(gain, 1.0))
        gain *= (done / ends) ** (1 - RATIO_EXPONENT)
        denoiser_samples = _denoiser_samples(pixels, renderer.guide_rays) / pixels
        if is_whole and ends == done:
            denoiser_samples = 0.0
        return DenoiseForecast(gain, noise, denoiser_samples, ends)

    def _tried_rows(self) -> slice:
        """Rows in the middle of the picture, enough of them that their mean error is known."""
        columns, height = self._prepared.scene.view.crop_size
        rows = max(LEAST_ROWS, height // ROWS_OF_TRIAL, -(-LEAST_TRIED_PIXELS // columns))
        if SMALL * rows >= height:
            return slice(0, height)
        first = (height - rows) // 2
        return slice(first, first + rows)

    def _noise_ratio(self, light: Electrons, rows: slice) -> Float64Array:
        """Render noise over sensor noise of the lit pixels of these rows."""
        mean_e, variance_e2 = light
        beside_e = self._prepared.renderer.beside_e
        if beside_e.size > 1:
            beside_e = beside_e[rows]
        ratio = self._prepared.noise_ratio(self._exposure, (mean_e + beside_e, variance_e2))
        return ratio[_lit(mean_e) & np.isfinite(ratio)]

    def _samples_at_end(self, noise_ratio: Float64Array, gain: float) -> float:
        """Samples of the render if it is denoised with this gain now: what it works towards may be reached before."""
        stop, done = self._stop, self._prepared.renderer.samples_per_pixel
        if stop.goal is None and not stop.to_sensor_noise:
            return float(max(done, 1))
        goal, percentile = stop.sensor_noise_share, COUNTED
        if stop.goal is not None:
            goal, percentile = stop.goal, 50.0
        ratio = float(np.percentile(noise_ratio, percentile)) if noise_ratio.size else 0.0
        needed = done * (ratio / gain / goal) ** (1 / RATIO_EXPONENT)
        renderer = self._prepared.renderer
        most = stop.passes * renderer.samples * len(renderer.groups)
        return float(min(max(needed, done), max(most, done)))


def _denoiser_samples(pixels: int, rays: int) -> float:
    """Samples, of all pixels, that take as long as denoising so many.  rays : of the guides, per pixel."""
    return START_SAMPLES + (NETWORK_SAMPLES + RAY_SAMPLES * rays) * pixels


def _lit(mean_e: Float64Array) -> NDArray[np.bool_]:
    return (mean_e > 0) & np.isfinite(mean_e)


def _most(noise_ratio: Float64Array) -> float:
    """For how much a pixel counts at most."""
    return float(np.percentile(noise_ratio, COUNTED)) if noise_ratio.size else 0.0


def _mean_below(noise_ratio: Float64Array, most: float) -> float:
    """Mean noise ratio, each at most so large."""
    return float(np.minimum(noise_ratio, most).mean()) if noise_ratio.size else 0.0
