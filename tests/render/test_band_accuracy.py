"""Photoelectrons are right at any bandwidth: the camera's own filters are integrated beside the bands."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.patches import REFLECTANCES
from helpers.scenes import SCENES, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core.band_average import band_integrals
from mitsuba_sensor.optics import spectra
from mitsuba_sensor.optics.f_number_law import solid_angle_sr, transmittance
from mitsuba_sensor.optics.intrinsics import View
from mitsuba_sensor.render.light.bands import choose_bands, with_filters
from mitsuba_sensor.render.light.light_source import band_error, band_note
from mitsuba_sensor.render.light.photons import photons_per_irradiance

prepared = importlib.import_module("mitsuba_sensor.render.passes.prepared")
VISIBLE = np.arange(360.0, 831.0)  # nm
BAYER, EXPOSURE = ms.load_camera("bayer_2mp"), ms.Exposure(0.02)
SHAPE = (8, 12)  # of the scenes of helpers/scenes.py
COLOURED = BAYER.replace(**{
    "lens.transmission_curve": (0.2, 0.9, 0.85, 0.3), "lens.transmission_wavelengths_nm": (380.0, 433.0, 611.0, 720.0)
})  # fmt: skip
MERCURY = ((404.7, 0.4), (435.8, 1.0), (546.1, 1.1), (578.0, 0.9))


def lines(*of: tuple[float, float]) -> str:
    """A table of triangles, 1 nm wide at the foot, about wavelengths of some strength."""
    corners = [
        (nm + x, y * 1e-2)
        for nm, strength in of
        for x, y in ((-0.5, 0.0), (0.0, strength), (0.5, 0.0))
    ]
    return ", ".join(
        f"{nm:.2f}:{value:g}" for nm, value in [(380.0, 0.0), *corners, (720.0, 0.0)]
    )


SPECTRA = {
    "sloped": "380:1e-4, 452:1.5e-4, 560:6e-4, 600:1e-4, 720:9e-4",
    "mercury lamp": lines(*MERCURY),
    "laser": lines((632.8, 1.0)),
}


def table_of(text: str) -> np.ndarray:
    """(N, 2) wavelengths and values of a table in a scene file."""
    return np.array([[float(x) for x in pair.split(":")] for pair in text.split(",")])


def values_of(response: Mapping[str, object]) -> list[float]:
    return [float(x) for x in str(response["values"]).split(",")]


def nodes_of(response: Mapping[str, object]) -> np.ndarray:
    return np.linspace(
        response["wavelength_min"], response["wavelength_max"], len(values_of(response))
    )


def expected_e(
    camera: ms.Camera, table: str, low_nm: float = 380.0, high_nm: float = 720.0
) -> np.ndarray:
    """Photoelectrons of each filter per steradian, by the midpoint rule at 0.01 nm."""
    nm = np.arange(low_nm, high_nm, 0.01) + 0.005
    radiance = np.interp(nm, *table_of(table).T)
    photons = photons_per_irradiance(camera, EXPOSURE, nm, np.full(nm.size, 0.01))
    return np.asarray((camera.qe(nm) * photons * transmittance(camera, nm)) @ radiance)


def rendered(
    path: Path, camera: ms.Camera, width_nm: float, spp: int, spectral: str = "auto"
) -> tuple[ms.Irradiance, View]:
    variant = skip_unless_usable("llvm_ad_spectral")
    job = prepared.prepare(
        path, camera, EXPOSURE, bandwidth_nm=width_nm, variant=variant, spectral=spectral
    )
    return job.render(1, job.stop_criterion({"spp": spp})), job.scene.view


def electrons_of(light: ms.Irradiance, camera: ms.Camera) -> np.ndarray:
    """Mean photoelectrons, (H, W)."""
    return np.asarray(
        ms.expose(ms.collect(light, camera, EXPOSURE), camera, EXPOSURE).detected.mean_e
    )


def means_per_sr(light: ms.Irradiance, camera: ms.Camera, view: View) -> np.ndarray:
    """Mean photoelectrons per steradian of the pixels of each filter."""
    index, found = (
        camera.filter_index(SHAPE),
        electrons_of(light, camera) / solid_angle_sr(view, BAYER),
    )
    return np.array([found[index == number].mean() for number in range(index.max() + 1)])


def flat_field(folder: Path, table: str) -> Path:
    return write_scene(
        folder,
        scene_text(
            f'<emitter type="constant"><spectrum name="radiance" value="{table}"/></emitter>'
        ),
    )


@pytest.mark.parametrize("spectral", ["auto", "cube"])
@pytest.mark.parametrize("width_nm", [5.0, 10.0, 20.0, 50.0, 330.0])
@pytest.mark.parametrize("name", SPECTRA)
def test_the_film_has_the_integral_at_any_bandwidth(
    name: str, width_nm: float, spectral: str
) -> None:
    """Responses of the film times the spectrum, against the integral of QE·T·λ at 0.01 nm: lines too, to 1e-4."""
    nm = np.arange(380.0, 720.0, 0.01) + 0.005
    radiance = np.interp(nm, *table_of(SPECTRA[name]).T)
    for camera in (BAYER, COLOURED):
        bands = with_filters(choose_bands(camera, None, width_nm, spectral), camera)
        curves = [
            np.interp(nm, nodes_of(one), values_of(one), 0.0, 0.0)
            for one in bands.responses[len(bands) :]
        ]
        film = (np.array(curves) @ radiance * 0.01).reshape(-1, bands.filters).sum(axis=0)
        photons = photons_per_irradiance(camera, EXPOSURE, [bands.reference_nm], [1.0])
        np.testing.assert_allclose(film * photons, expected_e(camera, SPECTRA[name]), rtol=1e-4)


@pytest.mark.parametrize("width_nm", one_in(2, [50.0, 10.0, 330.0]))
def test_electrons_are_the_integral_at_any_bandwidth(tmp_path: Path, width_nm: float) -> None:
    """A rendered flat field behind a coloured lens: each filter's mean to 0.1 %."""
    light, view = rendered(flat_field(tmp_path, SPECTRA["sloped"]), COLOURED, width_nm, 4096)
    found = means_per_sr(light, COLOURED, view)
    np.testing.assert_allclose(found, expected_e(COLOURED, SPECTRA["sloped"]), rtol=1e-3)


@pytest.mark.parametrize("width_nm", one_in(2, [20.0, 5.0]))
def test_a_colour_checker_has_the_colours_of_its_tables(width_nm: float) -> None:
    """24 patches before a colour camera, each channel's mean over the patches to 0.1 % (measured: 0.023 %); with QE at
    the centre of 50 nm bands R was 15 % too dark. Single patches are as noisy as their pixels."""
    size, variant = {"width": 24, "height": 16}, skip_unless_usable("llvm_ad_spectral")
    options = {"bandwidth_nm": width_nm, "parameters": size, "variant": variant}
    job = prepared.prepare(SCENES / "color_checker.xml", BAYER, EXPOSURE, **options)
    light, nm = (
        job.render(1, job.stop_criterion({"spp": 1024})),
        np.arange(390.0, 710.0, 0.05) + 0.025,
    )
    weights = BAYER.qe(nm) * photons_per_irradiance(BAYER, EXPOSURE, nm, np.full(nm.size, 0.05))
    lit = spectra.d65(nm) * 85 / np.pi / spectra.luminous(VISIBLE, spectra.d65(VISIBLE))
    expected = np.array(
        [weights @ (np.interp(nm, *table) * lit) for table in REFLECTANCES.values()]
    )
    found = electrons_of(light, BAYER) / solid_angle_sr(job.scene.view, BAYER)
    for number in range(3):
        own = np.where(BAYER.filter_index((16, 24)) == number, found, np.nan)
        inner = own.reshape(4, 4, 6, 4)[:, 1:3, :, 1:3].transpose(0, 2, 1, 3).reshape(24, 4)
        ratio = np.nanmean(inner, axis=1) / expected[:, number]
        assert abs(ratio.mean() - 1) < 1e-3 and np.abs(ratio - 1).max() < 1e-2, ratio


@pytest.mark.parametrize("width_nm", one_in(2, [50.0, 5.0]))
def test_electrons_of_a_laser_follow_its_own_wavelength(
    tmp_path: Path, width_nm: float
) -> None:
    """Per irradiance of the same samples, whose noise cancels: QE at 632.8 nm, to 0.1 %, not that of the band."""
    light, _ = rendered(flat_field(tmp_path, SPECTRA["laser"]), BAYER, width_nm, 2048)
    index = BAYER.filter_index(SHAPE)
    irradiance = (light.data @ light.bandwidths_nm).astype(float)
    photons = photons_per_irradiance(BAYER, EXPOSURE, [632.8], [1.0])
    for number, qe in enumerate(BAYER.qe([632.8])[:, 0]):
        total = irradiance[index == number].sum() * photons[0] * qe
        found = electrons_of(light, BAYER)[index == number].sum()
        assert found == pytest.approx(total, rel=1e-3)


def test_another_camera_is_told_its_error(tmp_path: Path) -> None:
    """The error of wide bands is stated, of the right size, and narrower bands have less of it."""
    path, other = flat_field(tmp_path, SPECTRA["sloped"]), ms.load_camera("rgbir_2mp")
    stated = []
    for width_nm in (5.0, 50.0):
        light, view = rendered(path, BAYER, width_nm, 1024)
        low, high = BAYER.band_nm
        truth = expected_e(other, SPECTRA["sloped"], low, high)
        found = means_per_sr(light, other, view)
        error = band_error(light, other)
        stated.append(error.error_estimate)
        assert np.abs(found[:3] / truth[:3] - 1).max() < 2 * error.error_estimate + 2e-3
        assert error.error_estimate < error.largest_error
        assert band_error(light, BAYER).largest_error == 0
        assert not list(band_note(light, band_error(light, BAYER)))
    assert stated[0] < stated[1]
    (note,) = band_note(light, error)
    assert "not rendered for this camera: in bands of 50 nm" in note and "bandwidth_nm=" in note


def test_a_line_in_a_band_is_bounded_for_another_camera(tmp_path: Path) -> None:
    light, _ = rendered(flat_field(tmp_path, SPECTRA["laser"]), BAYER, 20.0, 256)
    found = band_error(light, ms.load_camera("rgbir_2mp"))
    assert found.error_estimate > 0.05


def test_what_is_known_of_a_pixel_holds_for_its_own_filter_only(tmp_path: Path) -> None:
    """Moved by one pixel, behind another mosaic or another QE, electrons are those of the bands alone; brighter light
    has more of both."""
    light, _ = rendered(flat_field(tmp_path, SPECTRA["laser"]), BAYER, 50.0, 64)
    photons, bare = (
        ms.collect(light, BAYER, EXPOSURE),
        ms.collect(replace(light, in_band=None), BAYER, EXPOSURE),
    )
    turned = BAYER.replace(**{"quantum_efficiency.tile": [["B", "G"], ["G", "R"]]})
    for camera, options in ((BAYER, {"origin": (0, 1)}), (turned, {})):
        one, two = (
            ms.expose(x, camera, EXPOSURE, **options).detected.mean_e for x in (photons, bare)
        )
        np.testing.assert_array_equal(one, two)
    own, by_two = (
        ms.expose(photons, BAYER, EXPOSURE, origin=origin).detected.mean_e
        for origin in (None, (2, 4))
    )
    np.testing.assert_array_equal(own, by_two)
    twice = ms.expose(photons.changed(mean=2 * photons.mean), BAYER, EXPOSURE).detected.mean_e
    np.testing.assert_allclose(twice, 2 * own, rtol=1e-6)
    with pytest.raises(ms.InputError, match="in_band has shape"):
        ms.expose(replace(photons, in_band=np.ones(3)), BAYER, EXPOSURE)
    with pytest.raises(ms.InputError, match="one positive, finite width in nm per band"):
        ms.expose(replace(photons, bandwidths_nm=np.ones(2)), BAYER, EXPOSURE)


def test_a_quantum_yield_is_averaged_over_the_band_too(tmp_path: Path) -> None:
    """Interactions are exact; electrons of each follow the bands."""
    rising = tuple(np.linspace(3.0, 1.0, len(BAYER.quantum_efficiency.wavelengths_nm)))
    camera = BAYER.replace(**{"quantum_efficiency.quantum_yield": rising})
    light, _ = rendered(flat_field(tmp_path, SPECTRA["sloped"]), camera, 50.0, 64)
    one, two = electrons_of(light, camera), electrons_of(light, BAYER)
    np.testing.assert_array_equal(one, two)


def test_integrals_over_bands_are_exact_for_polynomials() -> None:
    low, high = np.array([1.0, 2.5, 0.0]), np.array([2.0, 7.0, 10.0])
    found = band_integrals(
        lambda x: np.array([x**5, np.where(x < 4, 0, x)]), np.array([0.0, 4.0, 10.0]), low, high
    )
    np.testing.assert_allclose(found[0], (high**6 - low**6) / 6, rtol=1e-13)
    np.testing.assert_allclose(found[1], [0.0, (49 - 16) / 2, (100 - 16) / 2], rtol=1e-13)
