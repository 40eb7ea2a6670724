"""Pixels with random telegraph noise (RTN) of the source follower: after CDS they show three levels, −A, 0 and +A.

A trap in the transistor of such a pixel is full or empty. CDS subtracts two samples: if the trap changed between them,
a step of either sign remains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...core import Array, Frame, SensorWindow, arrays
from ..datasheet import Chance, FileTable, NotNegative, optional
from ..fpn_distributions import site_map
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, Stage


class RtnPixelsFields(FileTable):
    """Three-level random telegraph noise of some pixels, in addition to the noise of all pixels."""

    cmos_only = ("rtn_pixel_fraction",)

    rtn_pixel_fraction: Chance = optional(
        "fraction of the pixels with random telegraph noise", 0.001, 0.0
    )
    rtn_pixel_amplitude_e: NotNegative = optional(
        "step A of that noise, as electrons [e-]", 10.0, 0.0
    )
    rtn_pixel_duty: Chance = optional("fraction of the time that such a trap is full", 0.5, 0.5)
    rtn_pixel_switching: Chance = optional(
        "probability that its state is redrawn between the two CDS samples",
        0.2,
        1.0,
    )


@dataclass(frozen=True)
class RtnPixels(Stage):
    """Adds −A, 0 or +A in pixels with a trap.

    fraction : of the pixels that have a trap.  amplitude_e : A, as electrons at the sense node.
    duty : fraction of the time that a trap is full.  switching : probability that its state is redrawn between the two
        CDS samples, 1 − e^(−t_s/τ).  gain_v_per_e : one electron at this stage [V/e-].
    States of different frames are independent.
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
        """Return None for a camera without such pixels."""
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
        """Probability of +A in a pixel with a trap, and equally of −A."""
        return self.switching * self.duty * (1 - self.duty)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing with the steps of this frame."""
        chance, step_v = self.chance_of_a_step, self.amplitude_e * self.gain_v_per_e
        if self.fraction == 0 or step_v == 0 or chance == 0:
            return swing
        down, none, up = (frame.number(level) for level in (-1.0, 0.0, 1.0))
        draw = frame.window.backend.uniform(frame.random_bits("rtn_pixels"))
        level = arrays.where(draw < 2 * chance, arrays.where(draw < chance, down, up), none)
        return swing + frame.number(step_v) * (self.fpn_maps(frame.window)["rtn_site"] * level)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return ``rtn_site``, 1 for pixels with a trap, else 0."""
        return site_map(window, "rtn_site", self.fraction)


def rtn_noise_e(camera: Datasheet) -> float:
    """Return the rms of this noise over all pixels of a camera [e- rms]."""
    follower, stage = camera.source_follower, RtnPixels.from_camera(camera)
    if stage is None:
        return 0.0
    variance = 2 * follower.rtn_pixel_fraction * stage.chance_of_a_step
    return float(follower.rtn_pixel_amplitude_e * math.sqrt(variance))
