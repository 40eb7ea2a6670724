"""Shipped camera files of HDR sensors: right, sourced, and what their publications say of them."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.theory.dynamic_range import hdr_figures

FILES = {
    "sony_imx490": (0.1344, 24),
    "omnivision_split_pixel": (0.7473, 20),
    "scmos_dual_gain": (1.2488, 17),
}


@pytest.mark.parametrize("name", FILES)
def test_a_camera_file_is_right(name: str) -> None:
    camera, (gain, bits) = ms.load_camera(name), FILES[name]
    assert not [one for one in ms.check_camera(name) if one.level == "error"]
    assert camera.code_bits == bits
    first = next(iter(camera.readout_cameras.values()))
    assert first.system_gain_dn_per_e == pytest.approx(gain)


def test_the_split_pixel_has_the_noise_and_the_range_of_its_publication() -> None:
    camera = ms.load_camera("omnivision_split_pixel")
    noise = [one.emva1288().temporal_dark_noise_e for one in camera.readout_cameras.values()]
    assert noise == pytest.approx([0.83, 3.05, 2.96])
    figures = hdr_figures(camera, ms.Exposure(0.0))
    assert figures.saturation_e == pytest.approx(7_900 / 0.01, rel=1e-3)
    light = ms.Photons(np.full((64, 64), 300_000.0), detected=True)
    frames = ms.expose(light, camera, ms.Exposure(0.01))
    assert frames.digital.mean() == pytest.approx(300_000, rel=0.01)
