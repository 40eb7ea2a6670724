"""What render noise means in a frame: its part of a pixel's variance, and the samples that would make it small."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...core import Caution
from ...sensor.frames import RawFrames
from ...theory.input_noise import input_noise
from ..limits import MOST_IN_ALL
from ..passes.pooled import FEWEST
from ..passes.statistics import POOLED, RenderStatistics, summary_of
from ..passes.stop_criterion import DEFAULT_SPP, RATIO_EXPONENT
from .irradiance import Irradiance

ALL = 0.995  # of the variance: more would be called 100 %
LITTLE_NOISE = 0.1  # of the sensor's variance: 5 % more noise in the frame
# The gain g of a denoiser falls as the render gets better: where f × the samples would do if it stayed,
# f·min(g, f)^(1/3) × are needed. Cornell box, 96 columns: 64, 256 and 1024 samples foretell 6500, 5700 and 7100; 6720
# reach 0.118.
GAIN_EXPONENT = 1 / 3


def render_noise(light: Irradiance, frames: RawFrames) -> dict[str, float | None]:
    """Variance of the render over the sensor's own temporal variance, both as electrons at the input, in this exposure.

    The render statistics have the same for the exposure of the render; a longer exposure of the same light shows more.
    share_of_variance_median : of the noise of a lit pixel in one frame, the render's part.  above_sensor : share of the
    lit pixels in which the render's variance is the larger one.  samples_for_a_tenth, seconds_for_a_tenth : of a render
    whose median ratio is 0.1, roughly; None where it is less, or nobody can tell.
    most_samples, most_samples_median, most_samples_p95, most_samples_more_s : what a render that stopped at the
    sensor's noise would reach with all samples that the default allows, roughly, and how much longer it would take;
    None for other renders.
    """
    electrons = frames.detected.mean_e
    statistics = light.statistics
    with np.errstate(invalid="ignore"):
        variance_e2 = light.relative_error * electrons
        variance_e2 *= variance_e2
    ratio = input_noise(frames.camera, frames.first.exposure).ratio(electrons, variance_e2)
    del variance_e2
    lit = np.isfinite(electrons) & np.isfinite(ratio) & (electrons > 0)
    passes = POOLED if statistics.passes >= FEWEST else statistics.passes
    found = summary_of(np.where(np.isfinite(electrons), ratio, np.inf), electrons > 0, passes)
    median = found["noise_ratio_median"]
    samples = samples_for(LITTLE_NOISE, median, statistics)
    more = (
        None
        if samples is None
        else (samples - statistics.samples_per_pixel) * statistics.seconds_per_sample
    )
    most = _with_most_samples(statistics, median, found["noise_ratio_p95"])
    return {
        "over_sensor_median": median,
        "over_sensor_p95": found["noise_ratio_p95"],
        "over_sensor_max": found["noise_ratio_max"],
        "share_of_variance_median": median / (1 + median) if np.isfinite(median) else 1.0,
        "above_sensor": float((ratio[lit] > 1).mean()) if lit.any() else 0.0,
        "samples_for_a_tenth": samples,
        "seconds_for_a_tenth": None if more is None else statistics.seconds + more,
        **most,
    }


def _with_most_samples(
    statistics: RenderStatistics, median: float, p95: float
) -> dict[str, float | None]:
    """What all samples of the default would bring to a render that stopped at the sensor's noise."""
    done = statistics.samples_per_pixel
    if statistics.ended_by != "sensor_noise" or done >= DEFAULT_SPP:
        names = (
            "most_samples",
            "most_samples_median",
            "most_samples_p95",
            "most_samples_more_s",
        )
        return dict.fromkeys(names)
    exponent = 1.0 if statistics.denoised is None else RATIO_EXPONENT
    falls_to = (done / DEFAULT_SPP) ** exponent
    return {
        "most_samples": float(DEFAULT_SPP),
        "most_samples_median": median * falls_to,
        "most_samples_p95": p95 * falls_to,
        "most_samples_more_s": (DEFAULT_SPP - done) * statistics.seconds_per_sample,
    }


def noise_note(
    light: Irradiance, noise: Mapping[str, float | None], frames: RawFrames
) -> Iterator[str]:
    """Where the render's noise is more than a tenth of the sensor's: how much of the grain is its, and what helps.

    noise : what :func:`render_noise` returned of them.
    """
    median, share = noise["over_sensor_median"], noise["share_of_variance_median"]
    if median is None or share is None or not median > LITTLE_NOISE:
        return
    samples, seconds = noise["samples_for_a_tenth"], noise["seconds_for_a_tenth"]
    remedy = f"render with more samples than {light.statistics.samples_per_pixel} (--spp)"
    if samples is not None and seconds is not None and samples <= MOST_IN_ALL:
        goal = f"--noise-ratio {LITTLE_NOISE:g}"
        if new := _not_rendered_for(light, frames):
            goal = f"a render for this {' and '.join(new)} with {goal}"
        remedy = f"{goal} takes about {_rough(samples)} samples, {_rough(seconds)} s"
    said = f"{share:.0%}" if share < ALL else "nearly all"
    yield Caution(
        f"{said} of the noise variance of a typical pixel is the render's, not the camera's; {remedy}"
    )


def _not_rendered_for(light: Irradiance, frames: RawFrames) -> list[str]:
    """What of these frames the render did not know: a noise ratio is that of its own camera and exposure."""
    if (known := light.rendered_for) is None:
        return []
    shared = known.shared_with(frames.camera, frames.first.exposure, None)
    return [name for name in ("camera", "exposure") if name not in shared]


def _rough(value: float) -> str:
    """Two digits: a forecast has no more."""
    return f"{float(f'{value:.2g}'):.0f}" if value >= 1 else f"{value:.1g}"


def samples_for(wanted: float, median: float, statistics: RenderStatistics) -> float | None:
    """Samples per pixel of a render with so small a median noise ratio, from one that has ``median``; None where it has
    it already."""
    factor, done = median / wanted, statistics.denoised
    if not 1 < factor < np.inf:
        return None
    gain = 1.0
    if done is not None and statistics.noise_ratio_median > 0:
        gain = max(float(done["raw_noise_ratio_median"]) / statistics.noise_ratio_median, 1.0)
    return float(statistics.samples_per_pixel * factor * min(gain, factor) ** GAIN_EXPONENT)
