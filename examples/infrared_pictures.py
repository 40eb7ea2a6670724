"""Make the pictures of a plant in RGB as an RGB-IR camera sees it: held beyond 700 nm, and as measured.

python examples/infrared_pictures.py docs/images
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use
from mitsuba_sensor.sensor.metering import AUTO, Metering

CAMERA = "rgbir_2mp"
MATERIALS = {"leaf": "vegetation", "pot": "roof_tile", "wall": "concrete", "ground": "wood"}
LEAVES, SEED = 260, 8
SIZE, SAMPLES, DARKER = (400, 300), 256, 0.3


def main() -> None:
    """Render twice, expose both equally, write two PNG files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("infrared_pictures"))
    pictures = parser.parse_args().folder
    use(choose_variant(None))
    scene = garden()
    pictures.mkdir(parents=True, exist_ok=True)
    camera = ms.load_camera(CAMERA)
    exposure: ms.Exposure | Metering = AUTO
    for name, rule in (("table", MATERIALS), ("hold", "hold")):
        light = ms.render(scene, camera, exposure, spp=SAMPLES, infrared=rule)
        if exposure is AUTO:
            metered = ms.expose(light, camera).first.exposure
            exposure = replace(metered, time_s=DARKER * metered.time_s)
        frames = ms.expose(light, camera, exposure)
        digital = frames.digital[0]
        colour = preview(digital, camera, illuminant=frames.light.illuminant)
        write_png(pictures / f"infrared_{name}.png", np.hstack([colour, infrared(digital)]))
        print(name, *light.statistics.beyond_data, sep="\n")


def infrared(digital: np.ndarray) -> np.ndarray:
    """The infrared pixels alone, one of four, enlarged to the size of the frame, behind the sRGB curve."""
    plane = digital[1::2, 0::2].astype(float)
    dark, bright = np.percentile(plane, (0.5, 99.5))
    grey = np.clip((plane - dark) / (bright - dark), 0, 1) ** (1 / 2.2)
    enlarged = np.repeat(np.repeat(grey, 2, axis=0), 2, axis=1)
    return np.round(255 * enlarged[..., None].repeat(3, axis=2)).astype(np.uint8)


def garden() -> dict[str, Any]:
    """A plant of many leaves in a pot on planks, before a wall, and a chequered picture of RGB beside it."""
    mi = mitsuba()
    place = mi.ScalarTransform4f
    width, height = SIZE
    look = place().look_at([0.3, 1.35, 5.2], [0.1, 0.78, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    stripes = np.where(np.arange(8)[:, None] % 2, [0.6, 0.05, 0.05], [0.7, 0.66, 0.6])
    cloth = mi.Bitmap(np.repeat(stripes[None], 8, axis=0).astype(np.float32))
    flat = {"type": "regular", "wavelength_min": 300.0, "wavelength_max": 2500.0}
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8},
        "sensor": {"type": "perspective", "fov": 30, "to_world": look, "film": film},
        "leaf": two_sided([0.05, 0.2, 0.03]),
        "pot_shape": {
            "type": "cylinder",
            "p0": [0, 0, 0],
            "p1": [0, 0.5, 0],
            "radius": 0.32,
            "bsdf": two_sided([0.45, 0.16, 0.08]) | {"id": "pot"},
        },
        "soil": {
            "type": "disk",
            "to_world": place().translate([0, 0.45, 0]).rotate([1, 0, 0], -90).scale(0.32),
            "bsdf": two_sided([0.1, 0.07, 0.05]),
        },
        "wall": {
            "type": "rectangle",
            "to_world": place().translate([0, 0, -1.4]).scale(5),
            "bsdf": diffuse([0.45, 0.43, 0.4]),
        },
        "ground": {
            "type": "rectangle",
            "to_world": place().rotate([1, 0, 0], -90).scale(5),
            "bsdf": diffuse([0.22, 0.15, 0.1]),
        },
        "cloth": {
            "type": "rectangle",
            "to_world": place()
            .translate([1.25, 0.62, -0.9])
            .rotate([0, 1, 0], -20)
            .scale(0.55),
            "bsdf": {
                "type": "twosided",
                "bsdf": {
                    "type": "diffuse",
                    "reflectance": {
                        "type": "bitmap",
                        "bitmap": cloth,
                        "filter_type": "nearest",
                    },
                },
            },
        },
        "sky": {"type": "constant", "radiance": flat | {"values": "4e-3, 4e-3"}},
        "lamp": {
            "type": "rectangle",
            "to_world": place().look_at([-3, 5, 4], [0, 0.6, 0], [0, 1, 0]).scale(0.7),
            "emitter": {"type": "area", "radiance": flat | {"values": "0.25, 0.25"}},
        },
    }
    return scene | dict(leaves())


def leaves() -> list[tuple[str, dict[str, Any]]]:
    """Long disks on a ball above the pot, each turned another way."""
    place, random = mitsuba().ScalarTransform4f, np.random.default_rng(SEED)
    found = []
    for number in range(LEAVES):
        up, turn = random.uniform(-0.6, 1), random.uniform(0, 2 * math.pi)
        side = math.sqrt(1 - up * up)
        outward = np.array([side * math.cos(turn), up, side * math.sin(turn)])
        centre = np.array([0, 1.05, 0]) + outward * random.uniform(0.25, 0.55)
        target = centre + outward + random.normal(0, 0.5, 3)
        to_world = (
            place().look_at(centre.tolist(), target.tolist(), [0, 1, 0]).scale([0.07, 0.17, 1])
        )
        shape = {"type": "disk", "to_world": to_world, "bsdf": {"type": "ref", "id": "leaf"}}
        found.append((f"blade_{number}", shape))
    return found


def diffuse(rgb: list[float]) -> dict[str, Any]:
    """A matt surface of an RGB colour."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": rgb}}


def two_sided(rgb: list[float]) -> dict[str, Any]:
    """The same on both sides."""
    return {"type": "twosided", "bsdf": diffuse(rgb)}


if __name__ == "__main__":
    main()
