"""Make the pictures of docs/dual-pixels.md: both photodiodes of one frame, and the disparity between them.

python examples/dual_pixel.py                                 # small, into dual_pixel/
python examples/dual_pixel.py docs/images --size 160 --spp 128     # the pictures of docs/dual-pixels.md
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import mitsuba_sensor as ms
from mitsuba_sensor.files.png import write_png

SCENE = Path(__file__).parent.parent / "scenes" / "still_life.xml"
EXPOSURE = ms.Exposure(0.07)
WINDOW_PX = 3.0
"""Standard deviation of the window in which both pictures are compared."""
SHARPEST_PX, CLEAR = 2.0, 1e-4
"""Largest disparity of the colours; contrast over signal squared, below which nothing is seen to move."""
CROP, ENLARGED = 4, 4
"""Rows and columns of the picture over those of its crop; how much the crop is enlarged."""


def photodiodes(size: int, spp: int) -> tuple[np.ndarray, np.ndarray]:
    """Codes of the left and the right photodiodes over black, of one exposure [DN]."""
    camera = ms.load_camera("konnik_table1").replace(**{"sensor.dual_pixel": True})
    parameters = {"width": size * 3 // 2, "height": size}
    captured = ms.capture(SCENE, camera, EXPOSURE, spp=spp, parameters=parameters)
    black_dn = captured.metadata["summary"]["black_level_dn"]
    left, right = captured.frames.readouts.values()
    return left.digital[0] - black_dn, right.digital[0] - black_dn


def disparity_px(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """How far the left picture lies to the right of the other, by least squares in a window about each pixel [pixels];
    NaN where there is too little to be seen."""
    mean = gaussian_filter((left + right) / 2, 1.0)
    slope = np.gradient(mean, axis=1)
    products = -slope * gaussian_filter(left - right, 1.0)
    contrast = gaussian_filter(slope**2, WINDOW_PX)
    shift = gaussian_filter(products, WINDOW_PX) / np.maximum(contrast, 1e-9)
    return np.where(contrast > CLEAR * mean**2, shift, np.nan)


def coloured(shift_px: np.ndarray) -> np.ndarray:
    """Red where the left picture lies to the right, nearer than the focus, blue where to the left, (H, W, 3)."""
    known = np.nan_to_num(np.clip(shift_px / SHARPEST_PX, -1, 1))
    red, blue = 1 - np.maximum(-known, 0), 1 - np.maximum(known, 0)
    colours = np.stack([red, np.minimum(red, blue), blue], axis=-1)
    colours[np.isnan(shift_px)] = 0.0
    return colours


def crop_of_largest(picture: np.ndarray, shift_px: np.ndarray) -> np.ndarray:
    """The part of a picture with the most displacement, enlarged."""
    rows, columns = (length // CROP for length in shift_px.shape)
    moved = np.cumsum(np.cumsum(np.abs(np.nan_to_num(shift_px)), axis=0), axis=1)
    moved = np.pad(moved, ((1, 0), (1, 0)))
    inside = moved[rows:, columns:] - moved[:-rows, columns:]
    inside = inside - moved[rows:, :-columns] + moved[:-rows, :-columns]
    row, column = np.unravel_index(np.argmax(inside), inside.shape)
    crop = picture[row : row + rows, column : column + columns]
    return crop.repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("dual_pixel"))
    parser.add_argument("--size", type=int, default=32, help="rows of the picture")
    parser.add_argument("--spp", type=int, default=8, help="light paths per pixel")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    left, right = photodiodes(options.size, options.spp)
    white = np.quantile([left, right], 0.98)
    both = np.clip(np.stack([left, right, right], axis=-1) / white, 0, 1) ** (1 / 2.2)
    shift_px = disparity_px(left, right)
    pictures = {"dual_pixel": both, "dual_pixel_disparity": coloured(shift_px)}
    pictures["dual_pixel_crop"] = crop_of_largest(
        both, np.clip(shift_px, -SHARPEST_PX, SHARPEST_PX)
    )
    for name, picture in pictures.items():
        file = options.folder / f"{name}.png"
        write_png(file, (255 * picture).astype(np.uint8))
        print(file)


if __name__ == "__main__":
    main()
