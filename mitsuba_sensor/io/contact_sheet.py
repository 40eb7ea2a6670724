"""Contact sheets: small versions of pictures side by side, in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core import InputError

COLUMNS, SIDE, GAP = 6, 160, 4  # pictures in a row; their longer side and the space between them [pixels]
WHITE = 255


def contact_sheet(pictures: Sequence[Path]) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB of PNG files, row by row, none larger than it is."""
    small = [thumbnail(path) for path in pictures]
    height, width = (max((one.shape[axis] for one in small), default=1) + GAP for axis in (0, 1))
    columns = min(COLUMNS, len(small)) or 1
    rows = -(-len(small) // columns)
    sheet = np.full((rows * height + GAP, columns * width + GAP, 3), WHITE, np.uint8)
    for number, one in enumerate(small):
        top, left = number // columns * height + GAP, number % columns * width + GAP
        sheet[top : top + one.shape[0], left : left + one.shape[1]] = one
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
        raise InputError(f"{path} is no picture that can be read: {why}; make it again.") from None
