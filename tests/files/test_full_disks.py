"""A disk that is full at any byte of a file is an error of every writer, and leaves no file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.files import npz, png, texts, tiff
from mitsuba_sensor.files.openexr import Plane, write_planes
from mitsuba_sensor.output import dng

resource = pytest.importorskip("resource")
TRIES = 40
IMAGE = np.random.default_rng(1).random((40, 24)).astype(np.float32)
RAW = (IMAGE * 4000).astype(np.uint16)
FRAMES = ms.expose(np.full((24, 24), 100.0), ms.load_camera("konnik_table1"), ms.Exposure(0.01))
WRITERS = {
    "one.tiff": lambda path: tiff.write_tiff(path, RAW),
    "three.tiff": lambda path: tiff.write_tiff(path, RAW[None].repeat(3, 0)),
    "frame.dng": lambda path: dng.write_dng(path, FRAMES),
    "small.exr": lambda path: write_planes(path, {}, {"Y": Plane(IMAGE[:4, :4])}),
    "tail.exr": lambda path: write_planes(
        path, {}, {name: Plane(IMAGE[:34]) for name in "RGB"}
    ),
    "large.exr": lambda path: write_planes(
        path, {}, {name: Plane(IMAGE.repeat(9, 0)) for name in "RGB"}
    ),
    "maps.npz": lambda path: npz.write_fpn_maps(path, {"prnu": IMAGE}),
    "frame.json": lambda path: texts.write_json(path, {"values": IMAGE.tolist()}),
    "frame.png": lambda path: png.write_png(path, (IMAGE * 255).astype(np.uint8)),
}


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """The kernel lets no file grow beyond ``size`` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("name", WRITERS)
def test_no_byte_is_lost_without_an_error(name: str, tmp_path: Path) -> None:
    """NumPy (tofile) and OpenEXR do not say so themselves when the last bytes of a file find no place."""
    path = tmp_path / name
    WRITERS[name](path)
    size = path.stat().st_size
    path.unlink()
    for limit in sorted({size * number // TRIES for number in range(TRIES)} | {size - 1}):
        with files_up_to(limit), pytest.raises(DiskFull) as caught:
            WRITERS[name](path)
        assert (caught.value.path, limit < size) == (path, True) and caught.value.size
        assert not list(tmp_path.iterdir()), f"of {size} bytes {limit} were written"
    with files_up_to(size):
        WRITERS[name](path)


def test_the_pages_of_a_tiff_are_those_of_the_stack_in_one(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    tiff.write_pages(
        tmp_path / "pages.tiff", RAW[None].repeat(3, 0), b"text", [(50714, 4, 1, 5, False)]
    )
    kinds = {
        "photometric": "minisblack",
        "metadata": None,
        "software": "mitsuba_sensor",
        "description": b"text",
    }
    extra = [(50714, 4, 1, 5, False)]
    tifffile.imwrite(
        tmp_path / "stack.tiff", RAW[None].repeat(3, 0), byteorder="<", extratags=extra, **kinds
    )
    assert (tmp_path / "pages.tiff").read_bytes() == (tmp_path / "stack.tiff").read_bytes()
