"""The readouts of frames whose codes are combined from several, each as the exposure of a camera with one readout.

Its codes are exactly those that were combined: the random numbers of a readout depend on its name only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..camera.dual_pixels import PHOTODIODES, camera_of_photodiode, stages_of_photodiode
from ..core import Frame
from ..stages.combined_readouts import ReadoutChain, combined_of
from ..stages.effects.shot_noise import RIGHT
from .detection import Detected
from .expose import PreparedExposure, on_numpy
from .frames import RawFrames


def exposures_of_readouts(frames: RawFrames) -> Mapping[str, PreparedExposure]:
    """Return the exposure of each readout of these frames by its name; empty for a camera with one readout.

    Dual pixels have their left and right photodiodes.
    """
    if frames.camera.sensor.dual_pixel:
        return {name: exposure_of_photodiode(frames, name) for name in PHOTODIODES}
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
    """Return the light that a readout collects of this light."""
    photons = light.photons.changed(by_readout=None)
    if light.photons.by_readout is not None and readout.charge in light.photons.by_readout:
        photons = light.photons.by_readout[readout.charge]
    elif readout.exposure_ratio != 1:
        photons = photons.changed(mean=photons.mean * readout.exposure_ratio)
    return Detected(photons, readout.light_of(light.signal, on_numpy(frame)))


def exposure_of_photodiode(frames: RawFrames, name: str) -> PreparedExposure:
    """Return the exposure of one photodiode of dual pixels."""
    camera, first = camera_of_photodiode(frames.camera), frames.first.on(frames.backend)
    stages = stages_of_photodiode(camera, frames.stages)
    frame = replace(first, charge=name, _blocks={})
    light = light_of_photodiode(frames.detected, name)
    return PreparedExposure(camera, stages, frame, len(frames.digital), (), light=light)


def light_of_photodiode(light: Detected, name: str) -> Detected:
    """Return the light on one photodiode of dual pixels."""
    signal, photons = light.signal, light.photons
    part = 0.5 if signal.left_share is None else signal.left_share
    if name == RIGHT:
        part = 1 - part
    own = replace(signal, light=np.asarray(part * signal.light), left_share=None)
    mean = photons.mean * np.reshape(part, np.shape(part) + (1,) * (photons.mean.ndim - 2))
    return Detected(photons.changed(mean=mean, by_readout=None), own)
