"""Contact sheets: small versions of pictures side by side, in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import InputError

SIDE, GAP = 160, 4  # longer side of a picture, and the space between two [pixels]
WHITE = 255


def contact_sheet(rows: Sequence[Sequence[Path]]) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB of rows of PNG files, none larger than it is; each row is as high as its highest picture."""
    thumbnails = [[thumbnail(path) for path in row] for row in rows]
    most_in_a_row = max(map(len, thumbnails))
    heights = [max(picture.shape[0] for picture in row) + GAP for row in thumbnails]
    width = GAP + max(max(picture.shape[1] for picture in row) for row in thumbnails)
    shape = (sum(heights) + GAP, most_in_a_row * width + GAP, 3)
    sheet = np.full(shape, WHITE, np.uint8)
    top = GAP
    for row, height in zip(thumbnails, heights, strict=True):
        for number, picture in enumerate(row):
            left = number * width + GAP
            sheet[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
        top += height
    return sheet


def thumbnail(path: Path) -> NDArray[np.uint8]:
    """(h, w, 3) sRGB of a PNG file, averaged down to SIDE. Raises InputError."""
    from PIL import Image

    try:
        with Image.open(path, formats=["PNG"]) as picture:
            factor = max(-(-max(picture.size) // SIDE), 1)
            return np.asarray(picture.convert("RGB").reduce(factor), dtype=np.uint8)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        why = " ".join(str(error).split()).rstrip(".") or "it is cut short"
        raise InputError(
            f"{path} is no picture that can be read: {why}; make it again."
        ) from None
