"""What render noise means in a frame: its part of the variance, and the samples that a tenth of the sensor's takes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.irradiance import RenderedFor
from mitsuba_sensor.render.light.render_noise import noise_note, render_noise, samples_for

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)


def test_without_denoising_the_variance_falls_as_one_over_the_samples(light: Any) -> None:
    """64 samples of ratio 1.5: 15 times as many for 0.1, none where the ratio is reached, is infinite or unknown."""
    assert samples_for(0.1, 1.5, light.statistics) == pytest.approx(15 * 64)
    assert samples_for(0.1, 0.1, light.statistics) is None
    assert samples_for(0.1, np.inf, light.statistics) is None


def test_with_denoising_more_are_needed_as_its_gain_falls(light: Any) -> None:
    """A gain of 8 costs twice the samples; of a small step no more than the cube root of that step."""
    statistics = replace(light.statistics, denoised={"raw_noise_ratio_median": 12.0})
    assert samples_for(0.1, 1.5, statistics) == pytest.approx(2 * 15 * 64)
    assert samples_for(1.4, 1.5, statistics) == pytest.approx((1.5 / 1.4) ** (4 / 3) * 64)


def test_a_pixel_as_noisy_by_the_render_as_by_the_sensor_owes_half_its_variance_to_it(
    light: Any,
) -> None:
    """The render's error scaled until the median ratio is 1: half of the variance, more than that in half the pixels;
    seconds are those of the render and of the samples that are missing."""
    statistics = replace(light.statistics, passes=2**20, seconds=2.0, seconds_per_sample=0.5)
    known = replace(light, statistics=statistics)
    frames = ms.expose(ms.collect(known, CAMERA, EXPOSURE), CAMERA, EXPOSURE)
    before = render_noise(known, frames)["over_sensor_median"]
    assert before is not None
    noisy = replace(known, relative_error=known.relative_error / np.float32(before**0.5))
    found = render_noise(noisy, frames)
    assert found["over_sensor_median"] == pytest.approx(1.0, rel=1e-5)
    assert found["share_of_variance_median"] == pytest.approx(0.5, rel=1e-5)
    assert found["above_sensor"] == pytest.approx(0.5, abs=1e-2)
    assert found["samples_for_a_tenth"] == pytest.approx(640, rel=1e-5)
    assert found["seconds_for_a_tenth"] == pytest.approx(2.0 + 0.5 * (640 - 64), rel=1e-5)


def test_a_note_says_how_much_of_the_grain_is_the_renders(light: Any) -> None:
    """From a tenth of the sensor's variance on; with the samples and seconds of a tenth, where they can be had."""
    long = {"over_sensor_median": 1.0, "share_of_variance_median": 0.5}
    short = {"over_sensor_median": 0.1, "share_of_variance_median": 0.1 / 1.1}
    known, unknown, endless = (
        {"samples_for_a_tenth": samples, "seconds_for_a_tenth": seconds}
        for samples, seconds in ((1234.0, 56.7), (None, None), (1e12, 1e9))
    )
    nothing = {"over_sensor_median": None, "share_of_variance_median": None}
    frames = ms.expose(ms.collect(light, CAMERA, EXPOSURE), CAMERA, EXPOSURE)
    half = "50% of the noise variance of a typical pixel is the render's, not the camera's; "
    assert list(noise_note(light, long | known, frames)) == [
        half + "--noise-ratio 0.1 takes about 1200 samples, 57 s"
    ]
    for further in (unknown, endless):
        assert list(noise_note(light, long | further, frames)) == [
            half + "render with more samples than 64 (--spp)"
        ]
    (most,) = noise_note(light, long | known | {"share_of_variance_median": 0.998}, frames)
    assert most.startswith("nearly all of the noise variance")
    assert not list(noise_note(light, short | known, frames))
    assert not list(noise_note(light, nothing | unknown, frames))


@pytest.mark.parametrize(
    ("settings", "time_s", "new"),
    [
        ({}, 0.1, ""),
        ({}, 0.15, "exposure"),
        ({"adc.bits": 14}, 0.1, "camera"),
        ({"adc.bits": 14}, 0.15, "camera and exposure"),
    ],
)
def test_a_noise_ratio_is_that_of_the_camera_and_exposure_of_its_render(
    light: Any, settings: dict[str, int], time_s: float, new: str
) -> None:
    """For others the scene is rendered again with them: the same command would stop where it did before."""
    known = replace(
        light,
        relative_error=10 * light.relative_error,
        rendered_for=RenderedFor(CAMERA, EXPOSURE, 1),
    )
    taken = ms.capture(known, CAMERA.replace(**settings), ms.Exposure(time_s))
    goal = f"a render for this {new} with --noise-ratio 0.1" if new else "--noise-ratio 0.1"
    assert (
        sum(f"the camera's; {goal} takes about" in note for note in taken.metadata["notes"])
        == 1
    )


def test_the_error_bars_of_two_passes_have_one_degree_of_freedom(light: Any) -> None:
    """The median of χ² with one is 0.455 of its mean; with more passes the neighbours' are counted in."""
    few = replace(light, statistics=replace(light.statistics, passes=2))
    frames = ms.expose(ms.collect(light, CAMERA, EXPOSURE), CAMERA, EXPOSURE)
    two, many = (render_noise(one, frames)["over_sensor_median"] for one in (few, light))
    assert two is not None and many is not None
    assert many / two == pytest.approx(0.4549, rel=1e-3)
