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
    """Traps of the longest dark stack; None where no pixel switches, or with fewer frames than that shows."""
    if len(stack) < FEWEST_FRAMES or not stack.exposure_s:
        return None
    pixels, frames = rts_pixels(stack), frames_of(stack)
    if len(pixels.steps) < FEWEST or not pixels.step.low > 0:
        return None
    site, mean = np.zeros(stack.shape), np.zeros(stack.shape)
    site[pixels.rows, pixels.columns] = 1.0
    mean[pixels.rows, pixels.columns] = pixels.shares * pixels.steps / stack.exposure_s
    return Telegraph(
        share=Fitted(pixels.fraction.scaled(0.01, ""), frames),
        step=Fitted(pixels.step.scaled(1 / stack.exposure_s, "DN/s"), frames),
        duty=Fitted(_duty(pixels), frames),
        switching=Fitted(_switching(stack, pixels), frames),
        site=site,
        mean=mean,
    )


def _duty(pixels: TelegraphPixels) -> Quantity:
    """Mean share of the frames in the upper level."""
    error = float(pixels.shares.std(ddof=1)) / math.sqrt(len(pixels.shares))
    value, low, high = normal_interval(float(pixels.shares.mean()), error)
    name = "share of the time that a trap is on"
    return Quantity("duty", name, value, max(low, 0.0), min(high, 1.0), "", "fit")


def _switching(stack: Stack, pixels: TelegraphPixels) -> Quantity:
    """1 − ρ, ρ the correlation of a state with that of the next frame."""
    values = stack.frames[:, pixels.rows, pixels.columns].astype(np.float64)
    middle = values.min(axis=0) + 0.5 * (values.max(axis=0) - values.min(axis=0))
    state = (values > middle).astype(np.float64)
    rest = state - state.mean(axis=0)
    power = np.square(rest).sum(axis=0)
    products = (rest[1:] * rest[:-1]).sum(axis=0)
    sample = float(products.sum() / power.sum())
    scatter = float(np.std(products - sample * power, ddof=1))
    error = scatter * math.sqrt(len(products)) / float(power.sum())
    correlation = _without_bias(sample, len(stack))
    if error:
        error *= (_without_bias(sample + error, len(stack)) - correlation) / error
    value, low, high = (
        min(max(1 - rho, SLOWEST), 1.0) for rho in normal_interval(correlation, -error)
    )
    name = "probability per frame that a trap's state is drawn anew"
    return Quantity("switching", name, value, min(low, value), max(high, value), "", "fit")


def _without_bias(sample: float, frames: int) -> float:
    """ρ of a sample's Σ x(t)x(t+1)/Σ x(t)²: subtracting the mean over N frames takes g = (1 + ρ)/(1 − ρ) off both sums.

    Solved by iteration: sample = ((N − 1)ρ − g)/(N − g).
    """
    rho = sample
    for _ in range(50):
        taken = min((1 + rho) / max(1 - rho, 1e-3), 0.5 * frames)
        rho = min(max((sample * (frames - taken) + taken) / (frames - 1), -0.9), 1 - SLOWEST)
    return rho
