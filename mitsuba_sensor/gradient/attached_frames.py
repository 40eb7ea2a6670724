"""Frames as a part of somebody else's graph of derivatives: from mean photoelectrons on Dr.Jit to digital numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..camera.camera import Camera
from ..camera.figures import refuse_readouts
from ..core import Array, Electrons, Exposure, Frame, Photons, SensorWindow
from ..core.code_slope import LARGEST_DN
from ..core.differentiable import DifferentiableBackend
from ..sensor.choices import check_law
from ..sensor.detection import uploaded
from ..sensor.map_checks import checked_maps
from ..sensor.run import begin
from ..stages.chain import chain, whole_chain
from ..stages.stage import Chain, sample
from ..theory.response import least_noise_dn
from .conditional_slope import ConditionalSlope
from .field_derivatives import Recording
from .pixel_law import PixelLaw, pixel_law


@dataclass(frozen=True)
class Pixels:
    """Which pixels: serial number of the camera, rows and columns, and row and column of the first pixel."""

    serial: int
    shape: tuple[int, int]
    origin: tuple[int, int] = (0, 0)


@dataclass(frozen=True, eq=False)
class AttachedFrames:
    """Frames of one camera and exposure; their FPN maps are computed.

    first : the first frame, on a backend that knows the derivatives of the numbers of the camera.
    """

    stages: Chain
    first: Frame = field(repr=False)

    def sampled(self, light_e: Array, changes: Mapping[str, Array], seed: int) -> Array:
        """Digital numbers of the first frame of a seed, (H·W), whose derivatives are those of ``ms.differentiable``."""
        frame = self._frame(changes, seed)
        slope = ConditionalSlope.of(self.stages)
        if least_noise_dn(self.stages, self.first) < LARGEST_DN:
            return slope.sample(Electrons(light_e), frame)
        return sample(self.stages[1:], Electrons(light_e), frame)

    def law(self, light_e: Array, changes: Mapping[str, Array]) -> PixelLaw:
        """The law of every pixel. Raises InputError for a chain that has none."""
        slope = ConditionalSlope.of(self.stages)
        return pixel_law(slope, Electrons(light_e), self._frame(changes, self.first.seed))

    def _frame(self, changes: Mapping[str, Array], seed: int) -> Frame:
        backend = self.first.window.backend
        assert isinstance(backend, DifferentiableBackend)
        _, window = backend.attached(self.first.window, changes)
        return replace(self.first, window=window, seed=seed, _blocks={})


@lru_cache(maxsize=4)
def attached_frames(
    camera: Camera,
    exposure: Exposure,
    pixels: Pixels,
    names: tuple[str, ...],
    of_light: tuple[str, ...],
    backend: str,
) -> AttachedFrames:
    """Frames with derivatives by these numbers. An optimiser asks for the same ones again and again: the last are kept.

    of_light : those of ``names`` that the light depends on.  backend : "llvm" or "cuda".
    Raises InputError for numbers that have no derivative.
    """
    return attached_frames_with_maps(camera, exposure, pixels, names, of_light, backend, {})


def attached_frames_with_maps(
    camera: Camera,
    exposure: Exposure,
    pixels: Pixels,
    names: tuple[str, ...],
    of_light: tuple[str, ...],
    backend: str,
    maps: Mapping[str, ArrayLike],
) -> AttachedFrames:
    """The same with measured FPN maps."""
    refuse_readouts(camera, "derivatives are those of one read-out")
    stages = chain(camera)
    check_law(stages, "derivatives of the expected code are", "compute differences of frames")
    window = SensorWindow(pixels.serial, pixels.shape, pixels.origin, camera=camera.name)
    given = checked_maps(maps, whole_chain(camera), window, camera)
    first = Frame(exposure, replace(window, given=given), gain=camera.gain or "")
    recording = recording_of(camera, first)
    first = first.on(DifferentiableBackend(backend, recording.by(names, of_light)))
    zeros = uploaded(Electrons(np.zeros(pixels.shape, np.float32)), first)
    begin(stages, zeros, first)
    return AttachedFrames(stages, first)


def recording_of(camera: Camera, first: Frame) -> Recording:
    """One pixel of photoelectrons."""
    return Recording.of(Photons(np.ones(first.window.shape), detected=True), camera, first)
