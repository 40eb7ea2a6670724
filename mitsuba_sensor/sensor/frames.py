"""Frames: the raw frames of one exposure, with their theory, report and files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Frame, InputError, Photons
from ..core.backend import Backend
from .camera import Camera
from .checks import check_chip, check_reference_shape, check_streams
from .detection import Detected
from .frame_notes import exposure_notes
from .frame_theory import FrameTheory
from .noise_budget import NoiseBudget
from .pixel_moments import PixelMoments, pixel_moments
from .plan import Plan
from .report import FrameObserver, report
from .stage import Chain


@dataclass(frozen=True, eq=False, repr=False)
class Frames:
    """Raw frames of one camera.

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    plan : what was left out of the chain, where ``plan`` or ``tolerance_dn`` was given.
    detected : mean photoelectrons of the light.  backend : what computed the frames.
    photons, photoelectrons, dark_electrons, electrons, volts, input_referred_electrons : (N, H, W) float64 if asked for
        by ``keep``, else None.
    """

    digital: NDArray[np.unsignedinteger]
    camera: Camera
    light: Photons
    first: Frame
    stages: Chain
    detected: Detected
    backend: Backend
    plan: Plan | None = None
    photons: NDArray[np.float64] | None = None
    photoelectrons: NDArray[np.float64] | None = None
    dark_electrons: NDArray[np.float64] | None = None
    electrons: NDArray[np.float64] | None = None
    volts: NDArray[np.float64] | None = None
    input_referred_electrons: NDArray[np.float64] | None = None

    @cached_property
    def theory(self) -> FrameTheory:
        """Theory of every pixel of these frames."""
        return self._observer.theory

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Sentences on light, camera and frames that may surprise, as frame.json, command line and notebook show them.

        Where one says that the result is probably not what was wanted, there was a :class:`SensorWarning` too.
        """
        source = self.light.source
        of_light = () if source is None else source.notes
        return (*of_light, *self._exposure_notes, *self._render_noise[1])

    @cached_property
    def _render_noise(self) -> tuple[dict[str, float | None], tuple[str, ...]]:
        """What the render's noise means in these frames, and the notes on it; nothing without a render."""
        source = self.light.source
        return ({}, ()) if source is None else source.render_noise(self)

    @cached_property
    def _exposure_notes(self) -> tuple[str, ...]:
        """The notes that cost next to nothing; all doubts but those on the light itself are among them."""
        return exposure_notes(self.camera, self.detected, self.first)

    @cached_property
    def pixel_moments(self) -> PixelMoments:
        """``clean[0]`` and ``temporal_variance``, by the theory of every pixel with the FPN maps of this serial."""
        return pixel_moments(self.stages, self.detected, self.first)

    @cached_property
    def clean(self) -> NDArray[np.float32]:
        """Expectation of the raw frame over temporal noise, fixed patterns of this serial included, (1, H, W) [DN].

        Of frames with renders of their own (N, H, W). Not rounded. Raises InputError for chain konnik2014.
        """
        return self.pixel_moments.mean[None]

    @property
    def temporal_variance(self) -> NDArray[np.float32]:
        """Variance of every pixel from frame to frame in the light of the first, (H, W) [DN²]."""
        return self.pixel_moments.temporal

    @cached_property
    def spatial_mean(self) -> NDArray[np.float32]:
        """Expectation over temporal noise and over all cameras of this model, (H, W) [DN]: no fixed pattern."""
        return self.theory.digital_mean()

    @cached_property
    def report(self) -> dict[str, Any]:
        """Theory and sample of every stage in the first frame, ready for JSON (see report.py)."""
        self._observer.sample(self.first.window.backend)
        return report(self.camera, self._observer)

    @cached_property
    def _observer(self) -> FrameObserver:
        """Who saw the first frame; it is computed again unless ``frames_with_report`` made it."""
        from .expose import PreparedExposure

        observer = FrameObserver(FrameTheory(self.stages, self.detected, self.first))
        first = self.first.on(self.backend)
        PreparedExposure(self.camera, self.stages, first, 1, (), light=self.detected).frames(observer)
        return observer

    def minus(self, reference: Frames) -> NDArray[np.int64]:
        """Signed difference to a zero-exposure frame or a stack of as many, (N, H, W) [DN]: the paper's CDS.

        Fixed patterns cancel, temporal variances add (√2 in σ for equal frames), and nothing wraps below zero.
        Raises InputError when the frames do not fit, are of another camera, serial number or part of the sensor, or
        have the same temporal noise: the same frame numbers of the same seed and exposure.
        """
        if not isinstance(reference, Frames):
            raise InputError(f"the reference is a {type(reference).__name__}; pass the Frames of a zero exposure.")
        check_reference_shape(self.digital.shape, reference.digital.shape)
        check_chip((self.camera, self.first.window), (reference.camera, reference.first.window))
        check_streams((self.first, len(self.digital)), (reference.first, len(reference.digital)))
        return self.digital.astype(np.int64) - reference.digital.astype(np.int64)

    def preview(self, number: int = 0, gain: float = 1.0) -> NDArray[np.uint8]:
        """What frame.png shows: one of the frames, 8 bit, (H, W) grey or (H, W, 3) sRGB.  gain : brightens it."""
        from ..output.frame_files import preview_of

        return preview_of(self, number, gain)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write frame.tiff, frame.png and frame.json: all, or none; those of older frames go. Raises InputError."""
        from ..output.frame_files import save_frames

        save_frames(self, folder)

    def save_dng(self, path: str | os.PathLike[str], number: int = 0) -> None:
        """Write one of the frames as a DNG, its pixels unchanged. Raises InputError where other programs read none:
        beyond 16 bits, of filters that are not red, green and blue in 2 × 2, below 22 × 22 pixels."""
        from ..output.dng import write_dng

        write_dng(path, self, number)

    def __repr__(self) -> str:
        """``<Frames: 16 × 480 × 640, uint16, of bayer_2mp at 0.02 s, serial 7, seed 1>``."""
        size, first = " × ".join(map(str, self.digital.shape)), self.first
        gain = f", gain {first.gain}" if first.gain else ""
        taken = f"{self.camera.name} at {first.exposure.time_s:g} s{gain}, serial {first.window.serial}"
        return f"<Frames: {size}, {self.digital.dtype}, of {taken}, seed {first.seed}>"

    def _repr_html_(self) -> str:
        from ..output.frame_files import frames_html

        return frames_html(self)

    def noise_budget(self) -> NoiseBudget:
        """What every source contributes to each pixel of the first frame, in DN; the sum is the frame."""
        theory = FrameTheory(self.stages, self.detected, self.first)
        return NoiseBudget(self.stages, self.detected, self.first, theory)
