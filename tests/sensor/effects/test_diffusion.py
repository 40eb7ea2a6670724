"""Charge diffusion: shares of a Gaussian that is averaged over two pixels, by wavelength, and no electron lost."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate
import scipy.stats
from numpy.typing import NDArray

import mitsuba_sensor as ms

BASE = ms.load_camera("konnik_table1").replace(
    **{
        "quantum_efficiency.wavelengths_nm": [400.0, 800.0],
        "quantum_efficiency.curves": {"mono": [0.5, 0.5]},
        "quantum_efficiency.reference_nm": 600.0,
        "pixel.pitch_x_um": 5.0,
        "pixel.pitch_y_um": 4.0,
    }
)
DIFFUSION = "quantum_efficiency.diffusion_um"
WIDE = BASE.replace(**{DIFFUSION: [1.0, 5.0]})
SHORT = ms.Exposure(0.1)


def collected(camera: ms.Camera, photons: ms.Photons) -> NDArray[np.float64]:
    """Mean photoelectrons of each pixel."""
    return ms.expose(photons, camera, SHORT, precision="float64").theory.light.mean_e


def of_one_pixel(nm: float, photons: float = 1e4) -> NDArray[np.float64]:
    """What the pixels about one that light of this wavelength falls on collect, over all its electrons."""
    light = np.zeros((31, 31, 1))
    light[15, 15] = photons
    return collected(WIDE, ms.Photons(light, np.array([nm]))) / (0.5 * photons)


def share(distance_px: int, sigma_px: float) -> float:
    """By quadrature: a pixel frees electrons everywhere, and another collects what arrives in it."""

    def arriving(place: float) -> float:
        law = scipy.stats.norm(place, sigma_px)
        return float(law.cdf(distance_px + 0.5) - law.cdf(distance_px - 0.5))

    return float(scipy.integrate.quad(arriving, -0.5, 0.5, epsabs=1e-10)[0])


@pytest.mark.parametrize(("nm", "sigma_um"), [(400.0, 1.0), (600.0, 3.0), (800.0, 5.0)])
def test_shares_are_those_of_a_gaussian_averaged_over_two_pixels(
    nm: float, sigma_um: float
) -> None:
    """Within 1e-6, along rows of 5 µm and columns of 4 µm."""
    found = of_one_pixel(nm)
    down = [share(distance, sigma_um / 4.0) for distance in range(5)]
    right = [share(distance, sigma_um / 5.0) for distance in range(5)]
    np.testing.assert_allclose(found[15:20, 15:20], np.outer(down, right), atol=1e-6)
    np.testing.assert_allclose(found, found[::-1, ::-1], atol=1e-12)


def test_no_electron_is_lost_and_even_light_stays_even() -> None:
    assert of_one_pixel(800.0).sum() == pytest.approx(1.0, rel=1e-6)
    even = ms.Photons(np.full((20, 30, 2), 500.0), np.array([450.0, 750.0]))
    np.testing.assert_allclose(collected(WIDE, even), 500.0, rtol=1e-6)


def test_bands_of_a_colour_camera_mix_each_by_its_own_way() -> None:
    """The sum over bands of what each gives by itself, behind a mosaic."""
    bayer = ms.load_camera("bayer_2mp")
    points = len(bayer.quantum_efficiency.wavelengths_nm)
    mixed = bayer.replace(**{DIFFUSION: np.linspace(0.5, 4.0, points).tolist()})
    random = np.random.default_rng(2)
    nm = np.array([460.0, 550.0, 640.0])
    light = random.uniform(0, 1e4, (24, 26, 3))
    whole = collected(mixed, ms.Photons(light, nm))
    bands = range(3)
    parts = [collected(mixed, ms.Photons(light[..., k : k + 1], nm[k : k + 1])) for k in bands]
    np.testing.assert_allclose(whole, sum(parts), rtol=1e-9)
