"""Make the pictures of the night crossing: as the scene is exposed, and what is left of it in a 128th of the time.

    mitsuba-sensor render night_crossing -o out/crossing/
    python examples/night_pictures.py out/crossing/irradiance.exr docs/images

The first picture is out/crossing/frame.png. Its lamps are saturated; in the second one they are not.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview

SHORTER = 128.0


def main(irradiance_file: str, folder: str) -> None:
    """Read the irradiance, expose twice, write two PNG files."""
    light, pictures = ms.read_irradiance(irradiance_file), Path(folder)
    pictures.mkdir(parents=True, exist_ok=True)
    frames = ms.expose(light)  # camera and exposure are those of the render
    exposure, illuminant = frames.first.exposure, frames.light.illuminant
    short = ms.expose(light, exposure=replace(exposure, time_s=exposure.time_s / SHORTER))
    for name, digital in (("", frames.digital[0]), ("_short", short.digital[0])):
        picture = preview(digital, frames.camera, illuminant=illuminant)
        write_png(pictures / f"night_crossing{name}.png", picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
