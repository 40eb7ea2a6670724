"""check_stage: right stages pass; what the rest of the package relies on, and what is stated, is checked."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from helpers.amp_glow import AmpGlow

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))


@dataclass(frozen=True)
class Hum(ms.Stage):
    """Temporal noise of pixels, rows or columns."""

    draw: str = "normal"
    sigma_v: float = 1e-3
    domain = "volts"

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        return swing + frame.number(self.sigma_v) * getattr(frame, self.draw)("hum")


@dataclass(frozen=True)
class Flicker(ms.Stage):
    """Dark electrons that go up and down with the number of the frame."""

    period: float
    domain = "electrons"

    def sample(
        self, electrons: ms.stages.Electrons, frame: ms.stages.Frame
    ) -> ms.stages.Electrons:
        added_e = 100.0 + 20.0 * np.sin(2 * np.pi * frame.index / self.period)
        return replace(electrons, dark=electrons.dark + frame.number(added_e))


@dataclass(frozen=True)
class Ipc(ms.Stage):
    """Each pixel gives 2 % of its signal to each of its four neighbours, ``times`` times."""

    times: int = 1
    domain = "electrons"
    reach_px = 1

    def sample(
        self, electrons: ms.stages.Electrons, frame: ms.stages.Frame
    ) -> ms.stages.Electrons:
        def coupled(signal: ms.stages.Array) -> ms.stages.Array:
            for _ in range(self.times):
                sides = sum(frame.neighbour(signal, *side) for side in SIDES)
                signal = frame.number(0.92) * signal + frame.number(0.02) * sides
            return signal

        return ms.stages.Electrons(coupled(electrons.light), coupled(electrons.dark))


class GlowOfTheWindow(AmpGlow):
    """Begins anew in every window."""

    def glow_e(self, frame: ms.stages.Frame) -> ms.stages.Array:
        rows, columns = np.indices(frame.window.shape)
        return self.rate_e_per_s * frame.exposure.time_s * np.exp(-(rows + columns) / 40.0)


CALLS = itertools.count()


class Counting(Hum):
    """Another number at each call."""

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        return swing + frame.number(1e-3 * next(CALLS))


class Drjit(Hum):
    """Another number on a compiled engine."""

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        return swing + frame.number(1e-3 * frame.window.backend.compiled)


class Gap(Hum):
    """No number in one frame."""

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        return swing + frame.number(float("nan") if frame.index else 0.0)


def check(stage: ms.Stage, after: str = "reset_noise", **stated: Any) -> Any:
    return ms.check_stage(stage, camera=TABLE1, after=after, **stated)


def test_a_fifth_of_a_noise_is_found() -> None:
    with pytest.raises(ms.InputError, match=r"temporal σ .* V .*0\.0012 is stated"):
        check(Hum("row_normal"), temporal=1.2e-3)


@pytest.mark.parametrize(
    ("stage", "after", "said"),
    [
        (GlowOfTheWindow(), "dark_current", "crop"),
        (Ipc(2), "shot_noise", "reach_px"),
        (Counting(), "reset_noise", "asked again"),
        (Gap(), "reset_noise", "NaN"),
        (Drjit(), "reset_noise", "drjit"),
    ],
)
def test_a_stage_that_the_package_cannot_use_is_found(
    stage: ms.Stage, after: str, said: str
) -> None:
    with pytest.raises(ms.InputError, match=said):
        check(stage, after)


def test_a_coupling_keeps_the_mean_and_its_edges_are_left_out() -> None:
    check(Ipc(), "shot_noise", mean=lambda x: x, temporal=0.0, spatial=0.0)


def test_every_stage_of_a_camera_passes_and_one_that_is_not_in_the_chain_needs_its_place() -> (
    None
):
    camera = ms.load_camera("bayer_2mp")
    for stage in camera.stages[1:-1:5]:
        ms.check_stage(stage, camera=camera)
    for stage in (Hum(), TABLE1.stages[0], TABLE1.stages[-1]):
        with pytest.raises(ms.InputError, match="after='dark_current'"):
            ms.check_stage(stage, camera=TABLE1)


@pytest.mark.parametrize("period", [7.3, 8, 100])
def test_an_effect_that_repeats_after_some_frames_has_the_sigma_of_its_sine(
    period: float,
) -> None:
    """20/√2 of a sine; frames 0 and 100 000 alone would show none of a period of 8 or 100."""
    check = ms.check_stage(
        Flicker(period), camera=TABLE1, after="dark_current", temporal=20 / np.sqrt(2)
    )
    sigmas = [one for one in check.figures if "temporal" in one.quantity]
    assert sigmas and all(one.measured > 5 for one in sigmas)
