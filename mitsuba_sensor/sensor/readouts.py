"""The read-outs of frames whose codes are combined from several: each is an exposure of a camera with one read-out.

Its codes are those that the combination was made of, byte for byte: the random numbers of a read-out depend on its name
and not on who asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..core import Frame
from ..stages.combined_readouts import ReadoutChain, combined_of
from .detection import Detected
from .expose import PreparedExposure, on_numpy
from .frames import RawFrames


def exposures_of_readouts(frames: RawFrames) -> Mapping[str, PreparedExposure]:
    """The exposure of each read-out of these frames, by its name; none of a camera with one read-out."""
    combined = combined_of(frames.stages)
    if combined is None:
        return {}
    first, count = frames.first.on(frames.backend), len(frames.digital)
    found: dict[str, PreparedExposure] = {}
    for readout in combined.readouts:
        camera = frames.camera.readout_cameras[readout.name]
        light = light_of_readout(readout, frames.detected, first)
        found[readout.name] = PreparedExposure(
            camera, readout.stages, readout.frame_of(first), count, (), light=light
        )
    return found


def light_of_readout(readout: ReadoutChain, light: Detected, frame: Frame) -> Detected:
    """The light that a read-out collects in a frame of this light."""
    photons = light.photons.changed(later=None)
    if light.photons.later is not None and readout.charge in light.photons.later:
        photons = light.photons.later[readout.charge]
    elif readout.exposure_ratio != 1:
        photons = replace(photons, mean=photons.mean * readout.exposure_ratio)
    return Detected(photons, readout.light_of(light.signal, on_numpy(frame)))
