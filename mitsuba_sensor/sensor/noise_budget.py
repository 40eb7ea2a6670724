"""Noise budget: what every source contributes to the pixels of one frame, and to the variances, in digital numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Frame, Moments, Photons
from ..core.backend import NUMPY_FLOAT64
from .stage import Chain, Stage, total


@dataclass(frozen=True, eq=False)
class Contribution:
    """What one source contributes to a frame.

    dn : its contribution to every pixel, (H, W) [DN].
    temporal_dn2, spatial_dn2 : what it adds to the two variances on average [DN²]; negative where a clip reduces noise.
    """

    source: str
    dn: NDArray[np.float64]
    temporal_dn2: float
    spatial_dn2: float


@dataclass(frozen=True, eq=False)
class NoiseBudget:
    """The contributions of all sources: they add up to the digital numbers, the variances to the moments.

    entries : one per source, in the order of the chain.
    """

    entries: tuple[Contribution, ...]

    @property
    def total(self) -> NDArray[np.float64]:
        """The sum of all contributions: the frame itself, (H, W) [DN]."""
        return np.asarray(np.sum([entry.dn for entry in self.entries], axis=0))

    def explain(self) -> str:
        """A table for people."""
        lines = [f"{'source':<26}{'mean':>12}{'rms':>12}{'temporal':>12}{'spatial':>12}   [DN, DN, DN², DN²]"]
        for e in self.entries:
            numbers = (e.dn.mean(), np.sqrt(np.mean((e.dn - e.dn.mean()) ** 2)), e.temporal_dn2, e.spatial_dn2)
            lines.append(f"{e.source:<26}" + "".join(f"{x:>12.5g}" for x in numbers))
        return "\n".join(lines)


def noise_budget(photons: Photons, frame: Frame, stages: Chain) -> NoiseBudget:
    """The contributions to one frame.

    A contribution is the change that a stage makes, carried to DN by the nominal gains of the stages behind it, so the
    changes of all stages add up to the frame.
    """
    contributions: list[Contribution] = []
    signal: Array = photons
    moments = Moments(photons, 0.0, 0.0, frame.on(NUMPY_FLOAT64))
    to_dn = float(np.prod([stage.nominal_gain for stage in stages]))
    before, was = np.zeros(frame.window.shape), (0.0, 0.0)
    for stage in stages:
        entering, means = signal, moments
        signal, moments = stage.sample(signal, frame), stage.moments(moments)
        to_dn = to_dn / stage.nominal_gain
        after = to_dn * np.broadcast_to(_float64(signal), before.shape)
        now = float(np.mean(moments.temporal)) * to_dn**2, float(np.mean(moments.spatial)) * to_dn**2
        change = Contribution(stage.label, after - before, now[0] - was[0], now[1] - was[1])
        contributions += _sources(stage, entering, signal, means, to_dn) or [change]
        before, was = after, now
    return NoiseBudget(tuple(contributions))


def _sources(stage: Stage, before: Array, after: Array, m: Moments, to_dn: float) -> list[Contribution]:
    """The contributions of a stage that has several sources; none for one that has one."""
    return [
        Contribution(label, to_dn * values, float(np.mean(variance)) * to_dn**2, 0.0)
        for label, (values, variance) in stage.noise_sources(before, after, m).items()
    ]


def _float64(signal: Array) -> Array:
    """The same in float64, so that the parts of a float32 frame add up too."""
    if isinstance(signal, Electrons):
        return np.add(signal.light, signal.dark, dtype=np.float64)
    return np.asarray(total(signal), dtype=np.float64)
