"""Peak memory of a frame and its files beyond the light that they are made from, per pixel."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

BYTES_PER_PIXEL = 450  # beside bands and errors: 310 as it is, 580 with photons of all bands and copies for the file
PEAK = """
import sys
from pathlib import Path
import numpy as np
import mitsuba_sensor as ms
from mitsuba_sensor.io.exr import write_irradiance_exr
from mitsuba_sensor.render.foreign_light import Bands, irradiance_of

def peak_kib():
    return next(int(line.split()[1]) for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)

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
Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
before = peak_kib()
made_from(light)
print(1024 * (peak_kib() - before) / (960 * 600))
"""


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the peak memory is read as Linux has it")
def test_frame_and_files_need_little_memory_beside_the_light(tmp_path: Path) -> None:
    """As a file of the light has 260 bytes per pixel, a copy of it would be seen."""
    done = subprocess.run([sys.executable, "-c", PEAK, str(tmp_path / "out")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.splitlines()[-1]) < BYTES_PER_PIXEL
