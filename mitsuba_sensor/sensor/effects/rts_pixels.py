"""Random telegraph signal (RTS) pixels: traps that switch a pixel's dark current on and off between frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core import Array, Electrons, Frame, Moments, SensorWindow, arrays, distributions
from ...core.backend import Backend
from ..datasheet import Chance, FileTable, NotNegative
from ..pixel_law import PixelLaw, Quantiles
from ..stage import Datasheet, Stage


class RtsFields(FileTable):
    """Random telegraph signals."""

    rts_fraction: Chance = Field(
        0.0, description="fraction of the pixels with a random telegraph signal", examples=[0.001]
    )
    rts_amplitude_e_per_s: NotNegative = Field(0.0, description="step of the telegraph signal [e-/s]", examples=[200])
    rts_switching: Annotated[float, Field(ge=1e-4, le=1, strict=True)] = Field(
        0.1, description="probability per frame that the state of a trap is drawn anew", examples=[0.1]
    )
    rts_duty: Chance = Field(0.5, description="fraction of the time that a trap is on", examples=[0.5])


@dataclass(frozen=True)
class RtsPixels(Stage):
    """Adds amplitude·t dark electrons where a trap is on.

    fraction : of the pixels that have a trap.  amplitude_e_per_s : the step [e-/s].
    switching : probability per frame that a state is drawn anew; states Δ frames apart correlate by (1 − switching)^Δ.
    duty : fraction of the time that a trap is on.
    """

    fraction: float
    amplitude_e_per_s: float
    switching: float
    duty: float
    domain = "electrons"
    table = "dark_current"
    fields = RtsFields
    label = "RTS pixels"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> RtsPixels | None:
        """None for a camera without such pixels."""
        dark = camera.dark_current
        if not dark.rts_fraction:
            return None
        return cls(dark.rts_fraction, dark.rts_amplitude_e_per_s, dark.rts_switching, dark.rts_duty)

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Adds the electrons of the traps that are on."""
        step = self.amplitude_e_per_s * frame.exposure.time_s
        if self.fraction == 0 or step == 0:
            return electrons
        return replace(electrons, dark=electrons.dark + frame.number(step) * self.states(frame))

    def moments(self, m: Moments) -> Moments:
        """A pixel has a trap with probability ``fraction``, and the trap is on with probability ``duty``."""
        step = self.amplitude_e_per_s * m.frame.exposure.time_s
        mean = step * self.duty
        share, spread = m.frame.window.map_moments("rts_site", self.fraction, self.fraction * (1 - self.fraction))
        return m.add(mean=share * mean, temporal=share * step * mean * (1 - self.duty), spatial=spread * mean**2)

    def pixel_law(self, frame: Frame, quantiles: Quantiles) -> PixelLaw:
        """Pixels with and without a trap, which is off or on."""
        share, _ = frame.window.map_moments("rts_site", self.fraction, 0.0)
        step = self.amplitude_e_per_s * frame.exposure.time_s
        offsets = np.array([[0.0, 0.0], [0.0, step]])
        return PixelLaw(np.array([1 - share, share]), np.ones((2, 2)), offsets, np.array([1 - self.duty, self.duty]))

    def states(self, frame: Frame) -> Array:
        """1 where a trap is on in this frame, else 0, (H, W).

        The state is that of the latest frame in which it was drawn anew; that frame is searched backwards, so any frame
        can be computed alone. Traps are few: this is done on the host.
        """
        window = frame.window
        state = np.zeros(window.shape)
        site = self.fpn_maps(window)["rts_site"]
        rows, columns = window.cached("rts_sites", lambda: np.nonzero(window.backend.to_numpy(site, window)))
        index = frame.index
        while rows.size:
            pixels = window.rows[rows], window.columns[columns], index
            switch, on = frame.random_bits_at("rts_switch", *pixels), frame.random_bits_at("rts_state", *pixels)
            drawn = (distributions.survival(switch) < self.switching) | (index == 0)
            state[rows[drawn], columns[drawn]] = distributions.survival(on[drawn]) < self.duty
            rows, columns, index = rows[~drawn], columns[~drawn], index - 1
        return window.backend.from_numpy(state, window)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """``rts_site``: 1 where a pixel has a trap, else 0."""
        return {"rts_site": window.measured_or("rts_site", lambda: window.fixed_map("rts_site", self._from_bits))}

    def _from_bits(self, backend: Backend, bits: Array) -> Array:
        return arrays.where(
            backend.uniform(bits) < backend.number(self.fraction), backend.number(1.0), backend.number(0.0)
        )
