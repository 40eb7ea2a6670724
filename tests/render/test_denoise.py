"""Denoising is off by default; its errors from two half-sets agree with noise and bias of known size."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from helpers.scenes import SCENES

from mitsuba_sensor.core.errors import InputError
from mitsuba_sensor.core.exposure import Exposure
from mitsuba_sensor.render.denoise import denoising_errors
from mitsuba_sensor.render.prepared import render
from mitsuba_sensor.sensor.camera import load_camera

CAMERA, EXPOSURE = load_camera("konnik_table1"), Exposure(0.02)
BOX = {"parameters": {"width": 48, "height": 48}, "bandwidth_nm": 100, "variant": "scalar_spectral"}


def test_denoising_lowers_the_error_and_says_by_how_much_it_is_wrong() -> None:
    """Cornell box, 32 samples: against a render of 64 times as many the error falls by more than a fifth."""
    pytest.importorskip("pyoidn")
    box = {**BOX, "parameters": {"width": 32, "height": 32, "max_depth": 4}}
    plain = render(SCENES / "cornell_box.xml", CAMERA, EXPOSURE, spp=32, **box)
    smooth = render(SCENES / "cornell_box.xml", CAMERA, EXPOSURE, spp=32, denoise=True, **box)
    reference = render(SCENES / "cornell_box.xml", CAMERA, EXPOSURE, spp=2048, seed=2, **box).data
    before, after = (np.mean(((x.data - reference) / reference) ** 2) ** 0.5 for x in (plain, smooth))
    assert after < 0.8 * before
    found = smooth.statistics.denoised
    assert found is not None and plain.statistics.denoised is None
    assert found["error_after"] < 0.8 * found["error_before"]
    assert abs(found["bias_mean"]) < 0.05
    assert found["error_before"] == pytest.approx(before * 2**0.5, rel=0.25)  # of half the samples
    np.testing.assert_array_equal(smooth.standard_error, plain.standard_error)
    assert any("error bars are those before" in note for note in smooth.statistics.notes)
    assert (smooth.data >= 0).all()


def halves(rng: np.random.Generator, sigma: float) -> np.ndarray:
    """Two renders (2, 96, 96, 4) of a smooth picture about 10."""
    reference = 10 + np.sin(np.arange(96) / 9)[:, None, None] + np.zeros((96, 96, 4))
    return reference + sigma * rng.standard_normal((2, 96, 96, 4))


def test_a_perfect_denoiser_has_no_bias_and_an_idle_one_no_gain() -> None:
    """Perfect: the reference itself. Idle: the half as it is. 36 864 values see 1 % of the error."""
    raw = halves(np.random.default_rng(1), 1.0)
    reference = halves(np.random.default_rng(1), 0.0)
    perfect, idle = denoising_errors(raw, reference), denoising_errors(raw, raw)
    assert perfect["error_after"] < 0.02 and perfect["bias_blocks"] < 0.01
    assert abs(perfect["bias_mean"]) < 0.002
    assert idle["error_after"] == pytest.approx(idle["error_before"], rel=0.03) == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize("bias", [-0.05, 0.02])
def test_a_known_bias_is_measured(bias: float) -> None:
    """A denoiser that darkens everything by 5 %: bias_mean says so, and the blocks and the error too."""
    raw = halves(np.random.default_rng(2), 0.5)
    reference = halves(np.random.default_rng(2), 0.0)
    found = denoising_errors(raw, reference * (1 + bias))
    assert found["bias_mean"] == pytest.approx(bias, abs=0.002)
    assert found["bias_blocks"] == pytest.approx(abs(bias), rel=0.05)
    assert found["error_after"] == pytest.approx(abs(bias), rel=0.1)


def test_blur_is_measured_where_the_mean_is_right() -> None:
    """Stripes of 8 pixels that a denoiser wipes out: no bias of the mean, all of it in the blocks."""
    stripes = np.where(np.arange(96) // 8 % 2, 1.2, 0.8)[:, None, None] * np.ones((96, 96, 4))
    raw = stripes + 0.1 * np.random.default_rng(3).standard_normal((2, 96, 96, 4))
    found = denoising_errors(raw, np.ones((2, 96, 96, 4)))
    assert abs(found["bias_mean"]) < 0.002
    assert found["bias_blocks"] == pytest.approx(0.2, rel=0.03)


def test_without_the_extra_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """And before the render, not after it."""
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    with pytest.raises(InputError, match=r"pip install 'mitsuba-sensor\[denoise\]'"):
        render(SCENES / "flat_field.xml", CAMERA, EXPOSURE, denoise=True, spp=10**6, **BOX)
