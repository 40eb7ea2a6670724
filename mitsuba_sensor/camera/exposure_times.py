"""When the exposures of one frame are open: those of staggered read-outs follow each other (DOL-HDR)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ..core import Exposure

if TYPE_CHECKING:
    from .camera import Camera


class LaterExposure(NamedTuple):
    """Another exposure of a frame than its first.  begin_s : when its first row opens."""

    exposure: Exposure
    begin_s: float


def later_exposures(
    camera: Camera, exposure: Exposure, begin_s: float = 0.0
) -> Mapping[str, LaterExposure]:
    """The exposures of a frame whose light is not that of the first, by the read-out that begins each of them.

    Of the same photodiode each begins ``gap_us`` behind the end of the one before; that of a photodiode of its own
    begins with the frame.  begin_s : when the first exposure begins.
    """
    found, end_s = dict[str, LaterExposure](), begin_s + exposure.time_s
    for readout in camera.readouts[1:]:
        own = replace(exposure, time_s=exposure.time_s * readout.exposure_ratio)
        if readout.of == "exposure":
            opens_s = end_s + readout.gap_us * 1e-6
            end_s = opens_s + own.time_s
            found[readout.name] = LaterExposure(own, opens_s)
        elif readout.exposure_ratio != 1:
            found[readout.name] = LaterExposure(own, begin_s)
    return found


def frame_span_s(camera: Camera, exposure: Exposure) -> float:
    """From when a row first opens until its last exposure ends [s]."""
    ends_s = [exposure.time_s]
    for own, begin_s in later_exposures(camera, exposure).values():
        ends_s.append(begin_s + own.time_s)
    return max(ends_s)


def longest_exposure_s(camera: Camera, period_s: float) -> float:
    """The exposure time at which all exposures of a frame end within its period [s]; 0 where their gaps fill it."""
    gaps_s = frame_span_s(camera, Exposure(0.0))
    per_second = frame_span_s(camera, Exposure(1.0)) - gaps_s
    return max(period_s - gaps_s, 0.0) / per_second
