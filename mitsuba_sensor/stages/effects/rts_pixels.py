"""Random telegraph signal (RTS) pixels: traps that switch a pixel's dark current on and off between frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core import Array, Electrons, Frame, SensorWindow, arrays, distributions
from ...core.backend import Backend
from ..dark_components import Activation, Reference, reference_temperature_k
from ..dark_current_models import FIGURE_OF_MERIT_AT_K, arrhenius
from ..datasheet import Chance, FileTable, Kelvin, NotNegative, optional
from ..stage import Datasheet, Stage

AMPLITUDE_EV, SWITCHING_EV = 0.57, 0.9
"""Activation energies of the amplitude (0.5–0.6 eV) and of the mean times between switches (0.9 ± 0.1 eV) of irradiated
CCDs (Hopkins & Hopkinson, IEEE Trans. Nucl. Sci. 40, 1567, 1993, and 42, 2074, 1995)."""

FORGOTTEN = 33 * math.log(2)
"""States correlated by e^-this, 2^-33, are independent: less than the resolution of the random bits."""

LONGEST = 32
"""Frame numbers are below 2^32, so that no block needs to be longer."""

SITES = 2**14
"""Traps that are computed at a time: a bound of the memory."""


class RtsFields(FileTable):
    """Random telegraph signals."""

    rts_fraction: Chance = optional(
        "fraction of the pixels with a random telegraph signal", 0.001, 0.0
    )
    rts_amplitude_e_per_s: NotNegative = optional(
        "step of the telegraph signal at rts_at_temperature_k [e-/s]", 200, 0.0
    )
    rts_switching: Annotated[float, Field(ge=1e-4, le=1, strict=True)] = optional(
        "probability per frame that the state of a trap is drawn anew", 0.1, 0.1
    )
    rts_duty: Chance = optional("fraction of the time that a trap is on", 0.5, 0.5)
    rts_at_temperature_k: Annotated[Reference | None, Kelvin] = optional(
        "temperature of amplitude and switching [K]; default: at_temperature_k, or 300 K without one",
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
    """Adds amplitude·t dark electrons where a trap is on.

    fraction : of the pixels that have a trap.  amplitude_e_per_s : the step [e-/s].
    switching : probability per frame that a state is drawn anew; states Δ frames apart correlate by (1 − switching)^Δ.
    duty : fraction of the time that a trap is on.
    at_temperature_k : T_ref of amplitude and switching [K]; both follow exp(E_a/k·(1/T_ref − 1/T)), the second as a
        rate, −ln(1 − switching) per frame, each with its activation energy [eV].
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
        """None for a camera without such pixels."""
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
        """Adds the electrons of the traps that are on."""
        step = self.step_e(frame)
        if self.fraction == 0 or step == 0:
            return electrons
        return replace(electrons, dark=electrons.dark + frame.number(step) * self.states(frame))

    def step_e(self, frame: Frame) -> float:
        """Electrons of a trap that is on all the time, at this exposure's temperature [e-]."""
        exposure = frame.exposure
        thermal = arrhenius(exposure.temperature_k, self.at_temperature_k, self.activation_ev)
        return self.amplitude_e_per_s * thermal * exposure.time_s

    def traps(self, frame: Frame) -> TwoStates:
        """How the traps switch at this exposure's temperature. Those drawn anew in every frame do so unless frozen."""
        thermal = arrhenius(
            frame.exposure.temperature_k, self.at_temperature_k, self.switching_activation_ev
        )
        if self.switching == 1:
            rate = math.inf
        else:
            rate = -math.log1p(-self.switching)
        return TwoStates(self.duty, rate * thermal if thermal else 0.0)

    def states(self, frame: Frame) -> Array:
        """1 where a trap is on in this frame, else 0, (H, W). Traps are few: this is done on the host."""
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
        """``rts_site``: 1 where a pixel has a trap, else 0."""
        return {
            "rts_site": window.measured_or(
                "rts_site", lambda: window.fixed_map("rts_site", self._from_bits)
            )
        }

    def _from_bits(self, backend: Backend, bits: Array) -> Array:
        return arrays.where(
            backend.uniform(bits) < backend.number(self.fraction),
            backend.number(1.0),
            backend.number(0.0),
        )


@dataclass(frozen=True)
class TwoStates:
    """A stationary process of two states, on with probability ``duty``; Δ frames apart they correlate by e^(−rate·Δ).

    Any frame is computed alone, in a number of steps that grows with the logarithm of 1/rate. Frames 2^levels apart are
    independent (a block; the frame numbers of one block if the process is slower than that). Within a block the state
    in the middle of two known ones follows from Bayes' rule, P(m | a, c) ∝ P(m | a)·P(c | m), and so on by halves.
    """

    duty: float
    rate: float

    @property
    def levels(self) -> int:
        """log₂ of the frames of a block."""
        if self.rate * 2**LONGEST <= FORGOTTEN:
            return LONGEST
        if self.rate >= FORGOTTEN:
            return 0
        return math.ceil(math.log2(FORGOTTEN / self.rate))

    def path(self, frame: int) -> Iterator[int]:
        """Frames whose random numbers decide on the state in ``frame``: the block's ends, then by halves."""
        low = frame >> self.levels << self.levels
        high = low + (1 << self.levels)
        yield low
        yield high
        while low != frame:
            middle = (low + high) // 2
            yield middle
            low, high = (middle, high) if frame >= middle else (low, middle)

    def state(self, frame: int, path: list[int], uniform: Array) -> Array:
        """Whether each trap is on in ``frame``.  uniform : between 0 and 1, (frames of the path, traps)."""
        low, high = path[:2]
        on_low = uniform[0] < self.duty
        on_high = uniform[1] < (
            self.duty if self.levels < LONGEST else self._on_after(on_low, high - low)
        )
        for middle, draw in zip(path[2:], uniform[2:], strict=True):
            on = draw < self._between(on_low, on_high, middle - low)
            low, on_low, on_high = (
                (middle, on, on_high) if frame >= middle else (low, on_low, on)
            )
        return on_low

    def _on_after(self, on: Array, frames: int) -> Array:
        """Probability of being on so many frames after a state: duty + (state − duty)·e^(−rate·frames)."""
        anew = 0.0
        if self.rate:
            anew = -math.expm1(-self.rate * frames)
        return arrays.where(on, 1 - (1 - self.duty) * anew, self.duty * anew)

    def _between(self, before: Array, after: Array, frames: int) -> Array:
        """Probability of being on in the middle between two states, ``frames`` from each."""
        to_on, from_on, from_off = (
            self._on_after(state, frames) for state in (before, True, False)
        )
        on = to_on * arrays.where(after, from_on, 1 - from_on)
        off = (1 - to_on) * arrays.where(after, from_off, 1 - from_off)
        return arrays.ratio(on, on + off, 0.0)
