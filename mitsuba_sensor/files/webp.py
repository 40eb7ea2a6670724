"""Animated WebPs of pictures of 8 bits, which browsers show as a video."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .appearing import write_drawing

QUALITY = 90
LONGEST_MS = 2**24 - 1


def write_webp(path: Path, pictures: Sequence[np.ndarray], period_s: float) -> None:
    """Pictures (H, W) grey or (H, W, 3) sRGB in a loop.  period_s : of each, in whole milliseconds."""
    from PIL import Image

    first, *others = (Image.fromarray(picture).convert("RGB") for picture in pictures)
    content, period_ms = io.BytesIO(), min(max(round(period_s * 1000), 1), LONGEST_MS)
    first.save(
        content,
        format="WEBP",
        save_all=True,
        append_images=others,
        duration=period_ms,
        loop=0,
        quality=QUALITY,
    )
    write_drawing(path, content.getvalue())
