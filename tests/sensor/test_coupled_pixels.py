"""A stage of a user that couples neighbours, in frames, theory and noise budget.

Closed forms are the oracles. The random numbers are the same in every run: what passes once passes always.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import mitsuba_sensor as ms

TABLE1 = ms.load_camera("konnik_table1")
SHOT_NOISE_ALONE = TABLE1.replace(
    **{
        "pixel.prnu": 0.0,
        "dark_current.cv": 0.0,
        "readout.dsnu_col": 0.0,
        "source_follower.white_nv_per_rthz": 0.0,
        "adc.black_level_dn": 16.0,
    }
)
SHORT = ms.Exposure(0.1)
SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))


@dataclass(frozen=True)
class Ipc(ms.Stage):
    """Inter-pixel capacitance: each pixel gives a share ``alpha`` of its signal to each of its four neighbours."""

    alpha: float = 0.02
    domain = "electrons"
    reach_px = 1

    def coupled(self, signal: ms.Array, frame: ms.Frame) -> ms.Array:
        sides = [frame.neighbour(signal, *side) for side in SIDES]
        return frame.number(1 - 4 * self.alpha) * signal + frame.number(self.alpha) * sum(sides)

    def sample(self, electrons: ms.Electrons, frame: ms.Frame) -> ms.Electrons:
        light, dark = (self.coupled(x, frame) for x in (electrons.light, electrons.dark))
        return replace(electrons, light=light, dark=dark)


COUPLED = SHOT_NOISE_ALONE.with_stage(Ipc(), after="shot_noise")


def electrons(camera: ms.Camera, photons: float) -> tuple[float, ms.Array]:
    """Mean of two frames, and half their difference, of which the variance is half the temporal one."""
    light = np.full((512, 512), photons)
    found = ms.expose(light, camera, SHORT, frames=2, keep=("electrons",), engine="numpy")
    assert found.electrons is not None
    return float(found.electrons.mean()), (found.electrons[1] - found.electrons[0]) / 2**0.5


def test_a_coupling_of_2_percent_makes_the_photon_transfer_slope_0_848_and_keeps_the_mean() -> (
    None
):
    """Σk² = (1 − 4α)² + 4α². The same counts enter, so that the ratio of slopes is known to 0.1 %: 5 σ.

    Covariance of two neighbours 2α(1 − 4α) of the variance that enters, within 5 of its standard errors of 1/512.
    """
    slopes, noise = {}, {}
    for name, camera in (("apart", SHOT_NOISE_ALONE), ("coupled", COUPLED)):
        (dim, dim_noise), (bright, noise[name]) = (electrons(camera, x) for x in (2e3, 3e4))
        slopes[name] = (noise[name].var() - dim_noise.var()) / (bright - dim)
        slopes[f"mean {name}"] = bright
    assert slopes["coupled"] / slopes["apart"] == pytest.approx(0.848, rel=0.005)
    assert slopes["mean coupled"] == pytest.approx(slopes["mean apart"], rel=1e-6)
    beside = (noise["coupled"][:, 1:] * noise["coupled"][:, :-1]).mean()
    assert beside / noise["apart"].var() == pytest.approx(2 * 0.02 * 0.92, abs=5 / 512)


def test_a_noise_budget_has_what_the_coupling_takes_away() -> None:
    """−0.152 of the shot noise, of which 0.848 are left behind it; within 1 % of it."""
    frames = ms.expose(np.full((64, 64), 20_000.0), COUPLED, SHORT)
    found = {x.source: x.temporal_dn2 for x in frames.noise_budget().entries}
    shot = found["photon shot noise"] + found["dark shot noise"]
    assert found["ipc"] / shot == pytest.approx((0.848 - 1.0) / 0.848, abs=0.01)
