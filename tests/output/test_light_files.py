"""EXRs of other programs: photons by closed forms of what OpenEXR, OpenImageIO and Mitsuba wrote."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import colour
import Imath
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
    assert light.wavelengths_nm.tolist() == [900, 950, 1000]
    assert light.bandwidths_nm.tolist() == [50, 50, 50]
    found = ms.collect(light, MONO, EXPOSURE).mean
    expected = [photons_of(e * 50, nm) for nm, e in level.items()]
    np.testing.assert_allclose(
        found, np.broadcast_to(expected, (3, 4, 3)), rtol=2e-3
    )  # the band is not one wavelength


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


def test_rgb_radiance_becomes_the_light_that_mitsuba_makes_of_an_rgb_emitter(
    tmp_path: Path,
) -> None:
    """A sky of one colour, rendered in bands of 10 nm by Mitsuba itself, and the same colour read from an EXR: within
    0.5 % of the largest band, the noise of drawing wavelengths. The view is narrow: cos⁴ is 1 to 1e-4."""
    mi = use(choose_variant("scalar_spectral"))
    colour = (0.2, 0.5, 0.05)
    sky = f'<emitter type="constant"><rgb name="radiance" value="{colour[0]}, {colour[1]}, {colour[2]}"/></emitter>'
    narrow = PERSPECTIVE.replace('value="60"', 'value="0.5"')
    how = {"spp": 1024, "spectral": "cube", "variant": mi.variant()}
    made = ms.render(scene_text(sky, sensor=narrow), BAYER, EXPOSURE, **how)
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

    solid_angle_sr = math.pi / (4 * BAYER.lens.f_number**2)
    radiance = 2 * d65(white.wavelengths_nm) / 98.997
    expected = radiance * solid_angle_sr * BAYER.lens.transmission
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
    negative = write(tmp_path / "rgb.exr", {c: np.full((2, 2), -0.1) for c in "RGB"})
    for found, count in ((light, 1), (rgb_light(negative), 12)):
        assert found.statistics.negative == count
        assert f"{count} negative values became 0" in " ".join(found.statistics.notes)


FLAT = {c: np.full((6, 8), x, np.float32) for c, x in {"R": 0.2, "G": 0.5, "B": 0.1}.items()}
DEPTH = {"Z": np.ones((6, 8), np.float32)}
STRIPES = {name: np.arange(48.0).reshape(6, 8) * (1 + k) for k, name in enumerate("RGB")}


def rgb_light(file: Path, **options: Any) -> ms.Irradiance:
    return ms.read_irradiance(file, unit="radiance_rgb", camera=BAYER, **options)


@pytest.mark.parametrize("name", ["ACEScg", "ACES2065-1", "ITU-R BT.2020", "P3-D65", "sRGB"])
def test_rgb_of_other_primaries_is_converted_as_colour_science_does(
    tmp_path: Path, name: str
) -> None:
    """Its own matrices for sRGB are rounded to four digits."""
    space = colour.RGB_COLOURSPACES[name]
    chromaticities = tuple(np.ravel([*space.primaries, space.whitepoint]).tolist())
    there = write(tmp_path / "there.exr", FLAT, chromaticities=chromaticities)
    matrix = colour.matrix_RGB_to_RGB(space, "sRGB", chromatic_adaptation_transform="Bradford")
    values = matrix @ [0.2, 0.5, 0.1]
    converted = {c: np.full((6, 8), max(v, 0)) for c, v in zip("RGB", values, strict=True)}
    here = rgb_light(write(tmp_path / "here.exr", converted))
    found = rgb_light(there)
    np.testing.assert_allclose(found.data, here.data, rtol=2e-3, atol=1e-3 * here.data.max())
    assert found.statistics.negative == 48 * (values < 0).sum()
    assert any("converted from" in x for x in found.statistics.notes) == (name != "sRGB")


@pytest.mark.parametrize(
    ("data", "shown"),
    [
        ((0, 0), (0, 0, 8, 6)),
        ((-3, -2), (0, 0, 5, 4)),
        ((2, 3), (0, 0, 20, 15)),
        ((-7, 4), (-4, -6, 9, 11)),
        ((100, -50), (107, -50, 1, 1)),
    ],
)
def test_the_picture_is_what_lies_in_the_display_window(
    tmp_path: Path, data: tuple[int, int], shown: tuple[int, int, int, int]
) -> None:
    """data : first column and row.  shown : first column, first row, columns, rows."""

    def window(x: int, y: int, columns: int, rows: int) -> Any:
        ends = (x, y), (x + columns - 1, y + rows - 1)
        return tuple(np.array(end, np.int32) for end in ends)

    windows = {"dataWindow": window(*data, 8, 6), "displayWindow": window(*shown)}
    light = rgb_light(write(tmp_path / "a.exr", STRIPES, **windows))
    plane = {c: np.zeros((400, 400), np.float32) for c in "RGB"}
    for name, image in STRIPES.items():
        plane[name][200 + data[1] :, 200 + data[0] :][:6, :8] = image
    left, top, columns, rows = shown
    seen = {c: x[200 + top :, 200 + left :][:rows, :columns] for c, x in plane.items()}
    np.testing.assert_array_equal(light.data, rgb_light(write(tmp_path / "b.exr", seen)).data)


def write_parts(path: Path, parts: dict[str, dict[str, Any]]) -> Path:
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(
        [OpenEXR.Part({**kind}, {**images}, name=n) for n, images in parts.items()]
    ).write(str(path))
    return path


def layers(*names: str) -> dict[str, np.ndarray]:
    """The k-th layer is k times as bright."""
    return {f"{n}.{c}": (k + 1) * x for k, n in enumerate(names) for c, x in FLAT.items()}


def test_a_layer_or_part_that_holds_rgb_is_read_and_one_of_several_chosen(
    tmp_path: Path, cli: Any
) -> None:
    plain = rgb_light(write(tmp_path / "plain.exr", FLAT)).data
    blender = write(
        tmp_path / "blender.exr", {**layers("View.Combined"), "View.Depth.Z": np.ones((6, 8))}
    )
    parts = write_parts(tmp_path / "parts.exr", {"depth": DEPTH, "beauty": FLAT})
    nuke = write_parts(tmp_path / "nuke.exr", {"rgba": layers("rgba"), "depth": DEPTH})
    both = write(tmp_path / "both.exr", {**FLAT, **layers("nothing", "diffuse")})
    for file in (blender, parts, nuke, both):
        np.testing.assert_array_equal(rgb_light(file).data, plain, err_msg=file.name)
    eyes = write_parts(tmp_path / "eyes.exr", {"left": FLAT, "right": {c: 3 * x for c, x in FLAT.items()}})  # fmt: skip
    np.testing.assert_allclose(rgb_light(eyes, layer="right").data, 3 * plain, rtol=1e-4)
    np.testing.assert_allclose(rgb_light(both, layer="diffuse").data, 2 * plain, rtol=1e-4)
    for options in ({}, {"layer": "rihgt"}):
        with pytest.raises(ms.InputError, match="'left', 'right'"):
            rgb_light(eyes, **options)
    sheet = ("--unit", "radiance_rgb", "--camera", "bayer_2mp")
    done = cli("expose", eyes, "-o", tmp_path / "out", *sheet, "--layer", "left", "--json")
    assert done.exit_code == 0, done.stderr
    failed = cli("plan", eyes, *sheet)
    assert failed.exit_code == 2 and "--layer" in failed.stderr


def test_spectra_and_single_channels_of_several_layers_are_not_mixed(tmp_path: Path) -> None:
    names = [f"S0.{nm},0nm" for nm in (500, 550, 600)]
    spectra = {f"{a}.{n}": np.full((6, 8), k) for k, a in enumerate("ab") for n in names}
    file = write(tmp_path / "s.exr", spectra)
    assert (ms.read_irradiance(file, "w_per_m2_nm", layer="b").data == 1).all()
    with pytest.raises(ms.InputError, match="layer="):
        ms.read_irradiance(file, "w_per_m2_nm")
    mono = write_parts(tmp_path / "m.exr", {"depth": DEPTH, "beauty": FLAT})
    light = ms.read_irradiance(mono, "w_per_m2", 550, layer="beauty.G")
    np.testing.assert_array_equal(light.data[..., 0], FLAT["G"])


def test_pixels_that_are_no_picture_are_refused(tmp_path: Path) -> None:
    """Luminance and chroma; primaries on a line; a data window outside of the display window."""
    header, sampling = OpenEXR.Header(8, 6), {"Y": 1, "RY": 2, "BY": 2}
    kind = Imath.PixelType(Imath.PixelType.FLOAT)
    header["channels"] = {name: Imath.Channel(kind, n, n) for name, n in sampling.items()}
    file = OpenEXR.OutputFile(str(tmp_path / "yca.exr"), header)
    rows = {name: np.ones((6 // n, 8 // n), np.float32) for name, n in sampling.items()}
    file.writePixels({name: values.tobytes() for name, values in rows.items()})
    file.close()
    line = {"chromaticities": (0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3)}
    corners = (np.array([9, 9], np.int32), np.array([16, 14], np.int32))
    away = {"dataWindow": corners, "displayWindow": tuple(x - 9 for x in corners)}
    for made, said in (
        (tmp_path / "yca.exr", "BY"),
        (write(tmp_path / "line.exr", FLAT, **line), "chromaticities"),
        (write(tmp_path / "away.exr", FLAT, **away), "display window"),
    ):
        with pytest.raises(ms.InputError, match=said):
            rgb_light(made)


def test_our_own_file_needs_no_unit_and_refuses_one(light_file: Path, light: Any) -> None:
    np.testing.assert_array_equal(ms.read_irradiance(light_file).data, light.data)
    for asked in (
        {"unit": "w_per_m2_nm"},
        {"wavelength_nm": 550},
        {"fov_deg": 40},
        {"layer": "a"},
    ):
        with pytest.raises(ms.InputError, match=r"irradiance\.exr"):
            ms.read_irradiance(light_file, **asked)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("channels", "options", "words"),
    [
        ("RGB", {}, ("B, G, R", "unit=")),
        ("RGB", {"unit": "radiance_rbg"}, ("'radiance_rgb'",)),
        ("RGB", {"unit": "radiance_rgb"}, ("camera=",)),
        ("RGB", {"unit": "radiance_rgb", "camera": BAYER, "wavelength_nm": 550}, ("wavelength_nm",)),
        ("RGB", {"unit": "w_per_m2_nm"}, ("B, G, R", "S0.<wavelength>nm")),
        ("RGB", {"unit": "w_per_m2", "wavelength_nm": 550}, ("3 channels", "w_per_m2")),
        ("Y", {"unit": "w_per_m2", "fov_deg": 40}, ("fov_deg", "'w_per_m2'")),
        ("Y", {"unit": "w_per_m2"}, ("wavelength_nm", "550")),
        ("Y", {"unit": "w_per_m2", "wavelength_nm": -5}, ("wavelength_nm", "-5", "100000")),
        ("Y", {"unit": "w_per_m2_nm"}, ("w_per_m2", "wavelength_nm")),
        ("Y", {"unit": "radiance_rgb", "camera": "bayer_2mp"}, ("R, G and B",)),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_sentence(
    tmp_path: Path, channels: str, options: Any, words: tuple[str, ...]
) -> None:
    file = write(tmp_path / "x.exr", {name: np.ones((2, 2)) for name in channels})
    with pytest.raises(ms.InputError) as caught:
        ms.read_irradiance(file, **options)
    assert all(word in str(caught.value) for word in words), caught.value


def test_the_commands_take_light_of_another_program(tmp_path: Path, cli: Any) -> None:
    file = write(tmp_path / "rgb.exr", {name: np.full((4, 4), 0.02) for name in "RGB"})
    rgb = ("--camera", "bayer_2mp", "--unit", "radiance_rgb", "--set", "lens.f_number=4")
    done = cli("expose", file, "-o", tmp_path / "out", *rgb, "--json")
    assert done.exit_code == 0, done.stderr
    assert "Jakob & Hanika 2019" in " ".join(json.loads(done.stdout)["render"]["notes"])
    one = write(tmp_path / "y.exr", {"Y": np.full((4, 4), 1e-3)})
    mono = ("--unit", "w_per_m2", "--wavelength-nm", 550, "--camera", "konnik_table1")
    assert cli("plan", one, *mono, "--json").exit_code == 0
    for command in (("expose", file, "-o", tmp_path / "no"), ("plan", file)):
        failed = cli(*command, "--camera", "bayer_2mp")
        assert failed.exit_code == 2 and "--unit" in failed.stderr
    assert not (tmp_path / "no").exists()
    (tmp_path / "s.xml").write_text(scene_text(SKY))
    scene = cli("plan", tmp_path / "s.xml", "--unit", "w_per_m2")
    assert scene.exit_code == 2 and "--unit" in scene.stderr
