"""What the tests of light share: variants behind the guard, and scenes made of a few lines."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import pytest

import mitsuba_sensor as ms
from helpers import ROOT
from helpers.marks import exhaustive
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.scene.scene_settings import SceneSettings
from mitsuba_sensor.render.variants import choose_variant

SCENES = ROOT / "scenes"
SHIPPED = ("cornell_box", "color_checker", "step_wedge", "flat_field", "still_life")

SKY = (
    '<emitter type="constant"><spectrum name="radiance" value="360:2e-4, 830:2e-4"/></emitter>'
)
PERSPECTIVE = """<sensor type="perspective"><float name="fov" value="60"/>{more}
<film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="8"/>{film}</film></sensor>"""
BALL = '<shape type="sphere"><point name="center" value="0, 0, 4"/>{bsdf}</shape>'


WIDTH, HEIGHT, DISTANCE_M, FOV_DEG = 64, 24, 4.0, 50.0
PX_PER_M = WIDTH / (2 * DISTANCE_M * math.tan(math.radians(FOV_DEG / 2)))
WALL = f"""<scene version="3.0.0"><integrator type="direct"/><sensor type="perspective">
<float name="fov" value="{FOV_DEG}"/><transform name="to_world">
<lookat origin="0, 0, {DISTANCE_M}" target="0, 0, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="{WIDTH}"/><integer name="height" value="{HEIGHT}"/>
<rfilter type="box"/></film></sensor>
<shape type="rectangle" id="wall"><transform name="to_world"><scale value="10"/><translate x="-10"/></transform>
<emitter type="area" id="lamp"><spectrum name="radiance" value="LEVEL"/></emitter></shape></scene>"""
"""A bright wall whose right edge is in the middle of the picture at time 0."""


def scene_text(
    *elements: str,
    film: str = '<rfilter type="box"/>',
    more: str = "",
    sensor: str = PERSPECTIVE,
) -> str:
    """A scene with a 12 × 8 pixel perspective sensor of 60°, and these elements."""
    return f'<scene version="3.0.0">{sensor.format(film=film, more=more)}{"".join(elements)}</scene>'


def wall_that_moves(level: float, px_per_s: float) -> tuple[str, dict[str, object]]:
    """The scene of a wall of so much radiance, and its motion to the right."""
    speed = {"wall": {"velocity_m_per_s": [px_per_s / PX_PER_M, 0, 0]}}
    return WALL.replace("LEVEL", str(level)), {"objects": speed}


def write_scene(folder: Path, text: str) -> Path:
    path = folder / "scene.xml"
    path.write_text(text, encoding="utf-8")
    return path


def read_settings(path: Path, parameters: Mapping[str, object]) -> SceneSettings:
    """Camera, exposure and seeds of a scene file."""
    return parse(path, {"parameters": parameters}).settings


def skip_unless_usable(variant: str) -> str:
    """The variant, or a skip with the reason why this machine cannot run it; LLVM goes through the guard."""
    try:
        return choose_variant(variant).name
    except ms.InputError as error:
        pytest.skip(str(error))


both_variants = pytest.mark.parametrize("variant", ["scalar_spectral", "llvm_ad_spectral"])
scalar_first = pytest.mark.parametrize(
    "variant", ["scalar_spectral", exhaustive("llvm_ad_spectral")]
)
"""Of what variants share; the quick tests have the scalar one, which compiles no kernels."""
