"""A sensor's own colour filters as the channels of the film: the same electrons as the cube, without the bands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import (
    BALL,
    SCENES,
    SKY,
    scalar_first,
    scene_text,
    skip_unless_usable,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor import expose
from mitsuba_sensor.output.exr import read_irradiance_exr, write_irradiance_exr

BAYER, EXPOSURE = ms.load_camera("bayer_2mp"), ms.Exposure(0.02)
LAMP = '<emitter type="constant"><spectrum name="radiance" value="360:1e-4, 560:2e-4, 830:4e-4"/></emitter>'


def electrons(light: object, camera: object = BAYER) -> np.ndarray:
    """Mean photoelectrons, before any noise."""
    found = expose(
        ms.collect(light, camera, EXPOSURE),
        camera,
        EXPOSURE,
        keep="photoelectrons",
        precision="float64",
    )
    assert found.photoelectrons is not None
    return found.photoelectrons[0]


@scalar_first
def test_channels_free_the_electrons_that_the_cube_frees(tmp_path: Path, variant: str) -> None:
    """Flat light of a sloping spectrum: the mean of each filter's pixels agrees with bands of 2 nm to 1 %.

    96 pixels × 4096 samples × 4 wavelengths: the standard error of a filter's mean is below 0.2 %; the mean is of the
    expected electrons of a frame, whose shot noise adds 0.1 %.
    """
    path, variant = write_scene(tmp_path, scene_text(LAMP)), skip_unless_usable(variant)
    channels = ms.render(path, BAYER, EXPOSURE, spectral="channels", spp=1024, variant=variant)
    cube = ms.render(path, BAYER, EXPOSURE, bandwidth_nm=10, spp=4096, variant=variant)
    assert channels.filters == tuple(BAYER.quantum_efficiency.curves)
    assert channels.data.shape == (8, 12, 3) and channels.statistics.spectral == "channels"
    index = BAYER.filter_index((8, 12))
    one, two = electrons(channels), electrons(cube)
    for number in range(3):
        assert one[index == number].mean() == pytest.approx(
            two[index == number].mean(), rel=0.01
        )


def test_channels_are_the_integral_of_qe_over_the_spectrum(tmp_path: Path) -> None:
    """data·λ_ref/(hc) = ∫E·QE·λ/(hc) dλ: against the trapezium rule at 0.25 nm, to 0.3 % (four standard errors)."""
    light = ms.render(
        write_scene(tmp_path, scene_text(LAMP)), BAYER, EXPOSURE, spectral="channels", spp=4096,
        variant="scalar_spectral",
    )  # fmt: skip
    low, high = BAYER.band_nm
    fine = np.arange(low, high + 0.1, 0.25)
    radiance = np.interp(fine, [360, 560, 830], [1e-4, 2e-4, 4e-4], left=0, right=0)
    curves = BAYER.qe(fine) * radiance * fine / light.wavelengths_nm[0]
    expected = 0.5 * ((curves[:, 1:] + curves[:, :-1]) * 0.25).sum(axis=1)
    measured = light.data.mean(axis=(0, 1))
    np.testing.assert_allclose(measured / measured[1], expected / expected[1], rtol=3e-3)


def test_light_in_channels_is_refused_by_another_camera(tmp_path: Path) -> None:
    path = write_scene(tmp_path, scene_text(SKY, BALL.format(bsdf="")))
    light = ms.render(
        path, BAYER, EXPOSURE, spectral="channels", spp=16, variant="scalar_spectral"
    )
    assert ms.collect(light, BAYER.replace(**{"adc.bits": 8}), EXPOSURE).detected
    with pytest.raises(ms.InputError, match="another quantum efficiency"):
        ms.collect(light, ms.load_camera("rgbir_2mp"), EXPOSURE)


def test_channels_survive_the_file(tmp_path: Path) -> None:
    path = write_scene(tmp_path, scene_text(SKY, BALL.format(bsdf="")))
    light = ms.render(
        path, BAYER, EXPOSURE, spectral="channels", spp=16, variant="scalar_spectral"
    )
    write_irradiance_exr(tmp_path / "light.exr", light)
    again = read_irradiance_exr(tmp_path / "light.exr")
    np.testing.assert_array_equal(again.data, light.data)
    assert (again.filters, again.response) == (light.filters, light.response)
    np.testing.assert_array_equal(again.wavelengths_nm, light.wavelengths_nm)
    assert again.statistics == light.statistics


def test_a_camera_with_a_quantum_yield_needs_bands() -> None:
    camera = BAYER.replace(
        **{
            "quantum_efficiency.quantum_yield": [1.0]
            * len(BAYER.quantum_efficiency.wavelengths_nm)
        }
    )
    with pytest.raises(ms.InputError, match="quantum_yield"):
        ms.render(
            SCENES / "flat_field.xml",
            camera,
            EXPOSURE,
            spectral="channels",
            variant="scalar_spectral",
        )


@scalar_first
def test_bands_of_a_cube_stand_apart_and_are_quieter_each_for_itself(
    tmp_path: Path, variant: str
) -> None:
    """Thirty bands of a uniform sky: means of 96 pixels right to 1 % (four standard errors), a quarter of the noise.

    Four at a time, each path has about one wavelength in each band; together, every band gets one by chance.
    """
    path, variant = write_scene(tmp_path, scene_text(SKY)), skip_unless_usable(variant)
    options = {"spp": 192, "variant": variant}
    table1 = ms.load_camera("konnik_table1")
    grouped = ms.render(path, table1, EXPOSURE, spectral="cube", **options)
    together = ms.render(path, table1, EXPOSURE, **options)
    assert grouped.statistics.samples_per_pixel == together.statistics.samples_per_pixel == 192
    lens = together.data.mean(
        axis=2, keepdims=True
    )  # cos⁴: the same for all bands of a flat spectrum
    one, other = (np.std(light.data / lens) for light in (grouped, together))
    assert one < 0.25 * other
    np.testing.assert_allclose((grouped.data / lens).mean(axis=(0, 1)), 1.0, rtol=1e-2)


def test_few_samples_are_not_spread_over_groups(tmp_path: Path) -> None:
    """Twelve bands are three groups of at least 8 passes: 24 samples are the least that stand grouped."""
    path, table1 = write_scene(tmp_path, scene_text(SKY)), ms.load_camera("konnik_table1")
    options = {"bandwidth_nm": 25, "spectral": "cube", "variant": "scalar_spectral"}
    found = [
        ms.render(path, table1, EXPOSURE, spp=spp, **options).statistics.samples_per_pixel
        for spp in (1, 16, 24, 96)
    ]
    assert found == [2, 16, 24, 96]
