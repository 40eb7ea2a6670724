"""Contact sheets: small versions of pictures in rows, with what each row and each picture is, in one picture."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.printable import printable
from ..files.png import read_png
from ..optics.spectra import inverse_srgb_curve, srgb_curve

if TYPE_CHECKING:
    from PIL import Image

SIDE, GAP = 256, 4  # longer side of a picture, and the space between two [pixels]
FONT_PX, LINE_HEIGHT, MOST_LETTERS = (
    13,
    17,
    38,
)  # of a line of text, which is about as wide as a picture
BRIGHT_PERCENTILE, HALF, MOST_STOPS = 98, 0.5, 6
"""Of the pixels of a picture, the share of white that they reach, and by how many stops at most it is made brighter."""
WHITE, BLACK = (255, 255, 255), (0, 0, 0)


class Captioned(NamedTuple):
    """A PNG file, or its bytes, and the lines of text above it."""

    png: Path | bytes
    caption: Sequence[str] = ()


class SheetRow(NamedTuple):
    """Pictures side by side, and the lines of text left of them."""

    label: Sequence[str]
    pictures: Sequence[Captioned]


def contact_sheet(rows: Sequence[SheetRow]) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB of rows of PNG files, none larger than it is. Raises InputError.

    Each row is as high as its highest picture, each column as wide as the widest picture or caption.
    """
    from PIL import Image

    labels = [text_picture(row.label) for row in rows]
    cells = [[_cell(picture) for picture in row.pictures] for row in rows]
    margin = max(label.width for label in labels) + 2 * GAP
    column = max(cell.width for row in cells for cell in row) + GAP
    heights = [
        max(picture.height for picture in (label, *row)) + GAP
        for label, row in zip(labels, cells, strict=True)
    ]
    width = margin + max(map(len, cells)) * column
    sheet = Image.new("RGB", (width, sum(heights) + GAP), WHITE)
    top = GAP
    for label, row, height in zip(labels, cells, heights, strict=True):
        sheet.paste(label, (GAP, top))
        for number, cell in enumerate(row):
            sheet.paste(cell, (margin + number * column, top))
        top += height
    return np.asarray(sheet, dtype=np.uint8)


def _cell(picture: Captioned) -> Image.Image:
    """A small version of a picture below its caption."""
    from PIL import Image

    pixels, factor = brightened(thumbnail(picture.png))
    shown = f"shown {factor} x brighter" if factor > 1 else ""
    text = text_picture([*picture.caption, *([shown] if shown else [])])
    small = Image.fromarray(pixels)
    size = (max(text.width, small.width), text.height + small.height)
    cell = Image.new("RGB", size, WHITE)
    cell.paste(text, (0, 0))
    cell.paste(small, (0, text.height))
    return cell


def brightened(pixels: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """A dark sRGB picture by as many whole stops brighter as leave its bright pixels below half of white, and the
    factor of its light; 1 of one that is bright enough."""
    light = inverse_srgb_curve(np.divide(pixels, 255, dtype=np.float32))
    bright = float(np.percentile(light.max(axis=-1), BRIGHT_PERCENTILE))
    if bright <= 0:
        return pixels, 1
    stops = int(np.clip(np.floor(np.log2(HALF / bright)), 0, MOST_STOPS))
    if stops == 0:
        return pixels, 1
    shown = srgb_curve(np.minimum(light * 2.0**stops, 1.0))
    return np.rint(255 * shown).astype(np.uint8), 2**stops


def text_picture(lines: Sequence[str]) -> Image.Image:
    """Black lines on a white picture of their size; long ones are cut."""
    from PIL import Image, ImageDraw, ImageFont

    font, shown = ImageFont.load_default(FONT_PX), [_cut(line) for line in lines]
    widths = [int(font.getlength(line)) + 1 for line in shown]
    picture = Image.new(
        "RGB", (max(widths, default=1), max(LINE_HEIGHT * len(shown), 1)), WHITE
    )
    draw = ImageDraw.Draw(picture)
    for number, line in enumerate(shown):
        draw.text((0, number * LINE_HEIGHT), line, BLACK, font)
    return picture


def _cut(line: str) -> str:
    """At most so many letters, of those that the font has: ASCII."""
    plain = printable(" ".join(line.split())).replace("µ", "u")
    text = plain.encode("ascii", "replace").decode()
    if len(text) <= MOST_LETTERS:
        return text
    return f"{text[: MOST_LETTERS - 3]}..."


def thumbnail(png: Path | bytes) -> NDArray[np.uint8]:
    """(h, w, 3) sRGB of a PNG file, averaged down to SIDE. Raises InputError."""
    from PIL import Image

    if isinstance(png, bytes):
        picture = Image.fromarray(read_png(io.BytesIO(png), "the PNG"))
    else:
        picture = Image.fromarray(read_png(png, str(png)))
    factor = max(-(-max(picture.size) // SIDE), 1)
    return np.asarray(picture.convert("RGB").reduce(factor), dtype=np.uint8)
