"""Report of frames: expected and measured signal after every stage, clipped pixels, light outside the QE curve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..camera.camera import Camera
from ..sensor.frame_notes import outside_qe
from ..stages.gains import gain_dn_per_e
from ..stages.stage import UNITS, Stage
from .expected import Expectation


def report(camera: Camera, expected: Expectation, counts: Mapping[str, int]) -> dict[str, Any]:
    """Return the report of frames, ready for JSON.

    It has ``photons`` (min, median, max per pixel; electrons if ``detected``), ``stages``, ``counts`` of clipped pixels
    of the first frame, photons ``outside_qe`` and ``K_dn_per_e``. Each stage has the expected mean and σ (total,
    temporal, spatial) averaged over the window, their standard errors, and the mean and σ of the same pixels in the
    frames, where σ_frame is the rms distance from the expectation of each pixel. ``theory`` has the number of pixels.
    """
    photons = expected.light.photons
    seen = expected.light.mean_e if photons.detected else photons.total
    return {
        "photons": {
            "min": float(seen.min()),
            "median": float(np.median(seen)),
            "max": float(seen.max()),
            "detected": photons.detected,
        },
        "sampled_pixels": expected.pixels,
        "theory": {
            "pixels": expected.pixels,
            "windows": len(expected.windows),
            "samples_of_each": 4,
        },
        "stages": [_line(stage, expected) for stage in expected.stages],
        "counts": dict(counts),
        "outside_qe": outside_qe(photons, camera),
        "K_dn_per_e": gain_dn_per_e(camera),
    }


def _line(stage: Stage, expected: Expectation) -> dict[str, Any]:
    """Return the report of one stage, in its unit."""
    found = expected.averages(stage)
    return {
        "name": stage.label,
        "domain": stage.domain,
        "unit": UNITS[stage.domain],
        "mean_expected": found.mean,
        "sigma_expected": found.sigma,
        "sigma_temporal_expected": float(np.sqrt(found.temporal)),
        "sigma_spatial_expected": float(np.sqrt(found.spatial)),
        "mean_error": found.errors[0],
        "sigma_temporal_error": error_of_root(found.temporal, found.errors[1]),
        "sigma_spatial_error": error_of_root(found.spatial, found.errors[2]),
        "mean_frame": found.frame_mean,
        "sigma_frame": float(np.sqrt(found.frame_variance)),
    }


def error_of_root(variance: float, error: float) -> float:
    """Return the standard error of the root of a variance, which may be smaller than its standard error."""
    if error:
        return float(error / (np.sqrt(variance) + np.sqrt(variance + error)))
    return 0.0
