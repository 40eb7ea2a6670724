"""Mean and variance of every pixel's code, or the chance of a code, with derivatives by light and camera.

A code c = m + z·√v has the derivative dm + (c − m)·dv/(2v): then the mean of dc over frames is dm, and that of 2c·dc is
d(m² + v), whatever the steps of the converter and its clips make of the law.
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
"""Step of a difference of light, in its shot noise: the frames of a lattice jump from code to code."""

STEP, STEP_OF_LATTICE = 1e-4, 1e-2
"""Step of a difference of a number of the camera, relative to its value."""

STILL_DN2 = 1e-9
"""A code that varies by less has no derivative by its noise [DN²]."""

Law = Callable[[Chain, Electrons, Frame], Float64Array]
"""Values (R, H, W) of the pixels of a window, by mean photoelectrons."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """Values of a law, (R, H, W), and their derivatives by the light of the same pixel and by names."""

    values: Float64Array
    by_light: Float64Array | None = None
    by_name: Mapping[str, Float64Array] = field(default_factory=dict)

    def of_code(self, slope: Float64Array, codes: Array) -> Float64Array:
        """Derivative of the codes of a frame, of that of mean and variance."""
        (mean, variance), (by_mean, by_variance) = self.values, slope
        still = variance < STILL_DN2
        pulled = (codes - mean) * by_variance / np.where(still, 1.0, 2 * variance)
        return np.asarray(by_mean + np.where(still, 0.0, pulled))

    def attached(
        self, light_e: Array, changes: Mapping[str, Array], codes: Float64Array | None = None
    ) -> Array:
        """The first of the values, or codes of a frame, as a part of a graph of derivatives.

        light_e : mean photoelectrons, (H·W).  changes : by name, a variable minus its value.
        """
        dr, number = drjit(), type(light_e)

        def flat(slope: Float64Array) -> Array:
            moved = slope[0] if codes is None else self.of_code(slope, codes)
            return number(moved.astype(np.float32).ravel())

        found = number((self.values[0] if codes is None else codes).astype(np.float32).ravel())
        if self.by_light is not None:
            found = found + flat(self.by_light) * (light_e - dr.detach(light_e))
        for name, slope in self.by_name.items():
            found = found + flat(slope) * changes[name]
        return found


def mean_and_variance(stages: Chain, light: Electrons, frame: Frame) -> Float64Array:
    """Of the codes, (2, H, W)."""
    photons = Photons(np.asarray(light.light), detected=True)
    mean, variance, _ = pixel_moments(stages, Detected(photons, light), frame)
    return np.array([mean, variance], np.float64)


def chance_of(codes: Float64Array, render_e2: Float64Array) -> Law:
    """Logarithm of the probability of these codes (H, W). The law raises NotStraight.

    render_e2 : (H, W) variance of the mean photoelectrons, which the render estimates.
    """

    def law(stages: Chain, light: Electrons, frame: Frame) -> Float64Array:
        found = log_chance(line_of(stages, light, frame), codes.ravel(), render_e2.ravel())
        return found.reshape(1, *codes.shape)

    return law


def slopes_by_light(law: Law, stages: Chain, light: Electrons, frame: Frame) -> Float64Array:
    """Derivatives by the mean photoelectrons, through three levels of light about them."""
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
    """Derivatives by numbers of camera and exposure.

    light_of : mean photoelectrons of a camera.  of_light : names on which the light depends beside the chain.
    Raises InputError for a name that has no derivative.
    """

    def values(camera: Camera, exposure: Exposure) -> Float64Array:
        changed = replace(
            frame,
            exposure=exposure,
            window=replace(frame.window, _maps={}, _tiles={}),
            _blocks={},
        )
        return law(camera.stages, light_of(camera, exposure), changed)

    is_smooth = is_straight(camera.stages, light_of(camera, frame.exposure), frame)
    numbers = Parameters(camera, frame.exposure, STEP if is_smooth else STEP_OF_LATTICE)
    return {name: numbers.derivative(name, values, of_light) for name in names}
