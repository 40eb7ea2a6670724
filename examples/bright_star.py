"""Make the picture of blooming and radiation hits in docs/stages.md: a star field with one star that is far too bright.

python examples/bright_star.py                # into bright_star/
python examples/bright_star.py docs/images    # the picture of docs/stages.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png

SIZE, STARS = 256, 120
SEEING_PX, SKY_PHOTONS = 1.3, 400.0
BRIGHT_PHOTONS = 4e7
SPACE_PER_CM2_S = 5.0
EXPOSURE = ms.Exposure(600.0, 153.15)


def sky() -> np.ndarray:
    """Photons per pixel of faint stars, one bright one, and the sky behind them."""
    random = np.random.default_rng(4)
    stars = np.zeros((SIZE, SIZE))
    places = random.integers(8, SIZE - 8, (2, STARS))
    np.add.at(stars, tuple(places), 2e4 * random.pareto(1.2, STARS).clip(0, 40))
    stars[120, 90] += BRIGHT_PHOTONS
    return gaussian_filter(stars, SEEING_PX) + SKY_PHOTONS


def picture(camera: ms.Camera, photons: np.ndarray) -> np.ndarray:
    """The frame in grey, with a cube root from the sky to the full well."""
    digital = ms.expose(photons, camera, EXPOSURE).digital[0].astype(np.float64)
    low, high = np.percentile(digital, 2), digital.max()
    share = np.clip((digital - low) / (high - low), 0, 1)
    return np.uint8(np.round(255 * np.cbrt(share)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("bright_star"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    drained = ms.load_camera("eso_efosc2").replace(**{"adc.black_level_dn": 300.0})
    hit = drained.replace(**{"pixel.hits_per_cm2_s": SPACE_PER_CM2_S})
    blooming = hit.replace(**{"pixel.blooming": 1.0})
    photons = sky()
    pictures = [picture(camera, photons) for camera in (drained, hit, blooming)]
    border = np.full((SIZE, 6), 255, np.uint8)
    row = np.hstack([pictures[0], border, pictures[1], border, pictures[2]])
    path = folder / "bright_star.png"
    write_png(path, row)
    print(f"{path}: an antiblooming drain, radiation hits, blooming")


if __name__ == "__main__":
    main()
