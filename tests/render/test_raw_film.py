"""Raw frames out of plain Mitsuba: mi.render, film.develop(), film.bitmap(), film.write()."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from helpers.scenes import BALL, SKY, both_variants, skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.core.errors import InputError
from mitsuba_sensor.render.variants import choose_variant, use

RAW = '<string name="output" value="raw"/>'
LENS = '<sensor type="camera"><float name="focal_length_mm" value="0.05"/>'


def scene(
    integrator: str = '<integrator type="raw_frame"><integrator type="path"/></integrator>', film: str = RAW
) -> str:
    """A ball under an even sky, exposed by a Bayer camera whose window begins in an odd column."""
    size = (
        '<integer name="width" value="12"/><integer name="height" value="8"/><integer name="crop_offset_x" value="3"/>'
    )
    named = '<string name="camera" value="bayer_2mp"/><float name="exposure_s" value="0.02"/>'
    window = f'{named}{size}<integer name="crop_width" value="6"/><integer name="serial" value="7"/>'
    sensor = f'{LENS}<film type="photosensor">{film}{window}</film></sensor>'
    return f'<scene version="3.0.0">{integrator}{sensor}{SKY}{BALL.format(bsdf="")}</scene>'


def ready(variant: str) -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


@both_variants
def test_mitsuba_renders_the_raw_frame_of_capture(tmp_path: Path, variant: str) -> None:
    """mi.render, develop(), bitmap() and the file that write() makes have the digital numbers of ms.capture."""
    mi = ready(variant)
    loaded = mi.load_string(scene())
    film = loaded.sensors()[0].film()
    with pytest.raises(InputError, match="holds no raw frame yet"):
        film.develop()
    rendered = np.array(mi.render(loaded, spp=16, seed=3))
    wanted = ms.capture(scene(), seed=3, spp=16).frames
    assert rendered.shape == (8, 6, 1) and wanted.first.window.origin == (0, 3) and wanted.first.window.serial == 7
    np.testing.assert_array_equal(rendered[..., 0], wanted.digital[0])
    np.testing.assert_array_equal(np.array(film.develop(raw=True)), rendered)
    bitmap = np.array(film.bitmap())
    assert bitmap.dtype == np.uint16
    np.testing.assert_array_equal(bitmap.reshape(8, 6), wanted.digital[0])
    film.write(str(tmp_path / "raw.exr"))
    with OpenEXR.File(str(tmp_path / "raw.exr"), separate_channels=True) as file:
        np.testing.assert_array_equal(file.channels()["Y"].pixels, wanted.digital[0])
    other = np.array(mi.render(loaded, spp=16, seed=4))
    assert (other != rendered).any()


def test_a_loaded_scene_with_a_raw_film_can_be_captured_too() -> None:
    mi = ready("scalar_spectral")
    one, other = (ms.capture(x, spp=16).frames.digital for x in (scene(), mi.load_string(scene())))
    np.testing.assert_array_equal(one, other)
    assert not any("raw_frame" in note for note in ms.render(scene(), spp=1).statistics.notes)


def test_a_raw_film_and_another_integrator_are_one_sentence() -> None:
    """And the integrator with another film; and an output that there is not."""
    mi = ready("scalar_spectral")
    with pytest.raises(InputError, match='output "raw" needs <integrator type="raw_frame">; put the'):
        mi.render(mi.load_string(scene('<integrator type="path"/>')), spp=1)
    with pytest.raises(InputError, match="raw_frame renders the first sensor"):
        mi.render(mi.load_string(scene(film="")), spp=1)
    with pytest.raises(RuntimeError, match="output is 'dn'; it must be bands or raw"):
        mi.load_string(scene(film='<string name="output" value="dn"/>'))
