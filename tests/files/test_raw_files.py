"""Damaged raw files: every value that is delivered was in the file, else one sentence."""

from __future__ import annotations

import struct
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.files.raw_files import read_raw

PICTURE = np.random.default_rng(1).integers(100, 4000, (64, 96)).astype(np.uint16)
MOSAIC = [(50706, "B", 4, (1, 4, 0, 0)), (33421, "H", 2, (2, 2)), (33422, "B", 4, (0, 1, 1, 2))]
ALL = (slice(0, 64), slice(0, 96))
TILES = [(slice(y, y + 32), slice(x, x + 32)) for y, x in product((0, 32), (0, 32, 64))]
STRIPS = [(slice(y, y + 16), slice(0, 96)) for y in range(0, 64, 16)]


def lossless_jpeg(image: np.ndarray) -> bytes:
    """ITU-T T.81, SOF3 with predictor 1: Huffman codes of 5 bits, each the number of bits of the difference."""
    rows, columns = image.shape
    values = image.astype(int)
    before = np.hstack([np.r_[2**15, values[:-1, 0]][:, None], values[:, :-1]])
    text = ""
    for difference in (values - before).ravel().tolist():
        n = abs(difference).bit_length()
        code = difference if difference > 0 else difference + 2**n - 1
        text += f"{n:05b}" + (f"{code:0{n}b}" if n else "")
    text += "1" * (-len(text) % 8)
    table = (
        b"\xff\xc4"
        + struct.pack(">HB", 36, 0)
        + bytes([0] * 4 + [17] + [0] * 11 + [*range(17)])
    )
    frame = b"\xff\xc3" + struct.pack(">HBHHBBBB", 11, 16, rows, columns, 1, 1, 0x11, 0)
    scan = b"\xff\xda" + struct.pack(">HBBBBBB", 8, 1, 1, 0, 1, 0, 0)
    data = int(text, 2).to_bytes(len(text) // 8, "big").replace(b"\xff", b"\xff\0")
    return b"\xff\xd8" + table + frame + scan + data + b"\xff\xd9"


def write_dng(path: Path, segments: list[bytes], **layout: Any) -> None:
    kind: dict[str, Any] = {"shape": PICTURE.shape, "dtype": np.uint16, "photometric": 32803}
    tags = {"extratags": [*MOSAIC, (50708, "s", 0, "test")], "metadata": None}
    tifffile.imwrite(path, iter(segments), **kind, **tags, **layout, compression="zlib")
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages[0].tags["Compression"].overwrite(7)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("parts", "layout"),
    [([ALL], {"rowsperstrip": 64}), (TILES, {"tile": (32, 32)})],
    ids=["strip", "tiles"],
)
def test_a_dng_of_lossless_jpegs_is_read_if_each_has_its_pixels(
    tmp_path: Path, parts: list[tuple[slice, slice]], layout: dict[str, Any]
) -> None:
    """Where LibRaw decodes nothing it delivers what was in the memory, without a word."""
    file = tmp_path / "a.dng"
    whole = [lossless_jpeg(PICTURE[part]) for part in parts]
    write_dng(file, whole, **layout)
    np.testing.assert_array_equal(read_raw(file).frames[0], PICTURE)
    last, frame, scan = whole[-1], whole[-1].index(b"\xff\xc3"), whole[-1].index(b"\xff\xda")
    rows, columns = PICTURE[parts[-1]].shape
    for broken in (
        b"no picture",
        last[2:],
        last[:frame],
        last[:scan],
        last[:2] + last[frame:],  # no Huffman tables
        lossless_jpeg(PICTURE[: rows // 2, :columns]),
        b"",
    ):
        write_dng(file, [*whole[:-1], broken + b" "], **layout)
        with pytest.raises(ms.InputError, match=r"a\.dng has no complete lossless JPEG"):
            read_raw(file)


def test_a_dng_of_several_lossless_jpegs_in_strips_of_which_libraw_reads_one_is_refused(
    tmp_path: Path,
) -> None:
    strips = [lossless_jpeg(PICTURE[part]) for part in STRIPS]
    write_dng(tmp_path / "a.dng", strips, rowsperstrip=16)
    with pytest.raises(ms.InputError, match="no complete lossless JPEG of 6144 pixels"):
        read_raw(tmp_path / "a.dng")


def write_pages(path: Path, **options: Any) -> None:
    with tifffile.TiffWriter(path) as file:
        for _ in range(3):
            file.write(PICTURE, photometric="minisblack", **options)


WRITERS: dict[str, Callable[[Path], object]] = {
    "strip.tif": lambda path: tifffile.imwrite(path, PICTURE),
    "strips.tif": lambda path: tifffile.imwrite(path, PICTURE, rowsperstrip=16),
    "tiles.tif": lambda path: tifffile.imwrite(path, PICTURE, tile=(32, 32)),
    "deflate.tif": lambda path: tifffile.imwrite(
        path, PICTURE, rowsperstrip=16, compression="zlib"
    ),
    "pages.tif": lambda path: tifffile.imwrite(
        path, np.stack([PICTURE] * 3), photometric="minisblack"
    ),
    "own_pages.tif": lambda path: write_pages(path, contiguous=False),
    "deflate_pages.tif": lambda path: write_pages(path, compression="zlib"),
    "plain_pages.tif": lambda path: write_pages(path, metadata=None, rowsperstrip=16),
    "a.png": lambda path: Image.fromarray(PICTURE).save(path),
    "a.npy": lambda path: np.save(path, PICTURE),
    "a.fits": lambda path: fits.writeto(path, PICTURE),
    "a.dng": lambda path: tifffile.imwrite(path, PICTURE, photometric=32803, extratags=MOSAIC),
}
THREE = ("pages.tif", "own_pages.tif", "deflate_pages.tif", "plain_pages.tif")


@pytest.mark.filterwarnings("ignore::astropy.utils.exceptions.AstropyWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_is_cut_short_is_whole_or_refused(tmp_path: Path, name: str) -> None:
    """Also all pages that were written one by one are read."""
    file = tmp_path / name
    WRITERS[name](file)
    whole = np.stack([PICTURE] * (3 if name in THREE else 1))
    np.testing.assert_array_equal(read_raw(file).frames, whole)
    data, refused = file.read_bytes(), 0
    for length in np.linspace(0, len(data) - 1, 60).astype(int).tolist():
        file.write_bytes(data[:length])
        try:
            np.testing.assert_array_equal(read_raw(file).frames, whole, err_msg=f"{length}")
        except ms.InputError:
            refused += 1
    assert refused > 40


@pytest.mark.parametrize("name", ["strips.tif", "tiles.tif", "deflate.tif"])
@pytest.mark.parametrize("what", ["Offsets", "ByteCounts"])
def test_strips_and_tiles_that_are_empty_are_refused(
    tmp_path: Path, name: str, what: str
) -> None:
    file = tmp_path / name
    WRITERS[name](file)
    with tifffile.TiffFile(file, mode="r+b") as opened:
        tags = opened.pages[0].tags  # type: ignore[union-attr]
        tag = tags["Tile" + what if name == "tiles.tif" else "Strip" + what]
        tag.overwrite((0, *tag.value[1:]))
    with pytest.raises(ms.InputError, match="strips or tiles are empty"):
        read_raw(file)
