"""The SNR curve of a camera is that of its closed form."""

from __future__ import annotations

import json

import matplotlib
import numpy as np
import pytest
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.cli import app

LEVELS = np.geomspace(5, 8000, 10)
few = pytest.mark.usefixtures("few_windows")


def test_snr_is_n_over_the_root_of_n_and_the_variances_of_read_noise_and_rounding() -> None:
    camera = ms.load_camera("sony_imx174")
    exposure = ms.Exposure(0.01)
    dark = ms.expose(np.zeros((64, 64)), camera, exposure)
    gain = camera.system_gain_dn_per_e
    other_e2 = dark.temporal_variance.mean() / gain**2
    curve = ms.snr_curve(camera, exposure, LEVELS)
    np.testing.assert_allclose(curve.snr, LEVELS / np.sqrt(LEVELS + other_e2), rtol=3e-3)


def test_spatial_noise_is_the_prnu_of_the_signal_where_there_is_much() -> None:
    camera = ms.load_camera("sony_imx174")
    curve = ms.snr_curve(camera, electrons=[20_000.0])
    share = curve.spatial_dn / curve.signal_dn
    assert share == pytest.approx(camera.pixel.prnu, rel=0.05)
    assert curve.total_snr == pytest.approx(1 / np.hypot(1 / curve.snr, share))


@pytest.mark.parametrize("camera", ["konnik_table1", "scmos_dual_gain"])
@few
def test_every_camera_has_a_curve_that_rises_below_saturation(camera: str) -> None:
    levels = np.geomspace(1, 0.9 * ms.load_camera(camera).saturation_e, 3)
    curve = ms.snr_curve(camera, electrons=levels)
    assert np.isfinite(curve.snr).all() and (np.diff(curve.signal_dn) > 0).all()


@few
def test_the_command_budget_sweeps_the_levels_of_light() -> None:
    shown = CliRunner().invoke(app, ["budget", "--sweep", "--camera", "sony_imx174", "--json"])
    assert shown.exit_code == 0
    snr = [row["snr"] for row in json.loads(shown.stdout)]
    np.testing.assert_allclose(snr, ms.snr_curve("sony_imx174", ms.Exposure(0.01)).snr)
    refused = CliRunner().invoke(app, ["budget", "--sweep", "--electrons", "5"])
    assert refused.exit_code == 2 and "--electrons" in refused.stderr


@few
def test_plots_draw_the_numbers() -> None:
    matplotlib.use("Agg")
    camera, levels = ms.load_camera("konnik_table1"), LEVELS[::4]
    curve = ms.snr_curve(camera, electrons=levels)
    frames = ms.expose(np.full((16, 16), 3000.0), camera, ms.Exposure(0.01))
    np.testing.assert_array_equal(curve.plot().lines[0].get_ydata(), curve.snr)
    assert curve.explain().count("\n") == len(levels) + 1
    assert f"{curve.snr[-1]:.5g}" in curve.explain() and "<td" in curve._repr_html_()
    counts = frames.plot().patches[0].get_data().values
    assert counts.sum() == frames.digital.size == frames.histogram().sum()
    budget = frames.noise_budget()
    bars = budget.plot().patches
    assert bars[0].get_width() == pytest.approx(budget.rows[-1].temporal_dn2 ** 0.5)
    assert len(bars) == 2 * len(budget.rows)


def test_a_camera_lists_its_own_names_only() -> None:
    names = dir(ms.load_camera("konnik_table1"))
    assert {"pixel", "replace", "emva1288"} <= {*names}
    assert not [name for name in names if "pydantic" in name or name.startswith(("model", "_"))]


def test_the_histogram_of_the_largest_codes_is_drawn() -> None:
    """255 + 1 is 0 in uint8."""
    matplotlib.use("Agg")
    camera = ms.load_camera("konnik_table1").replace(**{"adc.bits": 8})
    frames = ms.expose(np.full((16, 16), 1e9), camera, ms.Exposure(0.01))
    assert frames.digital.dtype == np.uint8 and (frames.digital == 255).all()
    assert frames.plot().patches[0].get_data().values.sum() == frames.digital.size
