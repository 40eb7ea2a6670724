"""capture.py: capture() gives what render, collect and expose give one by one, and its files hold the same."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.scenes import SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.output.exr import read_aovs_exr, read_irradiance_exr
from mitsuba_sensor.render.load.scene import Scene
from mitsuba_sensor.render.motion.aovs import render_aovs

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.05)
RENDER = {"spp": 16, "wavelength_nm": 550.0, "variant": "scalar_spectral"}


@pytest.fixture(scope="module")
def captured(scene_file: Path) -> ms.Capture:
    return ms.capture(
        scene_file, CAMERA, EXPOSURE, seed=3, serial=4, frames=2, aovs=True, **RENDER
    )


def test_a_capture_is_render_collect_and_expose_in_one(
    captured: ms.Capture, scene_file: Path
) -> None:
    light = ms.render(scene_file, CAMERA, EXPOSURE, seed=3, **RENDER)
    frames = ms.expose(
        ms.collect(light, CAMERA, EXPOSURE), CAMERA, EXPOSURE, seed=3, serial=4, frames=2
    )
    np.testing.assert_array_equal(captured.light.data, light.data)
    np.testing.assert_array_equal(captured.frames.digital, frames.digital)
    assert captured.metadata["stages"] == frames.report["stages"]


def test_the_aovs_of_a_capture_are_those_of_a_pass_of_their_own(
    captured: ms.Capture, scene_file: Path
) -> None:
    alone = render_aovs(scene_file, CAMERA, exposure=EXPOSURE, variant="scalar_spectral")
    assert captured.aovs is not None
    for name in ("depth_m", "position_m", "normal", "albedo", "shape_index", "flow_px"):
        np.testing.assert_array_equal(
            getattr(captured.aovs, name), getattr(alone, name), err_msg=name
        )


def test_the_files_hold_what_the_capture_holds(captured: ms.Capture, tmp_path: Path) -> None:
    captured.save(tmp_path / "out")
    names = {"frame.tiff", "frame.png", "irradiance.exr", "aovs.exr", "frame.json"}
    names |= {"frame_brightened.png"}  # the scene is dark
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    np.testing.assert_array_equal(
        tifffile.imread(tmp_path / "out" / "frame.tiff"), captured.frames.digital
    )
    np.testing.assert_array_equal(
        read_irradiance_exr(tmp_path / "out" / "irradiance.exr").data, captured.light.data
    )
    aovs = read_aovs_exr(tmp_path / "out" / "aovs.exr")
    np.testing.assert_array_equal(
        aovs.depth_m, captured.aovs.depth_m if captured.aovs else None
    )
    report = json.loads((tmp_path / "out" / "frame.json").read_text(encoding="utf-8"))
    assert report["seeds"] == {"seed": 3, "serial": 4, "first_frame": 0}


def test_irradiance_is_written_small_or_not_at_all(scene_file: Path, tmp_path: Path) -> None:
    """An older irradiance.exr does not stay beside the new frame; another one's frames do not leave it."""
    options = {"spp": 16, "variant": "scalar_spectral", "wavelength_nm": 550.0}
    shots = {
        name: ms.capture(scene_file, CAMERA, EXPOSURE, **options, **more)
        for name, more in (
            ("float", {}),
            ("half", {"half": True}),
            ("none", {"no_irradiance": True}),
        )
    }
    for name, shot in shots.items():
        shot.save(tmp_path / name)
        assert (shot.frames.digital == shots["float"].frames.digital).all()
    half = read_irradiance_exr(tmp_path / "half" / "irradiance.exr")
    np.testing.assert_allclose(half.data, shots["float"].light.data, rtol=2.0**-11)
    assert (half.data != shots["float"].light.data).any()
    assert (
        not (tmp_path / "none" / "irradiance.exr").exists()
        and (tmp_path / "none" / "frame.tiff").exists()
    )
    with pytest.raises(ms.InputError, match="half is the precision"):
        ms.capture(scene_file, CAMERA, EXPOSURE, half=True, no_irradiance=True)
    shots["none"].save(tmp_path / "float")
    assert not (tmp_path / "float" / "irradiance.exr").exists()
    ms.capture(tmp_path / "half" / "irradiance.exr").save(tmp_path / "half")
    assert (tmp_path / "half" / "irradiance.exr").exists()


def test_frames_with_a_render_each_are_those_of_render_frames(scene_file: Path) -> None:
    asked = {"frames": 2, **RENDER}
    found = ms.capture(scene_file, CAMERA, EXPOSURE, render_noise="per-frame", **asked)
    each = list(ms.render_frames(scene_file, CAMERA, EXPOSURE, **asked))
    np.testing.assert_array_equal(
        found.frames.digital, np.concatenate([one.frames.digital for one in each])
    )
    np.testing.assert_array_equal(found.light.data, each[0].light.data)


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"spq": 3}, "'spq' is not an option"),
    ({"frames": 2, "first_frame": 2**32 - 1}, "frames is 2 from 4294967295"),
    ({"maps": {"prnu": np.ones((12, 15))}}, r"maps\['prnu'\] has shape \(12, 15\)"),
    ({"engine": "drjit", "precision": "float64"}, "compiled engines have float32 only"),
    ({"render_noise": "each"}, "render_noise is 'each'; it must be one of"),
    ({"subframes": 4}, "nothing moves"),
    ({"width": 17}, "width is 17"),
    ({"scene_unit": [1]}, "scene_unit is .*; it must be"),
]


@pytest.mark.parametrize(("options", "said"), REFUSED)
def test_what_cannot_be_made_is_refused_before_the_first_ray(
    options: dict[str, Any], said: str, scene_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Scene, "render", lambda *_: pytest.fail("it was rendered first"))
    with pytest.raises(ms.InputError, match=said):
        ms.capture(scene_file, CAMERA, EXPOSURE, **{**RENDER, **options})


def test_a_scene_without_a_camera_has_the_default_one_and_says_so(tmp_path: Path) -> None:
    """As the command `render`; the fields that the scene sets are those of the camera."""
    text = scene_text(SKY, film='<string name="adc.bits" value="10"/>')
    scene = write_scene(tmp_path, text.replace("hdrfilm", "photosensor"))
    options: dict[str, Any] = {"spp": 4, "width": 8, "progress": False}
    taken = ms.capture(scene, exposure=EXPOSURE, **options)
    named = ms.capture(scene, taken.frames.camera, EXPOSURE, **options)
    default = ms.load_camera("konnik_table1").replace(**{"adc.bits": 10})
    assert taken.frames.camera.adc == default.adc
    np.testing.assert_array_equal(taken.frames.digital, named.frames.digital)
    said = "rendered for konnik_table1, because"
    for notes in (taken.frames.notes, taken.light.notes):
        assert any(said in note for note in notes)
    assert not any(said in note for note in named.frames.notes)


# Peak memory per pixel: of a render, and of a frame and its files beside the light

# Bytes, beside bands and errors: 335 here, and 134 at 1.3 Mpx, which share what is needed once; 580 with photons of all
# bands and copies for the file.
OF_FRAME = 400
OF_RENDER = 950  # bytes, of which bands and errors are 256: 860 to 880 as it is, 690 of them in NumPy's arrays
PEAK = """
import sys
from pathlib import Path
import numpy as np
import mitsuba_sensor as ms

def kib(name):
    return next(int(line.split()[1]) for line in Path("/proc/self/status").read_text().splitlines() if name in line)

def begin():
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    return kib("VmRSS")

"""
FRAME_SCRIPT = """
from mitsuba_sensor.output.exr import write_irradiance_exr
from mitsuba_sensor.render.light.foreign_light import Bands, irradiance_of

def light_of(width, height):
    values = np.random.default_rng(1).random((height, width, 32), np.float32)
    light = irradiance_of(Bands(1e-4 * values, np.arange(400.0, 720.0, 10.0), np.full(32, 10.0)), (), "")
    light.standard_error[...] = 0.1 * light.data
    return light

def made_from(light):
    ms.capture(light, ms.load_camera("bayer_2mp"), ms.Exposure(0.01)).save(sys.argv[1])
    write_irradiance_exr(Path(sys.argv[1]) / "irradiance.exr", light)

made_from(light_of(96, 60))
light = light_of(960, 600)
before = begin()
made_from(light)
print(1024 * (kib("VmHWM") - before) / (960 * 600))
"""
RENDER_SCRIPT = """
from unittest.mock import MagicMock
from mitsuba_sensor.render.denoise import network

library = MagicMock()
library.Device.return_value.__enter__.return_value.get_error.return_value = None
setattr(network, "library", lambda: library)  # the network's memory has a limit of its own
SCENE = '''<scene version="3.0.0"><emitter type="constant"/><shape type="sphere"/><sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 0, 9" target="0, 0, 0" up="0, 1, 0"/></transform><film type="hdrfilm">
    <integer name="width" value="%d"/><integer name="height" value="%d"/></film></sensor></scene>'''

def rendered(width, height):
    camera, exposure = ms.load_camera("bayer_2mp"), ms.Exposure(0.01)
    return ms.render(SCENE % (width, height), camera, exposure, spp=4, denoise=True)

rendered(96, 60)
before = begin()
assert rendered(768, 480).statistics.denoised
print(1024 * (kib("VmHWM") - before) / (768 * 480))
"""
on_linux = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="the peak memory is read as Linux has it"
)


def bytes_per_pixel(script: str, *arguments: str) -> float:
    done = subprocess.run(
        [sys.executable, "-c", PEAK + script, *arguments], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return float(done.stdout.splitlines()[-1])


@pytest.mark.exhaustive
@on_linux
def test_frame_and_files_need_little_memory_beside_the_light(tmp_path: Path) -> None:
    """As a file of the light has 260 bytes per pixel, a copy of it would be seen."""
    assert bytes_per_pixel(FRAME_SCRIPT, str(tmp_path / "out")) < OF_FRAME


@pytest.mark.exhaustive
@on_linux
def test_a_denoised_render_needs_less_than_four_times_the_memory_of_its_light() -> None:
    """Of one sample in each pass; the network is left out."""
    pytest.importorskip("pyoidn")
    assert bytes_per_pixel(RENDER_SCRIPT) < OF_RENDER
