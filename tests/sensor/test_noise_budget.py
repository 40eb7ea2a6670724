"""The noise budget of a frame: what every source contributes, to the last digit, and how much that must be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in

import mitsuba_sensor as ms
from mitsuba_sensor.stages.gains import gain_dn_per_e
from mitsuba_sensor.theory.noise_budget import Contribution, NoiseBudget

TABLE1 = ms.load_camera("konnik_table1").replace(
    **{"adc.black_level_dn": 200.0, "readout.reset": "soft"}
)
EXPOSURE = ms.Exposure(0.1)
SHAPE = (200, 300)
RICH = {
    "pixel.prnu": 0.01, "dark_current.cv": 0.4, "readout.dsnu_row": 0.001, "pixel.dsnu_e": 10.0,
    "readout.prnu_col": 0.002, "dark_current.rts_fraction": 0.1, "dark_current.rts_amplitude_e_per_s": 500.0,
}  # fmt: skip
CURVED = {
    "readout.ve_nonlinearity": 1.0,
    "source_follower.vv_nonlinearity": 1.05,
    "adc.gamma": 1.04,
}
YIELD = {"quantum_efficiency.quantum_yield": [1.5, 1.5]}
PARTS = {
    "dark_current.components": [
        {"weight": 0.1, "family": "uniform", "low": 100, "high": 900, "unit": "e"}
    ]
}
CAMERAS = {
    "table 1": TABLE1,
    "everything": TABLE1.replace(**RICH),
    "non-linear": TABLE1.replace(**RICH | CURVED),
    "quantum yield": TABLE1.replace(**RICH | YIELD | PARTS),
    "steps": TABLE1.replace(
        **RICH | {"adc.bits": 8, "adc.black_level_dn": 20.0, "adc.dnl_lsb": {"60": -1.0}}
    ),
    "ccd": ms.load_camera("eev_44_82"),
}


def frames_of(camera: ms.Camera, light: float = 20_000.0, **how: Any) -> ms.Frames:
    return ms.expose(np.full(SHAPE, light), camera, EXPOSURE, precision="float64", **how)


def entries(noise_budget: NoiseBudget) -> dict[str, Contribution]:
    return {entry.source: entry for entry in noise_budget.entries}


@pytest.mark.parametrize("light", [exhaustive(0.0), 20_000.0, exhaustive(70_000.0)])
@pytest.mark.parametrize("name", one_in(3, CAMERAS))
def test_contributions_add_up_to_the_frame_and_variances_to_the_theory(
    name: str, light: float
) -> None:
    """To 1e-6 DN in every pixel, in darkness, at half a well, and where well and converter clip."""
    frames = frames_of(CAMERAS[name], light)
    noise_budget = frames.noise_budget()
    assert np.abs(noise_budget.total - frames.digital[0]).max() < 1e-6
    m = frames.theory.averages(frames.stages[-1])
    size = sum(abs(e.temporal_dn2) + abs(e.spatial_dn2) for e in noise_budget.entries)
    assert sum(e.temporal_dn2 for e in noise_budget.entries) == pytest.approx(
        m.temporal, abs=1e-9 * size
    )
    assert sum(e.spatial_dn2 for e in noise_budget.entries) == pytest.approx(
        m.spatial, abs=1e-9 * size
    )


def test_a_colour_camera_balances_its_books_too() -> None:
    camera = ms.load_camera("bayer_2mp")
    frames = ms.expose(
        np.full((20, 30, 2), 2000.0), camera, EXPOSURE, wavelengths_nm=[480, 620]
    )
    assert np.abs(frames.noise_budget().total - frames.digital[0]).max() < 1e-6


OFF = {
    "PRNU": {"pixel.prnu": 0.0},
    "dark current": {"dark_current.fom_na_per_cm2": 0.0},
    "reset noise": {"readout.ktc_residual": 0.0},
    "source follower noise": {"source_follower.white_nv_per_rthz": 0.0},
    "DSNU column": {"readout.dsnu_col": 0.0},
    "DSNU row": {"readout.dsnu_row": 0.0},
    "DSNU pixel": {"pixel.dsnu_e": 0.0},
    "PRNU column": {"readout.prnu_col": 0.0},
}
FOLLOWS = {
    **{
        name: {"photon shot noise", "dark shot noise", "PRNU column"}
        for name in ("PRNU", "dark current")
    },
    **{name: {"PRNU column"} for name in OFF if name not in ("PRNU", "dark current")},
}
"""What must change along: the shot noise of light and dark current, which is one count that is split, and the gain that
multiplies all that stands before it."""


@pytest.mark.parametrize("source", one_in(4, [*OFF][::3]))
def test_switching_a_source_off_changes_its_own_entry_only(source: str) -> None:
    """Entries of the sources before it are the same bits; those after it too, but for the last digits of adding up.

    (A contribution is a difference of two signals of about 3000 DN, whose float64 step is 4.5e-13.) Rounding to codes
    and clips see the sum and are left out. The variance of the shot noise is shared by photoelectrons and dark
    electrons as the means of these pixels are, 1e-5 of which changes with a map.
    """
    on = TABLE1.replace(**{key: value for key, value in RICH.items() if "rts" not in key})
    before, after = (
        entries(frames_of(camera).noise_budget()) for camera in (on, on.replace(**OFF[source]))
    )
    assert list(before) == list(after)
    names = list(before)
    assert before[source].dn.std() > 0.01
    np.testing.assert_array_equal(after[source].dn, 0.0)
    assert after[source].temporal_dn2 == pytest.approx(0, abs=1e-9)
    for name in set(names) - {source, "ADC", "full well"} - FOLLOWS[source]:
        if names.index(name) < names.index(source):
            np.testing.assert_array_equal(before[name].dn, after[name].dn)
        else:
            np.testing.assert_allclose(before[name].dn, after[name].dn, atol=5e-12, rtol=0)
        assert before[name].temporal_dn2 == pytest.approx(
            after[name].temporal_dn2, rel=1e-4, abs=1e-6
        )
        assert before[name].spatial_dn2 == pytest.approx(
            after[name].spatial_dn2, rel=0.04, abs=0.02
        )


def test_random_sources_are_as_strong_as_they_must_be() -> None:
    """rms of each entry over 60 000 pixels within 5 σ (1.5 %) of closed forms written out here."""
    frames = frames_of(
        TABLE1.replace(**{"adc.bits": 14, "adc.black_level_dn": 800.0, "pixel.prnu": 0.01})
    )
    books, k = entries(frames.noise_budget()), gain_dn_per_e(frames.camera)
    light, dark = 12_000.0, 174.158
    expected = {
        "PRNU": 0.01 * light,
        "photon shot noise": math.sqrt(light * (1 + 0.0)),
        "dark shot noise": math.sqrt(dark),
        "reset noise": math.sqrt(0.5 * 1.380649e-23 * 298.15 * 1.602176634e-19 / 5e-6)
        / 1.602176634e-19,
        "source follower noise": 6.105069,
        "ADC": math.sqrt(1 / 12) / k,
    }
    for name, electrons in expected.items():
        dn = books[name].dn - (800.0 if name == "ADC" else 0.0)
        assert np.sqrt(np.mean(dn**2)) == pytest.approx(
            k * electrons, rel=5 / math.sqrt(2 * dn.size) + 3e-4
        ), name
        assert abs(dn.mean()) < 5 * k * electrons / math.sqrt(dn.size), name
        variance = books[name].spatial_dn2 if name == "PRNU" else books[name].temporal_dn2
        assert variance == pytest.approx(
            (k * electrons) ** 2, rel=0.02 if name == "PRNU" else 2e-4
        ), name
    assert books["quantum efficiency"].dn.mean() == pytest.approx(k * light, rel=1e-12)
    assert books["dark current"].dn.mean() == pytest.approx(k * dark, rel=1e-3)
    assert books["DSNU column"].spatial_dn2 == pytest.approx((33 * k) ** 2, rel=0.04)


def test_entries_of_two_sources_are_not_correlated() -> None:
    """|ρ| < 5/√n for all pairs of temporal sources."""
    books = entries(frames_of(TABLE1).noise_budget())
    noises = (
        "photon shot noise",
        "dark shot noise",
        "reset noise",
        "source follower noise",
        "PRNU",
        "dark current",
    )
    rho = np.corrcoef([books[name].dn.ravel() for name in noises]) - np.eye(len(noises))
    assert np.abs(rho).max() < 5 / math.sqrt(SHAPE[0] * SHAPE[1])


def test_a_full_well_is_booked_as_what_it_took_away() -> None:
    """Far above saturation: detection puts in more than the range, the full well takes it, and noise before it dies."""
    books = entries(frames_of(TABLE1, 200_000.0).noise_budget())
    k = gain_dn_per_e(TABLE1)
    assert books["quantum efficiency"].dn.mean() == pytest.approx(120_000 * k)
    assert books["full well"].dn.mean() == pytest.approx(
        (33_000 - 120_000 - 174.158) * k, rel=1e-3
    )
    assert books["full well"].temporal_dn2 < 0


def test_a_noise_budget_of_frame_3_is_of_frame_3_and_explains_itself() -> None:
    frames = frames_of(TABLE1, first_frame=3)
    assert (
        np.abs(frames.noise_budget().total - frames_of(TABLE1, frames=4).digital[3]).max()
        < 1e-6
    )
    assert "photon shot noise" in frames.noise_budget().explain()


def test_the_table_has_sigma_share_and_total_and_no_source_without_effect() -> None:
    """The shares of what sources add are 100 %; the total is the variance of the theory, its root the printed σ."""
    frames = frames_of(TABLE1)
    budget = frames.noise_budget()
    *rows, total = budget.rows
    assert total.share == pytest.approx(1) and sum(r.share for r in rows) == pytest.approx(1)
    expected = frames.theory.averages(frames.stages[-1])
    assert total.temporal_dn2 == pytest.approx(expected.temporal, rel=1e-9)
    assert total.spatial_dn2 == pytest.approx(expected.spatial, rel=1e-9)
    assert total.mean_dn == pytest.approx(frames.digital[0].mean(), rel=1e-9)
    text = budget.explain()
    shown = {line.split("  ")[0]: line.split() for line in text.splitlines()}
    for row in (*rows, total):
        assert abs(row.temporal_dn2) + abs(row.spatial_dn2) + abs(row.mean_dn) > 5e-4
        for cell, variance_dn2 in zip(shown[row.source][-3:-1], row[2:4], strict=True):
            if variance_dn2:
                assert float(cell) ** 2 == pytest.approx(abs(variance_dn2), rel=1e-3)
            else:
                assert cell == "–"
    assert "without effect here:" in text and "reset noise" in shown


def test_what_a_clip_takes_away_is_below_zero_and_says_so() -> None:
    """Far above the full well nothing is left: what sources add and what the clips take cancel within 1 %."""
    budget = frames_of(TABLE1, 200_000.0).noise_budget()
    *rows, total = budget.rows
    assert next(row.source for row in rows if row.takes_noise) == "full well"
    assert sum(row.share for row in rows if row.share > 0) == pytest.approx(1)
    assert abs(total.share) < 0.01
    assert "below zero: the stage takes away noise" in " ".join(budget.explain().split())
    assert "below zero" not in frames_of(TABLE1).noise_budget().explain()


@pytest.mark.parametrize("photons", [1e4, 3e9])
def test_in_float32_the_contributions_add_up_to_the_frame_in_any_light(photons: float) -> None:
    """Up to 1e-6 DN. The counts of 3e9 photons are rounded by 64 electrons: 8 DN were missing."""
    camera = ms.load_camera("konnik_table1")
    light, exposure = np.full((16, 16), photons), ms.Exposure(0.1)
    frames = ms.expose(light, camera, exposure, precision="float32", engine="numpy")
    np.testing.assert_allclose(
        frames.noise_budget().total, frames.digital[0], rtol=0, atol=1e-6
    )
