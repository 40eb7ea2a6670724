"""A small dataset with a path, two cameras, spectra and AOVs, as exports need it."""

from __future__ import annotations

from pathlib import Path

from mitsuba_sensor.dataset.plan.planned import load_plan
from mitsuba_sensor.dataset.run.run import run

SCENE = """<scene version="3.0.0"><default name="height" value="0"/><integrator type="direct"/>
<sensor type="{sensor}">{fov}<film type="hdrfilm"><integer name="width" value="20"/>
<integer name="height" value="14"/></film><transform name="to_world">
<lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
<shape type="sphere" id="ball"><point name="center" value="0, $height, 0"/></shape>
<shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
<translate y="-1"/></transform></shape><emitter type="constant"/></scene>"""
FOV = '<float name="fov" value="50"/>'
FLIGHT = """name = "flight"
description = "Türme & 橋 | small"
licence = "CC0-1.0"
outputs = ["raw", "clean", "variance", "electrons", "preview", "aovs", "irradiance"]
render = { spp = 4, denoise = false, spectral = "cube" }
grid = { exposure_ev = [0, -2], frames = [2] }
cameras = [
    { camera = "konnik_table1", set = { "lens.distortion" = [-0.1, 0.02, 0.002, -0.001, 0.003] } },
    { camera = "bayer_2mp" },
]
[[scenes]]
name = "flight"
file = "perspective.xml"
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


def made_dataset(folder: Path, text: str = FLIGHT) -> Path:
    """A dataset that is made in ``folder`` of a file with this text, and of perspective.xml and orthographic.xml."""
    for sensor, fov in (("perspective", FOV), ("orthographic", "")):
        scene = SCENE.replace("{sensor}", sensor).replace("{fov}", fov)
        (folder / f"{sensor}.xml").write_text(scene, "utf-8")
    (folder / "dataset.toml").write_text(text, "utf-8")
    run(load_plan(folder / "dataset.toml", [folder]), folder / "made", workers=0)
    return folder / "made"
