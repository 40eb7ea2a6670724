"""The noise budget: what each source changes in mean and variance of the digital numbers, against closed forms.

The random numbers are the same in every run: what passes once passes always.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive

import mitsuba_sensor as ms
from mitsuba_sensor.theory.noise_budget import Contribution, NoiseBudget

TABLE1 = ms.load_camera("konnik_table1").replace(
    **{"adc.black_level_dn": 200.0, "readout.reset": "soft"}
)
EXPOSURE = ms.Exposure(0.1)
SHAPE = (200, 300)
pytestmark = pytest.mark.usefixtures("few_windows")
RICH = {
    "pixel.prnu": 0.01, "dark_current.cv": 0.4, "readout.dsnu_row": 0.001, "pixel.dsnu_e": 10.0,
    "readout.prnu_col": 0.002, "dark_current.rts_fraction": 0.1, "dark_current.rts_amplitude_e_per_s": 500.0,
}  # fmt: skip
CURVED = {
    "readout.ve_nonlinearity": 1.0,
    "source_follower.vv_nonlinearity": 1.05,
    "adc.gamma": 1.04,
}
STEPS = {"adc.bits": 8, "adc.black_level_dn": 20.0, "adc.dnl_lsb": {"60": -1.0}}
CAMERAS = {
    "everything": TABLE1.replace(**RICH | STEPS),
    "non-linear": TABLE1.replace(**RICH | CURVED),
    "EM gain": ms.load_camera("proem_hs_1024b"),
}


def frames_of(camera: ms.Camera, light: float = 20_000.0, **how: Any) -> ms.Frames:
    return ms.expose(np.full(SHAPE, light), camera, EXPOSURE, **how)


def entries(noise_budget: NoiseBudget) -> dict[str, Contribution]:
    return {entry.source: entry for entry in noise_budget.entries}


def require_close(found: float, error: float, expected: float) -> None:
    """A variance within 4 of its standard errors, or 1 % of σ."""
    assert abs(found - expected) <= max(4 * error, 0.02 * expected), (found, error, expected)


@pytest.mark.parametrize("name", ["everything", "EM gain", exhaustive("non-linear")])
def test_rows_add_up_to_the_variances_of_the_frames(name: str) -> None:
    """With what the sources do together in a row of its own; without it they add up within 4 standard errors."""
    frames = frames_of(CAMERAS[name], 50.0 if name == "EM gain" else 20_000.0)
    budget = frames.noise_budget()
    *rows, total = budget.rows
    expected = frames.theory.averages(frames.stages[-1])
    require_close(total.temporal_dn2, total.temporal_error_dn2, expected.temporal)
    require_close(total.spatial_dn2, total.spatial_error_dn2, expected.spatial)
    assert total.share == pytest.approx(1) and budget.clipped < 1e-3
    together = next((row for row in rows if row.source == "sources together"), None)
    for part in ("temporal", "spatial"):
        left = getattr(total, f"{part}_dn2") - sum(getattr(row, f"{part}_dn2") for row in rows)
        errors = [getattr(row, f"{part}_error_dn2") for row in (*rows, total)]
        assert abs(left) <= 4 * math.hypot(*errors) + 1e-6
    assert (together is not None) == (name != "everything")  # variances of the others mix
    assert all(math.isfinite(x) for row in budget.rows for x in row[1:])


def test_a_source_that_is_switched_off_is_without_effect_and_the_others_stay() -> None:
    """The same random numbers: rows of other sources change by what rounding of float32 does."""
    on = TABLE1.replace(**{**RICH, "dark_current.rts_fraction": 0.0})
    off = on.replace(**{"pixel.dsnu_e": 0.0})
    budgets = [frames_of(camera).noise_budget() for camera in (on, off)]
    before, after = map(entries, budgets)
    assert list(before) == list(after)
    assert before["DSNU pixel"].spatial_dn2 > 1 and after["DSNU pixel"].spatial_dn2 == 0
    assert not budgets[1].change_of("DSNU pixel").any()
    for name in set(before) - {"DSNU pixel", "ADC", "PRNU column"}:
        one, other = before[name], after[name]
        assert one.temporal_dn2 == pytest.approx(other.temporal_dn2, rel=1e-3, abs=1e-5)
        assert (
            abs(one.spatial_dn2 - other.spatial_dn2)
            < 0.1 * math.hypot(one.temporal_error_dn2, one.spatial_error_dn2) + 1e-3
        )


def test_pixels_that_are_clipped_do_not_count_and_the_budget_says_how_many() -> None:
    """Half of the pixels in light beyond the full well: the rows are those of the other half."""
    light = np.full(SHAPE, 20_000.0)
    light[:, 150:] = 200_000.0
    half = ms.expose(light, TABLE1, EXPOSURE).noise_budget()
    whole = frames_of(TABLE1).noise_budget()
    assert half.clipped == pytest.approx(0.5) and whole.clipped == 0
    assert half.explain().count("50 % of the pixels are clipped") == 1
    for name in ("photon shot noise", "DSNU column"):
        one, other = entries(half)[name], entries(whole)[name]
        assert (
            abs(one.temporal_dn2 - other.temporal_dn2)
            < 4 * math.hypot(one.temporal_error_dn2, other.temporal_error_dn2) + 1e-4
        )
        assert (
            abs(one.spatial_dn2 - other.spatial_dn2)
            < 4 * math.hypot(one.spatial_error_dn2, other.spatial_error_dn2) + 1e-4
        )
    full = frames_of(TABLE1, 200_000.0).noise_budget()
    assert full.clipped == 1 and "100 % of the pixels are clipped" in full.explain()
    assert [row.source for row in full.rows] == ["total"]


def test_a_budget_is_that_of_its_frames_and_of_each_readout() -> None:
    later = frames_of(TABLE1, first_frame=3)
    assert later.noise_budget().change_of("source follower noise").shape == SHAPE
    light = ms.Photons(np.full((64, 64), 1000.0), detected=True)
    frames = ms.expose(light, "scmos_dual_gain", EXPOSURE)
    with pytest.raises(ms.InputError, match="of one readout"):
        frames.noise_budget()
    for name, one in frames.readouts.items():
        *_, total = one.noise_budget().rows
        expected = one.theory.averages(one.stages[-1])
        require_close(total.temporal_dn2, total.temporal_error_dn2, expected.temporal), name
