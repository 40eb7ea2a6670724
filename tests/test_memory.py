"""Peak memory per pixel: of a render, and of a frame and its files beyond the light that they are made from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

# Bytes, beside bands and errors: 335 here, and 134 at 1.3 Mpx, which share what is needed once; 580 with photons of all
# bands and copies for the file.
OF_FRAME = 400
OF_RENDER = 525  # bytes, bands and errors included, which are 256: 472 as it is, 570 with electrons in float64
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
FRAME = """
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
RENDER = """
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


@on_linux
def test_frame_and_files_need_little_memory_beside_the_light(tmp_path: Path) -> None:
    """As a file of the light has 260 bytes per pixel, a copy of it would be seen."""
    assert bytes_per_pixel(FRAME, str(tmp_path / "out")) < OF_FRAME


@pytest.mark.exhaustive
@on_linux
def test_a_denoised_render_needs_as_much_again_as_its_bands_and_errors() -> None:
    """Of one sample in each pass; the network is left out."""
    pytest.importorskip("pyoidn")
    assert bytes_per_pixel(RENDER) < OF_RENDER
