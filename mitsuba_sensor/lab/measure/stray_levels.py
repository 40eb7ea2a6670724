"""Levels of light that are off the curve of the others: their photons or their exposure are not what is stated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.series import Level

FEWEST = 6
"""Levels of which one can be said to be off the curve of the others."""
MOST_SHARE = 0.2
"""Share of the levels up to which those that are off are named; of more, the light is what scatters."""
LIMIT = 8.0
"""Distance from the curve, over its own standard error and over the robust σ of all distances, from which on a level is
off: light that scatters, of whatever distribution, has no such level."""
LEAST_SHARE = 0.002
"""Smallest distance from the curve that is named: more than a smooth curve has between neighbouring levels."""
CANDIDATES = 4


class Distances(NamedTuple):
    """share : of the signal by which each level is off the line through its neighbours.  score : over σ, and over the
    limit, so that a level with 1 or more is off; (n,) each."""

    share: Float64Array
    score: Float64Array


def stray_levels(
    light: Float64Array, signal: Float64Array, errors: Float64Array
) -> dict[int, float]:
    """Numbers of the levels that are off the curve of the others, and the share of the signal by which they are.

    light, signal, errors : of levels in ascending order, (n,).  errors : standard errors of the signals [DN].

    Every level is compared with the straight line through its two neighbours, so that a smooth curve is no reason. Of
    the levels that are most off, that is taken out without which the others are least off, and so on.
    """
    if len(light) < FEWEST:
        return {}
    kept = np.arange(len(light))
    found: list[int] = []
    while len(kept) >= FEWEST and len(found) <= MOST_SHARE * len(light):
        score = _distances(light[kept], signal[kept], errors[kept]).score
        if score.max() < 1:
            break
        candidates = np.argsort(score)[-CANDIDATES:]
        rest = [np.delete(kept, place) for place in candidates]
        worst = [_distances(light[k], signal[k], errors[k]).score.max() for k in rest]
        best = int(np.argmin(worst))
        found.append(int(kept[candidates[best]]))
        kept = rest[best]
    if len(found) > max(1.0, MOST_SHARE * len(light)):
        return {}
    if not found:
        return {}
    _, first = np.unique(light[kept], return_index=True)
    line = scipy.interpolate.make_interp_spline(light[kept][first], signal[kept][first], k=1)
    curve = line(light)
    return {number: float(signal[number] / curve[number] - 1) for number in sorted(found)}


def _distances(light: Float64Array, signal: Float64Array, errors: Float64Array) -> Distances:
    """Distances of levels, at least 3, from the line through their neighbours, or the next two at an end."""
    number = np.arange(len(light))
    first = np.clip(number - 1, 0, None)
    second = np.clip(number + 1, None, len(light) - 1)
    first[0], second[0], first[-1], second[-1] = 1, 2, len(light) - 3, len(light) - 2
    step = np.maximum(light[second] - light[first], 1e-300)
    weight = (light - light[first]) / step
    share = (signal - (1 - weight) * signal[first] - weight * signal[second]) / signal
    own = np.sqrt(
        errors**2 + ((1 - weight) * errors[first]) ** 2 + (weight * errors[second]) ** 2
    )
    grown = np.sqrt(1 + (1 - weight) ** 2 + weight**2)
    scatter = 1.4826 * float(np.median(np.abs(share / grown)))
    limit = LIMIT * np.maximum(scatter * grown, own / signal)
    return Distances(share, np.abs(share) / np.maximum(limit, LEAST_SHARE))


def note_stray(stray: dict[int, float], levels: Sequence[Level], unit: str) -> str:
    """Which levels are left out and by how much they are off, or nothing."""
    texts: list[str] = []
    for number, share in stray.items():
        level = levels[number]
        light = level.photons
        if light is None:
            light = level.exposure_s
        texts.append(
            f"{level.source} is {100 * share:+.3g} % off the others at {light:.4g} {unit}"
        )
    if not texts:
        return ""
    return f"left out, because their light is not what is stated: {'; '.join(texts)}"
