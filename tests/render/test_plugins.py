"""One scene file with scene, lens, sensor, exposure and seeds: <sensor type="camera">, <film type="photosensor">."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import CAMERAS
from helpers.marks import one_in
from helpers.scenes import (
    BALL,
    SCENES,
    SKY,
    both_variants,
    read_settings,
    scalar_first,
    skip_unless_usable,
    write_scene,
)

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.bands import box_bands, channel_bands
from mitsuba_sensor.render.load.scene import Scene, load_scene
from mitsuba_sensor.render.plugins import plugin_hook
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

CAMERA = ms.load_camera("konnik_table1")
PITCH_M = CAMERA.pixel.pitch_x_um * 1e-6
BANDS = box_bands(CAMERA, np.array([400.0, 550.0, 700.0]))
LENS = '<float name="focal_length_mm" value="0.05"/>'  # 12 pixels of 5.7 µm see 69°
FOCUS = '<float name="focus_distance_m" value="3"/><float name="f_number" value="2"/>'
NAME = '<string name="camera" value="konnik_table1"/>'
SIZE = '<integer name="width" value="12"/><integer name="height" value="8"/>'
NEAR_BALL = BALL.format(bsdf='<bsdf type="diffuse"/>')


def one_file(lens: str = LENS, film: str = NAME + SIZE, *elements: str) -> str:
    """A ball under an even sky, with our two elements on lines 2 and 3."""
    body = "".join(elements) or SKY + NEAR_BALL
    return (
        f'<scene version="3.0.0">\n<sensor type="camera">{lens}\n<film type="photosensor">{film}</film></sensor>\n'
        f'<integrator type="path"/>{body}</scene>'
    )


def by_hand(kind: str, parameters: dict[str, float], film: str = SIZE) -> str:
    """The same scene with Mitsuba's own sensor and film."""
    floats = "".join(
        f'<float name="{name}" value="{value!r}"/>' for name, value in parameters.items()
    )
    sensor = f'<sensor type="{kind}">{floats}<film type="hdrfilm">{film}</film></sensor>'
    return f'<scene version="3.0.0">{sensor}{SKY}{NEAR_BALL}</scene>'


def fov_deg(image_m: float, columns: int = 12) -> float:
    return 2 * math.degrees(math.atan(columns * PITCH_M / (2 * image_m)))


def plain(path: Path, **parameters: str) -> Any:
    """What a Mitsuba user does."""
    plugin_hook.register_plugins()
    return mitsuba().load_file(str(path), **parameters)


def ready(variant: str) -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


@scalar_first
def test_plain_mitsuba_renders_the_two_elements_as_its_own_objects(
    tmp_path: Path, variant: str
) -> None:
    """mi.load_file and mi.render; every pixel of an even sky is L·Δλ in every one of 30 bands.

    96 pixels of 256 samples know a band to 1.7 % (independent sampler), so that 8 % fails for one seed in 10 000.
    """
    mi = ready(variant)
    scene = plain(write_scene(tmp_path, one_file(LENS, NAME + SIZE, SKY)))
    assert type(scene.sensors()[0].film()).__name__ == "Film"
    image = np.array(mi.render(scene, spp=256, seed=1))
    assert image.shape == (8, 12, 30)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), 2e-4 * 10, rtol=0.08)


@scalar_first
def test_a_camera_without_focus_is_a_perspective_of_the_focal_length(
    tmp_path: Path, variant: str
) -> None:
    """Field of view 2·atan(columns·pitch/2f): the same numbers, bit for bit, as a perspective written by hand."""
    ready(variant)
    ours = load_scene(write_scene(tmp_path, one_file()), BANDS, {})
    hand = load_scene(
        write_scene(tmp_path, by_hand("perspective", {"fov": fov_deg(0.05e-3)})), BANDS, {}
    )
    assert ours.view == hand.view and ours.notes == ()
    np.testing.assert_array_equal(ours.render(1, 16, (0, 8)), hand.render(1, 16, (0, 8)))


@scalar_first
@pytest.mark.parametrize(
    ("unit", "metres"), one_in(3, [("m", 1.0), ("mm", 1e-3), ("2.5", 2.5)], several=True)
)
def test_a_camera_in_focus_is_a_thin_lens_in_scene_units(
    tmp_path: Path, variant: str, unit: str, metres: float
) -> None:
    """Aperture radius f/2N and focus distance in units, field of view from s = f·d/(d − f): bit for bit by hand."""
    ready(variant)
    lens = LENS + FOCUS + f'<string name="scene_unit" value="{unit}"/>'
    ours = load_scene(write_scene(tmp_path, one_file(lens)), BANDS, {})
    focal, focus = 0.05e-3, 3.0
    parameters = {
        "fov": fov_deg(focal * focus / (focus - focal)),
        "aperture_radius": focal / (2 * 2.0) / metres,
        "focus_distance": focus / metres,
    }
    hand = load_scene(
        write_scene(tmp_path, by_hand("thinlens", parameters)), BANDS, {}, scene_unit=unit
    )
    assert ours.view == hand.view
    np.testing.assert_array_equal(ours.render(1, 16, (0, 8)), hand.render(1, 16, (0, 8)))


def test_channels_of_the_film_hold_the_transmission_of_the_sensor_around_it(
    tmp_path: Path,
) -> None:
    """The response is T(λ)·QE(λ)·λ/λ_ref with the spectrum that the sensor element gives."""
    mi = ready("scalar_spectral")
    through = '<spectrum name="transmission" value="400:0.5, 700:0.9"/>'
    spectral = '<string name="spectral" value="channels"/>'
    path = write_scene(tmp_path, one_file(LENS + through, NAME + SIZE + spectral))
    film = mi.traverse(plain(path).sensors()[0].film())
    lens = {
        "lens.transmission_curve": (0.5, 0.9),
        "lens.transmission_wavelengths_nm": (400.0, 700.0),
    }
    expected = channel_bands(CAMERA.replace(**lens)).responses[0]["values"]
    values = [float(number) for number in expected.split(",")]
    np.testing.assert_allclose(np.array(film["band0000.values"]), values, rtol=1e-6)
    assert values[-1] / values[0] == pytest.approx(0.9 / 0.5 * 700 / 400, rel=1e-3)


def test_defaults_and_given_parameters_reach_both_elements(tmp_path: Path) -> None:
    mi = ready("scalar_spectral")
    default = '<default name="f" value="0.05"/><default name="bits" value="10"/>'
    film = NAME + SIZE + '<integer name="adc.bits" value="$bits"/>'
    text = one_file('<float name="focal_length_mm" value="$f"/>', film).replace(
        "<sensor", f"{default}<sensor", 1
    )
    path = write_scene(tmp_path, text)
    for parameters, focal, bits in (({}, 0.05, 10), ({"f": "0.1", "bits": "14"}, 0.1, 14)):
        settings = read_settings(path, parameters)
        assert (
            settings.camera is not None
            and settings.camera.adc.bits == bits
            and settings.focal_length_mm == focal
        )
        view = float(mi.traverse(plain(path, **parameters).sensors()[0])["x_fov"])
        assert view == pytest.approx(fov_deg(focal * 1e-3), rel=1e-6)


def test_a_gain_setting_is_that_of_the_camera_of_the_film(tmp_path: Path) -> None:
    """What the film sets beside it comes after it, and another camera does not get it."""
    film = '<string name="camera" value="sony_a7s2"/><integer name="gain" value="800"/>'
    shape = '<float name="source_follower.read_noise_shape" value="0.1"/>'
    settings = read_settings(write_scene(tmp_path, one_file(LENS, film + shape)), {})
    shipped = ms.load_camera("sony_a7s2").at_gain(800)
    assert settings.camera is not None and settings.camera.adc == shipped.adc
    noise = settings.camera.source_follower
    assert (noise.read_noise_e, noise.read_noise_shape) == (4.637, 0.1)
    settings = read_settings(write_scene(tmp_path, one_file(LENS, film)), {})
    assert settings.camera == shipped and settings.applied_to(CAMERA) == CAMERA


def test_a_camera_file_lies_beside_the_scene(tmp_path: Path) -> None:
    """Found from any folder, by read_settings and by plain Mitsuba."""
    mi = ready("scalar_spectral")
    shipped = CAMERAS / "konnik_table1.toml"
    text = (
        shipped.read_text(encoding="utf-8")
        .replace('"konnik_table1"', '"mine"')
        .replace("pitch_x_um = 5.7", "pitch_x_um = 11.4")
    )
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    path = write_scene(
        tmp_path, one_file(LENS, '<string name="camera" value="mine.toml"/>' + SIZE)
    )
    assert not Path("mine.toml").exists()
    settings = read_settings(path, {})
    assert settings.camera is not None and settings.camera.name == "mine"
    assert float(mi.traverse(plain(path).sensors()[0])["x_fov"]) == pytest.approx(
        2 * math.degrees(math.atan(12 * 11.4e-6 / 1e-4)), rel=1e-6
    )


TYPING_ERRORS = [
    (LENS + '<float name="f_nubmer" value="2"/>', NAME + SIZE, "f_nubmer", 2),
    (LENS, NAME + SIZE + '<float name="exposure" value="2"/>', "exposure", 3),
    (LENS, NAME + SIZE + '<integer name="adc.bit" value="2"/>', "adc.bit", 3),
    (LENS, NAME + SIZE + '<float name="adc.bits" value="2.5"/>', "adc.bits", 3),
    (LENS, NAME + SIZE + '<rfilter type="gaussian"/>', "_arg", 3),
]  # fmt: skip


@pytest.mark.parametrize(("lens", "film", "name", "line"), TYPING_ERRORS)
def test_a_typing_error_is_told_with_its_line(
    tmp_path: Path, lens: str, film: str, name: str, line: int
) -> None:
    """By plain Mitsuba, when nothing is rendered, and by load_scene, which gives the nearest name."""
    ready("scalar_spectral")
    path = write_scene(tmp_path, one_file(lens, film))
    with pytest.raises(RuntimeError, match=rf"(?s)line {line}.*{name}"):
        plain(path)
    for load in (lambda: read_settings(path, {}), lambda: load_scene(path, BANDS, {}, CAMERA)):
        with pytest.raises(ms.InputError, match=rf"line {line}.*{name}") as caught:
            load()
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("lens", "film", "sentence"),
    [
        ("", NAME + SIZE, "focal_length_mm"),
        (LENS + '<float name="focus_distance_m" value="0.00005"/>', NAME + SIZE, "more than the focal length, 5e-05 m"),
        (LENS + '<float name="focus_distance_m" value="-1"/>', NAME + SIZE, "focus_distance_m is -1"),
        (LENS + '<string name="scene_unit" value="ell"/>', NAME + SIZE, "scene_unit is 'ell'"),
        (LENS + FOCUS, NAME + SIZE + '<float name="lens.f_number" value="2"/>', "in one of the two"),
        (LENS + '<float name="transmission" value="2"/>', NAME + SIZE, "lens.transmission is 2"),
        (LENS + '<texture type="uniform" name="transmission"/>', NAME + SIZE, "pairs"),
        (LENS + '<string name="pupil_convention" value="round"/>', NAME + SIZE, "lens.convention is 'round'"),
        (LENS, NAME + SIZE + '<float name="exposure_s" value="-1"/>', "time_s is -1"),
        (LENS, NAME + SIZE + '<float name="seed" value="1.5"/>', "seed is 1.5"),
        (LENS, NAME + SIZE + '<string name="spectral" value="rgb"/>', "spectral is 'rgb'"),
        (LENS, NAME + SIZE + '<point name="adc.bits" value="1, 2, 3"/>', "must be a <string>"),
        (LENS, '<string name="camera" value="nikon"/>' + SIZE, "unknown camera"),
        (LENS, '<string name="camera" value="gone.toml"/>' + SIZE, "cannot be read"),
        (LENS, SIZE, "names it"),
    ],
)  # fmt: skip
def test_wrong_values_are_refused_in_one_sentence(
    tmp_path: Path, lens: str, film: str, sentence: str
) -> None:
    """By load_scene; and plain Mitsuba does not build it either."""
    ready("scalar_spectral")
    path = write_scene(tmp_path, one_file(lens, film))
    with pytest.raises(ms.InputError) as caught:
        load_scene(path, BANDS, {})
    assert sentence in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(RuntimeError):
        plain(path)


def test_a_camera_around_another_film_takes_its_pixels_from_the_camera_that_renders(
    tmp_path: Path,
) -> None:
    """load_scene is given the camera; plain Mitsuba is not, and raises."""
    ready("scalar_spectral")
    path = write_scene(
        tmp_path, one_file().replace('type="photosensor"', 'type="hdrfilm"').replace(NAME, "")
    )
    view = load_scene(path, BANDS, {}, CAMERA).view
    assert 2 * math.degrees(math.atan(view.half_width)) == pytest.approx(
        fov_deg(0.05e-3), rel=1e-6
    )
    with pytest.raises(RuntimeError, match="needs a <film"):
        plain(path)


@both_variants
def test_the_example_loads_in_plain_mitsuba_and_says_everything(variant: str) -> None:
    """scenes/one_file.xml: loaded by both without a note, and in focus where the near ball stands."""
    mi = ready(variant)
    path, small = SCENES / "one_file.xml", {"width": "16", "height": "12"}
    assert np.array(mi.render(plain(path, **small), spp=4)).shape == (12, 16, 15)
    settings = read_settings(path, small)
    assert settings.camera is not None and settings.exposure == ms.Exposure(0.1, 298.15)
    assert None not in (
        settings.seed,
        settings.serial,
        settings.spectral,
        settings.bandwidth_nm,
        settings.unit_m,
    )
    scene: Scene = load_scene(path, BANDS, small)
    assert scene.notes == () and scene.view.focus_m == pytest.approx(0.3, rel=1e-6)


IN_PLAIN_MITSUBA = (
    "import mitsuba as mi; mi.set_variant('scalar_spectral'); import mitsuba_sensor",
    "import mitsuba_sensor; import mitsuba as mi; mi.set_variant('scalar_rgb'); mi.set_variant('scalar_spectral')",
    "import mitsuba as mi; import mitsuba_sensor; mi.set_variant('scalar_spectral')",
)


@pytest.mark.parametrize("imports", one_in(3, IN_PLAIN_MITSUBA))
def test_importing_the_package_makes_the_plugins_known_in_either_order(
    tmp_path: Path, imports: str
) -> None:
    """Nothing is registered by hand; importing one does not import the other."""
    path = write_scene(tmp_path, one_file())
    code = (
        f"import sys; {imports.replace('import mitsuba_sensor', IMPORT)}\n"
        f"print(mi.render(mi.load_file({str(path)!r}), spp=1).shape, type(mitsuba_sensor.render).__name__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ)
    )
    assert done.stdout.split("\n")[-2] == "(8, 12, 30) function", done.stderr


IMPORT = "before = 'mitsuba' in sys.modules; import mitsuba_sensor; assert before == ('mitsuba' in sys.modules)"
