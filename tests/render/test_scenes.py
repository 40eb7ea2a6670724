"""Scenes: the shipped ones have their stated exposure, any other one loads, broken ones are refused in one sentence."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.scenes import BALL, SCENES, SHIPPED, SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.scene.scene import load_scene
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA = ms.load_camera("konnik_table1")
BANDS = box_bands(CAMERA, np.array([400.0, 550.0, 700.0]))


def fill(light: ms.Irradiance) -> np.ndarray:
    """Detected electrons over full well, at 0.1 s, (H, W)."""
    photons = ms.collect(light, CAMERA, ms.Exposure(0.1))
    return (photons.mean * CAMERA.qe(light.wavelengths_nm)[0]).sum(
        axis=-1
    ) / CAMERA.pixel.full_well_e


def render_frames(
    name: str, spp: int, size: tuple[int, int], **parameters: object
) -> np.ndarray:
    options = {"width": size[0], "height": size[1], **parameters}
    return fill(
        ms.render(
            SCENES / f"{name}.xml",
            CAMERA,
            ms.Exposure(0.1),
            spp=spp,
            bandwidth_nm=50,
            parameters=options,
            variant="scalar_spectral",
            denoise=False,
        )
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_load_without_a_note_and_in_plain_mitsuba(name: str) -> None:
    """Nothing of ours has to be replaced, and nothing is black in 360 to 830 nm."""
    mi = use(choose_variant("scalar_spectral"))
    assert (
        load_scene(
            SCENES / f"{name}.xml",
            box_bands(CAMERA, np.array([360.0, 830.0])),
            {"width": 8, "height": 8},
        ).notes
        == ()
    )
    assert mi.load_file(str(SCENES / f"{name}.xml"), width="8", height="8").sensors()


@pytest.mark.parametrize("name", (*SHIPPED, "one_file", "first_frame", "night_crossing"))
def test_every_parameter_of_a_shipped_scene_is_explained(name: str) -> None:
    """Each <default> follows a comment, or another <default> of the same comment; size and level are among them."""
    text = (SCENES / f"{name}.xml").read_text(encoding="utf-8")
    names = re.findall(r'<default name="(\w+)"', text)
    explained = re.findall(r"-->\s*((?:<default[^>]*/>\s*)+)", text)
    assert re.findall(r'<default name="(\w+)"', "".join(explained)) == names
    assert {"width", "height"} < set(names)


def test_cornell_walls_are_well_exposed_and_the_lamp_saturates() -> None:
    """White back wall at 30 to 50 % of full well, the lamp far above it (64 × 64, wall mean good to 1 %)."""
    well = render_frames("cornell_box", 64, (64, 64))
    assert 0.30 < well[16:40, 36:48].mean() < 0.50
    assert well[7:9, 28:36].min() > 5


def test_step_wedge_is_linear_from_dark_to_beyond_saturation() -> None:
    """64 equal steps: exactly 0, then a straight line to 1.2 full wells, every step within 1 % (0.1 % of error)."""
    steps = render_frames("step_wedge", 256, (64, 16)).mean(axis=0)
    assert steps[0] == 0 and steps[-1] == pytest.approx(1.2, abs=0.02)
    rise = steps[1:] / np.arange(1, 64)
    np.testing.assert_allclose(rise, rise.mean(), rtol=1e-2)


def test_still_life_is_well_exposed() -> None:
    """The median pixel stands between a tenth and a half of full well, under a tenth of the pixels saturate."""
    well = render_frames("still_life", 36, (36, 24))
    assert 0.1 < np.median(well) < 0.5 and (well > 1).mean() < 0.1


def test_foreign_rgb_scene_renders_and_the_user_is_told(tmp_path: Path) -> None:
    """rgb colours, hdrfilm, gaussian filter, independent sampler, two sensors, an aov integrator: all still loads."""
    text = scene_text(
        '<emitter type="constant"><rgb name="radiance" value="0.01, 0.01, 0.01"/></emitter>',
        BALL.format(
            bsdf='<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.1, 0.1"/></bsdf>'
        ),
        '<integrator type="aov"><string name="aovs" value="d:depth"/><integrator type="path"/></integrator>',
        '<sensor type="perspective"/>',
        film='<rfilter type="gaussian"/>',
        more='<sampler type="independent"/>',
    )
    light = ms.render(
        write_scene(tmp_path, text),
        CAMERA,
        ms.Exposure(0.1),
        spp=16,
        bandwidth_nm=100,
        variant="scalar_spectral",
    )
    notes, facts = ("\n".join(said) for said in (light.notes, light.statistics.facts))
    for fact in ("'hdrfilm' replaced", "'gaussian' replaced", "'independent' replaced"):
        assert fact in facts and fact not in notes
    assert "'aov' replaced" in notes and "2 sensors" in notes
    assert light.data.shape == (8, 12, 3) and (light.data > 0).all()
    assert light.data[4, 6, 2] > 3 * light.data[4, 6, 0], (
        "the ball is red: 650 nm far above 450 nm"
    )


def test_parameters_reach_the_scene_and_its_fingerprint(tmp_path: Path) -> None:
    use(choose_variant("scalar_spectral"))
    path = SCENES / "flat_field.xml"
    small, same, large = (load_scene(path, BANDS, {"width": w}) for w in (4, "4", 5))
    assert (small.view.size, large.view.size) == ((4, 256), (5, 256))
    assert small.sha256 == same.sha256 != large.sha256


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "No document element"),
        ('<scene version="3.0.0"><sensor', "Error parsing"),
        ("<scene></scene>", "version"),
        ('<bsdf version="3.0.0" type="diffuse"/>', "holds no scene"),
        ('<scene version="3.0.0"></scene>', "add one, e.g. <sensor"),
        (scene_text(), "add an emitter"),
        (scene_text(SKY, '<shape type="blob"/>'), '"blob" not found'),
        (scene_text(SKY, "<blob/>"), "<blob>"),
        (
            scene_text(SKY, '<shape type="sphere"><float name="radios" value="3"/></shape>'),
            "radios",
        ),
        (
            scene_text(SKY, '<shape type="sphere"><float name="radius" value="$r"/></shape>'),
            "-D name=value",
        ),
        (
            scene_text(SKY, '<shape type="sphere"><float name="radius" value="abc"/></shape>'),
            "abc",
        ),
        (scene_text(SKY, '<shape type="sphere"><ref id="gone"/></shape>'), "gone"),
        (
            scene_text(
                SKY, '<shape type="ply"><string name="filename" value="no.ply"/></shape>'
            ),
            "no.ply",
        ),
        (scene_text(SKY, '<include filename="no.xml"/>'), "no.xml"),
        (scene_text(SKY, film='<integer name="crop_width" value="99"/>'), "crop"),
        (
            scene_text(SKY, film='<float name="crop_width" value="2.5"/>'),
            "2.5; it must be a whole",
        ),
        (scene_text(SKY, '<integrator type="depth"/>'), "computes no radiance"),
        (
            scene_text(SKY, sensor='<sensor type="irradiancemeter"/>'),
            "irradiancemeter",
        ),
        (scene_text(SKY.replace("360:", "750:")), "no light in the bands"),
    ],
)
def test_broken_scenes_are_refused_in_one_sentence(
    tmp_path: Path, text: str, sentence: str
) -> None:
    use(choose_variant("scalar_spectral"))
    with pytest.raises(ms.InputError) as caught:
        load_scene(write_scene(tmp_path, text), BANDS, {})
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_fewer_columns_are_the_same_view(tmp_path: Path) -> None:
    """A ball in the sky: half the columns show the mean of two by two pixels, rows and the crop in proportion."""
    use(choose_variant("scalar_spectral"))
    path = write_scene(tmp_path, scene_text(SKY, BALL.format(bsdf='<bsdf type="diffuse"/>')))
    exposure = ms.Exposure(0.1)
    wide, narrow = (
        ms.render(path, CAMERA, exposure, spp=1024, wavelength_nm=550, width=c).data[..., 0]
        for c in (12, 6)
    )
    binned = wide.reshape(4, 2, 6, 2).mean(axis=(1, 3))
    assert narrow.shape == binned.shape and np.ptp(binned) > 0.2 * binned.max()
    np.testing.assert_allclose(narrow, binned, rtol=0.05)
    crop = "".join(
        f'<integer name="{k}" value="{v}"/>'
        for k, v in {
            "crop_width": 6,
            "crop_height": 4,
            "crop_offset_x": 4,
            "crop_offset_y": 2,
        }.items()
    )
    view = load_scene(
        write_scene(tmp_path, scene_text(SKY, film=crop)), BANDS, {}, width=6
    ).view
    assert (view.size, view.crop_size, view.crop_offset) == ((12, 8), (6, 4), (4, 2))


@pytest.mark.parametrize(
    ("scene", "way_out"),
    [
        ("cornell_box", r"256; a larger film is -D width=512 -D height=512 \(parameters="),
        (scene_text(SKY), "12; give the film in the scene a width of 512 and a height of "),
    ],
    ids=["parameters", "none"],
)
def test_more_columns_than_the_film_has_are_refused_with_a_larger_film(
    scene: str, way_out: str
) -> None:
    with pytest.raises(ms.InputError, match=way_out):
        ms.render(scene, CAMERA, ms.Exposure(0.1), width=512)


def test_an_old_scene_is_what_mitsuba_s_own_upgrade_makes_of_it(tmp_path: Path) -> None:
    """Format 0.6: parameters in camelCase are understood, with a note; an element that is not is refused, and the
    sentence says of which format the scene is."""
    use(choose_variant("scalar_spectral"))
    ball = BALL.format(
        bsdf='<bsdf type="diffuse"><rgb name="{}" value="0.1, 0.2, 0.3"/></bsdf>'
    )
    old = scene_text(SKY, ball.format("diffuseReflectance")).replace("3.0.0", "0.6.0")
    new = scene_text(SKY, ball.format("reflectance"))
    scenes = [load_scene(text, BANDS, {}) for text in (old, new)]
    a, b = (scene.render(1, 4, (0, 8)) for scene in scenes)
    np.testing.assert_array_equal(a, b)
    told = [any("Mitsuba 0.6.0" in note for note in scene.notes) for scene in scenes]
    assert told == [True, False]
    with pytest.raises(ms.InputError, match=r"format of Mitsuba 0\.6\.0"):
        load_scene(old.replace("<rgb", "<srgb"), BANDS, {})


def test_a_small_render_imports_no_optimiser(tmp_path: Path) -> None:
    """scipy.optimize takes half a second, a sixth of a small render in a fresh process."""
    call = "ms.render('cornell_box', width=8, spp=1, denoise=False, variant='scalar_spectral', progress=False)"
    code = f"import sys, mitsuba_sensor as ms; {call}; print('scipy.optimize' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"
