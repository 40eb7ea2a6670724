"""Light that no renderer made: an irradiance map, a spectral cube, a complex field, a flat field, a gradient."""

from __future__ import annotations

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.units import LIGHT_SPEED_M_PER_S, PLANCK_J_S

TABLE1 = ms.load_camera("konnik_table1")
BAYER = ms.load_camera("bayer_2mp")
EXPOSURE = ms.Exposure(0.1)
FULL_WELL_W_PER_M2 = 0.0122280424770
"""Fills Table 1's well in 0.1 s at 550 nm."""


def photons_of(
    irradiance: float, wavelength_nm: float, camera: ms.Camera = TABLE1, time_s: float = 0.1
) -> float:
    """E·w·h·FF·t·λ/(hc), written out."""
    area = camera.pixel.pitch_x_um * camera.pixel.pitch_y_um * 1e-12 * camera.pixel.fill_factor
    return (
        irradiance * area * time_s * wavelength_nm * 1e-9 / (PLANCK_J_S * LIGHT_SPEED_M_PER_S)
    )


def test_the_irradiance_of_the_paper_fills_the_well_of_table_1() -> None:
    """0.0122280424770 W/m² in 0.1 s: 55 000 photons, 33 000 photoelectrons.

    To 2e-7: that number was made with the Planck constant of CODATA 2006, 1.8e-7 below the exact one of 2019. (And 1e-7
    of float32.)
    """
    light = ms.uniform_light(FULL_WELL_W_PER_M2, (3, 4))
    photons = ms.collect(light, TABLE1, EXPOSURE)
    assert photons.mean.shape == (3, 4, 1) and list(photons.wavelengths_nm) == [550.0]
    np.testing.assert_allclose(photons.total, 55_000, rtol=2e-7)
    frames = ms.expose(
        photons, TABLE1.replace(**{"pixel.prnu": 0.0, "pixel.full_well_e": 1e6}), EXPOSURE
    )
    line = next(
        line for line in frames.report["stages"] if line["name"] == "quantum efficiency"
    )
    assert line["mean_frame"] == pytest.approx(33_000, rel=3e-7)


def test_the_map_becomes_photons_in_proportion_to_time_and_wavelength() -> None:
    light = np.array([[0.0, 0.001], [0.002, 0.01]])
    for wavelength in (400.0, 550.0, 700.0):
        for time_s in (0.0, 1e-3, 2.0):
            photons = ms.collect(light, TABLE1, ms.Exposure(time_s), wavelengths_nm=wavelength)
            expected = [
                [photons_of(e, wavelength, TABLE1, time_s) for e in row] for row in light
            ]
            np.testing.assert_allclose(photons.mean[..., 0], expected, rtol=1e-12)
    listed = ms.collect(light, TABLE1, EXPOSURE, wavelengths_nm=[400])
    np.testing.assert_array_equal(
        listed.mean, ms.collect(light, TABLE1, EXPOSURE, wavelengths_nm=400).mean
    )


def test_a_complex_field_is_the_irradiance_of_its_squared_modulus() -> None:
    """|U|², whatever the phase; the paper's input. A tilted wave and a real one give the same photons."""
    amplitude = np.linspace(0, 0.1, 12).reshape(3, 4)
    phase = np.linspace(0, 40, 12).reshape(3, 4)
    field = ms.collect(amplitude * np.exp(1j * phase), TABLE1, EXPOSURE)
    np.testing.assert_allclose(
        field.mean, ms.collect(amplitude**2, TABLE1, EXPOSURE).mean, rtol=1e-12
    )
    single = ms.collect((amplitude * np.exp(1j * phase)).astype(np.complex64), TABLE1, EXPOSURE)
    np.testing.assert_allclose(single.mean, field.mean, rtol=1e-5)


def test_a_cube_is_counted_band_by_band() -> None:
    """W/m²/nm times the width of the band: the spacing of the wavelengths, or what is given."""
    cube = np.random.default_rng(1).uniform(0, 1e-4, (2, 3, 4))
    centres = [450.0, 500.0, 550.0, 600.0]
    photons = ms.collect(cube, BAYER, EXPOSURE, wavelengths_nm=centres)
    for k, wavelength in enumerate(centres):
        factor = photons_of(1.0, wavelength, BAYER)
        np.testing.assert_allclose(
            photons.mean[..., k], cube[..., k] * 50.0 * factor, rtol=1e-12
        )
    widths = [10.0, 20.0, 30.0, 40.0]
    given = ms.collect(cube, BAYER, EXPOSURE, wavelengths_nm=centres, bandwidths_nm=widths)
    np.testing.assert_allclose(given.mean, photons.mean * np.array(widths) / 50, rtol=1e-12)
    same = ms.collect(cube, BAYER, EXPOSURE, wavelengths_nm=centres, bandwidths_nm=20.0)
    np.testing.assert_allclose(same.mean, photons.mean * 20 / 50, rtol=1e-12)
