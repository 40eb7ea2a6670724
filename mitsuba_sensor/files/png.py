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
