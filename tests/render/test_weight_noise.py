"""The noise that the weights of displaced rays add, and what is left of it: mean, even fields, edges.

Random tests fix their seeds.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import scene_text, skip_unless_usable, write_scene
from helpers.slanted_edge import edge_picture, frequency_response

import mitsuba_sensor as ms
from mitsuba_sensor.core import Float64Array
from mitsuba_sensor.optics.point_spread import diffraction_mtf
from mitsuba_sensor.render.load.weight_noise import without_weight_noise
from mitsuba_sensor.render.passes.prepared import PreparedRender, prepare

LLVM = "llvm_ad_spectral"
EXPOSURE = ms.Exposure(0.05)


def camera(**fields: Any) -> ms.Camera:
    named = {name.replace("__", "."): value for name, value in fields.items()}
    return ms.load_camera("bayer_2mp").replace(**{"lens.diffraction": True, **named})


def prepared(scene: Any, cam: ms.Camera, **options: Any) -> PreparedRender:
    usual = {"variant": skip_unless_usable(LLVM), "width": 24}
    return prepare(scene, cam, EXPOSURE, **{**usual, **options})


def test_an_even_field_has_hardly_more_noise_with_diffraction() -> None:
    """64 samples: variance of the photoelectrons at most 1.5 times that without; it was 21 times."""
    variances = [
        np.mean(
            ms.render(
                "flat_field",
                camera(lens__diffraction=on),
                EXPOSURE,
                spp=64,
                width=24,
                denoise=False,
                progress=False,
                seed=2,
                variant=skip_unless_usable(LLVM),
            ).relative_error.astype(float)
            ** 2
        )
        for on in (False, True)
    ]
    assert variances[1] < 1.5 * variances[0]


@pytest.mark.exhaustive
def test_the_light_of_random_paths_stays_the_same_in_the_mean() -> None:
    """The Cornell box: photoelectrons of all pixels with and without what is taken away, of the same rays, within five
    standard errors of their difference by pass."""
    render, means = prepared("cornell_box", camera(), spectral="channels").scene, list[float]()
    for number in range(24):
        image = render.render(number + 1, 16, (0, render.view.crop_size[1])).astype(float)
        values = image[..., :3].copy()
        without_weight_noise(values, image[..., 3:].astype(np.float32))
        means.append((values - image[..., :3]).sum() / image[..., :3].sum())
    error = np.std(means) / math.sqrt(len(means))
    assert abs(np.mean(means)) < 5 * error < 0.01


def test_the_level_is_the_smaller_neighbour_and_never_the_own_pixel() -> None:
    values = np.array([[[4.0], [6.0], [9.0], [5.0]]])
    without_weight_noise(values, np.full((1, 4, 1), 0.1, np.float32))
    np.testing.assert_allclose(values[0, :, 0], [3.4, 5.6, 8.5, 4.1], rtol=1e-6)
    narrow = np.array([[[4.0], [6.0]]])
    without_weight_noise(narrow, np.full((1, 2, 1), 0.1, np.float32))
    np.testing.assert_array_equal(narrow[0, :, 0], [4.0, 6.0])


@pytest.mark.exhaustive
def test_an_edge_behind_colour_filters_has_the_response_of_its_wavelengths(
    tmp_path: Path,
) -> None:
    """f/8, 3.45 µm: within 0.005 up to Nyquist's frequency behind red, green and blue, of the mean of the closed forms
    over what each filter detects; 2048 samples have a standard error of 0.0015."""
    from render.test_point_spread import ANGLE_DEG, HALF_PLANE, PITCH_UM, SHAPE

    pixel = {"pixel__pitch_x_um": PITCH_UM, "pixel__pitch_y_um": PITCH_UM}
    cam = camera(**pixel, pixel__fill_factor=1.0, lens__f_number=8.0)
    film = (
        f'<integer name="width" value="{SHAPE[1]}"/><integer name="height" value="{SHAPE[0]}"/>'
    )
    sensor = (
        '<sensor type="perspective"><float name="fov" value="2"/>{more}<film type="hdrfilm">'
        + film
        + "{film}</film></sensor>"
    )
    text = scene_text('<integrator type="direct"/>', HALF_PLANE, sensor=sensor)
    light = ms.render(
        write_scene(tmp_path, text),
        cam,
        EXPOSURE,
        spp=2048,
        spectral="channels",
        denoise=False,
        progress=False,
        seed=3,
        variant=skip_unless_usable(LLVM),
    )
    angle, nm = math.radians(ANGLE_DEG), np.linspace(*cam.band_nm, 301)
    for number, detected in enumerate(cam.qe(nm) * nm):

        def mtf(frequency: Float64Array, share: Float64Array = detected) -> Float64Array:
            scaled = frequency[..., None] * nm * 1e-3 * 8.0 / PITCH_UM
            lens = (diffraction_mtf(scaled) * share).sum(axis=-1) / share.sum()
            across = np.sinc(frequency * math.cos(angle))
            return np.asarray(lens * across * np.sinc(frequency * math.sin(angle)))

        found = frequency_response(light.data[..., number].astype(float))
        expected = frequency_response(edge_picture(mtf, SHAPE, ANGLE_DEG))
        np.testing.assert_allclose(found, expected, atol=0.005)
