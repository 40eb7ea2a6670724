"""Raw frames of one exposure: their codes, and what these were made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..core import Frame, InputError, Photons, SensorWindow
from ..core.backend import Backend
from ..stages.stage import Chain
from .detection import Detected
from .run import INPUT_REFERRED

KEEP = ("photons", "photoelectrons", "dark_electrons", "electrons", "volts", INPUT_REFERRED)
"""Intermediate signals that ``expose(keep=…)`` can return: mean photons of all bands, electrons that light and dark
current left in the well, their sum [e-], swing at the converter [V], that swing as electrons at the input."""


CLIPPED = ("clipped_full_well", "clipped_adc_low", "clipped_adc_high")
"""Causes of clipping that every frame counts."""


class PlannedChain(Protocol):
    """What a plan leaves of a camera's chain; plans are made in theory/plan.py."""

    @property
    def camera(self) -> str:
        """Name of the camera."""

    @property
    def stages(self) -> Chain:
        """The stages that are left."""

    @property
    def whole(self) -> Chain:
        """All stages of the camera."""

    def check(self, light: Detected, frame: Frame) -> None:
        """Raise InputError for light, an exposure or a window that the plan was not made for."""


@dataclass(frozen=True, eq=False, repr=False)
class RawFrames:
    """Raw frames of one camera; :class:`output.frames.Frames` adds what is expected of them, and files.

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    light : mean photons.  first : number, exposure and window of the first frame.  stages : the chain.
    plan : what was left out of the chain, where ``plan`` or ``tolerance_dn`` was given.
    detected : mean photoelectrons of the light.  backend : what computed the frames.
    counted : pixels of the first frame that are clipped or cut to zero, by the cause; None where not known.
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
    counted: Mapping[str, int] | None = None
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
        _check_reference_shape(self.digital.shape, reference.digital.shape)
        _check_chip(
            (self.camera, self.first.window), (reference.camera, reference.first.window)
        )
        _check_streams(
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


def _check_reference_shape(shape: tuple[int, ...], reference: tuple[int, ...]) -> None:
    """Raise InputError unless a frame is subtracted from each frame, or one from all."""
    if shape[1:] != reference[1:] or reference[0] not in (1, shape[0]):
        raise InputError(
            f"the reference has shape {reference}; it must be {shape}, or (1, {shape[1]}, {shape[2]})."
        )


def _check_chip(one: tuple[Camera, SensorWindow], other: tuple[Camera, SensorWindow]) -> None:
    """Raise InputError unless frames and their reference are of the same pixels, whose fixed patterns cancel."""
    pairs = {
        "the camera": (one[0].name, other[0].name),
        "the serial": (one[1].serial, other[1].serial),
        "the datasheet": (one[0].stages, other[0].stages),
        "the part of the sensor": (tuple(one[1].origin), tuple(other[1].origin)),
    }
    differs = " and ".join(what for what, (mine, its) in pairs.items() if mine != its)
    if not differs:
        return
    mine, its = (
        f"{camera.name}, serial {at.serial}, from pixel {tuple(at.origin)}"
        for camera, at in (one, other)
    )
    raise InputError(
        f"the frames are of {mine}, and the reference of {its} ({differs} differs), whose fixed patterns are others; "
        "expose the reference with the same camera, serial and origin."
    )


def _check_streams(one: tuple[Frame, int], other: tuple[Frame, int]) -> None:
    """Raise InputError where frames and their reference share temporal noise, which would cancel in the difference.

    one, other : the first frame, and how many there are.
    """
    (first, count), (reference, references) = one, other
    begin, end = (
        max(first.index, reference.index),
        min(first.index + count, reference.index + references),
    )
    if first.key != reference.key or begin >= end:
        return
    raise InputError(
        f"the frames and the reference share frame {begin} of seed {first.seed} at the same exposure, whose temporal "
        f"noise would cancel; expose the reference with another seed, or with first_frame={first.index + count}."
    )
