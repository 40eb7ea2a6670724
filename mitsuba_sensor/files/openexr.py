"""OpenEXR files by the OpenEXR library: images of named channels, and checks of files."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.small_files import require_plausible, require_regular
from .appearing import appearing

EXR_MAGIC = b"\x76\x2f\x31\x01"  # OpenEXR file layout, "Magic Number"
ZIP_ROWS = 16  # rows compressed together (OpenEXR file layout, "ZIP_COMPRESSION")
VALUES_AT_ONCE = 2**21  # 8 MiB in float32, which the library copies


class Plane(NamedTuple):
    """A channel to write: an image (H, W) in float32, or in half precision times ``scale`` if given."""

    image: np.ndarray
    scale: float | None = None

    def rows(self, rows: slice) -> bytes:
        """Return the bytes of some rows as in the file."""
        if self.scale is None:
            return np.asarray(self.image[rows], dtype=np.float32).tobytes()
        return (self.image[rows] * np.float32(self.scale)).astype(np.float16).tobytes()


def write_planes(
    path: Path, header: Mapping[str, str | float], channels: Mapping[str, Plane]
) -> None:
    """Write an EXR some rows at a time, because a reordered copy of all planes would double the memory."""
    import OpenEXR

    rows, columns = next(iter(channels.values())).image.shape
    step = max(VALUES_AT_ONCE // (columns * len(channels)) // ZIP_ROWS, 1) * ZIP_ROWS
    # Before compression.
    size = sum(x.image.size * (4 if x.scale is None else 2) for x in channels.values())
    with appearing(path, size) as temporary:
        try:
            with closing(
                OpenEXR.OutputFile(
                    str(temporary), _file_header((columns, rows), header, channels)
                )
            ) as file:
                for first in range(0, rows, step):
                    here = slice(first, min(first + step, rows))
                    file.writePixels(
                        {name: x.rows(here) for name, x in channels.items()}, here.stop - first
                    )
        except (RuntimeError, ValueError) as error:  # of any cause
            raise OSError(str(error)) from error
        if not _ends_well(temporary, rows - 1):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _ends_well(path: Path, last_row: int) -> bool:
    """Return True if a file that was just written has its table of offsets and its last row.

    The library reports no error if the disk is full when it writes its buffers at the end of a file.
    """
    import OpenEXR

    if path.stat().st_size == 0:
        return False
    try:
        with _silent_library(), closing(OpenEXR.InputFile(str(path))) as file:
            file.channels(
                list(file.header()["channels"]), scanLine1=last_row, scanLine2=last_row
            )
            return bool(file.isComplete())
    except (RuntimeError, ValueError, OSError):
        return False


def _file_header(
    size: tuple[int, int], header: Mapping[str, str | float], channels: Mapping[str, Plane]
) -> dict[str, Any]:
    """Return the header for the library's writer of rows.  size : (columns, rows)."""
    import Imath
    import OpenEXR

    kinds = {
        name: Imath.PixelType.FLOAT if x.scale is None else Imath.PixelType.HALF
        for name, x in channels.items()
    }
    return {
        **OpenEXR.Header(*size),
        "type": b"scanlineimage",
        "compression": Imath.Compression(Imath.Compression.ZIP_COMPRESSION),
        "channels": {
            name: Imath.Channel(Imath.PixelType(kind)) for name, kind in kinds.items()
        },
        **{
            name: value.encode() if isinstance(value, str) else value
            for name, value in header.items()
        },
    }


@contextmanager
def _silent_library() -> Iterator[None]:
    """Suppress the OpenEXR library's own output about a damaged file, one line for each row."""
    kept, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        with redirect_stdout(io.StringIO()):
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


@contextmanager
def whole_exr(
    path: Path, wrong: str, remedy: str = "", pixels: bool = True
) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
    """Yield header and channels of an EXR. Raises InputError if the file is missing, no EXR, or cut short, and if the
    block finds an entry missing.

    Channels are images of the display window; with several parts, names begin with the name of the part.
    pixels : False to read the header only; the images are then empty.
    """
    import OpenEXR

    require_exr(path)
    try:
        if pixels:
            require_plausible_exr(path)
        with (
            _silent_library(),
            OpenEXR.File(str(path), separate_channels=True, header_only=not pixels) as file,
        ):
            header, images = dict(file.header()), dict[str, np.ndarray]()
            for number, part in enumerate(file.parts):
                layer = f"{part.name() or number}." if len(file.parts) > 1 else ""
                for channel in part.header["channels"]:
                    name = channel.name
                    if not name.startswith(layer):  # some programs write the part's name
                        name = layer + name
                    images[name] = np.empty((0, 0), np.float32)
                    if pixels:
                        image = part.channels[channel.name].pixels
                        windows = part.header["dataWindow"], part.header["displayWindow"]
                        images[name] = _displayed(image, *windows, f"{path}: {name}")
    except InputError:
        raise
    except (RuntimeError, ValueError, KeyError, TypeError, MemoryError) as error:
        why = "is cut short or damaged and cannot be read as an OpenEXR file"
        raise InputError(f"{path} {why}; render it again.") from error
    try:
        yield header, images
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError) as error:
        why = " ".join(str(error).split())
        raise InputError(
            f"{path} is an EXR {wrong} (missing or unreadable: {why}){remedy}."
        ) from error


def _displayed(image: np.ndarray, data: ArrayLike, shown: ArrayLike, name: str) -> np.ndarray:
    """Return an image of the display window from an image of the data window; pixels outside the latter are black.

    name : for messages. Raises InputError for deep and subsampled channels, and for windows that do not overlap.
    """
    left, top, columns, rows = _window(data)
    if image.dtype.kind not in "fu" or image.shape != (rows, columns):
        raise InputError(
            f"{name} is deep or subsampled, so it has no single value per pixel; flatten it, and write R, G and B of "
            "full size."
        )
    left_shown, top_shown, width, height = _window(shown)
    if (left, top, columns, rows) == (left_shown, top_shown, width, height):
        return image
    left, top = left - left_shown, top - top_shown
    seen = image[max(-top, 0) : max(height - top, 0), max(-left, 0) : max(width - left, 0)]
    if not seen.size:
        raise InputError(
            f"{name} has no pixel in the display window; correct the windows in its header."
        )
    picture, left, top = np.zeros((height, width), image.dtype), max(left, 0), max(top, 0)
    picture[top : top + seen.shape[0], left : left + seen.shape[1]] = seen
    return picture


def _window(corners: ArrayLike) -> tuple[int, int, int, int]:
    """Return left column, top row, columns and rows of a window of a header."""
    left, top, right, bottom = np.reshape(corners, 4).tolist()
    return left, top, max(right - left + 1, 0), max(bottom - top + 1, 0)


def require_plausible_exr(path: Path) -> None:
    """Raise InputError if the header announces more pixels than the file can contain, and errors of the library if the
    header is unreadable."""
    import OpenEXR

    with _silent_library(), OpenEXR.File(str(path), header_only=True) as file:
        require_plausible(path, sum(_unpacked_bytes(part.header) for part in file.parts))


def _unpacked_bytes(header: Mapping[str, Any]) -> int:
    """Return the size of all pixels in float32. Raises KeyError, TypeError and ValueError for an incomplete header."""
    sizes = [_window(header[name]) for name in ("dataWindow", "displayWindow")]
    pixels = max(columns * rows for _, _, columns, rows in sizes)
    return pixels * len(header["channels"]) * 4


def is_exr(path: str | os.PathLike[str]) -> bool:
    """Return True if this is an OpenEXR file, by its first bytes."""
    try:
        require_exr(Path(path))
    except InputError:
        return False
    return True


WAY_OUT = (
    "give an irradiance.exr, render a scene (`mitsuba-sensor render SCENE -o out/`), or convert a picture in Python "
    "(light_from_rgb)"
)


def require_exr(path: Path) -> None:
    """Raise InputError for any other file."""
    try:
        require_regular(path)
        with path.open("rb") as file:
            magic = file.read(len(EXR_MAGIC))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; {WAY_OUT}.") from error
    if magic != EXR_MAGIC:
        raise InputError(f"{path} is not an OpenEXR file; {WAY_OUT}.")
