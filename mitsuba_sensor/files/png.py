"""PNGs of pictures of 8 bits, as files and as bytes."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .appearing import write_drawing
from .texts import plain_values

NOTHING: Mapping[str, Any] = {}


CAPTION_ROWS = 14


def captioned(picture: np.ndarray, caption: str) -> np.ndarray:
    """The picture with a line of text in a black strip below it, cut off where the picture is narrow."""
    from PIL import Image, ImageDraw

    strip = Image.new("L", (picture.shape[1], CAPTION_ROWS), 0)
    ImageDraw.Draw(strip).text((2, 1), caption, fill=255)
    rows = np.asarray(strip)
    if picture.ndim == 3:
        rows = np.repeat(rows[..., None], picture.shape[2], axis=2)
    return np.concatenate([picture, rows])


def write_png(path: Path, picture: np.ndarray, facts: Mapping[str, Any] = NOTHING) -> None:
    """An 8-bit preview, (H, W) grey or (H, W, 3) sRGB.  facts : what becomes text in it, each value as JSON."""
    write_drawing(path, png(picture, facts))


def png(picture: np.ndarray, facts: Mapping[str, Any] = NOTHING) -> bytes:
    """The same as the bytes of a file."""
    from PIL import Image, PngImagePlugin

    texts, content = PngImagePlugin.PngInfo(), io.BytesIO()
    for name, value in facts.items():
        texts.add_text(name, json.dumps(plain_values(value)))
    Image.fromarray(picture).save(content, format="PNG", pnginfo=texts)
    return content.getvalue()
