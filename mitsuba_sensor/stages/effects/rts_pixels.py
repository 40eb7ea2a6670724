"""Random telegraph signal (RTS) pixels: traps that switch extra dark current on and off between frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core import Array, Electrons, Frame, SensorWindow, arrays, distributions
from ..dark_components import Activation, Reference, reference_temperature_k
from ..dark_current_models import FIGURE_OF_MERIT_AT_K, arrhenius
from ..datasheet import Chance, FileTable, Kelvin, NotNegative, optional
from ..fpn_distributions import site_map
from ..stage import Datasheet, Stage

AMPLITUDE_EV, SWITCHING_EV = 0.57, 0.9
"""Activation energies of the amplitude (0.5–0.6 eV) and of the mean times between switches (0.9 ± 0.1 eV) of irradiated
CCDs (Hopkins & Hopkinson, IEEE Trans. Nucl. Sci. 40, 1567, 1993, and 42, 2074, 1995)."""

INDEPENDENT = 33 * math.log(2)
"""States with a correlation of e^-this, 2^-33, are independent: it is below the resolution of the random bits."""

LEVELS_MAX = 32
"""Frame numbers are below 2^32, so no block needs to be longer."""

SITES = 2**14
"""Traps that are computed at a time, to bound memory."""


class RtsFields(FileTable):
    """Random telegraph signals."""

    rts_fraction: Chance = optional(
        "fraction of the pixels with a random telegraph signal", 0.001, 0.0
    )
    rts_amplitude_e_per_s: NotNegative = optional(
        "step of the telegraph signal at rts_at_temperature_k [e-/s]", 200, 0.0
    )
    rts_switching: Annotated[float, Field(ge=1e-4, le=1, strict=True)] = optional(
        "probability per frame that the state of a trap is redrawn", 0.1, 0.1
    )
    rts_duty: Chance = optional("fraction of the time that a trap is on", 0.5, 0.5)
    rts_at_temperature_k: Annotated[Reference | None, Kelvin] = optional(
        "temperature of amplitude and switching [K]; default: at_temperature_k or 300 K",
        298.15,
    )
    rts_activation_ev: Activation = optional(
        "activation energy of the amplitude [eV]",
        0.57,
        AMPLITUDE_EV,
        title="activation energy E_a, Arrhenius law",
    )
    rts_switching_activation_ev: Activation = optional(
        "activation energy of the switching rate [eV]", 0.9, SWITCHING_EV
    )


@dataclass(frozen=True)
class RtsPixels(Stage):
    """Adds amplitude·t dark electrons in pixels whose trap is on.

    fraction : of the pixels that have a trap.  amplitude_e_per_s : the step [e-/s].
    switching : probability per frame that a state is redrawn; states Δ frames apart correlate by (1 − switching)^Δ.
    duty : fraction of the time that a trap is on.
    at_temperature_k : T_ref of amplitude and switching [K]; the amplitude and the rate −ln(1 − switching) per frame
        follow exp(E_a/k·(1/T_ref − 1/T)), each with its activation energy [eV].
    """

    fraction: float
    amplitude_e_per_s: float
    switching: float
    duty: float
    at_temperature_k: float = FIGURE_OF_MERIT_AT_K
    activation_ev: float = 0.0
    switching_activation_ev: float = 0.0
    domain = "electrons"
    table = "dark_current"
    fields = RtsFields
    terms = "RTS pixels, random telegraph signal of the dark current"
    label = "RTS pixels"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> RtsPixels | None:
        """Return None for a camera without such pixels."""
        dark = camera.dark_current
        if not dark.rts_fraction:
            return None
        at = dark.rts_at_temperature_k or reference_temperature_k(camera)
        energies = dark.rts_activation_ev, dark.rts_switching_activation_ev
        return cls(
            dark.rts_fraction,
            dark.rts_amplitude_e_per_s,
            dark.rts_switching,
            dark.rts_duty,
            at,
            *energies,
        )

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return the electrons with those of the traps that are on."""
        step = self.step_e(frame)
        if self.fraction == 0 or step == 0:
            return electrons
        return replace(electrons, dark=electrons.dark + frame.number(step) * self.states(frame))

    def step_e(self, frame: Frame) -> float:
        """Return the electrons of a trap that is on, at the temperature of this exposure [e-]."""
        exposure = frame.exposure
        thermal = arrhenius(exposure.temperature_k, self.at_temperature_k, self.activation_ev)
        return self.amplitude_e_per_s * thermal * exposure.time_s

    def traps(self, frame: Frame) -> TwoStates:
        """Return the switching at this exposure's temperature; traps with switching = 1 stop only at 0 K."""
        thermal = arrhenius(
            frame.exposure.temperature_k, self.at_temperature_k, self.switching_activation_ev
        )
        if self.switching == 1:
            rate = math.inf
        else:
            rate = -math.log1p(-self.switching)
        return TwoStates(self.duty, rate * thermal if thermal else 0.0)

    def states(self, frame: Frame) -> Array:
        """Return 1 for traps that are on in this frame, else 0, (H, W); on the host, since traps are few."""
        window = frame.window
        state = np.zeros(window.shape)
        site = self.fpn_maps(window)["rts_site"]
        rows, columns = window.cached(
            "rts_sites", lambda: np.nonzero(window.backend.to_numpy(site, window))
        )
        traps = self.traps(frame)
        path = list(traps.path(frame.index))
        for start in range(0, rows.size, SITES):
            some = rows[start : start + SITES], columns[start : start + SITES]
            pixels = window.rows[some[0]][None, :], window.columns[some[1]][None, :]
            bits = frame.random_bits_at("rts_state", *pixels, np.array(path)[:, None])
            state[some] = traps.state(frame.index, path, distributions.survival(bits))
        return window.backend.from_numpy(state, window)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return ``rts_site``, 1 for pixels with a trap, else 0."""
        return site_map(window, "rts_site", self.fraction)


@dataclass(frozen=True)
class TwoStates:
    """A stationary process of two states, on with probability ``duty``; states Δ frames apart correlate by e^(−rate·Δ).

    Each frame is computed alone, in a number of steps that grows with log(1/rate). Frames 2^levels apart (the ends of a
    block) are independent. Within a block the state in the middle of two known states follows from Bayes' rule,
    P(m | a, c) ∝ P(m | a)·P(c | m), and so on by halves. A slower process has one block for all frame numbers.
    """

    duty: float
    rate: float

    @property
    def levels(self) -> int:
        """log₂ of the frames in a block."""
        if self.rate * 2**LEVELS_MAX <= INDEPENDENT:
            return LEVELS_MAX
        if self.rate >= INDEPENDENT:
            return 0
        return math.ceil(math.log2(INDEPENDENT / self.rate))

    def path(self, frame: int) -> Iterator[int]:
        """Yield the frames whose random numbers determine the state in ``frame``: ends of the block, then halves."""
        low = frame >> self.levels << self.levels
        high = low + (1 << self.levels)
        yield low
        yield high
        while low != frame:
            middle = (low + high) // 2
            yield middle
            low, high = (middle, high) if frame >= middle else (low, middle)

    def state(self, frame: int, path: list[int], uniform: Array) -> Array:
        """Return whether each trap is on in ``frame``.  uniform : between 0 and 1, (frames of the path, traps)."""
        low, high = path[:2]
        on_low = uniform[0] < self.duty
        on_high = uniform[1] < (
            self.duty if self.levels < LEVELS_MAX else self._on_after(on_low, high - low)
        )
        for middle, draw in zip(path[2:], uniform[2:], strict=True):
            on = draw < self._between(on_low, on_high, middle - low)
            low, on_low, on_high = (
                (middle, on, on_high) if frame >= middle else (low, on_low, on)
            )
        return on_low

    def _on_after(self, on: Array, frames: int) -> Array:
        """Return the probability of on so many frames after a state: duty + (state − duty)·e^(−rate·frames)."""
        redrawn = 0.0
        if self.rate:
            redrawn = -math.expm1(-self.rate * frames)
        return arrays.where(on, 1 - (1 - self.duty) * redrawn, self.duty * redrawn)

    def _between(self, before: Array, after: Array, frames: int) -> Array:
        """Return the probability of on in the middle of two states, ``frames`` from each."""
        to_on, from_on, from_off = (
            self._on_after(state, frames) for state in (before, True, False)
        )
        on = to_on * arrays.where(after, from_on, 1 - from_on)
        off = (1 - to_on) * arrays.where(after, from_off, 1 - from_off)
        return arrays.ratio(on, on + off, 0.0)
