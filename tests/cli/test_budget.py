"""The command budget: the noise budget of Python, for photoelectrons or for the light of a render."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms


def test_shot_noise_read_noise_and_quantisation_are_what_a_hand_calculation_gives(
    cli: Callable[..., Any],
) -> None:
    """K·√N, K·σ_d and 1/√12; PRNU·K·N, within 4 standard errors that the rows have."""
    camera, electrons = ms.load_camera("sony_imx174"), 1000
    argv = ("budget", "--camera", camera.name, "--electrons", electrons, "--json")
    rows = {row["source"]: row for row in json.loads(cli(*argv).stdout)}
    k_dn_per_e = camera.system_gain_dn_per_e
    shot, prnu = rows["photon shot noise"], rows["PRNU"]
    off = shot["temporal_dn2"] - k_dn_per_e**2 * electrons
    assert abs(off) < 4 * shot["temporal_error_dn2"] < 0.1 * shot["temporal_dn2"]
    expected = (k_dn_per_e * electrons * camera.pixel.prnu) ** 2
    assert abs(prnu["spatial_dn2"] - expected) < 4 * prnu["spatial_error_dn2"] < 0.1 * expected
    adc = rows["ADC"]
    assert abs(adc["temporal_dn2"] - 1 / 12) < 4 * adc["temporal_error_dn2"] < 0.1
    assert rows["total"]["share"] == pytest.approx(1)
    text = cli(*argv[:-1]).stdout
    assert f"{math.sqrt(shot['temporal_dn2']):.4g}" in text and "0.01 s (--exposure-s)" in text


@pytest.mark.filterwarnings("ignore::mitsuba_sensor.SensorWarning")
def test_the_budget_of_a_render_is_that_of_its_frames(
    cli: Callable[..., Any], light: Any, light_file: Path
) -> None:
    camera = ("--camera", "konnik_table1", "--exposure-s", 0.02)
    shown = json.loads(cli("budget", light_file, *camera, "--json").stdout)
    expected = ms.expose(light, "konnik_table1", ms.Exposure(0.02)).noise_budget().rows
    assert [one["source"] for one in shown] == [one.source for one in expected]
    own = [one["temporal_dn2"] for one in shown]
    np.testing.assert_allclose(own, [one.temporal_dn2 for one in expected], rtol=1e-9)


def test_the_budget_of_a_camera_with_readouts_is_that_of_each_and_of_the_combination(
    cli: Callable[..., Any],
) -> None:
    """Temporal σ of the combination where the high gain counts: √(μ + σ_1²) electrons."""
    argv = ("budget", "--camera", "scmos_dual_gain", "--electrons", 1000, "--exposure-s", 0.001)
    found = json.loads(cli(*argv, "--json").stdout)
    gain = ms.load_camera("scmos_dual_gain").combined_readouts.nominal_gain
    combination, read_e2 = found["combination"], 1.0763**2 + 1 / 12 / gain**2
    assert combination["temporal_dn2"] == pytest.approx(gain**2 * (1000 + read_e2), rel=0.04)
    assert combination["share_of_pixels"] == {"high": 1, "low": 0}
    snr_db = 10 * math.log10(1000**2 / (1000 + read_e2))
    assert combination["snr_db"] == pytest.approx(snr_db, abs=0.2)
    assert list(found["readouts"]) == ["high", "low"]
    alone = json.loads(cli(*argv, "--readout", "low", "--json").stdout)
    assert alone == found["readouts"]["low"]


def test_electrons_above_saturation_are_rejected_and_a_replaced_k_is_noted(
    cli: Callable[..., Any], tmp_path: Path
) -> None:
    saturation_e = f"{ms.load_camera('sony_imx174').saturation_e:.5g}"
    done = cli("budget", "--camera", "sony_imx174", "--electrons", "1e6")
    assert done.exit_code == 2 and "1e6 e- is above the saturation" in done.stderr
    assert f"({saturation_e} e-)" in done.stderr
    k = ("--set", "readout.gain_dn_per_e=0.2")
    assert (
        cli("cameras", "new", tmp_path / "k.toml", "--like", "sony_imx174", *k).exit_code == 0
    )
    volts = ("--electrons", 1000, "--set", "adc.full_scale_v=1")
    done = cli("budget", "--camera", tmp_path / "k.toml", *volts)
    assert (
        done.exit_code == 0 and done.stderr.count("was replaced by adc.full_scale_v; K is") == 1
    )
