"""TIFFs of raw frames, one page per frame, unscaled."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from ..core import InputError, refuse_masked
from ..core.checks import refuse_path
from ..core.small_files import require_regular
from .appearing import appearing
from .texts import to_json

Facts: TypeAlias = Mapping[str, Any]
NOTHING: Facts = {}

TIFF_TYPES = "uint8", "uint16", "uint32", "float32"
TiffTag: TypeAlias = tuple[int, int, int, Any, bool]
"""Code, type, count, value, and whether the tag is on the first page only."""
TIFF_BYTES_MAX = 2**32 - 2**25
"""Largest size of pixels; more become a BigTIFF."""
CFA_COLOURS = "rgb"  # 0, 1, 2 in the CFAPattern of TIFF/EP
TIFF_BYTE, TIFF_ASCII, TIFF_SHORT, TIFF_LONG = 1, 2, 3, 4  # types of tags
PAGE_NAME = 285
READOUTS = "readouts.tiff"
BOTH_HALVES = "left and right"
"""Name of the page of a frame of dual pixels."""
COMBINED = ("combined", "companded", BOTH_HALVES)
"""Names of pages that are not a single readout."""


def write_tiff(
    path: str | os.PathLike[str], frames: np.ndarray, facts: Facts = NOTHING
) -> None:
    """Write raw digital numbers (N, H, W), unsigned 8, 16 or 32 bit or float32, one page per frame, unscaled.

    ::

        frames = ms.expose(photons, camera, exposure)
        ms.write_tiff("frame.tiff", frames.digital)

    Raises InputError for any other array, and for errors of the disk.
    facts : ``image`` of frame.json, written as JSON to the description; black level, white level and an RGB pattern
        also go to the tags of TIFF/EP and DNG.
    """
    content_tags = _checked_tags(frames, facts)
    with appearing(Path(path), frames.nbytes) as temporary:
        write_pages(temporary, frames, *content_tags)


def tiff_bytes(frames: np.ndarray, facts: Facts = NOTHING) -> bytes:
    """Return the bytes of the file that :func:`write_tiff` writes. Raises InputError."""
    text, tags = _checked_tags(frames, facts)
    content = io.BytesIO()
    _write_to(content, frames, text, tags)
    return content.getvalue()


def _checked_tags(frames: np.ndarray, facts: Facts) -> tuple[bytes | None, list[TiffTag]]:
    """Return the description and the tags of a TIFF. Raises InputError for unsupported frames."""
    refuse_masked("frames", frames)
    refuse_path("frames", frames, "the path is the first argument: write_tiff(path, frames)")
    if (
        not isinstance(frames, np.ndarray)
        or str(frames.dtype) not in TIFF_TYPES
        or frames.ndim not in (2, 3)
    ):
        given = f"{getattr(frames, 'dtype', type(frames).__name__)} of shape {getattr(frames, 'shape', ())}"
        if hasattr(frames, "digital"):
            raise InputError(
                "frames is the result of expose; pass its raw frames: frames.digital."
            )
        raise InputError(
            f"frames is {given}; pass (H, W) or (N, H, W) of {', '.join(TIFF_TYPES)}."
        )
    if not frames.size:
        raise InputError(f"frames has shape {frames.shape} and no pixel; pass at least one.")
    if facts:
        return to_json(dict(facts)).encode(), _raw_tags(facts)
    return None, []


def write_pages(
    path: Path, frames: np.ndarray, text: bytes | None, tags: Sequence[TiffTag]
) -> None:
    """Write a TIFF of frames (H, W) or (N, H, W) with a description and tags. Raises OSError.

    Every byte passes through Python, because NumPy's tofile does not report a full disk for the last bytes.
    """
    with io.BufferedWriter(_NoTofile(path, "wb")) as file:
        _write_to(file, frames, text, tags)


def _write_to(
    file: BinaryIO, frames: np.ndarray, text: bytes | None, tags: Sequence[TiffTag]
) -> None:
    import tifffile

    large = frames.nbytes > TIFF_BYTES_MAX
    with tifffile.TiffWriter(file, bigtiff=large, byteorder="<") as tiff:
        for page in frames.reshape(-1, *frames.shape[-2:]):
            tiff.write(
                page,
                contiguous=True,
                photometric="minisblack",
                metadata=None,
                software="mitsuba_sensor",
                description=text,
                extratags=tags,
            )


def write_named_pages(
    path: Path,
    pages: Sequence[tuple[str, np.ndarray]],
    pattern: Sequence[Sequence[str]] | None,
) -> None:
    """Write a TIFF of pages (H, W) of any unsigned type, each with its PageName. Raises InputError and DiskFull.

    pattern : names of the colour filters of all pages.
    """
    import tifffile

    size = sum(page.nbytes for _, page in pages)
    with (
        appearing(path, size) as temporary,
        io.BufferedWriter(_NoTofile(temporary, "wb")) as file,
        tifffile.TiffWriter(file, bigtiff=size > TIFF_BYTES_MAX, byteorder="<") as tiff,
    ):
        for name, page in pages:
            tags = [(PAGE_NAME, TIFF_ASCII, 0, name, False), *cfa_tags(pattern)]
            tiff.write(
                page,
                photometric="minisblack",
                metadata=None,
                software="mitsuba_sensor",
                extratags=tags,
            )


def _read_named_pages(path: Path) -> list[tuple[str, np.ndarray]]:
    """Return name and pixels of every page. Raises InputError for damaged and other files."""
    import tifffile

    try:
        require_regular(path)
        with tifffile.TiffFile(path) as opened:
            pages = [page.aspage() for page in opened.pages]
            return [(str(page.tags[PAGE_NAME].value), page.asarray()) for page in pages]
    except Exception as error:  # tifffile raises errors of every kind for broken files
        raise InputError(
            f"{path} cannot be read as named pages ({type(error).__name__}); recreate it."
        ) from None


class _NoTofile(io.FileIO):
    """A file to which NumPy cannot write directly."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation


def _raw_tags(facts: Facts) -> list[TiffTag]:
    """Return the tags BlackLevel, WhiteLevel, CFARepeatPatternDim and CFAPattern."""
    tags: list[TiffTag] = [
        (50714, TIFF_LONG, 1, round(facts["black_level_dn"]), False),
        (50717, TIFF_LONG, 1, facts["white_level_dn"], False),
    ]
    return [*tags, *cfa_tags(facts["cfa_pattern"])]


def cfa_tags(pattern: Sequence[Sequence[str]] | None) -> list[TiffTag]:
    """Return CFARepeatPatternDim and CFAPattern of rows of filter names; [] unless all are red, green or blue."""
    names = np.array(pattern or [[]])
    initials = [name[:1].lower() for name in names.ravel()]
    if not initials or not set(initials) <= set(CFA_COLOURS):
        return []
    colours = bytes(CFA_COLOURS.index(one) for one in initials)
    return [
        (33421, TIFF_SHORT, 2, names.shape, False),
        (33422, TIFF_BYTE, names.size, colours, False),
    ]


def page_name(frame: int, readout: str) -> str:
    """Return the name of the page of one readout, or of the combined frame."""
    return f"frame {frame}, {readout}"


def read_readouts(path: Path) -> dict[str, np.ndarray]:
    """Return the pages of each name, shape (N, H, W). Raises InputError."""
    readouts = dict[str, list[np.ndarray]]()
    for name, page in _read_named_pages(path):
        readouts.setdefault(name.partition(", ")[2], []).append(page)
    return {name: np.stack(pages) for name, pages in readouts.items()}
