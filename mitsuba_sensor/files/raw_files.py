"""Readers of raw frames of any camera, with their metadata: TIFF, PNG, NumPy, FITS, DNG and camera raw."""

from __future__ import annotations

import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core import InputError
from ..core.small_files import (
    json_value,
    require_plausible,
    require_plausible_ratio,
    require_regular,
)
from ..core.units import KELVIN_AT_0_C
from .openexr import is_exr, require_plausible_exr
from .tiff_checks import OF_RAW, require_all_pages, require_jpegs, require_segments

CAMERA_RAW = (
    *(".dng", ".cr2", ".cr3", ".crw", ".nef", ".nrw"),
    *(".arw", ".raf", ".rw2", ".orf", ".pef", ".srw", ".x3f"),
)
LABEL_CHARACTERS_MAX = 100
EXTRA = "pip install '.[raw]' in the checkout of mitsuba_sensor"
Tile: TypeAlias = tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class RawFile:
    """Frames of one file and its metadata; None or "" for unknown values.

    frames : integers or floats [DN], shape (N, H, W), rows in the order of the file.
    exposure_s : exposure time [s].  temperature_k : sensor temperature [K].
    gain : ISO speed or gain setting.  bits : bits of the ADC.
    tile : names of the colour filters in rows, from the first pixel.
    kind : ``bias``, ``dark``, ``flat`` or ``light``, from FITS headers.
    """

    frames: NDArray[Any]
    exposure_s: float | None = None
    temperature_k: float | None = None
    gain: str = ""
    bits: int | None = None
    tile: Tile = ()
    kind: str = ""


def read_raw(path: str | os.PathLike[str]) -> RawFile:
    """Return the frames of one file. Raises InputError for unreadable files, and for pictures of several channels."""
    file = Path(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError(f"{file} has an unknown format; give one of {', '.join(RAW_FORMATS)}.")

    def read() -> RawFile:
        require_regular(file)
        return reader(file)

    return _checked(str(file), read)


def read_raw_tiff(file: Path | BinaryIO, place: str) -> RawFile:
    """Return the frames of a TIFF, which may be bytes in memory. Raises InputError.  place : name for messages."""
    return _checked(place, partial(_tiff_of, file, place))


def _checked(file: str, read: Callable[[], RawFile]) -> RawFile:
    """Return what ``read`` returns, if it is raw frames. Raises InputError.  file : name for messages."""
    try:
        raw = read()
    except (InputError, MemoryError):
        raise
    except Exception as error:  # foreign readers raise errors of every kind for broken files
        why = getattr(error, "strerror", None) or str(error) or type(error).__name__
        why = re.sub(r":? <[^<>]* at 0x[0-9a-f]+>", "", why.split("\n")[0])  # names of objects
        raise InputError(
            f"{file} cannot be read: {why.rstrip('.')}; omit it, or copy it again."
        ) from error
    frames = raw.frames
    if frames.ndim != 3 or frames.dtype.kind not in "uif" or not frames.size:
        shape = frames.shape[1:] if frames.ndim > 3 else frames.shape
        raise InputError(
            f"{file} contains {frames.dtype} of shape {shape}; raw frames have one value per pixel."
        )
    return raw


def _pages(values: NDArray[Any]) -> NDArray[Any]:
    """Return (N, H, W) of (H, W)."""
    return values[None] if values.ndim == 2 else values


def _tiff_of(file: Path | BinaryIO, place: str = "") -> RawFile:
    import tifffile

    place = place or str(file)
    with tifffile.TiffFile(file) as opened:
        first = opened.pages.first
        tags = {tag.name: tag.value for tag in first.tags}
        if first.samplesperpixel != 1:
            raise InputError(
                f"{place} has {first.samplesperpixel} values per pixel; raw frames have one."
            )
        require_all_pages(place, opened)
        kind = opened.series[0].shape[-2:], opened.series[0].dtype
        series = [one for one in opened.series if (one.shape[-2:], one.dtype) == kind]
        unpacked = sum(math.prod(one.shape) * one.dtype.itemsize for one in series)
        require_plausible_ratio(place, opened.filehandle.size, unpacked)
        for page in (page for one in series for page in one.pages):
            require_segments(place, page)
        frames = _pages(series[0].asarray())
        if len(series) > 1:  # pages that were written individually
            frames = np.concatenate([frames, *(_pages(one.asarray()) for one in series[1:])])
    facts = _own_facts(tags.get("ImageDescription"))
    pattern, size = tags.get("CFAPattern"), tags.get("CFARepeatPatternDim")
    tile = _tile_of(facts.get("cfa_pattern"))
    if not tile and pattern is not None and size is not None:
        tile = tuple(
            tuple("RGBCMYW"[number] for number in row)
            for row in np.reshape(list(pattern), size)
        )
    exposure_s, iso = _exif(tags)
    return RawFile(
        frames,
        _not_negative(facts.get("exposure_s", exposure_s)),
        _not_negative(facts.get("temperature_k")),
        _label(facts.get("gain")) or iso,
        _bits(facts.get("white_level_dn")),
        tile,
    )


def _own_facts(description: object) -> dict[str, Any]:
    """Return the facts that this package writes to the description of a TIFF; {} for other TIFFs."""
    with suppress(ValueError):
        facts = json_value(str(description))
        if isinstance(facts, dict):
            return facts
    return {}


def _exif(tags: Mapping[str, Any]) -> tuple[float | None, str]:
    """Return exposure time [s] and ISO speed of EXIF tags."""
    exif = tags.get("ExifTag")
    tags = {**tags, **(exif if isinstance(exif, dict) else {})}
    time = tags.get("ExposureTime")
    iso = tags.get("PhotographicSensitivity", tags.get("ISOSpeedRatings"))
    exposure_s = None
    if isinstance(time, tuple) and len(time) == 2 and time[1]:
        exposure_s = time[0] / time[1]
    return exposure_s, _label(iso[0] if isinstance(iso, tuple) and iso else iso)


def _bits(white_level_dn: object) -> int | None:
    white = _not_negative(white_level_dn)
    return math.ceil(math.log2(white + 1)) if white else None


def _not_negative(value: object) -> float | None:
    """Return a number of metadata; None for other values and negative numbers."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    return float(value) if 0 <= value <= sys.float_info.max else None


def _label(value: object) -> str:
    """Return the name or number of a setting in metadata; "" for other values."""
    if isinstance(value, bool) or not isinstance(
        value, str | int | float | np.integer | np.floating
    ):
        return ""
    return str(value)[:LABEL_CHARACTERS_MAX]


def _tile_of(value: object) -> Tile:
    """Return the names of colour filters in metadata; () for other values."""
    rows = [row for row in value if isinstance(row, list)] if isinstance(value, list) else []
    names = [name for row in rows for name in row]
    if not names or len({*map(len, rows)}) != 1 or not all(isinstance(x, str) for x in names):
        return ()
    return tuple(map(tuple, rows))


def _png(file: Path) -> RawFile:
    from PIL import Image

    with Image.open(file) as picture:
        if len(picture.getbands()) != 1 or picture.mode == "P":
            raise InputError(
                f"{file} has {len(picture.getbands())} values per pixel ({picture.mode}); raw frames have one."
            )
        require_plausible(file, math.prod(picture.size) * 4)
        values = np.asarray(picture)
    return RawFile(_pages(values.astype(np.uint16) if values.dtype == np.int32 else values))


def _npy(file: Path) -> RawFile:
    return RawFile(_pages(np.load(file, mmap_mode="r", allow_pickle=False)))


def _fits(file: Path) -> RawFile:
    with _needed("astropy", file):
        from astropy.io import fits
    with fits.open(file) as opened:
        for one in opened:
            axes = range(1, 1 + int(one.header.get("NAXIS", 0)))
            values = math.prod(int(one.header[f"NAXIS{k}"]) for k in axes) if axes else 0
            require_plausible(file, values * abs(int(one.header.get("BITPIX", 8))) // 8)
        image = next(
            (one for one in opened if one.data is not None and np.ndim(one.data) in (2, 3)),
            None,
        )
        if image is None:
            raise InputError(
                f"{file} contains no image; give a FITS file with frames of one value per pixel."
            )
        header = {**opened[0].header, **image.header}
        frames = np.asarray(image.data)
    pattern = _label(header.get("BAYERPAT", "")).strip().upper()
    celsius = header.get("CCD-TEMP")
    temperature_k = None
    if isinstance(celsius, int | float) and not isinstance(celsius, bool):
        temperature_k = _not_negative(celsius + KELVIN_AT_0_C)
    kind = str(header.get("IMAGETYP", "")).lower().replace(" frame", "").strip()
    return RawFile(
        _pages(frames.astype(frames.dtype.newbyteorder("="), copy=False)),
        _not_negative(header.get("EXPTIME", header.get("EXPOSURE"))),
        temperature_k,
        _label(header.get("ISOSPEED", header.get("GAIN", ""))),
        tile=tuple(map(tuple, (pattern[:2], pattern[2:]))) if len(pattern) == 4 else (),
        kind={"zero": "bias", "object": "light"}.get(kind, kind),
    )


def _camera_raw(file: Path) -> RawFile:
    with _needed("rawpy", file):
        import rawpy
    import tifffile

    with suppress(tifffile.TiffFileError), tifffile.TiffFile(file) as opened:
        require_jpegs(file, opened)
    with rawpy.imread(os.fspath(file)) as raw:
        require_plausible(file, raw.sizes.raw_width * raw.sizes.raw_height * 2)
        image = raw.raw_image_visible
        if image is None or image.ndim != 2:
            raise InputError(f"{file} has several values per pixel; raw frames have one.")
        pattern, tile = raw.raw_pattern, Tile()
        if pattern is not None and raw.num_colors > 1:
            rows, columns = pattern.shape
            names, numbers = raw.color_desc.decode(), raw.raw_colors_visible[:rows, :columns]
            tile = tuple(tuple(names[number] for number in row) for row in numbers)
        shutter_s, iso = raw.other.shutter_speed, raw.other.iso_speed
        return RawFile(
            image[None].copy(),
            shutter_s or None,
            gain=f"{iso:g}" if iso else "",
            bits=_bits(raw.white_level),
            tile=tile,
        )


def require_plausible_picture(path: Path) -> None:
    """Raise InputError for a texture whose header announces more pixels than the file can contain. The renderer rejects
    a file that is not a picture."""
    require_regular(path, "the picture")
    if not is_exr(path):
        require_plausible(path, _pixels_of_picture(path) * 4)
        return
    try:
        require_plausible_exr(path)
    except InputError:
        raise
    except (RuntimeError, ValueError, KeyError, TypeError):
        return


def _pixels_of_picture(path: Path) -> int:
    """Return the pixels in the header; 0 for other files, and a lower limit for what Pillow calls a bomb."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            with Image.open(path) as picture:
                return math.prod(picture.size)
        except Image.DecompressionBombError:
            return 2 * (Image.MAX_IMAGE_PIXELS or 0)
        except (OSError, ValueError, SyntaxError):
            return 0


@contextmanager
def _needed(package: str, file: Path) -> Iterator[None]:
    """Import a library that only these files need. Raises InputError with the command that installs it."""
    try:
        yield
    except ImportError:
        raise InputError(
            f"{file} needs {package}, which is not installed; run {EXTRA}."
        ) from None


READERS: dict[str, Callable[[Path], RawFile]] = {
    **dict.fromkeys((".tif", ".tiff"), _tiff_of),
    ".png": _png,
    ".npy": _npy,
    **dict.fromkeys((".fits", ".fit", ".fts"), _fits),
    **dict.fromkeys(CAMERA_RAW, _camera_raw),
}
RAW_FORMATS = tuple(READERS)


def dng_tags(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the tags of a DNG by name, from its first page, its raw picture and Exif; fractions as floats.

    Raises InputError for other files.
    """
    import tifffile

    try:
        require_regular(path)
        with tifffile.TiffFile(path) as opened:
            first: Any = opened.pages[0]
            pages = [first, *(first.pages or ())]
            raw = next((page for page in pages if page.photometric in OF_RAW), first)
            tags = {tag.name: _plain(tag) for page in (first, raw) for tag in page.tags}
    except Exception as error:  # tifffile raises errors of every kind for broken files
        why = str(error).split("\n")[0] or type(error).__name__
        raise InputError(f"{path} cannot be read as a DNG: {why}. Give a .dng file.") from None
    exif = tags.get("ExifTag")
    return {**tags, **(exif if isinstance(exif, dict) else {})}


def _plain(tag: Any) -> Any:
    """Return the value of a tag; numerators are divided by denominators."""
    value = tag.value
    if getattr(tag.dtype, "name", "") in ("RATIONAL", "SRATIONAL") and isinstance(value, tuple):
        pairs = np.asarray(value, np.float64).reshape(-1, 2)
        with np.errstate(all="ignore"):
            return [float(x) for x in pairs[:, 0] / pairs[:, 1]]
    return value
