"""Raw frames out of plain Mitsuba: mi.render, film.develop(), film.bitmap(), film.write()."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from helpers.scenes import BALL, SKY, scalar_first, skip_unless_usable
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.render.variants import choose_variant, use

RAW = '<string name="output" value="raw"/>'
LENS = '<sensor type="camera"><float name="focal_length_mm" value="0.05"/>'


def scene(
    integrator: str = '<integrator type="raw_frame"><integrator type="path"/></integrator>',
    film: str = RAW,
) -> str:
    """A ball under an even sky, exposed by a Bayer camera whose window begins in an odd column."""
    size = '<integer name="width" value="12"/><integer name="height" value="8"/>'
    size += '<integer name="crop_offset_x" value="3"/>'
    named = '<string name="camera" value="bayer_2mp"/><float name="exposure_s" value="0.02"/>'
    window = (
        f'{named}{size}<integer name="crop_width" value="6"/><integer name="serial" value="7"/>'
    )
    sensor = f'{LENS}<film type="photosensor">{film}{window}</film></sensor>'
    return f'<scene version="3.0.0">{integrator}{sensor}{SKY}{BALL.format(bsdf="")}</scene>'


def ready(variant: str) -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


@scalar_first
def test_mitsuba_renders_the_raw_frame_of_capture(tmp_path: Path, variant: str) -> None:
    """mi.render, develop(), bitmap() and the file that write() makes have the digital numbers of ms.capture."""
    mi = ready(variant)
    loaded = mi.load_string(scene())
    film = loaded.sensors()[0].film()
    with pytest.raises(ms.InputError, match="holds no raw frame yet"):
        film.develop()
    rendered = np.array(mi.render(loaded, spp=16, seed=3))
    wanted = ms.capture(scene(), seed=3, spp=16).frames
    assert (
        rendered.shape == (8, 6, 1)
        and wanted.first.window.origin == (0, 3)
        and wanted.first.window.serial == 7
    )
    np.testing.assert_array_equal(rendered[..., 0], wanted.digital[0])
    np.testing.assert_array_equal(np.array(film.develop(raw=True)), rendered)
    bitmap = np.array(film.bitmap())
    assert bitmap.dtype == np.uint16
    np.testing.assert_array_equal(bitmap.reshape(8, 6), wanted.digital[0])
    film.write(str(tmp_path / "raw.exr"))
    with OpenEXR.File(str(tmp_path / "raw.exr"), separate_channels=True) as file:
        np.testing.assert_array_equal(file.channels()["Y"].pixels, wanted.digital[0])
    film.write(str(tmp_path / "raw.png"))
    with Image.open(tmp_path / "raw.png") as picture:
        np.testing.assert_array_equal(np.array(picture), wanted.digital[0])
    assert (np.array(mi.render(loaded, spp=16, seed=4)) != rendered).any()
    again = ms.capture(loaded, seed=3, spp=16).frames
    np.testing.assert_array_equal(again.digital, wanted.digital)
    assert not any("raw_frame" in note for note in again.notes)


@scalar_first
def test_a_raw_film_and_another_integrator_are_one_sentence(variant: str) -> None:
    """And the integrator with another film; and an output that there is not. A traceback ends with the sentence."""
    mi = ready(variant)
    with pytest.raises(
        ms.InputError, match='output "raw" needs <integrator type="raw_frame">; put the'
    ):
        mi.render(mi.load_string(scene('<integrator type="path"/>')), spp=1)
    with pytest.raises(ms.InputError, match="raw_frame renders a sensor with"):
        mi.render(mi.load_string(scene(film="")), spp=1)
    with pytest.raises(RuntimeError, match="output is 'dn'; it must be bands or raw"):
        mi.load_string(scene(film='<string name="output" value="dn"/>'))


TWO = [
    '<sensor type="camera"><float name="focal_length_mm" value="0.05"/><transform name="to_world">'
    f'<translate x="{x}"/></transform><film type="photosensor">{RAW}<string name="camera" value="konnik_table1"/>'
    '<float name="exposure_s" value="0.002"/><float name="wavelength_nm" value="550"/>'
    f'<integer name="width" value="{width}"/><integer name="height" value="8"/></film></sensor>'
    for x, width in ((0, 6), (0.5, 6))
]
AROUND_PATH = '<integrator type="raw_frame"><integrator type="path"/></integrator>'


def seen_by(*sensors: str, integrator: str = AROUND_PATH) -> str:
    return f'<scene version="3.0.0">{integrator}{"".join(sensors)}{SKY}{BALL.format(bsdf="")}</scene>'


def frame(mi: Any, text: str, **options: Any) -> Any:
    return np.array(mi.render(mi.load_string(text), spp=16, seed=3, **options))


@scalar_first
def test_any_sensor_of_a_scene_has_a_raw_frame(variant: str) -> None:
    """By its number, and as an object: that of a scene in which it is the only one."""
    mi = ready(variant)
    alone = frame(mi, seen_by(TWO[1]))
    scene = mi.load_string(seen_by(*TWO))
    np.testing.assert_array_equal(np.array(mi.render(scene, sensor=1, spp=16, seed=3)), alone)
    np.testing.assert_array_equal(
        np.array(mi.render(scene, sensor=scene.sensors()[1], spp=16, seed=3)), alone
    )
    assert (frame(mi, seen_by(*TWO)) != alone).any()


def test_raw_frame_may_be_given_to_render_instead_of_the_integrator_of_the_scene() -> None:
    mi = ready("llvm_ad_spectral")
    around = mi.load_dict({"type": "raw_frame"})
    given = frame(
        mi, seen_by(TWO[0], integrator='<integrator type="direct"/>'), integrator=around
    )
    np.testing.assert_array_equal(given, frame(mi, seen_by(TWO[0])))
