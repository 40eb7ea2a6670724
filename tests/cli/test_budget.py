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
from mitsuba_sensor.output.exr import write_irradiance_exr


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
    assert f"{math.sqrt(shot['temporal_dn2']):.4g}" in text and "total" in text
    assert "0.01 s (--exposure-s)" in text


def test_the_budget_of_a_render_is_that_of_its_frames(
    cli: Callable[..., Any], tmp_path: Path
) -> None:
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.02)
    light = ms.render("flat_field", camera, exposure, width=8, spp=4, denoise=False)
    write_irradiance_exr(tmp_path / "irradiance.exr", light)
    shown = json.loads(cli("budget", tmp_path / "irradiance.exr", "--json").stdout)
    expected = [row._asdict() for row in ms.expose(light).noise_budget().rows]
    for one, other in zip(shown, expected, strict=True):
        assert one["source"] == other["source"]
        np.testing.assert_allclose(one["temporal_dn2"], other["temporal_dn2"], rtol=1e-3)


def test_the_budget_of_a_camera_with_readouts_is_that_of_each_and_of_the_combination(
    cli: Callable[..., Any],
) -> None:
    """Temporal σ of the combination where the high gain counts: √(μ + σ_1²) electrons."""
    argv = ("budget", "--camera", "scmos_dual_gain", "--electrons", 1000, "--exposure-s", 0.001)
    found = json.loads(cli(*argv, "--json").stdout)
    camera = ms.load_camera("scmos_dual_gain")
    light = ms.Photons(np.full((128, 128), 1000.0), detected=True)
    frames = ms.expose(light, camera, ms.Exposure(0.001))
    assert list(found["readouts"]) == ["high", "low"]
    for name, rows in found["readouts"].items():
        expected = frames.readouts[name].noise_budget().rows
        assert [row["source"] for row in rows] == [row.source for row in expected]
        error = math.hypot(rows[-1]["temporal_error_dn2"], expected[-1].temporal_error_dn2)
        assert abs(rows[-1]["temporal_dn2"] - expected[-1].temporal_dn2) < 4 * error
    combination, gain = found["combination"], camera.combined_readouts.nominal_gain
    read_e2 = 1.0763**2 + 1 / 12 / gain**2
    assert combination["temporal_dn2"] == pytest.approx(gain**2 * (1000 + read_e2), rel=0.04)
    assert combination["share_of_pixels"] == {"high": 1, "low": 0}
    assert combination["snr_db"] == pytest.approx(
        10 * math.log10(1000**2 / (1000 + read_e2)), abs=0.2
    )
    text = cli(*argv).stdout
    assert "read-out low" in text and "combined to 17 bits" in text
    alone = json.loads(cli(*argv, "--readout", "low", "--json").stdout)
    assert alone == found["readouts"]["low"]
    split = ("budget", "--electrons", "1000", "--camera", "omnivision_split_pixel")
    told = cli(*split, "--readout", "small")
    assert "1000 e- on the first read-out are 10 e- on small" in told.stdout + told.stderr
    wrong = cli(*argv, "--readout", "lo")
    assert wrong.exit_code == 2 and "Did you mean 'low'?" in wrong.stderr


@pytest.mark.parametrize(
    ("argv", "sentence"),
    [
        ((), "give the light, and give it once: --electrons 1000"),
        (("light.exr", "--electrons", "3"), "give it once"),
        (("--electrons", "1k"), "'1k' is 1000"),
        (("--electrons", "-1"), "electrons is -1"),
        (("--electrons", "9", "--exposure-s", "auto"), "give its seconds"),
        (("none.exr",), "none.exr"),
    ],
)
def test_wrong_light_is_one_sentence(
    cli: Callable[..., Any], argv: tuple[str, ...], sentence: str
) -> None:
    done = cli("budget", *argv)
    assert done.exit_code == 2 and sentence in done.stderr and done.stderr.count("error:") == 1
