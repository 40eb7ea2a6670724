"""Every electron accounted for: theory and sample of one frame, stage by stage."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..engine.frame import Frame
from ..engine.moments import Moments
from ..engine.quantities import Electrons, Photons
from .camera import Camera
from .chain import chain, gain_dn_per_e

UNITS = {"electrons": "e-", "volts": "V", "digital numbers": "DN"}


def account(photons: Photons, camera: Camera, frame: Frame) -> dict[str, Any]:
    """Follow one frame and its moments through the chain.

    Returns a dict ready for JSON: ``photons`` (min, median, max per pixel), ``stages`` (below), ``counts`` of clipped
    pixels and ``K_dn_per_e``. Each stage holds mean and σ as they must be, averaged over the window (σ total,
    temporal, fixed), and as this frame shows them: σ_frame is the rms distance of the pixels from their own means.
    """
    stages = []
    signal: Any = photons
    moments = Moments(photons, 0.0, 0.0, frame)
    counts = {"clipped_full_well": 0, "clipped_adc_low": 0, "clipped_adc_high": 0}
    for stage in chain(camera):
        before = moments
        signal, moments = stage(signal, frame), stage.moments(moments)
        value = signal.total if isinstance(signal, Electrons) else signal
        stages.append(_entry(stage, value, before, moments))
        if type(stage).__name__ == "FullWell":
            counts["clipped_full_well"] = int(np.sum(value >= stage.full_well_e))
    counts["clipped_adc_low"] = int(np.sum(value <= 0))
    counts["clipped_adc_high"] = int(np.sum(value >= stage.highest))
    total = photons.total
    return {
        "photons": {"min": float(total.min()), "median": float(np.median(total)), "max": float(total.max())},
        "stages": stages,
        "counts": counts,
        "K_dn_per_e": gain_dn_per_e(camera),
    }


def _entry(stage: Any, value: Any, before: Moments, m: Moments) -> dict[str, Any]:
    """One line of the account, in the unit of the stage's room."""
    with np.errstate(invalid="ignore"):
        residual = np.nan_to_num(np.asarray(value, dtype=np.float64) - m.mean, nan=0.0, posinf=0.0)
    return {
        "name": stage_name(stage),
        "room": stage.room,
        "unit": UNITS[stage.room],
        "mean_expected": float(np.mean(m.mean)),
        "sigma_expected": m.sigma,
        "sigma_temporal_expected": float(np.sqrt(np.mean(m.temporal))),
        "sigma_fixed_expected": float(np.sqrt(np.mean(m.fixed))),
        "mean_frame": float(np.mean(value)),
        "sigma_frame": float(np.sqrt(np.mean(residual**2))),
    }


def stage_name(stage: Any) -> str:
    """``SourceFollowerNoise`` → ``source follower noise``: what a report calls a stage."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", type(stage).__name__).lower()
