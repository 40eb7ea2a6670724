"""Defect and RTS pixels that were put in are found where they are; sensors without any have the stated false alarms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.lab_frames import Sigmas, frames, noise, rounded, stack

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.defects import defects
from mitsuba_sensor.lab.measure.rts_pixels import rts_pixels

QUIET = Sigmas(0, 0, 2)


def test_hot_dead_and_deviating_pixels_are_found_where_they_are() -> None:
    """Among columns of 5 DN, pixels of 1 DN and light that falls off: 9 σ in the dark, 0 and 60 % of the response."""
    rng, shape = np.random.default_rng(1), (80, 90)
    dark = 100 + noise(rng, shape, Sigmas(0, 5, 1))
    response = (1500 - np.linspace(0, 500, 90)) * (1 + 0.005 * rng.normal(size=shape))
    hot, dead, weak = [(7, 9), (40, 41)], [(5, 5), (79, 89)], [(60, 3)]
    dark[tuple(zip(*hot, strict=True))] += 12
    response[tuple(zip(*dead, strict=True))] = 0
    response[60, 3] *= 0.6
    found = defects(*(stack(frames(rng, mean, 16, QUIET)) for mean in (dark, dark + response)))
    for pixels, places in ((found.hot, hot), (found.dead, dead), (found.deviating, weak)):
        assert pixels is not None and list(map(tuple, np.argwhere(pixels).tolist())) == places
    share = found.hot_share
    assert share.value == pytest.approx(100 * 2 / 7200) and share.covers(100 * 2.5 / 7200)


def test_defects_have_the_stated_false_alarms() -> None:
    """100 sensors of 60 × 60, one in ten may name a pixel: more than 22 once in 10⁴."""
    rng = np.random.default_rng(5)
    images = (Stack(100 + 3 * rng.normal(size=(1, 60, 60)), 0.1) for _ in range(100))
    assert 1 < sum(bool(defects(one, false_alarm=0.1).hot.any()) for one in images) < 23


def test_the_simulators_rts_pixels_are_found_with_step_and_share() -> None:
    """Table 1's camera with 1 % of RTS pixels: those that were in both levels for 6 frames are found, at most one other
    is; steps of 300 e- · exp(−0.57 eV/k·(1/298.15 K − 1/300 K)) within 4 standard errors on average."""
    fields = {"fraction": 0.01, "amplitude_e_per_s": 3000.0, "duty": 0.3, "switching": 0.5}
    changes = {f"dark_current.rts_{key}": value for key, value in fields.items()}
    camera, shape = ms.load_camera("konnik_table1").replace(**changes), (60, 100)
    kept = ("dark_electrons",)
    made = ms.expose(np.zeros(shape), camera, ms.Exposure(0.1), frames=40, seed=4, keep=kept)
    assert made.dark_electrons is not None
    site = ms.fpn_maps(camera, shape=shape)["rts_site"] > 0
    on = (made.dark_electrons > 174 + 130).sum(axis=0)
    both = set(map(tuple, np.argwhere(site & (on >= 6) & (on <= 34)).tolist()))
    found = rts_pixels(Stack(made.digital, 0.1, bits=12))
    places = set(zip(found.rows.tolist(), found.columns.tolist(), strict=True))
    others = places - set(map(tuple, np.argwhere(site).tolist()))
    assert len(both) > 30 and both <= places and len(others) <= 1
    step = 0.1241212 * 300 * math.exp(-0.57 / 8.617333262e-5 * (1 / 298.15 - 1 / 300))
    for values, true in ((found.steps, step), (found.shares, 0.3)):
        error = 4 * values.std() / len(places) ** 0.5
        assert values.mean() == pytest.approx(true, abs=error)


@pytest.mark.parametrize("sigma", [0.15, 0.5, 1.0, 5.0])
def test_stacks_without_rts_have_the_stated_false_alarms(sigma: float) -> None:
    """6 stacks of 100 × 100 pixels, 32 integer frames with a fixed pattern and σ/10 of drift, one in ten may name a
    pixel: 4 or more once in 800 runs. Rounding to two or three codes makes no levels."""
    rng, named = np.random.default_rng(5), 0
    for _ in range(6):
        pattern = rng.normal(size=(100, 100)) + 0.1 * sigma * rng.normal(size=(32, 1, 1))
        values = rounded(100 + pattern + sigma * rng.normal(size=(32, 100, 100)))
        named += bool(rts_pixels(Stack(values, 0.1), false_alarm=0.1).rows.size)
    assert named < 4


def test_frames_that_show_no_defects_are_marked_or_refused() -> None:
    quiet = np.full((2, 30, 30), 100, np.uint16)
    quiet[:, 3, 4] = 103
    found = defects(Stack(quiet, 0.1))
    assert np.argwhere(found.hot).tolist() == [[3, 4]] and found.dead_share.note
    dark = stack(frames(np.random.default_rng(3), np.full((30, 30), 100.0), 16, QUIET))
    saturated = defects(dark, Stack(np.full((2, 30, 30), 4095, np.uint16), 0.1)).dead_share
    assert math.isnan(saturated.value) and "4095" in saturated.note
    steady = rts_pixels(dark)
    assert steady.fraction.value == 0 and steady.fraction.high < 0.5 and steady.step.note
    for refused in (
        lambda: defects(dark, dark.window(slice(0, 20), slice(0, 20))),
        lambda: defects(dark, false_alarm=0.0),
        lambda: rts_pixels(Stack(dark.frames[:7], 0.1)),
    ):
        with pytest.raises(ms.InputError):
            refused()


def test_two_levels_are_what_went_in_and_no_hot_pixel_or_particle() -> None:
    """400 pixels of 64 frames, 40 % of them 20 DN higher, σ 2: means within 5 standard errors. Pixels of more shot
    noise and two frames of a particle are no RTS pixels."""
    rng = np.random.default_rng(7)
    electrons = rng.poisson(np.where(rng.random((40, 80)) < 0.1, 16.0, 1.0), (64, 40, 80))
    values = 100.0 + electrons + 2 * rng.normal(size=electrons.shape)
    values[4:6, 20, 21] += 500
    levels = 20 * (rng.random((64, 40, 10)) < 0.4)
    values[:, :, ::8] = 100 + 2 * rng.normal(size=(64, 40, 10)) + levels
    found = rts_pixels(stack(values))
    assert sorted(set(found.columns)) == list(range(0, 80, 8)) and found.rows.size == 400
    assert found.steps.mean() == pytest.approx(20, abs=5 * 0.51 / 20)
    assert found.shares.mean() == pytest.approx(0.4, abs=5 * 0.0613 / 20)
