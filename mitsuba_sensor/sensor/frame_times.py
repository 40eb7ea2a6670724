"""Start times of the frames of a series: frame k starts at start_s + k·period, with k counted from 0."""

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
    """Start times of frames.

    start_s : start of frame 0 [s].  period_s : time between starts [s]; None for simultaneous frames.
    fps : frame rate [Hz], 1/period_s.
    """

    start_s: float = 0.0
    period_s: float | None = None
    fps: float | None = None

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> FrameTimes:
        """Read completed options. Raises InputError if both ``fps`` and ``frame_period_s`` are given."""
        start_s, fps, period_s = (
            options[name] for name in ("start_s", "fps", "frame_period_s")
        )
        if fps is not None and period_s is not None:
            raise InputError(
                f"fps is {fps} and frame_period_s is {period_s}, which set the same; omit one of them."
            )
        if fps is not None:
            period_s = 1 / fps
        elif period_s is not None:
            fps = 1 / period_s
        return cls(start_s, period_s, fps)

    def of_frame(self, number: int) -> float:
        """Return the start of the frame with this number [s]."""
        return self.start_s if self.fps is None else self.start_s + number / self.fps

    def check(self, exposure: Exposure, camera: Camera) -> None:
        """Raise InputError if the exposure, or all exposures in sequence, take longer than a frame."""
        whole_s = frame_span_s(camera, exposure)
        if self.period_s is None or whole_s <= self.period_s * (1 + 1e-9):
            return
        said = f"the exposure time of {exposure.time_s:g} s"
        if whole_s > exposure.time_s:
            said += f" with later exposures, {whole_s:g} s,"
        longest_s = 0.9995 * longest_exposure_s(camera, self.period_s)  # so that 4 digits fit
        remedy = (
            f"use at most {longest_s:.4g} s" if longest_s else "reduce gap_us of the readouts"
        )
        raise InputError(
            f"{said} exceeds the frame period of {self.period_s:.6g} s; {remedy}, or reduce fps."
        )
