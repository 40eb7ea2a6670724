"""Every electron accounted for: theory and sample of one frame, stage by stage and source by source."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.backend import NUMPY_FLOAT64
from ..core.frame import Frame
from ..core.moments import Moments
from ..core.signals import Electrons, Photons
from .camera import Camera
from .chain import gain_dn_per_e
from .compensation import LIMIT, compensable
from .electrons import ShotNoise

UNITS = {"photons": "photons", "electrons": "e-", "volts": "V", "DN": "DN"}


def stage_report(photons: Photons, camera: Camera, frame: Frame, stages: tuple[Any, ...]) -> dict[str, Any]:
    """Follow one frame and its moments through the chain.

    Returns a dict ready for JSON: ``photons`` (min, median, max per pixel; of electrons where they are ``detected``),
    ``stages`` (below), ``counts`` of clipped and cut pixels, photons ``outside_qe`` and ``K_dn_per_e``. Each stage
    holds mean and σ as they must be, averaged over the window (σ total, temporal, fixed), and as this frame shows them:
    σ_frame is the rms distance of the pixels from their own means. Photons with ``variance_e2`` have ``spending`` too,
    and the count ``compensated_short``.
    """
    lines = []
    spending: dict[str, Any] = {}
    signal: Any = photons
    moments = Moments(photons, 0.0, 0.0, frame.on(NUMPY_FLOAT64))
    counts = {"clipped_full_well": 0, "clipped_adc_low": 0, "clipped_adc_high": 0}
    for stage in stages:
        if isinstance(stage, ShotNoise) and signal.variance_e2 is not None:
            counts["compensated_short"], spending["spending"] = _spending(signal)
        signal, moments = stage(signal, frame), stage.moments(moments)
        value = plain(signal)
        lines.append(_line(stage, value, moments))
        if hasattr(stage, "maps"):
            counts |= _cut_to_zero(stage.maps(frame.window))
        if hasattr(stage, "full_well_e"):
            counts["clipped_full_well"] = int(np.sum(value >= stage.full_well_e))
    counts["clipped_adc_low"] = int(np.sum(value <= 0))
    counts["clipped_adc_high"] = int(np.sum(value >= stages[-1].highest))
    total = stages[0](photons, frame).light if photons.detected else photons.total
    return {
        "photons": {
            "min": float(total.min()),
            "median": float(np.median(total)),
            "max": float(total.max()),
            "detected": photons.detected,
        },
        "stages": lines,
        "counts": counts,
        **spending,
        "outside_qe": outside_qe(photons, camera),
        "K_dn_per_e": gain_dn_per_e(camera),
    }


def outside_qe(photons: Photons, camera: Camera) -> dict[str, Any]:
    """Bands beyond the ends of the QE curve, where nothing is detected: wavelengths [nm], share of all photons."""
    points = camera.quantum_efficiency.wavelengths_nm
    if photons.wavelengths_nm is None or photons.mean.ndim == 2:
        return {"wavelengths_nm": [], "share_of_photons": 0.0}
    outside = (photons.wavelengths_nm < points[0]) | (photons.wavelengths_nm > points[-1])
    finite = np.where(np.isfinite(photons.mean), photons.mean, 0.0).sum(axis=(0, 1))
    share = float(finite[outside].sum() / finite.sum()) if finite.sum() else 0.0
    return {"wavelengths_nm": photons.wavelengths_nm[outside].tolist(), "share_of_photons": share}


def _spending(mean: Electrons) -> tuple[int, dict[str, float]]:
    """In how many pixels the render's variance could not be spent in full, and averages over the window.

    ``variance_e2``, ``compensated_e2``, ``left_e2`` : of the render, compensated, and left on top of the shot noise.
    ``left_over_shot`` : the last over the mean electrons of the pixels with a render's variance, that is by which share
    theirs is too large.
    """
    by_light, by_dark = compensable(mean.light, mean.dark, mean.variance_e2)
    spent, shot = by_light + by_dark, np.where(mean.variance_e2 > 0, mean.total, 0.0)
    of_render, of_frame, shot_e = (float(np.mean(x, dtype=np.float64)) for x in (mean.variance_e2, spent, shot))
    left = of_render - of_frame
    return int(np.sum(spent < mean.variance_e2)), {
        "limit": LIMIT,
        "variance_e2": of_render,
        "compensated_e2": of_frame,
        "left_e2": left,
        "left_over_shot": left / shot_e if shot_e else 0.0,
    }


def _cut_to_zero(maps: dict[str, Any]) -> dict[str, int]:
    """How many pixels of a gain or dark map a normal or logistic law would have made negative."""
    factors = ("prnu", "dark_fpn", "prnu_col")
    return {f"cut_to_zero_{name}": int(np.sum(maps[name] <= 0)) for name in factors if name in maps}


def _line(stage: Any, value: Any, m: Moments) -> dict[str, Any]:
    """One line of the account, in the unit of the stage's room."""
    with np.errstate(invalid="ignore"):
        residual = np.nan_to_num(np.asarray(value, dtype=np.float64) - m.mean, nan=0.0, posinf=0.0)
        if getattr(value, "dtype", None) == np.float32:  # the last digit of a float32 is no noise
            residual = np.where(np.abs(residual) <= np.spacing(np.abs(value)), 0.0, residual)
    return {
        "name": stage_name(stage),
        "room": stage.domain,
        "unit": UNITS[stage.domain],
        "mean_expected": float(np.mean(m.mean)),
        "sigma_expected": m.sigma,
        "sigma_temporal_expected": float(np.sqrt(np.mean(m.temporal))),
        "sigma_spatial_expected": float(np.sqrt(np.mean(m.spatial))),
        "mean_frame": float(np.mean(value, dtype=np.float64)),
        "sigma_frame": float(np.sqrt(np.mean(residual**2))),
    }


@dataclass(frozen=True, eq=False)
class Contribution:
    """What one source put into a frame.

    dn : its contribution to every pixel, (H, W) [DN].
    temporal_dn2, spatial_dn2 : how far it moves the two variances on average [DN²]; negative where a clip eats noise.
    """

    source: str
    dn: NDArray[np.float64]
    temporal_dn2: float
    spatial_dn2: float


@dataclass(frozen=True, eq=False)
class NoiseBudget:
    """A frame taken apart: the contributions add up to the digital numbers, the variances to the moments.

    entries : one per source, in the order of the chain.
    """

    entries: tuple[Contribution, ...]

    @property
    def total(self) -> NDArray[np.float64]:
        """The sum of all contributions: the frame itself, (H, W) [DN]."""
        return np.sum([entry.dn for entry in self.entries], axis=0)

    def explain(self) -> str:
        """A table for people."""
        lines = [f"{'source':<26}{'mean':>12}{'rms':>12}{'temporal':>12}{'fixed':>12}   [DN, DN, DN², DN²]"]
        for e in self.entries:
            numbers = (e.dn.mean(), np.sqrt(np.mean((e.dn - e.dn.mean()) ** 2)), e.temporal_dn2, e.spatial_dn2)
            lines.append(f"{e.source:<26}" + "".join(f"{x:>12.5g}" for x in numbers))
        return "\n".join(lines)


def noise_budget_of(photons: Photons, frame: Frame, stages: tuple[Any, ...]) -> NoiseBudget:
    """Take one frame apart by the named streams.

    A contribution is the change that a stage makes, carried to DN by the nominal gains of the stages after it, so the
    changes of all stages telescope to the frame.
    """
    entries: list[Contribution] = []
    signal: Any = photons
    moments = Moments(photons, 0.0, 0.0, frame.on(NUMPY_FLOAT64))
    to_dn = np.prod([getattr(stage, "nominal_gain", 1.0) for stage in stages])
    before, was = np.zeros(frame.window.shape), (0.0, 0.0)
    for stage in stages:
        electrons_before, means = signal, moments
        signal, moments = stage(signal, frame), stage.moments(moments)
        to_dn = to_dn / getattr(stage, "nominal_gain", 1.0)
        after = to_dn * np.broadcast_to(_exact(signal), before.shape)
        now = float(np.mean(moments.temporal)) * to_dn**2, float(np.mean(moments.spatial)) * to_dn**2
        change = Contribution(stage_name(stage), after - before, now[0] - was[0], now[1] - was[1])
        entries += _shot_parts(electrons_before, signal, means, to_dn) if change.source == "shot noise" else [change]
        before, was = after, now
    return NoiseBudget(tuple(entries))


def _shot_parts(mean: Electrons, counted: Electrons, m: Moments, to_dn: float) -> list[Contribution]:
    """Photon shot noise and dark shot noise apart; the variance of each is its mean, less what it spends."""
    light = (m.light or m).mean
    spent = (0.0, 0.0) if m.variance_e2 is None else compensable(light, m.mean - light, m.variance_e2)
    shape = np.broadcast_shapes(np.shape(mean.light), np.shape(counted.light))
    pairs = (
        ("photon shot noise", np.subtract(counted.light, mean.light, dtype=np.float64), light - spent[0]),
        ("dark shot noise", np.subtract(counted.dark, mean.dark, dtype=np.float64), m.mean - light - spent[1]),
    )
    return [
        Contribution(name, np.broadcast_to(to_dn * dn, shape), float(np.mean(v)) * to_dn**2, 0.0)
        for name, dn, v in pairs
    ]


def _exact(signal: Any) -> Any:
    """The same in float64, so that the parts of a float32 frame add up too."""
    if isinstance(signal, Electrons):
        return np.add(signal.light, signal.dark, dtype=np.float64)
    return np.asarray(plain(signal), dtype=np.float64)


def plain(signal: Any) -> Any:
    """The signal of any room as an array: photons of all bands, electrons of light and dark together."""
    return signal.total if isinstance(signal, Photons | Electrons) else signal


def stage_name(stage: Any) -> str:
    """``SourceFollowerNoise`` → ``source follower noise``: what a report calls a stage."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", type(stage).__name__).lower()
