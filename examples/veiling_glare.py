"""Make the picture of docs/optics-and-pixels.md: a street at night through a clean lens and one with veiling glare.

python examples/veiling_glare.py                                   # small, into veiling_glare/
python examples/veiling_glare.py docs/images --width 240 --spp 64 # the picture of docs/optics-and-pixels.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview

SCENE = Path(__file__).parent.parent / "scenes" / "night_crossing.xml"
FRACTIONS = 0.0, 0.01, 0.05


def street(fraction: float, width: int, spp: int) -> np.ndarray:
    """A preview of the street behind a lens that scatters this share of the light; says how dark its darkness is."""
    camera = ms.load_camera("sony_a7s2").at_gain("3200")
    camera = camera.replace(**{"lens.f_number": 1.4, "lens.veiling_glare": fraction})
    captured = ms.capture(
        SCENE,
        camera,
        ms.Exposure(0.025),
        spp=spp,
        parameters={"width": width, "height": 2 * width // 3},
    )
    electrons = captured.photons.total
    dark, bright = np.percentile(electrons, [1, 99.9])
    print(
        f"veiling glare {fraction:g}: {20 * np.log10(bright / dark):.0f} dB from 1 % to 99.9 % of the pixels"
    )
    known = captured.light.rendered_for
    illuminant = None if known is None else known.illuminant
    return preview(captured.frames.digital[0], camera, illuminant=illuminant)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("veiling_glare"))
    parser.add_argument("--width", type=int, default=48, help="columns of each picture")
    parser.add_argument("--spp", type=int, default=8, help="light paths per pixel")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    pictures = [street(fraction, options.width, options.spp) for fraction in FRACTIONS]
    file = options.folder / "veiling_glare.png"
    write_png(file, np.concatenate(pictures, axis=1))
    print(file)


if __name__ == "__main__":
    main()
