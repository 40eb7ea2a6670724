"""Arguments of expose, the frames that it returns, and their report."""

from __future__ import annotations

import json
import pickle
from typing import Any

import numpy as np
import pytest
from helpers import KEEP

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.stages.chain import chain

EXPOSURE = ms.Exposure(0.1)
pytestmark = pytest.mark.usefixtures("few_windows")
CAMERA = ms.load_camera("konnik_table1")
BAYER = ms.load_camera("bayer_2mp")
LIGHT = np.full((6, 8), 5000.0)
ENGINES = ["numpy"] if backend_problem("llvm") else ["numpy", "drjit"]


def test_a_number_lights_the_whole_sensor() -> None:
    camera = CAMERA.replace(**{"sensor.columns": 7, "sensor.rows": 5})
    frames = ms.expose(1000.0, camera, EXPOSURE)
    assert frames.digital.shape == (1, 5, 7)
    np.testing.assert_array_equal(
        frames.digital, ms.expose(np.full((5, 7), 1000.0), camera, EXPOSURE).digital
    )


def test_photons_come_as_an_array_a_list_or_photons_and_give_the_same_frame() -> None:
    one = ms.expose(LIGHT, CAMERA, EXPOSURE).digital
    for same in (
        LIGHT.tolist(),
        LIGHT.astype(np.float32),
        LIGHT.astype(int),
        ms.Photons(LIGHT),
    ):
        np.testing.assert_array_equal(ms.expose(same, CAMERA, EXPOSURE).digital, one)
    with_band = ms.expose(LIGHT[..., None], CAMERA, EXPOSURE, wavelengths_nm=[550.0])
    np.testing.assert_array_equal(with_band.digital, one)


def test_intermediate_signals_come_on_request_and_belong_together() -> None:
    plain = ms.expose(LIGHT, CAMERA, EXPOSURE, frames=3)
    assert plain.electrons is None and plain.volts is None
    assert ms.expose(LIGHT, CAMERA, EXPOSURE, keep="electrons").electrons.shape == (1, 6, 8)
    frames = ms.expose(LIGHT, CAMERA, EXPOSURE, frames=3, keep=("electrons", "volts"))
    np.testing.assert_array_equal(frames.digital, plain.digital)
    assert frames.electrons.shape == frames.volts.shape == frames.digital.shape == (3, 6, 8)
    np.testing.assert_array_equal(frames.electrons, np.floor(frames.electrons))
    adc = chain(CAMERA)[-1]
    code = np.clip(
        np.floor(adc.black_level_dn + frames.volts * adc.gain_dn_per_v + 0.5), 0, 4095
    )
    np.testing.assert_array_equal(frames.digital, code)


def test_the_report_is_json_with_photons_gain_and_counts() -> None:
    light = np.full((10, 10), 100.0)
    light[0, :4] = 1e6
    light[1, :3] = 7.0
    frames = ms.expose(light, CAMERA, EXPOSURE, frames=2)
    report = json.loads(json.dumps(frames.report, allow_nan=False))
    assert report["photons"] == {"min": 7.0, "median": 100.0, "max": 1e6, "detected": False}
    assert report["K_dn_per_e"] == pytest.approx(0.1241212, rel=1e-6)
    assert report["counts"]["clipped_full_well"] == 4
    assert report["counts"]["clipped_adc_high"] == np.sum(frames.digital[0] == 4095)
    assert report["counts"]["clipped_adc_low"] == 0
    cut = ms.expose(
        np.zeros((50, 50)), CAMERA.replace(**{"adc.black_level_dn": 0.0}), ms.Exposure(0.0)
    )
    assert cut.report["counts"]["clipped_adc_low"] == np.sum(cut.digital == 0) > 500


@pytest.mark.parametrize("frames", [1, 3])
def test_every_signal_is_an_array_of_all_pixels_and_no_report_changes_it(frames: int) -> None:
    """At 0 K there is no dark electron: one 0 for all pixels, and yet an array like every other signal."""
    cold, options = ms.Exposure(0.1, 0.0), {"frames": frames, "keep": KEEP, "first_frame": 5}
    one, other = (ms.expose(LIGHT, CAMERA, cold, **options) for _ in range(2))  # type: ignore[arg-type]
    assert other.report
    for name in (*KEEP, "digital"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert getattr(other, name).shape == (frames, *LIGHT.shape)


@pytest.mark.parametrize("engine", ENGINES)
def test_frames_survive_pickling(engine: Any) -> None:
    """So that processes can hand them to each other; the report is computed anew."""
    frames = ms.expose(LIGHT, CAMERA, EXPOSURE, serial=3, engine=engine)
    other = pickle.loads(pickle.dumps(frames))
    np.testing.assert_array_equal(other.digital, frames.digital)
    assert other.report == frames.report


@pytest.mark.parametrize("name", ["konnik_table1", "bayer_2mp", "rgbir_2mp"])
@pytest.mark.parametrize("engine", ENGINES)
def test_photoelectrons_are_exposed_of_each_filter_or_of_each_pixel(
    name: str, engine: Any
) -> None:
    """Without wavelengths: the QE is applied already. A pixel takes the layer of its own filter, at any origin."""
    camera, at = ms.load_camera(name), (3, 2)
    layers = np.random.default_rng(5).uniform(0, 5e3, (6, 8, len(camera.filter_names)))
    own = np.take_along_axis(layers, camera.filter_index((6, 8), at)[..., None], axis=2)[..., 0]
    by_filter, by_pixel = (
        ms.expose(ms.Photons(mean, detected=True), camera, EXPOSURE, origin=at, engine=engine)
        for mean in (layers, own)
    )
    np.testing.assert_allclose(by_filter.detected.mean_e, own, rtol=1e-6)
    np.testing.assert_array_equal(by_pixel.digital, by_filter.digital)
