"""Moments of a uniform signal through a chain: by the moments of each stage, or measured by its samples."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..core import Electrons, Frame, Moments, SensorWindow
from ..core.backend import normals
from ..core.types import Array, Float64Array
from .stage import Stage, total

SERIALS, SIDE_PX, FIRST_SERIAL = 16, 64, 2**30
"""Windows of so many pixels squared, each of a serial number of its own, by which a stage is measured."""

FRAMES = (0, 100_000)
"""Numbers of the two frames of each: so far apart that a telegraph signal has forgotten its state."""

SIGNAL = "signal of a measured stage"
"""Source of the random numbers of the noise that enters."""


def has_moments(stage: Stage) -> bool:
    """Whether a stage states what it does to mean and variances."""
    return type(stage).moments is not Stage.moments


def propagate(stages: Iterable[Stage], m: Moments) -> Moments:
    """Moments behind these stages, one stage after the other; a stage without any is measured."""
    for stage in stages:
        if has_moments(stage):
            m = stage.moments(m)
        else:
            m = measured_behind(stage, m)
    return m


def measured_behind(stage: Stage, m: Moments) -> Moments:
    """Moments behind one stage by its samples, for normal noise about the average of the signal that enters.

    Two frames of one pixel differ by temporal noise alone, and the product of their distances from the mean has that of
    spatial noise.
    """
    size = SIDE_PX, SIDE_PX
    first, second = np.empty((2, SERIALS, *size))
    light_e = np.zeros(size)
    for number in range(SERIALS):
        window = SensorWindow(
            FIRST_SERIAL + number, size, m.frame.window.origin, camera=m.frame.window.camera
        )
        for index, signals in zip(FRAMES, (first, second), strict=True):
            frame = replace(m.frame, window=window, index=index, _blocks={})
            signal = stage.sample(_entering(stage, m, frame), frame)
            signals[number] = total(signal)
            if isinstance(signal, Electrons):
                light_e += signal.light / (2 * SERIALS)
    mean = float((first + second).mean() / 2)
    spatial = max(float(np.mean((first - mean) * (second - mean))), 0.0)
    temporal = float(np.mean((first - second) ** 2) / 2)
    if m.light is None:
        light = None
    else:
        light = replace(m.light, mean=float(light_e.mean()))
    return replace(m, mean=mean, temporal=temporal, spatial=spatial, light=light)


def _entering(stage: Stage, m: Moments, frame: Frame) -> Array:
    """One frame of a normal signal with these moments, averaged over their pixels."""
    mean, temporal, spatial = (float(np.mean(x)) for x in (m.mean, m.temporal, m.spatial))
    noise: Float64Array = np.sqrt(temporal) * frame.normal(SIGNAL)
    pattern = np.sqrt(spatial) * frame.window.fixed_map(SIGNAL, normals)
    signal = mean + noise + pattern
    if stage.domain != "electrons":
        return signal
    if m.light is None:
        dark = 0.0
    else:
        dark = mean - float(np.mean(m.light.mean))
    return Electrons(signal - dark, dark)
