"""What a render without a fixed number of samples works towards: a noise ratio, or less noise than the sensor.

The noise ratio is the render's variance over the sensor's own temporal variance, both as electrons at the input.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...core import Exposure, Float64Array
from .statistics import median_bias
from .stop_criterion import StopCriterion

if TYPE_CHECKING:
    from .prepared import PreparedRender
    from .renderer import Renderer

MOST_GAIN = 40.0  # of a denoiser, in the noise ratio that 95 % of the pixels stay below


def exposure_for(prepared: PreparedRender, lit_e: Float64Array) -> Exposure:
    """The exposure that a render gets whose lit pixels have so many photoelectrons in its own."""
    if prepared.metering is None or prepared.metered or not lit_e.size:
        return prepared.exposure
    time_s = prepared.metering.time_of(lit_e, prepared.camera, prepared.exposure)
    return replace(prepared.exposure, time_s=time_s)


class MedianNoiseRatio:
    """Measures the median noise ratio of the lit pixels after a pass.

    Light that will be denoised is denoised again after a quarter as many passes more; between, the
    ratio is forecast to fall as one over the passes.
    """

    def __init__(self, renderer: Renderer, denoised: bool) -> None:
        self._renderer, self._denoised = renderer, denoised
        self._passes, self._ratio = 0, np.nan

    def __call__(self, mean_e: Float64Array, variance_e2: Float64Array, freedom: int) -> float:
        """The ratio.  mean_e, variance_e2, freedom : see :meth:`renderer.Renderer.noise_estimate`."""
        renderer = self._renderer
        self._denoised = self._denoised and renderer.denoises()
        if self._denoised and 4 * renderer.passes >= 5 * self._passes:
            light = renderer.denoised_electrons()
            if light is None:
                return self._median(mean_e, variance_e2) * median_bias(freedom + 1)
            self._passes, self._ratio = renderer.passes, self._median(*light)
        if self._denoised:
            return self._ratio * self._passes / renderer.passes
        return self._median(mean_e, variance_e2) * median_bias(freedom + 1)

    def _median(self, mean_e: Float64Array, variance_e2: Float64Array) -> float:
        beside_e = self._renderer.beside_e[:, -mean_e.shape[1] :]
        ratio = self._renderer.noise.ratio(mean_e + beside_e, variance_e2)[mean_e > 0]
        return float(np.median(ratio)) if ratio.size else 0.0


class SensorNoise:
    """Tells when 95 % of the lit pixels have less render noise than sensor noise.

    It looks after the passes that :class:`stop_criterion.StopCriterion` names only, because it
    denoises the light for that. What it looks at, the render goes on with, or ends with.
    """

    def __init__(self, prepared: PreparedRender, stop: StopCriterion) -> None:
        self._prepared, self._stop = prepared, stop
        self._next_look, self._passes = stop.first_look(), stop.passes

    def most_passes(self, before: int) -> int:
        """How many passes there may be: more where they take the time of a denoiser that is left out."""
        return self._stop.passes if self._stop.to_sensor_noise else before

    def is_reached(self, looks: Callable[[], object] = lambda: None) -> bool:
        """Whether the passes so far suffice.  looks : called before it looks, which takes a while where the light is
        denoised."""
        passes = self._prepared.renderer.passes
        if self._next_look is None or passes < self._next_look:
            return False
        looks()
        ratio = self._ratio()
        choice = self._prepared.renderer.choice
        if choice is not None:
            self._stop = replace(self._stop, passes=self._passes + choice.passes_instead)
        self._next_look = self._stop.next_look(passes, ratio)
        return ratio <= self._stop.sensor_noise_share

    def _ratio(self) -> float:
        """The 95th percentile of the ratio; without denoising where no denoiser could make it 1."""
        renderer = self._prepared.renderer
        raw_ratio = self._ratio_p95(*renderer.electrons())
        if not (renderer.can_denoise and renderer.denoises()):
            return raw_ratio
        if raw_ratio > MOST_GAIN:
            return raw_ratio / MOST_GAIN
        light = renderer.denoised_electrons()
        if light is None:
            return raw_ratio
        return self._ratio_p95(*light)

    def _ratio_p95(self, mean_e: Float64Array, variance_e2: Float64Array) -> float:
        """What 95 % of the lit pixels stay below, in the exposure that this light gets; infinite
        where no pixel is lit yet."""
        prepared = self._prepared
        lit = (mean_e > 0) & ~prepared.renderer.infinite()
        if not lit.any():
            return np.inf
        exposure = exposure_for(prepared, mean_e[lit])
        light = mean_e, variance_e2
        return prepared.noise_ratios(exposure, light, prepared.renderer.passes)[
            "noise_ratio_p95"
        ]
