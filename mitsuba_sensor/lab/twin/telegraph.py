"""Pixels whose dark current switches between two values: their share, step, duty and switching."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..frames.stack import Stack
from ..measure.rts_pixels import FEWEST_FRAMES, TelegraphPixels, rts_pixels
from ..quantity import Quantity, normal_interval
from .evidence import Fitted, frames_of

FEWEST = 4
"""Pixels from which on their duty and switching say something."""
SLOWEST = 1e-3
"""Switching per frame below which stacks look constant."""


@dataclass(frozen=True, eq=False)
class Telegraph:
    """share : of all pixels.  step : median [DN/s].  duty : share of the time that a trap is on.

    switching : probability per frame that a state is drawn anew.  site : 1 where a pixel has a trap, (H, W).
    mean : what the traps add to the mean of their pixels [DN/s], (H, W).
    """

    share: Fitted
    step: Fitted
    duty: Fitted
    switching: Fitted
    site: NDArray[np.float64]
    mean: NDArray[np.float64]


def telegraph(stack: Stack) -> Telegraph | None:
    """Of the longest dark stack; None where no pixel switches, or with fewer frames than that shows."""
    if len(stack) < FEWEST_FRAMES or not stack.exposure_s:
        return None
    found, frames = rts_pixels(stack), frames_of(stack)
    if len(found.steps) < FEWEST or not found.step.low > 0:
        return None
    site, mean = np.zeros(stack.shape), np.zeros(stack.shape)
    site[found.rows, found.columns] = 1.0
    mean[found.rows, found.columns] = found.shares * found.steps / stack.exposure_s
    step, share = (
        found.step.scaled(1 / stack.exposure_s, "DN/s"),
        found.fraction.scaled(0.01, ""),
    )
    return Telegraph(
        Fitted(share, frames),
        Fitted(step, frames),
        Fitted(_duty(found), frames),
        Fitted(_switching(stack, found), frames),
        site,
        mean,
    )


def _duty(found: TelegraphPixels) -> Quantity:
    error = float(found.shares.std(ddof=1)) / math.sqrt(len(found.shares))
    value, low, high = normal_interval(float(found.shares.mean()), error)
    return Quantity(
        "duty",
        "share of the time that a trap is on",
        value,
        max(low, 0.0),
        min(high, 1.0),
        "",
        "fit",
    )


def _switching(stack: Stack, found: TelegraphPixels) -> Quantity:
    """1 − ρ, ρ the correlation of a state with that of the next frame."""
    values = stack.frames[:, found.rows, found.columns].astype(np.float64)
    middle = values.min(axis=0) + 0.5 * (values.max(axis=0) - values.min(axis=0))
    state = (values > middle).astype(np.float64)
    rest = state - state.mean(axis=0)
    power = np.square(rest).sum(axis=0)
    each = (rest[1:] * rest[:-1]).sum(axis=0)
    sample = float(each.sum() / power.sum())
    error = (
        float(np.std(each - sample * power, ddof=1)) * math.sqrt(len(each)) / float(power.sum())
    )
    correlation = _without_bias(sample, len(stack))
    error *= (_without_bias(sample + error, len(stack)) - correlation) / error if error else 1.0
    value, low, high = (
        min(max(1 - one, SLOWEST), 1.0) for one in normal_interval(correlation, -error)
    )
    ordered = value, min(low, value), max(high, value)
    return Quantity(
        "switching",
        "probability per frame that a trap's state is drawn anew",
        *ordered,
        "",
        "fit",
    )


def _without_bias(sample: float, frames: int) -> float:
    """ρ of a sample's Σ x(t)x(t+1)/Σ x(t)²: subtracting the mean over N frames takes g = (1 + ρ)/(1 − ρ) off both sums.

    Solved by iteration: sample = ((N − 1)ρ − g)/(N − g).
    """
    found = sample
    for _ in range(50):
        taken = min((1 + found) / max(1 - found, 1e-3), 0.5 * frames)
        found = min(max((sample * (frames - taken) + taken) / (frames - 1), -0.9), 1 - SLOWEST)
    return found
