"""What render noise means in a frame: its part of a pixel's variance, and what makes it small."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...core import Caution
from ...sensor.frames import RawFrames
from ...theory.input_noise import input_noise
from .irradiance import Irradiance
from .statistics import POOLED, POOLED_PASSES_MIN, summary_of

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
