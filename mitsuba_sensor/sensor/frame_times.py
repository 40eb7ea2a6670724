"""When the frames of a series begin: frame k at start_s + k·period, with k counted from 0 whatever the first one is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..camera.exposure_times import frame_span_s, longest_exposure_s
from ..core import Exposure, InputError

if TYPE_CHECKING:
    from ..camera.camera import Camera


@dataclass(frozen=True)
class FrameTimes:
    """start_s : when frame 0 begins.  period_s : from one begin to the next; None where all frames are of one instant.

    fps : its inverse.
    """

    start_s: float = 0.0
    period_s: float | None = None
    fps: float | None = None

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> FrameTimes:
        """Of these options, completed. Raises InputError where both ``fps`` and ``frame_period_s`` are given."""
        start_s, fps, period_s = (
            options[name] for name in ("start_s", "fps", "frame_period_s")
        )
        if fps is not None and period_s is not None:
            raise InputError(
                f"fps is {fps} and frame_period_s is {period_s}, which say the same; leave one of them out."
            )
        if fps is not None:
            period_s = 1 / fps
        elif period_s is not None:
            fps = 1 / period_s
        return cls(start_s, period_s, fps)

    def of_frame(self, number: int) -> float:
        """When the frame with this number begins [s]."""
        return self.start_s if self.fps is None else self.start_s + number / self.fps

    def check(self, exposure: Exposure, camera: Camera) -> None:
        """Raise InputError for an exposure, or exposures one after the other, longer than a frame."""
        whole_s = frame_span_s(camera, exposure)
        if self.period_s is None or whole_s <= self.period_s * (1 + 1e-9):
            return
        said = f"the exposure time of {exposure.time_s:g} s"
        if whole_s > exposure.time_s:
            said += f" with the read-outs behind it, {whole_s:g} s,"
        longest_s = 0.9995 * longest_exposure_s(camera, self.period_s)  # so that 4 digits fit
        way_out = f"give a shorter time (--exposure-s {longest_s:.4g})"
        if not longest_s:
            way_out = "shorten the gap_us of its read-outs"
        raise InputError(
            f"{said} is longer than the frame period of {self.period_s:.6g} s; {way_out}, or have "
            "fewer frames per second."
        )
