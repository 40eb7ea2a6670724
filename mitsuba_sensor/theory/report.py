"""Report of a frame: every stage as expected and as it is, counts of clipped pixels, light outside the QE curve."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..camera.camera import Camera
from ..core import Array, Frame
from ..sensor.frame_notes import outside_qe
from ..sensor.run import Strip
from ..stages.gains import gain_dn_per_e
from ..stages.stage import UNITS, Chain, Stage, total
from .expected import Expectation


class FrameObserver:
    """Follows a frame behind every stage: counts of its clipped pixels."""

    def __init__(self, stages: Chain) -> None:
        self.stages = stages
        self.counts: Counter[str] = Counter(
            clipped_full_well=0, clipped_adc_low=0, clipped_adc_high=0
        )

    def strip(self, strip: Strip, frame: Frame) -> StripFollower:
        """Before a strip is computed.  frame : of all its rows."""
        return StripFollower(self, strip, frame)

    def count(self, counts: Mapping[str, int]) -> None:
        """Pixels of the masks of one strip."""
        self.counts.update(counts)


class StripFollower:
    """Sees the signals of one strip."""

    def __init__(self, observer: FrameObserver, strip: Strip, frame: Frame) -> None:
        self.observer, self.strip, self.frame = observer, strip, frame
        self.masks: dict[str, Array] = {}

    def behind(self, stage: Stage, signal: Array) -> None:
        """The signal behind a stage."""
        self.masks |= stage.marked(total(signal), self.frame)

    def end(self) -> dict[str, Array]:
        """Masks of the rows that the strip delivers, whose pixels are to be counted."""
        if self.strip.around == self.strip.rows:
            return self.masks
        shape, inside = self.frame.window.shape, self.strip.inside
        return {name: np.broadcast_to(mask, shape)[inside] for name, mask in self.masks.items()}


def report(camera: Camera, expected: Expectation, observer: FrameObserver) -> dict[str, Any]:
    """The report of frames, ready for JSON.

    ``photons`` (min, median, max per pixel; of electrons where they are ``detected``), ``stages`` (below), ``counts``
    of clipped and cut pixels of the first frame, photons ``outside_qe`` and ``K_dn_per_e``. Each stage has mean and σ
    as expected, averaged over the window (σ total, temporal, spatial; standard errors of mean, temporal and spatial σ),
    and as the same pixels of the frames have them: σ_frame is the rms distance from what is expected of each pixel.
    ``theory`` says by how many pixels.
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
        "counts": dict(observer.counts),
        "outside_qe": outside_qe(photons, camera),
        "K_dn_per_e": gain_dn_per_e(camera),
    }


def _line(stage: Stage, expected: Expectation) -> dict[str, Any]:
    """One stage of the report, in its own unit."""
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
    """Standard error of the root of a variance whose standard error may be larger than itself."""
    if error:
        return float(error / (np.sqrt(variance) + np.sqrt(variance + error)))
    return 0.0
