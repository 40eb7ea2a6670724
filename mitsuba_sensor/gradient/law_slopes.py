"""Mean and variance of every pixel's code, or the probability of a code, with derivatives by light and camera.

A code c = m + z·√v has the derivative dm + (c − m)·dv/(2v). Then the mean of dc over frames is dm and the mean of 2c·dc
is d(m² + v), also with the steps and clips of the ADC.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..camera.camera import Camera
from ..core import Array, Electrons, Exposure, Float64Array, Frame, Photons
from ..core.llvm import drjit
from ..sensor.detection import Detected
from ..stages.stage import Chain
from ..stages.straight import line_of, log_chance
from ..theory.clean import is_straight, pixel_moments
from .parameters import Parameters

LIGHT_STEP, LIGHT_STEP_OF_LATTICE = 0.02, 0.3
"""Step of a finite difference in light over its shot noise; frames of a lattice change in steps."""

STEP, STEP_OF_LATTICE = 1e-4, 1e-2
"""Relative step of a finite difference in a camera field."""

VARIANCE_MIN_DN2 = 1e-9
"""A code with less variance has no derivative by its noise."""

Law = Callable[[Chain, Electrons, Frame], Float64Array]
"""Maps mean photoelectrons to values of the pixels of a window, shape (R, H, W)."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """Values of a law, shape (R, H, W), and their derivatives by the light of the same pixel and by names."""

    values: Float64Array
    by_light: Float64Array | None = None
    by_name: Mapping[str, Float64Array] = field(default_factory=dict)

    def of_code(self, slope: Float64Array, codes: Array) -> Float64Array:
        """Return the derivative of the codes of a frame, from the derivative of mean and variance."""
        (mean, variance), (by_mean, by_variance) = self.values, slope
        still = variance < VARIANCE_MIN_DN2
        pulled = (codes - mean) * by_variance / np.where(still, 1.0, 2 * variance)
        return np.asarray(by_mean + np.where(still, 0.0, pulled))

    def attached(
        self, light_e: Array, changes: Mapping[str, Array], codes: Float64Array | None = None
    ) -> Array:
        """Return the first of the values, or the codes of a frame, in a graph of derivatives.

        light_e : mean photoelectrons, shape (H·W,).  changes : name → variable minus its value.
        """
        dr, number = drjit(), type(light_e)

        def flat(slope: Float64Array) -> Array:
            moved = slope[0] if codes is None else self.of_code(slope, codes)
            return number(moved.astype(np.float32).ravel())

        total = number((self.values[0] if codes is None else codes).astype(np.float32).ravel())
        if self.by_light is not None:
            total = total + flat(self.by_light) * (light_e - dr.detach(light_e))
        for name, slope in self.by_name.items():
            total = total + flat(slope) * changes[name]
        return total


def mean_and_variance(stages: Chain, light: Electrons, frame: Frame) -> Float64Array:
    """Return mean and variance of the codes, shape (2, H, W)."""
    photons = Photons(np.asarray(light.light), detected=True)
    mean, variance, _ = pixel_moments(stages, Detected(photons, light), frame)
    return np.array([mean, variance], np.float64)


def chance_of(codes: Float64Array, render_e2: Float64Array) -> Law:
    """Return the law of the log-probability of codes (H, W). The law raises NotStraight.

    render_e2 : (H, W) variance of the mean photoelectrons from the render.
    """

    def law(stages: Chain, light: Electrons, frame: Frame) -> Float64Array:
        line = line_of(stages, light, frame)
        return log_chance(line, codes.ravel(), render_e2.ravel()).reshape(1, *codes.shape)

    return law


def slopes_by_light(law: Law, stages: Chain, light: Electrons, frame: Frame) -> Float64Array:
    """Return derivatives by the mean photoelectrons, from three neighbouring light levels."""
    light_e = np.asarray(light.light, np.float64)
    share = LIGHT_STEP if is_straight(stages, light, frame) else LIGHT_STEP_OF_LATTICE
    step = share * np.sqrt(np.maximum(light_e, 1.0))
    low_e = np.maximum(light_e - step, 0.0)
    low, middle, high = (
        law(stages, replace(light, light=low_e + k * step), frame) for k in range(3)
    )
    off = light_e - (low_e + step)
    return (high - low) / (2 * step) + off * (high - 2 * middle + low) / step**2


def slopes_by_names(
    law: Law,
    light_of: Callable[[Camera, Exposure], Electrons],
    camera: Camera,
    frame: Frame,
    names: Collection[str],
    of_light: Collection[str] = (),
) -> dict[str, Float64Array]:
    """Return derivatives by fields of camera and exposure.

    light_of : returns the mean photoelectrons of a camera.  of_light : names that also change the light.
    Raises InputError for a name without derivative.
    """

    def values(camera: Camera, exposure: Exposure) -> Float64Array:
        window = replace(frame.window, _maps={})
        changed = replace(frame, exposure=exposure, window=window, _blocks={})
        return law(camera.stages, light_of(camera, exposure), changed)

    is_smooth = is_straight(camera.stages, light_of(camera, frame.exposure), frame)
    numbers = Parameters(camera, frame.exposure, STEP if is_smooth else STEP_OF_LATTICE)
    return {name: numbers.derivative(name, values, of_light) for name in names}
