"""Start and length of the exposures of a frame; staggered readouts follow each other (DOL-HDR)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ..core import Exposure

if TYPE_CHECKING:
    from .camera import Camera


class LaterExposure(NamedTuple):
    """An exposure of a frame after its first.  begin_s : start of its first row."""

    exposure: Exposure
    begin_s: float


def later_exposures(
    camera: Camera, exposure: Exposure, begin_s: float = 0.0
) -> Mapping[str, LaterExposure]:
    """Return readout name → exposure, for the readouts whose light differs from the first exposure.

    An exposure of the same photodiode starts ``gap_us`` after the end of the previous exposure; an exposure of another
    photodiode starts with the frame.  begin_s : start of the first exposure.
    """
    exposures, end_s = dict[str, LaterExposure](), begin_s + exposure.time_s
    for readout in camera.readouts[1:]:
        later = replace(exposure, time_s=exposure.time_s * readout.exposure_ratio)
        if readout.of == "exposure":
            start_s = end_s + readout.gap_us * 1e-6
            end_s = start_s + later.time_s
            exposures[readout.name] = LaterExposure(later, start_s)
        elif readout.exposure_ratio != 1:
            exposures[readout.name] = LaterExposure(later, begin_s)
    return exposures


def frame_span_s(camera: Camera, exposure: Exposure) -> float:
    """Return the time from the start of a row to the end of its last exposure [s]."""
    later = later_exposures(camera, exposure).values()
    return max(exposure.time_s, *(x.begin_s + x.exposure.time_s for x in later), 0.0)


def longest_exposure_s(camera: Camera, period_s: float) -> float:
    """Return the exposure time that fills a frame period with all exposures [s]; 0 if their gaps fill it."""
    gaps_s = frame_span_s(camera, Exposure(0.0))
    per_second = frame_span_s(camera, Exposure(1.0)) - gaps_s
    return max(period_s - gaps_s, 0.0) / per_second
