"""Pixels with random telegraph noise (RTN) of the source follower: after the CDS they show three levels, −A, 0 and +A.

A trap in the transistor of such a pixel is full or empty. The CDS subtracts two samples: if the trap changed between
them, a step of one sign or the other is left, else nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from ...core import Array, Frame, SensorWindow, arrays
from ...core.backend import Backend
from ..datasheet import Chance, FileTable, NotNegative, optional
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, Stage


class RtnPixelsFields(FileTable):
    """Three-level random telegraph noise of some pixels, beside the noise that all pixels have."""

    cmos_only: ClassVar[Mapping[str, float | str]] = {"rtn_pixel_fraction": 0.0}

    rtn_pixel_fraction: Chance = optional(
        "fraction of the pixels with random telegraph noise of their own", 0.001, 0.0
    )
    rtn_pixel_amplitude_e: NotNegative = optional(
        "step A of that noise, as electrons [e-]", 10.0, 0.0
    )
    rtn_pixel_duty: Chance = optional("fraction of the time that such a trap is full", 0.5, 0.5)
    rtn_pixel_switching: Chance = optional(
        "probability 1 - exp(-t_s/τ) that its state is drawn anew between the two CDS samples",
        0.2,
        1.0,
    )


@dataclass(frozen=True)
class RtnPixels(Stage):
    """Adds −A, 0 or +A in the pixels that have a trap.

    fraction : of the pixels that have a trap.  amplitude_e : A, as electrons at the sense node.
    duty : fraction of the time that a trap is full.  switching : probability that its state is drawn anew between the
        two samples of the CDS, 1 − e^(−t_s/τ).  gain_v_per_e : one electron at this stage [V/e-].
    Frames are so much further apart than the samples that each has a state of its own.
    """

    fraction: float
    amplitude_e: float
    duty: float
    switching: float
    gain_v_per_e: float
    domain = "volts"
    table = "source_follower"
    fields = RtnPixelsFields
    terms = "RTN pixels, three-level CDS noise"
    label = "RTN pixels"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> RtnPixels | None:
        """None for a camera without such pixels."""
        follower = camera.source_follower
        if not follower.rtn_pixel_fraction:
            return None
        trap = (
            follower.rtn_pixel_amplitude_e,
            follower.rtn_pixel_duty,
            follower.rtn_pixel_switching,
        )
        return cls(follower.rtn_pixel_fraction, *trap, sense_gain_v_per_e(camera))

    @property
    def chance_of_a_step(self) -> float:
        """Probability of +A in a pixel with a trap, and that of −A: empty in one sample and full in the other."""
        return self.switching * self.duty * (1 - self.duty)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing with the steps of this frame."""
        chance, step_v = self.chance_of_a_step, self.amplitude_e * self.gain_v_per_e
        if self.fraction == 0 or step_v == 0 or chance == 0:
            return swing
        down, none, up = (frame.number(level) for level in (-1.0, 0.0, 1.0))
        draw = frame.window.backend.uniform(frame.random_bits("rtn_pixels"))
        level = arrays.where(draw < 2 * chance, arrays.where(draw < chance, down, up), none)
        return swing + frame.number(step_v) * (self.fpn_maps(frame.window)["rtn_site"] * level)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """``rtn_site``: 1 where a pixel has a trap, else 0."""
        return {
            "rtn_site": window.measured_or(
                "rtn_site", lambda: window.fixed_map("rtn_site", self._from_bits)
            )
        }

    def _from_bits(self, backend: Backend, bits: Array) -> Array:
        return arrays.where(
            backend.uniform(bits) < self.fraction, backend.number(1.0), backend.number(0.0)
        )


def rtn_noise_e(camera: Datasheet) -> float:
    """The noise of all pixels of a camera [e- rms]."""
    follower, stage = camera.source_follower, RtnPixels.from_camera(camera)
    if stage is None:
        return 0.0
    variance = 2 * follower.rtn_pixel_fraction * stage.chance_of_a_step
    return float(follower.rtn_pixel_amplitude_e * math.sqrt(variance))
