"""Veiling glare of renders: ISO 9358's index, dynamic range with the sun, frames, and what cannot have it.

Renders of equal seeds have the same light before the glare.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import PERSPECTIVE, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core import Float64Array

SUN = (
    '<shape type="rectangle"><transform name="to_world"><scale value="{scale}"/>'
    '<rotate y="1" angle="180"/><translate z="100"/></transform>'
    '<emitter type="area"><spectrum name="radiance" value="300:{level}, 1100:{level}"/></emitter></shape>'
)
DARK = (
    '<emitter type="constant"><spectrum name="radiance" value="300:1e-6, 1100:1e-6"/></emitter>'
)
EXPOSURE = ms.Exposure(0.01)
SIZE = 12, 8
NARROW = PERSPECTIVE.replace('value="60"', 'value="2"')
GROUPS = {"headlights": "headlight_*"}


def camera(fraction: float, **fields: Any) -> ms.Camera:
    named = {name.replace("__", "."): value for name, value in fields.items()}
    return ms.load_camera("konnik_table1").replace(**{"lens.veiling_glare": fraction, **named})


def light_of(scene: Any, cam: ms.Camera, **options: Any) -> ms.Irradiance:
    """A render of few samples, always of the same rays."""
    usual = {"spp": 16, "seed": 3, "denoise": False, "progress": False, "wavelength_nm": 550.0}
    usual["variant"] = "scalar_spectral"
    return ms.render(scene, cam, EXPOSURE, **{**usual, **options})


def electrons(light: ms.Irradiance, cam: ms.Camera) -> Float64Array:
    """Photoelectrons of each pixel over a number that all share."""
    per_nm = cam.qe(light.wavelengths_nm, light.bandwidths_nm) * light.wavelengths_nm
    filters = cam.filter_index(light.data.shape[:2])
    weights = (per_nm * light.bandwidths_nm)[filters]
    assert light.in_band is not None
    return np.asarray((light.data * weights).sum(axis=2) * light.in_band)


def sun(folder: Path, level: float = 1.0, scale: float = 8.0) -> Path:
    """A bright square in the middle of a dark field of 12 × 8 pixels."""
    return write_scene(
        folder,
        scene_text('<integrator type="direct"/>', DARK, SUN.format(level=level, scale=scale)),
    )


@pytest.mark.parametrize("width_mm", [None, 0.01])
@pytest.mark.parametrize("fraction", [0.003, 0.05])
def test_the_light_of_all_pixels_stays(
    tmp_path: Path, fraction: float, width_mm: float | None
) -> None:
    """Within 1e-6 of a float32; asked is 1e-4."""
    scene = sun(tmp_path)
    clean = light_of(scene, camera(0.0)).data.sum(dtype=float)
    glare = light_of(scene, camera(fraction, lens__glare_width_mm=width_mm)).data
    assert glare.sum(dtype=float) == pytest.approx(clean, rel=1e-6)


def test_the_dynamic_range_of_a_scene_with_the_sun_falls_as_the_closed_form(
    tmp_path: Path,
) -> None:
    """Brightest over darkest pixel, each (1 − g)·E + g·mean(E): from 120 dB to at most 1/(g × share of the sun)."""
    scene, fraction = sun(tmp_path), 0.02
    clean = light_of(scene, camera(0.0)).data[..., 0].astype(float)
    found = light_of(scene, camera(fraction)).data[..., 0].astype(float)
    veil = fraction * clean.mean()
    expected = ((1 - fraction) * clean.max() + veil) / ((1 - fraction) * clean.min() + veil)
    assert 20 * np.log10(clean.max() / clean.min()) > 100
    assert found.max() / found.min() == pytest.approx(expected, rel=1e-5)
    share = clean.mean() / clean.max()
    assert expected < 1 / (fraction * share) + 1


def test_a_black_patch_in_an_even_field_has_the_veiling_glare_index(tmp_path: Path) -> None:
    """ISO 9358: light in a small black patch over light there without it, g·(1 − share of the patch). The field is even
    within 0.06 %, cos⁴ of 1°."""
    field = SUN.format(level=1.0, scale=400.0)
    patch = (
        '<shape type="rectangle"><transform name="to_world"><scale value="0.2"/>'
        '<rotate y="1" angle="180"/><translate z="50"/></transform>'
        '<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>'
    )
    integrator, cam = '<integrator type="direct"/>', camera(0.04)
    lights = [
        light_of(
            write_scene(tmp_path, scene_text(integrator, field, *more, sensor=NARROW)), cam
        ).data[..., 0]
        for more in ((), (patch,))
    ]
    dark = lights[1] < 0.1 * lights[0]
    assert 1 < dark.sum() < 30
    lost = 1 - lights[1].sum() / lights[0].sum()
    index = (lights[1] / lights[0])[dark].min()
    assert index == pytest.approx(0.04 * (1 - lost), rel=1e-3)


def test_error_bars_and_photoelectrons_are_behind_the_glare(tmp_path: Path) -> None:
    """In a colour camera: variance of every band (1 − g)²·v and the rest; the electrons of all pixels of a filter have
    the mean that they had."""
    bayer = ms.load_camera("bayer_2mp")
    scene, options = sun(tmp_path), {"wavelength_nm": None, "bandwidth_nm": 50.0, "spp": 64}
    fraction = 0.1
    lights = [
        light_of(scene, bayer.replace(**{"lens.veiling_glare": g}), **options)
        for g in (0.0, fraction)
    ]
    clean, glare = lights
    variance, count = clean.standard_error.astype(float) ** 2, clean.data[..., 0].size
    own = (1 - fraction) ** 2 + 2 * fraction * (1 - fraction) / count
    expected = own * variance + (fraction / count) ** 2 * variance.sum(axis=(0, 1))
    np.testing.assert_allclose(glare.standard_error**2, expected, rtol=1e-4)
    filters = bayer.filter_index((SIZE[1], SIZE[0]))
    before_e, after_e = (electrons(light, bayer) for light in lights)
    for number in range(len(bayer.filter_names)):
        seen = filters == number
        assert after_e[seen].sum() == pytest.approx(before_e[seen].sum(), rel=1e-4)


def test_frame_and_metadata_say_the_glare(tmp_path: Path) -> None:
    captured = ms.capture(
        sun(tmp_path), camera(0.02), EXPOSURE, spp=4, wavelength_nm=550.0, progress=False
    )
    known = captured.metadata["render"]["intrinsics"]["veiling_glare"]
    assert known == {"fraction": 0.02, "width_mm": None}
    assert any(
        "2 % of the light is veiling glare" in note for note in captured.metadata["notes"]
    )


@pytest.mark.exhaustive
def test_frames_of_denoised_light_and_of_light_groups_have_it(tmp_path: Path) -> None:
    """Light is linear: the sum of the groups, each behind the glare, is the whole behind it; a group that is off makes
    none."""
    asked = {"spp": 16, "width": 24, "progress": False, "denoise": True, "light_groups": GROUPS}
    lights = [
        ms.render(
            "night_crossing",
            ms.load_camera("sony_a7s2").replace(**{"lens.veiling_glare": g}),
            EXPOSURE,
            **asked,
        )
        for g in (0.0, 0.05)
    ]
    name = "headlights"
    for levels in ({}, {name: 0.0}):
        clean, glare = (light.with_lights(levels).data.astype(float) for light in lights)
        expected = 0.95 * clean + 0.05 * clean.mean(axis=(0, 1))
        np.testing.assert_allclose(glare, expected, rtol=2e-4, atol=1e-9)


def test_a_picture_of_another_program_has_it() -> None:
    rng = np.random.default_rng(4)
    picture = rng.random((6, 8, 3)).astype(np.float32)
    clean, glare = (
        ms.light_from_rgb(
            picture,
            ms.load_camera("bayer_2mp").replace(**{"lens.veiling_glare": g}),
            unit="cd_per_m2",
        )
        for g in (0.0, 0.1)
    )
    expected = 0.9 * clean.data + 0.1 * clean.data.mean(axis=(0, 1))
    np.testing.assert_allclose(glare.data, expected, rtol=1e-5)
    assert any("veiling glare" in note for note in glare.notes)


def test_a_crop_is_refused_because_it_lacks_the_other_light(tmp_path: Path) -> None:
    film = '<integer name="crop_width" value="4"/><integer name="crop_height" value="4"/>'
    scene = write_scene(tmp_path, scene_text('<integrator type="direct"/>', DARK, film=film))
    with pytest.raises(ms.InputError, match="crop of 4 × 4 of 12 × 8 pixels"):
        light_of(scene, camera(0.02))
