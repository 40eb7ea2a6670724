"""The plan of a stage that depends on the place: the pixels of a small frame are all looked at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.theory.plan_trial import Effect

CAMERA = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
SHAPE = (96, 128)
GAIN_DN_PER_E = 0.12
"""Less than the camera's gain from electrons to codes, about 0.124 DN/e-."""


@dataclass(frozen=True)
class Glow(ms.Stage):
    """Dark electrons at one corner of the window, 1/e of them length_px further, in the columns of one part of it."""

    electrons: float
    row: int
    column: int
    length_px: float
    domain = "electrons"

    def glow_e(self, frame: ms.Frame) -> ms.Array:
        rows, columns = np.ix_(frame.window.rows, frame.window.columns)
        distance_px = np.hypot(rows - self.row, columns - self.column)
        return self.electrons * np.exp(-distance_px / self.length_px)

    def sample(self, electrons: ms.Electrons, frame: ms.Frame) -> ms.Electrons:
        glow_e = frame.window.backend.from_numpy(self.glow_e(frame), frame.window)
        return replace(electrons, dark=electrons.dark + glow_e)

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m.add(mean=self.glow_e(m.frame))


@dataclass(frozen=True)
class HotColumn(ms.Stage):
    """One column of the sensor collects more dark electrons."""

    electrons: float
    column: int
    domain = "electrons"

    def added_e(self, frame: ms.Frame) -> ms.Array:
        hot = np.asarray(frame.window.columns) == self.column
        return self.electrons * np.where(hot, 1.0, 0.0)[None, :] * np.ones(frame.window.shape)

    def sample(self, electrons: ms.Electrons, frame: ms.Frame) -> ms.Electrons:
        added_e = frame.window.backend.from_numpy(self.added_e(frame), frame.window)
        return replace(electrons, dark=electrons.dark + added_e)

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m.add(mean=self.added_e(m.frame))


def effect_of(stage: ms.Stage, tolerance_dn: float, photons: float) -> Effect:
    camera = CAMERA.with_stage(stage, after="dark_current")
    plan = ms.plan(camera, EXPOSURE, np.full(SHAPE, photons), tolerance_dn)
    return next(effect for effect in plan.effects if effect.stage == stage.label)


@pytest.mark.parametrize("photons", [1.0, 1000.0])
@pytest.mark.parametrize("corner", one_in(3, [(0, 0), (95, 127), (0, 127), (40, 70)]))
def test_a_glow_is_kept_wherever_it_is(corner: tuple[int, int], photons: float) -> None:
    glow = Glow(2000.0, *corner, length_px=10.0)
    effect = effect_of(glow, 0.2, photons)
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    glow_e = 2000.0 * np.exp(-np.hypot(rows - corner[0], columns - corner[1]) / 10.0)
    assert effect.kept
    assert effect.mean_dn > GAIN_DN_PER_E * glow_e.mean() * 0.9
    assert effect.pixels_beyond > 0.9 * (GAIN_DN_PER_E * glow_e > 1).sum()


@pytest.mark.parametrize("column", one_in(2, [0, 41, 127]))
def test_a_single_column_is_kept(column: int) -> None:
    effect = effect_of(HotColumn(40.0, column), 0.2, 1000.0)
    assert effect.kept
    assert effect.pixels_beyond == pytest.approx(SHAPE[0], rel=0.3)


def test_a_glow_below_the_tolerance_is_left_out() -> None:
    assert not effect_of(Glow(0.01, 95, 0, length_px=10.0), 0.5, 1000.0).kept


def test_one_pixel_that_glows_is_expected_to_move() -> None:
    effect = effect_of(Glow(500.0, 33, 77, length_px=0.01), 0.2, 1000.0)
    assert effect.kept
    assert effect.pixels_beyond >= 1
