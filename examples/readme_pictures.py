"""Make the pictures of the README from what its first command wrote: without noise, and with a tenth of the exposure.

    mitsuba-sensor render scenes/first_frame.xml -o out/
    python examples/readme_pictures.py out/irradiance.exr docs/images

The picture without noise is what the frames of this very camera are on average. The last one is shown 10 × brighter.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview

SHORTER = 10.0


def main() -> None:
    """Read the irradiance, expose twice, write three PNG files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("irradiance_file", help="irradiance.exr of the render")
    parser.add_argument("folder", type=Path, help="for the pictures")
    options = parser.parse_args()
    light, pictures = ms.read_irradiance(options.irradiance_file), options.folder
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


if __name__ == "__main__":
    main()
