"""Checks for missing pages, strips, tiles and lossless JPEGs, for which readers of TIFF and DNG invent values."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError

if TYPE_CHECKING:
    import tifffile

DNG_VERSION = 50706  # tag
LOSSLESS_JPEG = 7  # compression of a TIFF
OF_RAW = (32803, 34892)  # photometric interpretation: colour filter array, linear raw
JPEG_HEADER_BYTES_MAX = 2**16
JPEG_FRAMES = range(0xC0, 0xC4)
HUFFMAN_TABLES, START_OF_SCAN = 0xC4, 0xDA


def require_all_pages(place: str, opened: tifffile.TiffFile) -> None:
    """Raise InputError if the chain of pages leads beyond the end of the file."""
    pages, end = len(opened.pages), opened.pages.next_page_offset
    if end is None:
        return
    opened.filehandle.seek(end)
    if any(opened.filehandle.read(opened.tiff.offsetsize)):
        raise InputError(f"{place} is cut short after {pages} page(s); copy it again.")


def require_segments(place: str, page: tifffile.TiffPage | tifffile.TiffFrame | None) -> None:
    """Raise InputError for strips and tiles that are not in the file, which the reader sets to 0."""
    lengths = [] if page is None or page.is_contiguous else page.databytecounts
    if page is None or 0 in (*page.dataoffsets, *lengths):
        raise InputError(
            f"{place} lacks pixels, because strips or tiles are empty; omit it, or copy it again."
        )


def require_jpegs(file: Path, opened: tifffile.TiffFile) -> None:
    """Raise InputError if a lossless JPEG of a DNG lacks pixels of its tile or of the picture: LibRaw reads only one
    strip, and returns uninitialised memory if it decodes nothing."""
    if DNG_VERSION not in opened.pages.first.tags:
        return
    for page in [one for parent in opened.pages for one in (parent, *(parent.pages or ()))]:
        if page.compression != LOSSLESS_JPEG or page.photometric not in OF_RAW:
            continue
        rows, columns = page.imagelength, page.imagewidth
        height, width = rows, columns
        if page.is_tiled:
            height, width = page.tilelength, page.tilewidth
        corners = product(range(0, rows, height), range(0, columns, width))
        for number, (top, left) in enumerate(corners):
            pixels = min(height, rows - top) * min(width, columns - left)
            start = b""
            if number < len(page.dataoffsets):
                opened.filehandle.seek(page.dataoffsets[number])
                start = opened.filehandle.read(JPEG_HEADER_BYTES_MAX)
            if _jpeg_samples(start) < pixels * page.samplesperpixel:
                raise InputError(
                    f"{file} has no complete lossless JPEG of {pixels} pixels at row {top}, column {left}; copy it "
                    "again, or convert it with Adobe's DNG Converter."
                )


def _jpeg_samples(start: bytes) -> int:
    """Return the samples of a JPEG by its start; 0 without frame, Huffman tables or scan (ITU-T T.81, B.1.1)."""
    samples, has_tables, place = 0, False, 2
    while start[:2] == b"\xff\xd8" and start[place : place + 1] == b"\xff":
        marker = int.from_bytes(start[place + 1 : place + 2], "big")
        segment = start[place + 2 : place + 10]
        if marker == START_OF_SCAN and has_tables:
            return samples
        if marker in JPEG_FRAMES and len(segment) == 8:
            samples = (
                (segment[3] << 8 | segment[4]) * (segment[5] << 8 | segment[6]) * segment[7]
            )
        has_tables |= marker == HUFFMAN_TABLES
        place += 2 + int.from_bytes(segment[:2], "big")
    return 0
