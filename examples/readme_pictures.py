"""Make the images of the README: the first frame in three ways, and the plots of studies.

    mitsuba-sensor render scenes/first_frame.xml -o out/
    mitsuba-sensor study stress -o out/stress
    mitsuba-sensor study ablation first_frame --width 96 -o out/ablation
    python examples/readme_pictures.py out/irradiance.exr out/stress out/ablation -o docs/images

The image without noise is the mean of all frames of this camera. The image with a tenth of the exposure time is shown
ten times brighter. Each study's first plot is copied from its folder.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import replace
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview

SHORTER = 10.0


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
        shutil.copy(study / f"{study.name}.png", pictures / f"readme_{study.name}.png")


if __name__ == "__main__":
    main()
