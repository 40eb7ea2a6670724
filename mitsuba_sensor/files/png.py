"""PNGs of 8 bits, as files and as bytes, and animated WebPs, which browsers show as a video."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..core import InputError
from .appearing import write_drawing
from .texts import plain_values

NOTHING: Mapping[str, Any] = {}

CAPTION_ROWS, CAPTION_MARGIN = 14, 2  # height of a line, and margin on its left [pixels]
WEBP_QUALITY = 90
WEBP_PERIOD_MAX_MS = 2**24 - 1
CAPTION_COLUMNS_MIN = 72
"""Narrower pictures are enlarged for a caption [pixels]."""


def captioned(picture: np.ndarray, caption: str) -> np.ndarray:
    """Return the picture above its caption, whose lines are wrapped in a black strip.

    A picture that is narrower than a word is enlarged: each pixel becomes a square of pixels.
    """
    from PIL import Image, ImageDraw, ImageFont

    font, pieces = ImageFont.load_default(), caption.split()
    widest_piece = max(math.ceil(font.getlength(piece)) for piece in pieces)
    factor = math.ceil(
        max(widest_piece + 2 * CAPTION_MARGIN, CAPTION_COLUMNS_MIN) / picture.shape[1]
    )
    enlarged = picture.repeat(factor, axis=0).repeat(factor, axis=1)
    lines = _wrapped(pieces, font.getlength, enlarged.shape[1])
    strip = Image.new("L", (enlarged.shape[1], CAPTION_ROWS * len(lines)), 0)
    draw = ImageDraw.Draw(strip)
    for number, line in enumerate(lines):
        draw.text((CAPTION_MARGIN, 1 + CAPTION_ROWS * number), line, fill=255, font=font)
    rows = np.asarray(strip)
    if picture.ndim == 3:
        rows = np.repeat(rows[..., None], picture.shape[2], axis=2)
    return np.concatenate([enlarged, rows])


def _wrapped(
    pieces: Sequence[str], width_of: Callable[[str], float], columns: int
) -> list[str]:
    """Join words to lines of at most ``columns`` pixels, margins included."""
    lines = [pieces[0]]
    for piece in pieces[1:]:
        longer = f"{lines[-1]} {piece}"
        if width_of(longer) + 2 * CAPTION_MARGIN <= columns:
            lines[-1] = longer
        else:
            lines.append(piece)
    return lines


def read_png(file: Path | BinaryIO, place: str) -> np.ndarray:
    """Return the pixels of a PNG, (H, W) or (H, W, 3). Raises InputError.  place : name of the file for messages."""
    from PIL import Image

    try:
        with Image.open(file, formats=["PNG"]) as picture:
            return np.asarray(picture)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        why = " ".join(str(error).split()).partition(" <")[0].rstrip(".") or "it is cut short"
        raise InputError(f"{place} cannot be read as a PNG: {why}; recreate it.") from None


def write_png(path: Path, picture: np.ndarray, facts: Mapping[str, Any] = NOTHING) -> None:
    """Write an 8-bit picture, (H, W) grey or (H, W, 3) sRGB.  facts : text chunks, each value as JSON."""
    write_drawing(path, png(picture, facts))


def png(picture: np.ndarray, facts: Mapping[str, Any] = NOTHING) -> bytes:
    """Return the bytes of the file that :func:`write_png` writes."""
    from PIL import Image, PngImagePlugin

    texts, content = PngImagePlugin.PngInfo(), io.BytesIO()
    for name, value in facts.items():
        texts.add_text(name, json.dumps(plain_values(value)))
    Image.fromarray(picture).save(content, format="PNG", pnginfo=texts)
    return content.getvalue()


def write_webp(path: Path, pictures: Sequence[np.ndarray], period_s: float) -> None:
    """Write pictures (H, W) grey or (H, W, 3) sRGB as a loop.  period_s : time of each, rounded to milliseconds."""
    from PIL import Image

    first, *others = (Image.fromarray(picture).convert("RGB") for picture in pictures)
    content, period_ms = io.BytesIO(), min(max(round(period_s * 1000), 1), WEBP_PERIOD_MAX_MS)
    first.save(
        content,
        format="WEBP",
        save_all=True,
        append_images=others,
        duration=period_ms,
        loop=0,
        quality=WEBP_QUALITY,
    )
    write_drawing(path, content.getvalue())
