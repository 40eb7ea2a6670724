"""Make the images of the README: the first frame in three ways, and small plots of studies.

    mitsuba-sensor render scenes/first_frame.xml -o out/
    mitsuba-sensor study stress -o out/stress
    mitsuba-sensor study ablation first_frame --width 96 -o out/ablation
    python examples/readme_pictures.py out/irradiance.exr out/stress out/ablation -o docs/images

The image without noise is the mean of all frames of this camera. The image with a tenth of the exposure time is shown
ten times brighter. Each study's first plot is drawn again from its study.json.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview
from mitsuba_sensor.pages.drawing import png
from mitsuba_sensor.pages.page import Bars, Grid

SHORTER = 10.0
KINDS: dict[str, Any] = {"bars": Bars, "grid": Grid}


def write_small_plot(study: Path, pictures: Path) -> None:
    """Draw the first plot of a study small, without engines that its machine lacks."""
    parts = json.loads((study / "study.json").read_text("utf-8"))["parts"]
    part = next(one for one in parts if one["kind"] in KINDS)
    kind = part.pop("kind")
    if kind == "grid":
        here = [
            k
            for k, cells in enumerate(zip(*part["texts"], strict=True))
            if "not here" not in cells
        ]
        part["columns"] = [part["columns"][k] for k in here]
        for name in ("marks", "texts"):
            part[name] = [[row[k] for k in here] for row in part[name]]
    (pictures / f"readme_{study.name}.png").write_bytes(png(KINDS[kind](**part), small=True))


def main() -> None:
    """Read the irradiance, expose twice, write three PNG files, and one of each study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("irradiance_file", help="irradiance.exr of the render")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of the pictures")
    parser.add_argument("studies", type=Path, nargs="*", help="folders of studies")
    options = parser.parse_args()
    light, pictures = ms.read_irradiance(options.irradiance_file), options.out
    pictures.mkdir(parents=True, exist_ok=True)
    frames = ms.expose(light)  # camera and exposure are those of the render
    exposure, illuminant = frames.first.exposure, frames.light.illuminant
    short = ms.expose(light, exposure=replace(exposure, time_s=exposure.time_s / SHORTER))
    shown = {
        "": (frames.digital[0], 1.0),
        "_clean": (frames.clean, 1.0),
        "_tenth": (short.digital[0], SHORTER),
    }
    for name, (image, gain) in shown.items():
        picture = preview(image, frames.camera, gain, illuminant=illuminant)
        write_png(pictures / f"first_frame{name}.png", picture)
    for study in options.studies:
        write_small_plot(study, pictures)


if __name__ == "__main__":
    main()
