"""What a theory is asked about and what it answers: kinds of light, and moments at levels of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.types import Float64Array


class Expected(NamedTuple):
    """Mean, temporal and spatial variance of a signal at some levels of light, in the unit of its stage."""

    mean: Float64Array
    temporal: Float64Array
    spatial: Float64Array


def possible(moments: Float64Array, limits: tuple[float, float]) -> Float64Array:
    """Mean and variances (…, 3) without what an interpolation leaves beyond the limits of the signal, or below zero."""
    low, high = limits
    return np.clip(moments, [low, 0.0, 0.0], [high, np.inf, np.inf])


class LightKind(NamedTuple):
    """What else the counts of a pixel depend on.

    yield_mean, yield_variance : electrons per interaction.
    compensated : variance of a render that the shot noise compensates, as a share of the mean photoelectrons.
    """

    yield_mean: float = 1.0
    yield_variance: float = 0.0
    compensated: float = 0.0


PLAIN = LightKind()  # visible light that is known exactly
