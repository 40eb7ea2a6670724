"""Report of one frame: theory and sample of every stage, counts of clipped pixels, light outside the QE curve."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..core import Array, Electrons, Frame, Moments, Photons
from ..core.backend import NUMPY_FLOAT64
from .camera import Camera
from .compensation import LIMIT, compensable
from .gains import gain_dn_per_e
from .run import named
from .stage import UNITS, Chain, Stage, total


@dataclass(eq=False)
class FrameReport:
    """The report, and the signals of the frame that it was made of.

    values : ready for JSON.  signals : (H, W) by name, ``digital`` and those of ``expose(keep=…)``.
    mean_photoelectrons : expected in every pixel, (H, W) float64 [e-].
    """

    values: dict[str, Any]
    mean_photoelectrons: Array
    signals: dict[str, Array] = field(default_factory=dict)


def frame_report(photons: Photons, camera: Camera, frame: Frame, stages: Chain) -> FrameReport:
    """Follow one frame and its moments through the chain.

    ``photons`` (min, median, max per pixel; of electrons where they are ``detected``), ``stages`` (below), ``counts``
    of clipped and cut pixels, photons ``outside_qe`` and ``K_dn_per_e``. Each stage has mean and σ as they must be,
    averaged over the window (σ total, temporal, spatial), and as this frame has them: σ_frame is the rms distance of
    the pixels from their own means. Photons with ``variance_e2`` have ``compensation`` too, and the count
    ``compensated_short``.
    """
    lines, compensation = [], {}
    kept: dict[str, Array] = {}
    signal: Array = photons
    detected = mean_photoelectrons = photons.total
    moments = Moments(photons, 0.0, 0.0, frame.on(NUMPY_FLOAT64))
    counts = {"clipped_full_well": 0, "clipped_adc_low": 0, "clipped_adc_high": 0}
    for stage, following in zip(stages, (*stages[1:], None), strict=True):
        if stage.counts_electrons and signal.variance_e2 is not None:
            counts["compensated_short"], compensation["compensation"] = _compensation(signal)
        signal, moments = stage.sample(signal, frame), stage.moments(moments)
        value = total(signal)
        if stage is stages[0]:
            detected, mean_photoelectrons = value, moments.mean
        lines.append(_line(stage, value, moments))
        counts |= stage.counts(value, stage.fpn_maps(frame.window))
        if following is None or following.domain != stage.domain:
            kept |= named(stage, signal, last=following is None)
    seen = detected if photons.detected else photons.total
    values = {
        "photons": {
            "min": float(seen.min()),
            "median": float(np.median(seen)),
            "max": float(seen.max()),
            "detected": photons.detected,
        },
        "stages": lines,
        "counts": counts,
        **compensation,
        "outside_qe": outside_qe(photons, camera),
        "K_dn_per_e": gain_dn_per_e(camera),
    }
    return FrameReport(values, mean_photoelectrons, kept)


def outside_qe(photons: Photons, camera: Camera) -> dict[str, Any]:
    """Bands beyond the ends of the QE curve, where nothing is detected: wavelengths [nm], share of all photons."""
    points = camera.quantum_efficiency.wavelengths_nm
    if photons.wavelengths_nm is None or photons.mean.ndim == 2:
        return {"wavelengths_nm": [], "share_of_photons": 0.0}
    outside = (photons.wavelengths_nm < points[0]) | (photons.wavelengths_nm > points[-1])
    finite = np.where(np.isfinite(photons.mean), photons.mean, 0.0).sum(axis=(0, 1))
    share = float(finite[outside].sum() / finite.sum()) if finite.sum() else 0.0
    return {"wavelengths_nm": photons.wavelengths_nm[outside].tolist(), "share_of_photons": share}


def _compensation(mean: Electrons) -> tuple[int, dict[str, float]]:
    """In how many pixels the render's variance could not be compensated in full, and averages over the window.

    ``variance_e2``, ``compensated_e2``, ``left_e2`` : of the render, compensated, and left on top of the shot noise.
    ``left_over_shot`` : the last over the mean electrons of the pixels with a render's variance: by which share their
    variance is too large.
    """
    by_light, by_dark = compensable(mean.light, mean.dark, mean.variance_e2)
    compensated, shot = by_light + by_dark, np.where(mean.variance_e2 > 0, mean.total, 0.0)
    of_render, of_frame, shot_e = (float(np.mean(x, dtype=np.float64)) for x in (mean.variance_e2, compensated, shot))
    left = of_render - of_frame
    return int(np.sum(compensated < mean.variance_e2)), {
        "limit": LIMIT,
        "variance_e2": of_render,
        "compensated_e2": of_frame,
        "left_e2": left,
        "left_over_shot": left / shot_e if shot_e else 0.0,
    }


def _line(stage: Stage, value: Array, m: Moments) -> dict[str, Any]:
    """One stage of the report, in its own unit."""
    with np.errstate(invalid="ignore"):
        residual = np.nan_to_num(np.asarray(value, dtype=np.float64) - m.mean, nan=0.0, posinf=0.0)
        if getattr(value, "dtype", None) == np.float32:  # the last digit of a float32 is no noise
            residual = np.where(np.abs(residual) <= np.spacing(np.abs(value)), 0.0, residual)
    return {
        "name": stage.label,
        "domain": stage.domain,
        "unit": UNITS[stage.domain],
        "mean_expected": float(np.mean(m.mean)),
        "sigma_expected": m.sigma,
        "sigma_temporal_expected": float(np.sqrt(np.mean(m.temporal))),
        "sigma_spatial_expected": float(np.sqrt(np.mean(m.spatial))),
        "mean_frame": float(np.mean(value, dtype=np.float64)),
        "sigma_frame": float(np.sqrt(np.mean(residual**2))),
    }
