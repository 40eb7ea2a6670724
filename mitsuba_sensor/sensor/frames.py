"""Raw frames of one exposure: their codes, and what these were made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..core import Frame, InputError, Photons
from ..core.backend import Backend
from ..stages.stage import Chain
from .checks import check_chip, check_reference_shape, check_streams
from .choices import PlannedChain
from .detection import Detected


@dataclass(frozen=True, eq=False, repr=False)
class RawFrames:
    """Raw frames of one camera; :class:`output.frames.Frames` adds what is expected of them, and files.

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    light : mean photons.  first : number, exposure and window of the first frame.  stages : the chain.
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
    plan: PlannedChain | None = None
    photons: NDArray[np.float64] | None = None
    photoelectrons: NDArray[np.float64] | None = None
    dark_electrons: NDArray[np.float64] | None = None
    electrons: NDArray[np.float64] | None = None
    volts: NDArray[np.float64] | None = None
    input_referred_electrons: NDArray[np.float64] | None = None

    def minus(self, reference: RawFrames) -> NDArray[np.int64]:
        """Signed difference to a zero-exposure frame or a stack of as many, (N, H, W) [DN]: the paper's CDS.

        Fixed patterns cancel, temporal variances add (√2 in σ for equal frames), and nothing wraps below zero.
        Raises InputError when the frames do not fit, are of another camera, serial number or part of the sensor, or
        have the same temporal noise: the same frame numbers of the same seed and exposure.
        """
        if not isinstance(reference, RawFrames):
            raise InputError(
                f"the reference is a {type(reference).__name__}; pass the Frames of a zero exposure."
            )
        check_reference_shape(self.digital.shape, reference.digital.shape)
        check_chip((self.camera, self.first.window), (reference.camera, reference.first.window))
        check_streams(
            (self.first, len(self.digital)), (reference.first, len(reference.digital))
        )
        return self.digital.astype(np.int64) - reference.digital.astype(np.int64)

    def __repr__(self) -> str:
        """``<Frames: 16 × 480 × 640, uint16, of bayer_2mp at 0.02 s, serial 7, seed 1>``."""
        size, first = " × ".join(map(str, self.digital.shape)), self.first
        gain = ""
        if first.gain:
            gain = f", gain {first.gain}"
        taken = f"{self.camera.name} at {first.exposure.time_s:g} s{gain}, serial {first.window.serial}"
        return f"<Frames: {size}, {self.digital.dtype}, of {taken}, seed {first.seed}>"
