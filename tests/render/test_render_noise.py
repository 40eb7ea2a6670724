"""What render noise means in a frame: its part of the variance, and the note on it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.irradiance import RenderedFor
from mitsuba_sensor.render.light.light_source import noise_note, render_noise

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)


def test_a_pixel_as_noisy_by_the_render_as_by_the_sensor_owes_half_its_variance_to_it(
    light: Any,
) -> None:
    """The render's error scaled until the median ratio is 1: half of the variance, more in half the pixels."""
    known = replace(light, statistics=replace(light.statistics, passes=2**20))
    frames = ms.expose(ms.collect(known, CAMERA, EXPOSURE), CAMERA, EXPOSURE)
    before = render_noise(known, frames)["over_sensor_median"]
    noisy = replace(known, relative_error=known.relative_error / np.float32(before**0.5))
    found = render_noise(noisy, frames)
    assert found["over_sensor_median"] == pytest.approx(1.0, rel=1e-5)
    assert found["share_of_variance_median"] == pytest.approx(0.5, rel=1e-5)
    assert found["above_sensor"] == pytest.approx(0.5, abs=1e-2)


@pytest.mark.parametrize(
    ("ratio", "share", "begins"),
    [(1.0, 0.5, "50 %"), (999.0, 0.999, "nearly all"), (0.1, 0.1 / 1.1, None)],
)
def test_a_note_says_how_much_of_the_grain_is_the_renders(
    light: Any, ratio: float, share: float, begins: str | None
) -> None:
    """From a tenth of the sensor's variance on."""
    frames = ms.expose(ms.collect(light, CAMERA, EXPOSURE), CAMERA, EXPOSURE)
    noise = {"over_sensor_median": ratio, "share_of_variance_median": share}
    notes = list(noise_note(light, noise, frames))
    assert len(notes) == (begins is not None)
    assert all(
        note.startswith(str(begins)) and "spp= above 64, or noise_ratio=0.1)" in note
        for note in notes
    )


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
    again = f"; render again{f' for this {new}' if new else ''} with more samples (spp="
    assert sum(again in note for note in taken.metadata["notes"]) == 1


def test_the_error_bars_of_two_passes_have_one_degree_of_freedom(light: Any) -> None:
    """The median of χ² with one is 0.455 of its mean; with more passes the neighbours' are counted in."""
    few = replace(light, statistics=replace(light.statistics, passes=2))
    frames = ms.expose(ms.collect(light, CAMERA, EXPOSURE), CAMERA, EXPOSURE)
    two, many = (render_noise(one, frames)["over_sensor_median"] for one in (few, light))
    assert many / two == pytest.approx(0.4549, rel=1e-3)
