"""From irradiance to photons per pixel: closed forms of paper eq. 12, band by band."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.units import photon_energy_j
from mitsuba_sensor.render.light.photons import photons_per_irradiance

CAMERA = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)


def light(data: Any, wavelengths: Any = (550.0,), widths: Any = (1.0,)) -> Any:
    """An Irradiance without errors, and of a render of which nothing is known."""
    values, statistics = np.asarray(data), SimpleNamespace(intrinsics=None, notes=())
    errors = np.zeros(values.shape, np.float32), np.zeros(values.shape[:2], np.float32)
    return ms.Irradiance(
        values, np.asarray(wavelengths), np.asarray(widths), *errors, statistics
    )  # type: ignore[arg-type]


def test_one_watt_per_square_metre_gives_table_1s_photons() -> None:
    """1 W/m² at 550 nm, 5.7 µm, fill factor 50 %, 0.1 s: 4 497 857.3 photons, with hc of SI 2019."""
    assert photons_per_irradiance(CAMERA, EXPOSURE, [550.0], [1.0])[0] == pytest.approx(
        4497857.300185223, rel=1e-9
    )


def test_the_irradiance_of_a_full_well_fills_the_well() -> None:
    """0.0122280424770 W/m² for 0.1 s: 55 000 photons, at QE 0.6 33 000 electrons, but for 2e-7 of an older hc."""
    photons = ms.collect(light([[[0.0122280424770]]]), CAMERA, EXPOSURE)
    assert photons.mean.item() == pytest.approx(55_000, rel=3e-7)
    assert (photons.mean * CAMERA.qe([550.0])).item() == pytest.approx(33_000, rel=3e-7)


@pytest.mark.parametrize("wavelength", [200.0, 550.0, 1100.0])
def test_photons_times_their_energy_is_the_energy_that_fell_on_the_pixel(
    wavelength: float,
) -> None:
    """Conservation: E·Δλ·w·h·FF·t joules, whatever the colour; so 1100 nm brings twice the photons of 550 nm."""
    photons = photons_per_irradiance(CAMERA, EXPOSURE, [wavelength], [10.0])[0]
    assert photons * photon_energy_j(wavelength) == pytest.approx(
        10 * 5.7e-6**2 * 0.5 * 0.1, rel=1e-12
    )


@pytest.mark.parametrize(
    ("change", "factor"),
    [
        ({"pixel.fill_factor": 1.0}, 2),
        ({"pixel.pitch_x_um": 11.4}, 2),
        ({"pixel.pitch_y_um": 11.4}, 2),
        (
            {
                "quantum_efficiency.curves": {"mono": [0.1, 0.1]},
                "lens.transmission": 0.5,
                "lens.f_number": 8.0,
            },
            1,
        ),
    ],
    ids=str,
)
def test_photons_follow_the_area_of_the_pixel_and_nothing_behind_it(
    change: dict[str, Any], factor: float
) -> None:
    """The lens has done its work before the focal plane; QE comes after it."""
    other = CAMERA.replace(**change)
    one, two = (
        photons_per_irradiance(c, EXPOSURE, [550.0], [10.0])[0] for c in (CAMERA, other)
    )
    assert two == pytest.approx(factor * one, rel=1e-12)


def test_bands_stay_apart_and_mean_photons_are_not_rounded() -> None:
    data = np.array([[[1e-9, 2e-9, 0.0]]])
    photons = ms.collect(
        light(data, [450.0, 550.0, 650.0], [10.0, 20.0, 5.0]), CAMERA, EXPOSURE
    )
    factor = photons_per_irradiance(CAMERA, EXPOSURE, [450.0, 550.0, 650.0], [10.0, 20.0, 5.0])
    np.testing.assert_array_equal(photons.mean, data * factor)
    np.testing.assert_array_equal(photons.wavelengths_nm, [450.0, 550.0, 650.0])
    assert 0 < photons.mean[0, 0, 0] < 0.1
    assert photons.total.shape == (1, 1) and photons.total.item() == photons.mean.sum()


def test_no_time_is_no_light_even_under_infinite_light() -> None:
    """∞·0 is 0 here, not NaN; and ∞ for any time saturates its own pixel."""
    data = [[[np.inf, 1.0]]]
    two = light(data, [500.0, 550.0], [1.0, 1.0])
    np.testing.assert_array_equal(ms.collect(two, CAMERA, ms.Exposure(0.0)).mean, 0.0)
    open_shutter = ms.collect(two, CAMERA, EXPOSURE).mean
    assert np.isinf(open_shutter[0, 0, 0]) and np.isfinite(open_shutter[0, 0, 1])


def test_float32_light_is_collected_in_float64() -> None:
    data = np.full((1, 1, 1), 0.01, dtype=np.float32)
    photons = ms.collect(light(data), CAMERA, EXPOSURE)
    assert photons.mean.dtype == np.float64
    assert photons.mean.item() == pytest.approx(
        float(np.float32(0.01)) * 4497857.300185223, rel=1e-12
    )


def test_photons_are_an_array_for_numpy() -> None:
    photons = ms.Photons(np.arange(6.0).reshape(2, 3))
    assert np.asarray(photons).sum() == 15
    assert np.asarray(photons, dtype=np.float32).dtype == np.float32
    assert photons.total is photons.mean
    with pytest.raises(ms.InputError, match=r"factor has shape \(2,\); pass .* \(3,\)"):
        photons.changed(factor=np.ones(2))


def test_photons_of_a_render_are_the_same_whole_in_strips_and_by_pixel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of bands in float32, one of them infinite in a pixel, as photons that are made at once in float64."""
    monkeypatch.setattr("mitsuba_sensor.core.signals.VALUES_AT_ONCE", 2 * 5 * 3)
    data = np.random.default_rng(1).random((7, 5, 3)).astype(np.float32)
    data[2, 3, 1] = np.inf
    lazy = ms.collect(light(data, (450.0, 550.0, 650.0), (10.0, 10.0, 10.0)), CAMERA, EXPOSURE)
    factor = photons_per_irradiance(CAMERA, EXPOSURE, [450.0, 550.0, 650.0], [10.0, 10.0, 10.0])
    whole = ms.Photons(data.astype(np.float64) * factor, lazy.wavelengths_nm)
    pixels = np.array([30, 0, 13, 13])
    assert lazy.shape == whole.shape and len(list(lazy.strips())) == 4
    for name, values in {"total": whole.total, "mean": whole.mean}.items():
        fresh = lazy.changed(origin=(1, 0))
        np.testing.assert_array_equal(fresh.at(pixels), whole.at(pixels))
        np.testing.assert_array_equal(
            np.concatenate([strip.mean for strip in fresh.strips()]), whole.mean
        )
        np.testing.assert_array_equal(
            fresh.crop_rows(slice(2, 4)).crop_rows(slice(1, 2)).mean, whole.mean[3:4]
        )
        assert "mean" not in vars(fresh)
        np.testing.assert_array_equal(getattr(fresh, name), values, err_msg=name)


@pytest.mark.parametrize("wrong", [-1.0, np.nan])
def test_a_render_with_wrong_values_is_refused_with_their_place(wrong: float) -> None:
    data = np.ones((4, 5, 2), np.float32)
    data[3, 1, 1] = wrong
    photons = ms.collect(light(data, (450.0, 550.0), (10.0, 10.0)), CAMERA, EXPOSURE)
    with pytest.raises(ms.InputError, match=r"1 place\(s\), first at \(3, 1, 1\)"):
        ms.expose(photons, CAMERA, EXPOSURE)
