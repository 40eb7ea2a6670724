"""What the tests of light share: variants behind the guard, and scenes made of a few lines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

import mitsuba_sensor as ms
from helpers import ROOT
from mitsuba_sensor.render.scene.parse_scene import parse_scene
from mitsuba_sensor.render.scene.scene_settings import SceneSettings, settings_of
from mitsuba_sensor.render.variants import choose_variant

SCENES = ROOT / "scenes"
SHIPPED = ("cornell_box", "color_checker", "step_wedge", "flat_field", "still_life")

SKY = (
    '<emitter type="constant"><spectrum name="radiance" value="360:2e-4, 830:2e-4"/></emitter>'
)
PERSPECTIVE = """<sensor type="perspective"><float name="fov" value="60"/>{more}
<film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="8"/>{film}</film></sensor>"""
BALL = '<shape type="sphere"><point name="center" value="0, 0, 4"/>{bsdf}</shape>'


def scene_text(
    *elements: str,
    film: str = '<rfilter type="box"/>',
    more: str = "",
    sensor: str = PERSPECTIVE,
) -> str:
    """A scene with a 12 × 8 pixel perspective sensor of 60°, and these elements."""
    return f'<scene version="3.0.0">{sensor.format(film=film, more=more)}{"".join(elements)}</scene>'


def write_scene(folder: Path, text: str) -> Path:
    path = folder / "scene.xml"
    path.write_text(text, encoding="utf-8")
    return path


def read_settings(path: Path, parameters: Mapping[str, object]) -> SceneSettings:
    """Camera, exposure and seeds of a scene file."""
    return settings_of(parse_scene(path, parameters))


def skip_unless_usable(variant: str) -> str:
    """The variant, or a skip with the reason why this machine cannot run it; LLVM goes through the guard."""
    try:
        return choose_variant(variant).name
    except ms.InputError as error:
        pytest.skip(str(error))


both_variants = pytest.mark.parametrize("variant", ["scalar_spectral", "llvm_ad_spectral"])
