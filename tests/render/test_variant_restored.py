"""Every call that chooses a Mitsuba variant leaves the user's one as it was."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import BALL, SKY, scene_text, skip_unless_usable, write_scene
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.cli import app
from mitsuba_sensor.render.motion.aovs import render_aovs
from mitsuba_sensor.render.variants import fastest_variant, mitsuba

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
SCENE = scene_text(SKY, BALL.format(bsdf=""))
FAST: Any = {"spp": 2, "bandwidth_nm": 200, "denoise": False}
PAIRS = [  # the user's variant, and that in which a call renders
    ("llvm_ad_rgb", "llvm_ad_spectral"),
    ("scalar_rgb", "scalar_spectral"),
    ("llvm_ad_spectral", "scalar_spectral"),
]


@pytest.fixture(autouse=True)
def _spectral_for_the_next_test() -> Iterator[None]:
    yield
    mitsuba().set_variant("scalar_spectral")


def user_has(variant: str) -> Any:
    skip_unless_usable(f"{variant.rpartition('_')[0]}_spectral")
    mitsuba().set_variant(variant)
    return mitsuba()


def read_colours(folder: Path, _: str) -> None:
    mitsuba().Bitmap(np.full((4, 4, 3), 0.02, np.float32)).write(str(folder / "rgb.exr"))
    assert ms.read_irradiance(folder / "rgb.exr", unit="radiance_rgb", camera=CAMERA).data.any()


def call_the_program(folder: Path, variant: str) -> None:
    arguments = (
        "lint",
        str(write_scene(folder, SCENE)),
        "--camera",
        "konnik_table1",
        "--variant",
        variant,
    )
    assert CliRunner().invoke(app, list(arguments)).exit_code == 0


CALLS: dict[str, Callable[[Path, str], object]] = {
    "render": lambda _, variant: ms.render(SCENE, CAMERA, EXPOSURE, variant=variant, **FAST),
    "capture": lambda _, variant: ms.capture(SCENE, CAMERA, EXPOSURE, variant=variant, **FAST),
    "render_frames": lambda _, variant: list(
        ms.render_frames(SCENE, CAMERA, EXPOSURE, variant=variant, spp=2)
    ),
    "render_aovs": lambda _, variant: render_aovs(SCENE, CAMERA, variant=variant),
    "read_irradiance": read_colours,
    "lint": call_the_program,
}


@pytest.mark.parametrize("call", one_in(3, CALLS))
@pytest.mark.parametrize(("own", "rendering"), PAIRS)
def test_the_user_s_variant_comes_back(
    tmp_path: Path, call: str, own: str, rendering: str
) -> None:
    mi = user_has(own)
    CALLS[call](tmp_path, rendering)
    assert mi.variant() == own


def test_a_variant_without_spectra_is_not_the_one_that_renders() -> None:
    """Where none is asked for, the same one is chosen as where none is set; a film of plain Mitsuba refuses colours."""
    mi = user_has("scalar_rgb")
    light = ms.render(SCENE, CAMERA, EXPOSURE, **FAST)
    assert light.statistics.variant == fastest_variant("cuda", "llvm").name
    assert mi.variant() == "scalar_rgb"
    film = '<film type="photosensor"><string name="camera" value="konnik_table1"/></film>'
    with pytest.raises(RuntimeError, match="needs a spectral variant"):
        mi.load_string(scene_text(SKY, sensor=f'<sensor type="perspective">{film}</sensor>'))


def test_it_comes_back_after_an_error_too() -> None:
    mi = user_has("llvm_ad_rgb")
    black = scene_text(SKY.replace("360:2e-4, 830:2e-4", "1500:1, 1600:1"))
    for scene in (black, "no_such.xml"):
        with pytest.raises(ms.InputError):
            ms.render(scene, CAMERA, EXPOSURE, variant="llvm_ad_spectral", **FAST)
        assert mi.variant() == "llvm_ad_rgb"


@pytest.mark.parametrize("integrator", ["path", "prb"])
def test_the_user_s_own_scene_renders_as_before(integrator: str) -> None:
    """Also with an integrator whose class Mitsuba makes anew with each change of the variant."""
    mi = user_has("llvm_ad_rgb")
    box = mi.cornell_box()
    box["integrator"] = {"type": integrator}
    box["sensor"]["film"] |= {"width": 8, "height": 8}
    scene = mi.load_dict(box)
    before = np.array(mi.render(scene, spp=4, seed=1))
    ms.render(SCENE, CAMERA, EXPOSURE, variant="llvm_ad_spectral", **FAST)
    np.testing.assert_allclose(
        np.array(mi.render(scene, spp=4, seed=1)), before, rtol=1e-5, atol=1e-7
    )


@pytest.mark.exhaustive
def test_frames_one_by_one_do_not_mind_what_is_set_between_them() -> None:
    """Between two frames the user's variant is set, whichever that is then; the frames are the same."""
    mi = user_has("llvm_ad_rgb")
    options: Any = {"variant": "llvm_ad_spectral", "spp": 2, "frames": 2, "seed": 5}
    expected = [
        made.frames.digital for made in ms.render_frames(SCENE, CAMERA, EXPOSURE, **options)
    ]
    frames = ms.render_frames(SCENE, CAMERA, EXPOSURE, **options)
    for own, digital in zip(("llvm_ad_rgb", "scalar_rgb"), expected, strict=True):
        mi.set_variant(own)
        np.testing.assert_array_equal(next(frames).frames.digital, digital)
        assert mi.variant() == own


@pytest.mark.parametrize("call", ["variant", "set", "loaded"])
def test_a_polarised_variant_renders_the_same_light(call: str) -> None:
    """Asked for, set, or of a scene that is loaded; none of what is lit polarises its light."""
    mi, polarised = mitsuba(), "scalar_spectral_polarized"
    options = {"variant": polarised} if call == "variant" else {}
    if call != "variant":
        mi.set_variant(polarised)
    scene = mi.load_string(SCENE) if call == "loaded" else SCENE
    light = ms.render(scene, CAMERA, EXPOSURE, **options, **FAST)
    plain = ms.render(SCENE, CAMERA, EXPOSURE, variant="scalar_spectral", **FAST)
    np.testing.assert_allclose(light.data, plain.data, rtol=1e-5)
