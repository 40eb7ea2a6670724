"""Noise of a camera on images: equal to expose, unbiased, with the stated variance, the same for the same number."""

from __future__ import annotations

import pickle
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive

import mitsuba_sensor as ms
from mitsuba_sensor.optics.spectra import srgb_curve

BAYER, MONO = ms.load_camera("bayer_2mp"), ms.load_camera("sony_imx174")
RNG = np.random.default_rng(17)
PICTURE = RNG.uniform(0.0, 1.0, (21, 30, 3)).astype(np.float32)
GREY = RNG.uniform(0.0, 5000.0, (20, 31)).astype(np.float32)


class Tensor:
    """The used methods of PyTorch's tensors."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array

    def detach(self) -> Tensor:
        return self

    def cpu(self) -> Tensor:
        return self

    def is_floating_point(self) -> bool:
        return self.array.dtype.kind == "f"

    def numpy(self) -> np.ndarray:
        return self.array

    def new_empty(self, size: int) -> Tensor:
        return Tensor(np.empty(size, self.array.dtype))

    def new_tensor(self, values: np.ndarray) -> Tensor:
        return Tensor(values.astype(self.array.dtype))

    def float(self) -> Tensor:
        return Tensor(self.array.astype(np.float32))


@pytest.mark.parametrize(
    ("camera", "image", "options"),
    [(BAYER, PICTURE, {"white_e": 3000.0}), (MONO, GREY, {"values": "electrons"}),
     (ms.load_camera("rgbir_2mp"), GREY, {"values": "electrons"}),
     (ms.load_camera("sony_a7s2"), PICTURE, {"white_e": 50.0, "gain": 6400, "serial": 9})],
)  # fmt: skip
def test_it_is_expose_bit_for_bit(
    camera: ms.Camera, image: np.ndarray, options: dict[str, Any]
) -> None:
    """For the same photons, sensor unit, gain and seed, which the result reports."""
    noise = ms.SensorNoise(camera, exposure=ms.Exposure(0.02), **options)
    found = noise(image, sample=4)
    (draw,) = found.draws
    filters = camera.filter_index(image.shape[:2])
    plane = image
    if image.ndim == 3:
        letters = np.array(["RGB".index(name[0]) for name in camera.filter_names])
        plane = np.take_along_axis(image, letters[filters][..., None], 2)[..., 0] * np.float32(
            draw.white_e
        )
    wavelength = noise.light_nm
    photons = plane / camera.qe([wavelength])[:, 0].astype(np.float32)[filters]
    expected = ms.expose(
        photons[..., None], camera, ms.Exposure(0.02), wavelengths_nm=[wavelength], gain=draw.gain,
        serial=draw.serial, seed=draw.seed, engine=noise.engine,
    )  # fmt: skip
    np.testing.assert_array_equal(found.image, expected.digital[0])


def test_mean_and_variance_are_those_of_theory_and_of_photon_transfer() -> None:
    """100 frames of 64 × 64 pixels at 900 e-: K·µ to 5 standard errors; K²·µ + σ² and the map to 1 %, also 5."""
    camera = MONO.replace(**{"pixel.prnu": 0.0, "dark_current.rate_e_per_s": 0.0})
    noise = ms.SensorNoise(camera, values="electrons", exposure=ms.Exposure(0.0))
    flat = np.full((64, 64), 900.0)
    stack = np.stack([noise(flat, k).image for k in range(100)]).astype(float)
    gain, read_e = camera.system_gain_dn_per_e, camera.source_follower.read_noise_e
    variance = gain**2 * (900 + read_e**2) + 1 / 12
    black = ms.expose(np.zeros((64, 64)), camera, ms.Exposure(0.0), frames=8).digital.mean()
    assert stack.mean() - black == pytest.approx(
        gain * 900, abs=5 * np.sqrt(variance / stack.size) + 0.02
    )
    assert stack.var(axis=0, ddof=1).mean() == pytest.approx(variance, rel=0.011)
    assert noise(flat).variance_dn2.mean() == pytest.approx(variance, rel=2e-3)


@pytest.mark.parametrize("values", [exhaustive("linear"), "srgb", "electrons"])
def test_a_developed_image_has_the_values_that_came_in(values: str) -> None:
    """30 flat images: within 5 standard errors of the mean (and 0.002 for the bend of the curve)."""
    scale = 2000.0 if values == "electrons" else 1.0
    flat = np.ones((56, 56, 3), np.float32) * np.array([0.8, 0.6, 0.5], np.float32) * scale
    white_e = None if values == "electrons" else 2000.0
    noise = ms.SensorNoise(
        BAYER.without("prnu"), values=values, white_e=white_e, output="developed"
    )
    found = np.stack([noise(flat, k).image for k in range(30)])
    assert found.dtype == np.float32 and found.shape == (30, 56, 56, 3)
    error = found.mean(axis=(1, 2)).std(axis=0, ddof=1) / np.sqrt(30)
    np.testing.assert_array_less(
        np.abs(found.mean(axis=(0, 1, 2)) - flat[0, 0]), 5 * error + 0.002 * scale
    )


def test_srgb_is_taken_through_the_inverse_of_its_curve() -> None:
    """Linear light and the same light after the curve give the same frame; 8-bit integers are 255 times the floats."""
    eight = RNG.integers(0, 256, (24, 24, 3), dtype=np.uint8)
    encoded = (eight / 255).astype(np.float32)
    frames = [
        ms.SensorNoise(BAYER, values="srgb", white_e=3000.0)(one).image
        for one in (eight, encoded)
    ]
    np.testing.assert_array_equal(*frames)
    linear = PICTURE.astype(np.float64)
    one = ms.SensorNoise(BAYER, values="srgb", white_e=3000.0)(srgb_curve(linear)).image.astype(
        int
    )
    other = ms.SensorNoise(BAYER, values="linear", white_e=3000.0)(linear).image.astype(int)
    assert np.abs(one - other).max() <= 1


def test_the_same_number_is_the_same_image_alone_in_a_batch_and_in_another_process() -> None:
    noise = ms.SensorNoise(BAYER, white_e=(50.0, 5000.0), serial=(1, 50), seed=3)
    batch = noise(np.stack([PICTURE] * 3), sample=10)
    again = pickle.loads(pickle.dumps(noise))
    for number in range(3):
        np.testing.assert_array_equal(batch.image[number], again(PICTURE, 10 + number).image)
    sent = pickle.loads(pickle.dumps(batch))  # as a DataLoader's worker sends it
    np.testing.assert_array_equal(sent.variance_dn2, batch.variance_dn2)
    assert len({draw.seed for draw in batch.draws}) == 3 and batch.variance_dn2.shape == (
        3,
        21,
        30,
    )
    assert not np.array_equal(
        noise(PICTURE, 10).image, ms.SensorNoise(BAYER, white_e=3e3, seed=4)(PICTURE, 10).image
    )


def test_chips_gains_and_brightness_are_drawn_from_their_ranges() -> None:
    """In 2000 draws the means of serial and ln(white) are within 5 standard errors; each gain occurs 600 times."""
    noise = ms.SensorNoise(
        "sony_a7s2", white_e=(10.0, 1000.0), serial=(5, 104), gain=[100, 1600], seed=1
    )
    draws = [noise.draw(k) for k in range(2000)]
    serials, whites = (
        np.array([one.serial for one in draws]),
        np.log([one.white_e for one in draws]),
    )
    assert serials.min() >= 5 and serials.max() <= 104
    assert serials.mean() == pytest.approx(54.5, abs=5 * 29 / np.sqrt(2000))
    assert whites.mean() == pytest.approx(np.log(100), abs=5 * np.log(100) / np.sqrt(12 * 2000))
    assert min(sum(one.gain == gain for one in draws) for gain in (100, 1600)) > 600


@pytest.mark.parametrize("kind", [np.uint8, np.int64, np.float16, np.float32])
def test_a_tensor_comes_back_as_a_tensor_of_more_than_its_own_few_bits(kind: type) -> None:
    """12-bit codes do not fit into 8 bits, and codes above 2048 not into a 16-bit float."""
    image = (GREY * 2.5).astype(kind)
    noise = ms.SensorNoise(MONO, values="electrons")
    found, expected = noise(Tensor(image)), noise(image)
    assert isinstance(found.image, Tensor) and isinstance(found.variance_dn2, Tensor)
    np.testing.assert_array_equal(found.image.array, expected.image)
    np.testing.assert_array_equal(
        found.variance_dn2.array, expected.variance_dn2.astype(np.float32)
    )


def test_a_developed_image_is_odd_about_black_behind_the_curve() -> None:
    """In the dark, values on both sides of 0 are equally far from it, within 5 standard errors."""
    noise = ms.SensorNoise(
        MONO.without("prnu"), values="srgb", white_e=100.0, output="developed"
    )
    noise.exposure = ms.Exposure(0.0)
    dark = np.stack([noise(np.zeros((64, 64), np.float32), k).image for k in range(12)])
    error = dark.mean(axis=(1, 2)).std(ddof=1) / np.sqrt(12)
    assert abs(dark.mean()) < 5 * error + 0.005


def test_threads_that_share_a_transform_get_the_frames_of_one() -> None:
    noise = ms.SensorNoise(MONO, white_e=(10.0, 1000.0), serial=(1, 40))
    image = GREY[:9, :8] / 5000
    expected = [noise(image, k).image for k in range(24)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda k: noise(image, k).image, range(24)))
    np.testing.assert_array_equal(found, expected)


WHITE: dict[str, Any] = {"white_e": 9.0}
SRGB: dict[str, Any] = {"values": "srgb", "white_e": 9.0}


@pytest.mark.parametrize(
    ("options", "image", "said"),
    [
        ({}, GREY, "white_e is missing: give"),
        ({**WHITE, "values": "electrons"}, GREY, " and values='electrons' needs none"),
        ({"white_e": (9.0, 2.0)}, GREY, "white_e is (9.0, 2.0); it must be one number, or"),
        ({**WHITE, "serial": 1.5}, GREY, "serial is 1.5; it must be a whole number"),
        ({**WHITE, "gain": []}, GREY, "gain is []; pass one setting or several"),
        (WHITE, PICTURE, "pass (H, W), the light after"),
        *((WHITE, np.ones(x), f"image has shape {x}; pass") for x in ((31,), (2, 8, 9, 4))),
        (WHITE, GREY > 3, "image is bool"),
        (WHITE, "a.png", "is the file name 'a.png'; read the picture"),
        (WHITE, GREY * np.float32(np.nan), "image has values such as nan"),
        (WHITE, np.full((4, 4), 1e38), "1e+38; mean light must be finite"),
        (WHITE, GREY.astype(np.uint8), 'pass values="srgb"'),
        (SRGB, GREY.astype(np.uint16), "image is uint16 with values from"),
        (SRGB, np.full((4, 4), 255.0), "values from 255 to 255, but values"),
    ],
)
def test_what_does_not_fit_is_one_sentence(
    options: dict[str, Any], image: np.ndarray, said: str
) -> None:
    with pytest.raises(ms.InputError) as caught:
        ms.SensorNoise(MONO, **options)(image)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_small_and_large_images_and_a_camera_of_a_file(tmp_path: Path) -> None:
    """Images larger than the sensor; with and without pixels of every colour; the repr of a result."""
    path = tmp_path / "mine.toml"
    path.write_text(MONO.replace(**{"sensor.rows": 8, "sensor.columns": 8}).to_toml())
    assert ms.SensorNoise(path, values="electrons")(GREY).image.shape == GREY.shape
    noise = ms.SensorNoise(BAYER, white_e=100.0, output="developed")
    found = noise(np.ones((2, 2, 2, 3)))
    assert repr(found) == "<NoisyImage: 2 × 2 × 2 × 3 of bayer_2mp, 2 draws>"
    assert [draw.white_e for draw in found.draws] == [100.0, 100.0]
    with pytest.raises(ms.InputError, match="image has 1 × 5 pixels, which lack a colour"):
        noise(np.ones((1, 5, 3)))
    with pytest.raises(ms.InputError, match="moveaxis"):  # three planes, or three grey images
        noise(np.ones((3, 8, 9)))


def test_saturated_images_are_told_once_of_a_transform_and_noted_each_time() -> None:
    """White at ten full wells gives a note; white at half a full well does not."""
    camera = ms.load_camera("sony_imx174")
    image = np.full((8, 8), 0.9)
    too_bright = ms.SensorNoise(camera, white_e=10 * camera.pixel.full_well_e)
    with pytest.warns(ms.SensorWarning, match="100 % of the pixels of an image are saturated"):
        first = too_bright(image)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        second = too_bright(np.stack([image, image]), 1)
        fine = ms.SensorNoise(camera, white_e=camera.pixel.full_well_e / 2)(image)
    assert len(first.notes) == len(second.notes) == 1 and fine.notes == ()
    assert "give a smaller white_e" in first.notes[0] and "sony_imx174 holds" in first.notes[0]
    electrons = ms.SensorNoise(camera, values="electrons")
    with pytest.warns(ms.SensorWarning, match="give fewer electrons"):
        electrons(image * 1e6)


def test_a_developed_picture_of_8_bits_is_one_of_8_bits_again() -> None:
    """In bright light the image is within five standard deviations of shot noise; floats stay floats."""
    grey = np.full((16, 16, 3), 128, np.uint8)
    noise = ms.SensorNoise(BAYER, values="srgb", white_e=20_000, output="developed", seed=4)
    found, floats = noise(grey).image, noise((grey / 255).astype(np.float32)).image
    assert found.dtype == np.uint8 and floats.dtype == np.float32
    np.testing.assert_array_equal(found, np.clip(np.rint(floats * 255), 0, 255))
    assert np.abs(found.astype(float) - 128).max() < 8
