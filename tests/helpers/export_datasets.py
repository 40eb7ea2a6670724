"""Small datasets for exports: a path of two sensors, variants of a world, spectra and AOVs."""

from __future__ import annotations

from pathlib import Path

from mitsuba_sensor.dataset import make_dataset

SENSOR = """<sensor type="{type}" id="{name}">{fov}<film type="hdrfilm"><integer name="width" value="20"/>
<integer name="height" value="14"/></film><transform name="to_world">
<lookat origin="{x}, 1, 4" target="{x}, 0, 0" up="0, 1, 0"/></transform></sensor>"""
SCENE = """<scene version="3.0.0"><default name="height" value="0"/><integrator type="direct"/>
{sensors}
<shape type="sphere" id="ball"><point name="center" value="0, $height, 0"/></shape>
<shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
<translate y="-1"/></transform></shape><emitter type="constant"/></scene>"""
BASELINE_M = 0.25
FOV = '<float name="fov" value="{}"/>'
FLIGHT = """name = "flight"
description = "Türme & 橋 | small"
licence = "CC0-1.0"
outputs = ["raw", "clean", "variance", "electrons", "preview", "aovs", "irradiance"]
render = { spp = 4, denoise = false, spectral = "cube", bandwidth_nm = 50 }
grid = { frames = [2], "parameters.height" = [0, 0.5] }
cameras = [{ camera = "bayer_2mp", set = { "lens.distortion" = [-0.1, 0.02, 0.002, -0.001, 0] } }]
[[scenes]]
name = "flight"
file = "perspective.xml"
sensors = "all"
[scenes.path]
views = 2
keys = [
    { time_s = 0.5, origin_m = [0, 1, 4], target_m = [0, 0, 0] },
    { time_s = 1.5, origin_m = [1, 2, 4], target_m = [0.3, 0, 0] },
]
[[scenes]]
name = "still"
file = "perspective.xml"
[splits]
shares = { train-1 = 0.5, test = 0.5 }
chips = 1
"""


def write_scenes(folder: Path) -> None:
    """Write perspective.xml with two sensors, and orthographic.xml with one."""
    left = SENSOR.format(type="perspective", name="left", fov=FOV.format(50), x=0)
    right = SENSOR.format(type="perspective", name="right", fov=FOV.format(45), x=BASELINE_M)
    flat = SENSOR.format(type="orthographic", name="flat", fov="", x=0)
    (folder / "perspective.xml").write_text(SCENE.format(sensors=left + right), "utf-8")
    (folder / "orthographic.xml").write_text(SCENE.format(sensors=flat), "utf-8")


def made_dataset(folder: Path, text: str = FLIGHT) -> Path:
    """Make a dataset from this text and the two scenes in ``folder``."""
    write_scenes(folder)
    (folder / "dataset.toml").write_text(text, "utf-8")
    found = make_dataset(folder / "dataset.toml", folder / "made", roots=[folder], workers=0)
    assert not found.failed, found.failed
    return folder / "made"
