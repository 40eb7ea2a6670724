"""EXRs of other programs: photons by closed forms of what OpenEXR, OpenImageIO and Mitsuba wrote."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from helpers.scenes import PERSPECTIVE, SKY, scene_text

import mitsuba_sensor as ms
from mitsuba_sensor.core.units import LIGHT_SPEED_M_PER_S, PLANCK_J_S
from mitsuba_sensor.render.variants import choose_variant, use

MONO, BAYER = ms.load_camera("konnik_table1"), ms.load_camera("bayer_2mp")
EXPOSURE = ms.Exposure(0.02)
AREA_M2 = MONO.pixel.pitch_x_um * MONO.pixel.pitch_y_um * 1e-12
F28 = math.pi / (4 * 2.8**2)  # Ω of f/2.8 at infinity


def write(path: Path, channels: dict[str, Any], **header: Any) -> Path:
    """By OpenEXR itself."""
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    images = {name: np.ascontiguousarray(x, np.float32) for name, x in channels.items()}
    OpenEXR.File(kind, images).write(str(path))
    return path


def photons_of(
    irradiance_w_per_m2: float, wavelength_nm: float, camera: ms.Camera = MONO
) -> float:
    """E·A·t·λ/(hc), and the share of the pixel that sees light."""
    energy_j = PLANCK_J_S * LIGHT_SPEED_M_PER_S / (wavelength_nm * 1e-9)
    return irradiance_w_per_m2 * AREA_M2 * 0.02 / energy_j * fill(camera)


def fill(camera: ms.Camera) -> float:
    """What collect() itself makes of one watt at one wavelength, over the closed form without any fill factor."""
    found = ms.collect(np.ones((1, 1)), camera, EXPOSURE, wavelengths_nm=550.0).total.item()
    return found / (AREA_M2 * 0.02 * 550e-9 / (PLANCK_J_S * LIGHT_SPEED_M_PER_S))


def test_a_spectral_exr_has_the_photons_of_its_bands(tmp_path: Path) -> None:
    """Fichet et al. 2021: S0 with a decimal comma; names sorted as text are not sorted by wavelength."""
    level = {900: 1e-5, 950: 2e-5, 1000: 3e-5}
    file = write(
        tmp_path / "s.exr", {f"S0.{nm},0nm": np.full((3, 4), e) for nm, e in level.items()}
    )
    light = ms.read_irradiance(file, unit="w_per_m2_nm")
    assert light.wavelengths_nm.tolist() == [
        900,
        950,
        1000,
    ] and light.bandwidths_nm.tolist() == [50, 50, 50]
    found = ms.collect(light, MONO, EXPOSURE).mean
    expected = [photons_of(e * 50, nm) for nm, e in level.items()]
    np.testing.assert_allclose(
        found, np.broadcast_to(expected, (3, 4, 3)), rtol=2e-3
    )  # the band is not one wavelength


def test_units_of_length_and_frequency_in_channel_names(tmp_path: Path) -> None:
    names = ("S0.0,5um", "S0.550.0nm", "S0.5e14Hz")  # 599.58 nm
    file = write(
        tmp_path / "s.exr",
        {name: np.ones((1, 1)) for name in names} | {"S1.550,0nm": np.ones((1, 1))},
    )
    light = ms.read_irradiance(file, unit="w_per_m2_nm")
    edges = light.wavelengths_nm + 0.5 * light.bandwidths_nm
    assert edges[:2].tolist() == pytest.approx([525.0, 0.5 * (550 + LIGHT_SPEED_M_PER_S / 5e5)])


def test_one_channel_has_the_photons_of_its_wavelength(tmp_path: Path) -> None:
    file = write(tmp_path / "y.exr", {"Y": np.full((2, 2), 0.003)})
    light = ms.read_irradiance(file, unit="w_per_m2", wavelength_nm=633)
    np.testing.assert_allclose(
        ms.collect(light, MONO, EXPOSURE).total, photons_of(0.003, 633), rtol=1e-5
    )
    behind = ms.read_irradiance(
        file, unit="radiance_w_per_m2_sr", wavelength_nm=633, camera="konnik_table1"
    )
    transmission = MONO.lens.transmission
    np.testing.assert_allclose(behind.data, 0.003 * F28 * transmission, rtol=1e-6)


def test_radiance_of_a_known_field_of_view_falls_off_with_cos4(tmp_path: Path) -> None:
    """60 degrees across 300 pixels: at the edge tan θ = 0.577."""
    file = write(tmp_path / "y.exr", {"Y": np.ones((1, 300))})
    data = ms.read_irradiance(file, "radiance_w_per_m2_sr", 550, MONO, fov_deg=60).data[0, :, 0]
    x = (np.arange(300) + 0.5 - 150) / 150 * math.tan(math.radians(30))
    np.testing.assert_allclose(data, F28 * MONO.lens.transmission * (1 + x**2) ** -2, rtol=1e-4)


def test_openimageio_wrote_it(tmp_path: Path) -> None:
    oiio = pytest.importorskip("OpenImageIO")
    spec = oiio.ImageSpec(4, 2, 3, "half")
    spec.channelnames = ("S0.500nm", "S0.510nm", "S0.520nm")
    out = oiio.ImageOutput.create(str(tmp_path / "o.exr"))
    assert out.open(str(tmp_path / "o.exr"), spec) and out.write_image(
        np.full((2, 4, 3), 0.25, np.float32)
    )
    out.close()
    light = ms.read_irradiance(str(tmp_path / "o.exr"), unit="w_per_m2_nm")
    assert (
        light.data.shape == (2, 4, 3)
        and (light.data == 0.25).all()
        and light.data.dtype == np.float32
    )


def test_rgb_radiance_becomes_the_light_that_mitsuba_makes_of_an_rgb_emitter(
    tmp_path: Path,
) -> None:
    """A sky of one colour, rendered in bands of 10 nm by Mitsuba itself, and the same colour read from an EXR: within
    0.5 % of the largest band, the noise of drawing wavelengths. The view is narrow: cos⁴ is 1 to 1e-4."""
    mi = use(choose_variant("scalar_spectral"))
    colour = (0.2, 0.5, 0.05)
    sky = f'<emitter type="constant"><rgb name="radiance" value="{colour[0]}, {colour[1]}, {colour[2]}"/></emitter>'
    narrow = PERSPECTIVE.replace('value="60"', 'value="0.5"')
    made = ms.render(
        scene_text(sky, sensor=narrow),
        BAYER,
        EXPOSURE,
        spp=1024,
        spectral="cube",
        variant=mi.variant(),
    )
    bitmap = mi.Bitmap(np.broadcast_to(np.float32(colour), (3, 4, 3)).copy())
    bitmap.write(str(tmp_path / "rgb.exr"))
    light = ms.read_irradiance(tmp_path / "rgb.exr", unit="radiance_rgb", camera=BAYER)
    rendered = made.data.mean(axis=(0, 1), dtype=float)
    there = np.interp(made.wavelengths_nm, light.wavelengths_nm, light.data[0, 0], 0, 0)
    inside = (made.wavelengths_nm > light.wavelengths_nm[0]) & (
        made.wavelengths_nm < light.wavelengths_nm[-1]
    )
    np.testing.assert_allclose(
        there[inside], rendered[inside], atol=0.005 * rendered.max(), rtol=0.02
    )
    grey = write(tmp_path / "grey.exr", {name: np.full((1, 1), 2.0) for name in "RGB"})
    white = ms.read_irradiance(grey, unit="radiance_rgb", camera=BAYER)
    from mitsuba_sensor.optics.spectra import d65

    expected = (
        2
        * d65(white.wavelengths_nm)
        / 98.997
        * math.pi
        / (4 * BAYER.lens.f_number**2)
        * BAYER.lens.transmission
    )
    np.testing.assert_allclose(white.data[0, 0], expected, rtol=2e-3)
    black = write(tmp_path / "black.exr", {name: np.zeros((1, 1)) for name in "RGB"})
    assert not ms.read_irradiance(black, unit="radiance_rgb", camera=BAYER).data.any()


def test_negative_and_nan_become_zero_and_are_counted(tmp_path: Path) -> None:
    values = np.array([[-1.0, np.nan, np.inf, 2.0]])
    light = ms.read_irradiance(
        write(tmp_path / "y.exr", {"Y": values}), unit="w_per_m2", wavelength_nm=550
    )
    assert light.data[0, :, 0].tolist() == [0, 0, np.inf, 2]
    assert (light.statistics.negative, light.statistics.non_finite) == (
        1,
        2,
    )  # infinity is counted, as of a render
    assert "<img" in light._repr_html_()


def test_our_own_file_needs_no_unit_and_refuses_one(light_file: Path, light: Any) -> None:
    np.testing.assert_array_equal(ms.read_irradiance(light_file).data, light.data)
    for asked in ({"unit": "w_per_m2_nm"}, {"wavelength_nm": 550}, {"fov_deg": 40}):
        with pytest.raises(
            ms.InputError,
            match=r"is an irradiance\.exr, whose unit, wavelengths and lens are known",
        ):
            ms.read_irradiance(light_file, **asked)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("channels", "options", "said"),
    [
        (
            "RGB",
            {},
            r"program \(channels B, G, R\) without a unit; say what its values are by unit= \(--unit\)",
        ),
        ("RGB", {"unit": "radiance_rbg"}, "Did you mean 'radiance_rgb'"),
        ("RGB", {"unit": "radiance_rgb"}, r"give the camera whose lens it passes \(--camera\)"),
        (
            "RGB",
            {"unit": "radiance_rgb", "camera": BAYER, "wavelength_nm": 550},
            "wavelength_nm is for one channel",
        ),
        (
            "RGB",
            {"unit": "w_per_m2_nm"},
            r"has 0 channels S0\.<wavelength>nm \(B, G, R\).*give another unit",
        ),
        (
            "RGB",
            {"unit": "w_per_m2", "wavelength_nm": 550},
            "has 3 channels .* and w_per_m2 is for one",
        ),
        (
            "Y",
            {"unit": "w_per_m2", "fov_deg": 40},
            "fov_deg is for radiance, and unit is 'w_per_m2'",
        ),
        ("Y", {"unit": "w_per_m2"}, "give wavelength_nm, e.g. 550"),
        (
            "Y",
            {"unit": "w_per_m2", "wavelength_nm": -5},
            "wavelength_nm is -5; it must be from 1 to 100000",
        ),
        ("Y", {"unit": "w_per_m2_nm"}, r"needs two at least; give w_per_m2 and wavelength_nm"),
        ("Y", {"unit": "radiance_rgb", "camera": "bayer_2mp"}, "has no channels R, G and B"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(
    tmp_path: Path, channels: str, options: Any, said: str
) -> None:
    file = write(tmp_path / "x.exr", {name: np.ones((2, 2)) for name in channels})
    with pytest.raises(ms.InputError, match=said):
        ms.read_irradiance(file, **options)


def test_the_commands_take_light_of_another_program(tmp_path: Path, cli: Any) -> None:
    file = write(tmp_path / "rgb.exr", {name: np.full((4, 4), 0.02) for name in "RGB"})
    done = cli("expose", file, "-o", tmp_path / "out", "--camera", "bayer_2mp", "--unit", "radiance_rgb", "--json",
               "--set", "lens.f_number=4")  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert "Jakob & Hanika 2019" in " ".join(json.loads(done.stdout)["render"]["notes"])
    one = write(tmp_path / "y.exr", {"Y": np.full((4, 4), 1e-3)})
    done = cli(
        "plan",
        one,
        "--unit",
        "w_per_m2",
        "--wavelength-nm",
        550,
        "--camera",
        "konnik_table1",
        "--json",
    )
    assert done.exit_code == 0, done.stderr
    for command in (("expose", file, "-o", tmp_path / "no"), ("plan", file)):
        failed = cli(*command, "--camera", "bayer_2mp")
        assert (
            failed.exit_code == 2
            and "say what its values are by unit= (--unit)" in failed.stderr.replace("\n", " ")
        )
    assert not (tmp_path / "no").exists()
    scene = tmp_path / "s.xml"
    scene.write_text(scene_text(SKY))
    assert (
        "is a scene, which is rendered; leave --unit and --fov-deg out"
        in cli("plan", scene, "--unit", "w_per_m2").stderr
    )
