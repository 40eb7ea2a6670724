"""Make the picture of docs/rendering.md: the still life through both halves of the pupil, left red and right cyan.

python examples/dual_pixel.py                                 # small, into dual_pixel/
python examples/dual_pixel.py docs/images --size 160 --spp 128     # the picture of docs/rendering.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png

SCENE = Path(__file__).parent.parent / "scenes" / "still_life.xml"
EXPOSURE = ms.Exposure(0.3)


def green(half: str, size: int, spp: int) -> np.ndarray:
    """Mean photons of a pixel from 500 to 600 nm through one half of the pupil."""
    camera = ms.load_camera("konnik_table1").replace(**{"lens.half_pupil": half})
    parameters = {"width": size * 3 // 2, "height": size}
    light = ms.render(
        SCENE,
        camera,
        EXPOSURE,
        spp=spp,
        wavelength_nm=550,
        bandwidth_nm=100,
        parameters=parameters,
    )
    return np.asarray(light.data[..., 0], dtype=float)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("dual_pixel"))
    parser.add_argument("--size", type=int, default=32, help="rows of the picture")
    parser.add_argument("--spp", type=int, default=8, help="light paths per pixel")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    left, right = (green(half, options.size, options.spp) for half in ("left", "right"))
    white = np.quantile([left, right], 0.98)
    channels = np.stack([left, right, right], axis=-1) / white
    file = options.folder / "dual_pixel.png"
    write_png(file, (255 * np.clip(channels, 0, 1) ** (1 / 2.2)).astype(np.uint8))
    print(file)


if __name__ == "__main__":
    main()
