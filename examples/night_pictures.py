"""Make the pictures of the night crossing: as the scene is exposed, and what is left of it in a 128th of the time.

    mitsuba-sensor render night_crossing -o out/crossing/
    python examples/night_pictures.py out/crossing/irradiance.exr docs/images

The first picture is out/crossing/frame.png. Its lamps are saturated; in the second one they are not.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview

SHORTER = 128.0


def main() -> None:
    """Read the irradiance, expose twice, write two PNG files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("irradiance_file", help="irradiance.exr of the render")
    parser.add_argument("folder", type=Path, help="for the pictures")
    options = parser.parse_args()
    light, pictures = ms.read_irradiance(options.irradiance_file), options.folder
    pictures.mkdir(parents=True, exist_ok=True)
    frames = ms.expose(light)  # camera and exposure are those of the render
    exposure, illuminant = frames.first.exposure, frames.light.illuminant
    short = ms.expose(light, exposure=replace(exposure, time_s=exposure.time_s / SHORTER))
    for name, digital in (("", frames.digital[0]), ("_short", short.digital[0])):
        picture = preview(digital, frames.camera, illuminant=illuminant)
        write_png(pictures / f"night_crossing{name}.png", picture)


if __name__ == "__main__":
    main()
