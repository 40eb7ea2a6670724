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
    small = [[thumbnail(path) for path in row] for row in rows]
    width = max(one.shape[1] for row in small for one in row) + GAP
    heights = [max(one.shape[0] for one in row) + GAP for row in small]
    sheet = np.full(
        (sum(heights) + GAP, max(map(len, small)) * width + GAP, 3), WHITE, np.uint8
    )
    top = GAP
    for row, height in zip(small, heights, strict=True):
        for number, one in enumerate(row):
            left = number * width + GAP
            sheet[top : top + one.shape[0], left : left + one.shape[1]] = one
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
