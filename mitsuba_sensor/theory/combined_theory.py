"""Mean and variance of the pixels of combined read-outs, from the law of each of them in closed form."""

from __future__ import annotations

import numpy as np

from ..core import Frame
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.readouts import light_of_readout
from ..stages.combined_readouts import CombinedReadouts, combined_of
from ..stages.stage import Chain
from .combined_codes import CodeMoments, combined_codes
from .pixel_moments import PixelMoments, check_clean_is_known, pixel_moments
from .response import behind_stages_at


def moments_of_pixels(stages: Chain, light: Detected, frame: Frame) -> PixelMoments:
    """Mean and temporal variance of the codes of a window, for the maps of its serial. Raises InputError where they are
    not known: see :func:`theory.pixel_moments.pixel_moments`."""
    combined = combined_of(stages)
    if combined is None:
        return pixel_moments(stages, light, frame)
    codes = list[CodeMoments]()
    for readout in combined.readouts:
        own = light_of_readout(readout, light, frame)
        mean, temporal = pixel_moments(readout.stages, own, readout.frame_of(frame))
        codes.append(
            CodeMoments(np.ravel(mean).astype(float), np.ravel(temporal).astype(float))
        )
    shape = frame.window.shape
    found = (
        x.reshape(shape).astype(np.float32) for x in combined_codes(combined, codes, frame)
    )
    return PixelMoments(*found)


def check_moments_are_known(stages: Chain) -> None:
    """Raise InputError for a chain, or a read-out of it, whose clean frame is not known."""
    combined = combined_of(stages)
    if combined is None:
        check_clean_is_known(stages)
        return
    for readout in combined.readouts:
        check_clean_is_known(readout.stages)


def codes_by_light(
    combined: CombinedReadouts, frame: Frame, light_e: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the linear code of a pixel without fixed-pattern noise, by its mean photoelectrons in the
    reference exposure, (L,) each [DN, DN²]."""
    codes = list[CodeMoments]()
    for readout in combined.readouts:
        stages, own = readout.stages, readout.frame_of(frame)
        last = len(stages) - 1
        found = behind_stages_at(stages, own, readout.light_ratio * light_e, [last])
        codes.append(CodeMoments(*found[last]))
    return combined_codes(combined, codes, frame)
