"""Make the pictures of docs/hdr.md: a lamp and dark corners by one read-out of a split pixel, and by all of them.

python examples/hdr_pictures.py                                    # small, into hdr_pictures/
python examples/hdr_pictures.py docs/images --size 160 --spp 512   # the pictures of docs/hdr.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png

CAMERA = "omnivision_split_pixel"
EXPOSURE = ms.Exposure(0.05, 298.15)
DARKEST_E, BRIGHTEST_E = 3.0, 5e5
"""Electrons of the large photodiode that are shown black and white, on a logarithmic scale."""


def shown(electrons: np.ndarray) -> np.ndarray:
    """The same curve for every picture: the logarithm of the electrons."""
    range_log = np.log(DARKEST_E), np.log(BRIGHTEST_E)
    level = np.interp(np.log(np.maximum(electrons, DARKEST_E)), range_log, (0.0, 255.0))
    return np.rint(level).astype(np.uint8)


def pictures(size: int, spp: int) -> dict[str, np.ndarray]:
    """The Cornell box by the most sensitive read-out, by the least sensitive one, and by all of them."""
    camera = ms.load_camera(CAMERA).replace(**{"quantum_efficiency.value": 0.6})
    options = {"width": size, "spp": spp, "denoise": False}
    light = ms.render("cornell_box", camera, EXPOSURE, **options)
    frames = ms.expose(light, camera, EXPOSURE)
    stage = camera.combined_readouts
    found = {}
    for linear, (name, one) in zip(
        stage.combination.readouts, frames.readouts.items(), strict=True
    ):
        found[name] = shown((one.digital[0] - linear.black_dn) * linear.electrons_per_dn)
    found["all"] = shown((frames.digital[0] - stage.black_level_dn) / stage.nominal_gain)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("hdr_pictures"))
    parser.add_argument("--size", type=int, default=32, help="columns of each picture")
    parser.add_argument("--spp", type=int, default=16, help="light paths per pixel")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures(options.size, options.spp).items():
        file = options.folder / f"hdr_{name}.png"
        write_png(file, picture)
        print(file)


if __name__ == "__main__":
    main()
