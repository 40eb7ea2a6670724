"""Make the pictures of docs/optics-and-pixels.md: the still life on pixels of 1.1 µm at f/4 and f/22.

python examples/point_spread.py                                    # small, into point_spread/
python examples/point_spread.py docs/images --size 160 --spp 256   # the pictures of docs/optics-and-pixels.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.output.preview import preview

SCENE = Path(__file__).parent.parent / "scenes" / "still_life.xml"
F_NUMBERS = 4, 22
FRAMES = 32  # whose mean is shown
BRIGHTER = 1.5
TIME_S = 0.6  # at f/4; the same light takes longer at f/22


def still_life(f_number: float, size: int, spp: int) -> np.ndarray:
    """A preview of the mean frame of the still life at this f-number, with the diffraction of the pupil."""
    camera = ms.load_camera("raspberry_pi_hq").replace(
        **{
            "pixel.pitch_x_um": 1.1,
            "pixel.pitch_y_um": 1.1,
            "lens.f_number": float(f_number),
            "lens.diffraction": True,
        }
    )
    exposure = ms.Exposure(TIME_S * (f_number / F_NUMBERS[0]) ** 2)
    light = ms.render(
        SCENE, camera, exposure, spp=spp, parameters={"width": size * 3 // 2, "height": size}
    )
    frames = ms.expose(ms.collect(light, camera, exposure), camera, exposure, frames=FRAMES)
    known = light.rendered_for
    return preview(
        frames.digital.mean(axis=0),
        camera,
        BRIGHTER,
        illuminant=None if known is None else known.illuminant,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("point_spread"))
    parser.add_argument("--size", type=int, default=32, help="rows of each picture")
    parser.add_argument("--spp", type=int, default=16, help="light paths per pixel")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for f_number in F_NUMBERS:
        file = options.folder / f"point_spread_f{f_number}.png"
        write_png(file, still_life(f_number, options.size, options.spp))
        print(file)


if __name__ == "__main__":
    main()
