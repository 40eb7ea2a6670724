"""Raw frames of one exposure, with their light, chain and conditions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..core import Frame, InputError, Photons, SensorWindow
from ..core.backend import Backend
from ..stages.stage import Chain
from .detection import Detected
from .run import INPUT_REFERRED

if TYPE_CHECKING:
    from ..theory.plan import Plan

KEEP = ("photons", "photoelectrons", "dark_electrons", "electrons", "volts", INPUT_REFERRED)
"""Intermediate signals for ``expose(keep=…)``: mean photons of all bands; photoelectrons, dark electrons and their sum
in the well [e-]; swing at the ADC [V]; that swing as electrons at the input [e-]."""


CLIPPED = ("clipped_full_well", "clipped_adc_low", "clipped_adc_high")
"""Causes of clipping that every frame counts."""


@dataclass(frozen=True, eq=False, repr=False)
class RawFrames:
    """Raw frames of one camera; :class:`output.frames.Frames` adds their expectation and their files.

    digital : shape (N, H, W) [DN], the smallest of uint8, uint16 and uint32 that contains ``adc.bits``.
    light : mean photons.  first : number, exposure and window of the first frame.  stages : the chain.
    plan : the plan that shortened the chain, if ``plan`` or ``tolerance_dn`` was given.
    detected : mean photoelectrons of the light.  backend : the backend that computed the frames.
    counted : number of pixels of the first frame that are clipped or cut to zero, by the cause; None if unknown.
    photons, photoelectrons, dark_electrons, electrons, volts, input_referred_electrons : shape (N, H, W), float64, if
        requested by ``keep``, else None.
    """

    digital: NDArray[np.unsignedinteger]
    camera: Camera
    light: Photons
    first: Frame
    stages: Chain
    detected: Detected
    backend: Backend
    plan: Plan | None = None
    counted: Mapping[str, int] | None = None
    photons: NDArray[np.float64] | None = None
    photoelectrons: NDArray[np.float64] | None = None
    dark_electrons: NDArray[np.float64] | None = None
    electrons: NDArray[np.float64] | None = None
    volts: NDArray[np.float64] | None = None
    input_referred_electrons: NDArray[np.float64] | None = None

    def minus(self, reference: RawFrames) -> NDArray[np.int64]:
        """Return the signed difference to a bias frame, or to as many, shape (N, H, W) [DN]: the paper's CDS.

        Fixed patterns cancel, temporal variances add (√2 in σ for equal frames), and nothing wraps below zero. Raises
        InputError if the reference has another shape, camera, serial number or part of the sensor, or if it shares
        temporal noise with the frames (same frame number, seed and exposure).
        """
        if not isinstance(reference, RawFrames):
            raise InputError(
                f"the reference is a {type(reference).__name__}; pass Frames of a zero exposure."
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
    """Raise InputError unless there is one reference for each frame, or one for all."""
    if shape[1:] != reference[1:] or reference[0] not in (1, shape[0]):
        raise InputError(
            f"the reference has shape {reference}; it must be {shape}, or (1, {shape[1]}, {shape[2]})."
        )


def _check_chip(one: tuple[Camera, SensorWindow], other: tuple[Camera, SensorWindow]) -> None:
    """Raise InputError unless frames and reference have the same pixels, so that fixed patterns cancel."""
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
        f"the frames are of {mine}, but the reference of {its} ({differs} differs), so fixed patterns stay; "
        "expose the reference with the same camera, serial and origin."
    )


def _check_streams(one: tuple[Frame, int], other: tuple[Frame, int]) -> None:
    """Raise InputError if frames and reference share temporal noise, which would cancel in the difference.

    one, other : the first frame and the number of frames of each.
    """
    (first, count), (reference, references) = one, other
    begin, end = (
        max(first.index, reference.index),
        min(first.index + count, reference.index + references),
    )
    if first.key != reference.key or begin >= end:
        return
    raise InputError(
        f"the frames and the reference share frame {begin} of seed {first.seed} at the same exposure, so temporal "
        f"noise would cancel; expose the reference with another seed, or with first_frame={first.index + count}."
    )
