"""PNGs of pictures of 8 bits, as files and as bytes, and animated WebPs, which browsers show as a video."""

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

CAPTION_ROWS, CAPTION_MARGIN = 14, 2  # of a line, and left of it [pixels]
QUALITY = 90
LONGEST_MS = 2**24 - 1  # of a picture in a WebP
NARROWEST_CAPTION = 72
"""Columns [pixels]; narrower pictures are enlarged for a caption."""


def captioned(picture: np.ndarray, caption: str) -> np.ndarray:
    """The picture above its caption in a black strip, in as many lines as it takes.

    One that is narrower than a text without blanks is enlarged by a whole number: each pixel becomes a square.
    """
    from PIL import Image, ImageDraw, ImageFont

    font, pieces = ImageFont.load_default(), caption.split()
    widest_piece = max(math.ceil(font.getlength(piece)) for piece in pieces)
    factor = math.ceil(
        max(widest_piece + 2 * CAPTION_MARGIN, NARROWEST_CAPTION) / picture.shape[1]
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
    """Lines of texts between blanks that are no wider than so many columns [pixels] without the margins."""
    lines = [pieces[0]]
    for piece in pieces[1:]:
        longer = f"{lines[-1]} {piece}"
        if width_of(longer) + 2 * CAPTION_MARGIN <= columns:
            lines[-1] = longer
        else:
            lines.append(piece)
    return lines


def read_png(file: Path | BinaryIO, place: str) -> np.ndarray:
    """The pixels of a PNG, (H, W) or (H, W, 3). Raises InputError.  place : of the file, for the message."""
    from PIL import Image

    try:
        with Image.open(file, formats=["PNG"]) as picture:
            return np.asarray(picture)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        why = " ".join(str(error).split()).partition(" <")[0].rstrip(".") or "it is cut short"
        raise InputError(
            f"{place} is no picture that can be read: {why}; make it again."
        ) from None


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
