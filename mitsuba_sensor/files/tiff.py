"""Writes TIFFs of raw frames, one page per frame, nothing scaled."""

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
"""Code, type, count, value, whether on the first page only."""
LARGEST_TIFF = 2**32 - 2**25
"""Bytes of pixels; more become a BigTIFF."""
CFA_COLOURS = "rgb"  # numbers 0, 1, 2 in the CFAPattern of TIFF/EP
TIFF_BYTE, TIFF_ASCII, TIFF_SHORT, TIFF_LONG = 1, 2, 3, 4  # types of tags
PAGE_NAME = 285
READOUTS = "readouts.tiff"
BOTH_HALVES = "left and right"
"""The page of a frame of dual pixels."""
COMBINED = ("combined", "companded", BOTH_HALVES)
"""Pages that are no read-out."""


def write_tiff(
    path: str | os.PathLike[str], frames: np.ndarray, facts: Facts = NOTHING
) -> None:
    """Raw digital numbers (N, H, W), unsigned 8, 16 or 32 bit or float32, one page per frame, nothing scaled.

    ::

        frames = ms.expose(photons, camera, exposure)
        ms.write_tiff("frame.tiff", frames.digital)

    Raises InputError for any other array, and for what the disk refuses.
    facts : ``image`` of frame.json; as JSON in the description, and black level, white level and the pattern of red,
        green and blue filters in the tags of TIFF/EP and DNG too.
    """
    content_tags = _checked_tags(frames, facts)
    with appearing(Path(path), frames.nbytes) as temporary:
        write_pages(temporary, frames, *content_tags)


def tiff_bytes(frames: np.ndarray, facts: Facts = NOTHING) -> bytes:
    """The bytes of the file that :func:`write_tiff` writes. Raises InputError."""
    text, tags = _checked_tags(frames, facts)
    content = io.BytesIO()
    _write_to(content, frames, text, tags)
    return content.getvalue()


def _checked_tags(frames: np.ndarray, facts: Facts) -> tuple[bytes | None, list[TiffTag]]:
    """The description and the tags of a TIFF. Raises InputError for frames that it cannot hold."""
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
                "frames is what expose returns; pass its raw frames: frames.digital."
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
    """A TIFF of frames (H, W) or (N, H, W) with a description and tags. Raises OSError.

    Every byte passes through Python: NumPy's own way into a file (tofile) does not say when the disk has no place for
    the last ones.
    """
    with io.BufferedWriter(_NoTofile(path, "wb")) as file:
        _write_to(file, frames, text, tags)


def _write_to(
    file: BinaryIO, frames: np.ndarray, text: bytes | None, tags: Sequence[TiffTag]
) -> None:
    import tifffile

    large = frames.nbytes > LARGEST_TIFF
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
    """A TIFF of pages (H, W) of any unsigned type, each with its PageName.

    pattern : names of colour filters, of all pages.

    Raises InputError for what the disk refuses.
    """
    import tifffile

    size = sum(page.nbytes for _, page in pages)
    with (
        appearing(path, size) as temporary,
        io.BufferedWriter(_NoTofile(temporary, "wb")) as file,
        tifffile.TiffWriter(file, bigtiff=size > LARGEST_TIFF, byteorder="<") as tiff,
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


def read_named_pages(path: Path) -> list[tuple[str, np.ndarray]]:
    """Its inverse: name and pixels of every page. Raises InputError for a file that is damaged or not such."""
    import tifffile

    try:
        require_regular(path)
        with tifffile.TiffFile(path) as opened:
            pages = [page.aspage() for page in opened.pages]
            return [(str(page.tags[PAGE_NAME].value), page.asarray()) for page in pages]
    except Exception as error:  # tifffile raises errors of every kind for broken files
        raise InputError(
            f"{path} cannot be read as pages with names ({type(error).__name__}); make it again."
        ) from None


class _NoTofile(io.FileIO):
    """A file to which NumPy does not write past Python."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation


def _raw_tags(facts: Facts) -> list[TiffTag]:
    """(code, type, count, value, first page only) of BlackLevel, WhiteLevel, CFARepeatPatternDim and CFAPattern."""
    tags: list[TiffTag] = [
        (50714, TIFF_LONG, 1, round(facts["black_level_dn"]), False),
        (50717, TIFF_LONG, 1, facts["white_level_dn"], False),
    ]
    return [*tags, *cfa_tags(facts["cfa_pattern"])]


def cfa_tags(pattern: Sequence[Sequence[str]] | None) -> list[TiffTag]:
    """CFARepeatPatternDim and CFAPattern of rows of filter names, if all of them are red, green or blue."""
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
    """Of the page of one read-out, or of what they were combined to."""
    return f"frame {frame}, {readout}"


def read_readouts(path: Path) -> dict[str, np.ndarray]:
    """The pages of each name, (N, H, W). Raises InputError for what cannot be read."""
    found = dict[str, list[np.ndarray]]()
    for name, page in read_named_pages(path):
        found.setdefault(name.partition(", ")[2], []).append(page)
    return {name: np.stack(pages) for name, pages in found.items()}
