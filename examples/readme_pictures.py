"""Make the three pictures of the README: the still life without noise, one raw frame, and one of 1/100 exposure.

    mitsuba-sensor render scenes/still_life.xml -o out/ --camera bayer_2mp --spp 512
    python examples/readme_pictures.py out/irradiance.exr docs/images

The picture without noise is the expectation over all cameras of the model. The last picture is shown 100 × brighter.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mitsuba_sensor as ms
from mitsuba_sensor.io.exr import read_irradiance_exr
from mitsuba_sensor.io.files import write_png
from mitsuba_sensor.io.preview import preview

TIME_S = 0.1


def main(irradiance_file: str, folder: str) -> None:
    """Read the irradiance, expose three times, write three PNG files."""
    camera, irradiance = ms.load_camera("bayer_2mp"), read_irradiance_exr(irradiance_file)
    pictures = Path(folder)
    pictures.mkdir(parents=True, exist_ok=True)
    full, short = ms.Exposure(TIME_S), ms.Exposure(TIME_S / 100)
    photons = ms.collect(irradiance, camera, full)
    frames = ms.expose(photons, camera, full)
    dark = ms.expose(ms.collect(irradiance, camera, short), camera, short).digital[0]
    known = irradiance.rendered_for
    illuminant = None if known is None else known.illuminant
    shown = ("clean", frames.spatial_mean, 1.0), ("raw", frames.digital[0], 1.0), ("hundredth", dark, 100.0)
    for name, frame, gain in shown:
        write_png(pictures / f"still_life_{name}.png", preview(frame, camera, gain, illuminant=illuminant))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
