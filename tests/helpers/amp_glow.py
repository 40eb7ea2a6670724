"""A stage of a user's own that depends on the place: the glow of an amplifier in the corner."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import mitsuba_sensor as ms


@dataclass(frozen=True)
class AmpGlow(ms.Stage):
    """Dark electrons of an amplifier in the corner, falling by 1/e per 40 pixels."""

    rate_e_per_s: float = 20_000.0
    domain = "electrons"

    def glow_e(self, frame: ms.stages.Frame) -> ms.stages.Array:
        rows, columns = np.ix_(frame.window.rows, frame.window.columns)
        return self.rate_e_per_s * frame.exposure.time_s * np.exp(-(rows + columns) / 40.0)

    def sample(
        self, electrons: ms.stages.Electrons, frame: ms.stages.Frame
    ) -> ms.stages.Electrons:
        glow = frame.window.backend.from_numpy(self.glow_e(frame), frame.window)
        return replace(electrons, dark=electrons.dark + glow)
