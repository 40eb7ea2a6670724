"""Small files that would unpack to gigabytes are refused in one sentence, before memory is taken; no pickle is read."""

from __future__ import annotations

import io
import itertools
import os
import pickle
import re
import resource
import struct
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.scenes import SKY, scene_text, write_scene
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.core.small_files import toml_tables
from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.files.npz import read_fpn_maps, write_fpn_maps
from mitsuba_sensor.files.openexr import Plane, write_planes
from mitsuba_sensor.files.raw_files import read_raw
from mitsuba_sensor.files.scene_references import scene_references
from mitsuba_sensor.files.tiff import read_readouts
from mitsuba_sensor.lab.frames.manifest import read_manifest
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.render.motion.aovs import render_aovs
from mitsuba_sensor.render.scene.motion import read_motion
from mitsuba_sensor.render.scene.parse_scene import parse

SIDE = 100_000
MOST_BYTES = 2**28  # of memory that reading one of these may take


@pytest.fixture(autouse=True)
def _little_memory() -> Iterator[None]:
    """Nothing near the 10 to 40 GB that the files ask for can be had, and the peak hardly rises."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_BYTES / 1024


def array_header(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_2_0(
        file, {"descr": kind, "fortran_order": False, "shape": shape}
    )
    return file.getvalue()


def exr(path: Path) -> None:
    """A file of 4 × 4 pixels whose data and display windows are patched."""
    write_planes(path, {}, {"Y": Plane(np.ones((4, 4), np.float32))})
    small, large = struct.pack("<4i", 0, 0, 3, 3), struct.pack("<4i", 0, 0, SIDE - 1, SIDE - 1)
    content = path.read_bytes()
    assert content.count(small) >= 2
    path.write_bytes(content.replace(small, large))


def tiff(path: Path) -> None:
    tifffile.imwrite(path, np.ones((4, 4), np.uint16), compression="zlib", metadata=None)
    with tifffile.TiffFile(path, mode="r+b") as opened:
        for name in ("ImageWidth", "ImageLength", "RowsPerStrip"):
            opened.pages.first.tags[name].overwrite(SIDE)


def png(path: Path, side: int = SIDE) -> None:
    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data))
            + name
            + data
            + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", side, side, 16, 0, 0, 0, 0)
    content = (
        chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0" * 1000))
        + chunk(b"IEND", b"")
    )
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + content)


def png_below_the_limit_of_pillow(path: Path) -> None:
    png(path, 9_400)


def jpeg(path: Path) -> None:
    """The size in the frame header (SOF0) is patched."""
    content = io.BytesIO()
    Image.fromarray(np.ones((8, 8), np.uint8)).save(content, format="JPEG")
    data = bytearray(content.getvalue())
    start = data.index(b"\xff\xc0")
    data[start + 5 : start + 9] = struct.pack(">HH", 65_500, 65_500)
    path.write_bytes(data)


def fits(path: Path) -> None:
    cards = [
        "SIMPLE  =                    T",
        "BITPIX  =                   16",
        "NAXIS   =                    2",
    ]
    cards += [f"NAXIS{k}  = {SIDE:20d}" for k in (1, 2)] + ["END"]
    path.write_bytes(
        "".join(card.ljust(80) for card in cards).encode().ljust(2880) + b"\0" * 2880
    )


def npy(path: Path) -> None:
    path.write_bytes(array_header((SIDE, SIDE)) + b"\0" * 1000)


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("f.tiff", tiff),
        ("f.png", png),
        ("g.png", png_below_the_limit_of_pillow),
        ("f.fits", fits),
        ("f.npy", npy),
    ],
)
def test_frames_that_announce_more_pixels_than_the_file_can_have_are_refused(
    name: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    if name.endswith("fits"):
        pytest.importorskip("astropy")
    make(tmp_path / name)
    assert (tmp_path / name).stat().st_size < 10_000
    with pytest.raises(ms.InputError) as caught:
        read_raw(tmp_path / name)
    assert name in str(caught.value) and "\n" not in str(caught.value)


def test_light_that_announces_more_pixels_than_the_file_can_have_is_refused(
    tmp_path: Path,
) -> None:
    exr(tmp_path / "light.exr")
    with pytest.raises(ms.InputError) as caught:
        ms.read_irradiance(tmp_path / "light.exr", unit="w_per_m2", wavelength_nm=550)
    assert "40000000000 unpacked bytes" in str(caught.value)


def zipped(path: Path, name: str, head: bytes, zeros: int = 0) -> None:
    """An archive of one array: its header, and zeros behind it."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(name, "w", force_zip64=True) as file,
    ):
        file.write(head)
        for _ in range(zeros // 2**20):
            file.write(bytes(2**20))


def test_maps_that_unpack_to_far_more_than_their_file_are_refused(tmp_path: Path) -> None:
    """300 MB of zeros in 300 kB; a header of 80 GB before a thousand bytes; and very many arrays."""
    zipped(tmp_path / "zeros.npz", "prnu.npy", array_header((40_000_000,)), 300 * 2**20)
    zipped(tmp_path / "header.npz", "prnu.npy", array_header((SIDE, SIDE)))
    write_fpn_maps(tmp_path / "many.npz", {f"m{k}": np.zeros(1) for k in range(1001)})
    for name in ("zeros.npz", "header.npz", "many.npz"):
        with pytest.raises(ms.InputError, match=re.escape(name)):
            read_fpn_maps(tmp_path / name)


class Malicious:
    """What a pickle would run."""

    def __reduce__(self) -> Any:
        return os.mkdir, ("/nowhere/that/pickle/ran",)


def test_no_pickle_is_loaded(tmp_path: Path) -> None:
    """mkdir of a folder whose parent is missing would raise FileNotFoundError."""
    np.save(tmp_path / "f.npy", np.array([Malicious()], dtype=object), allow_pickle=True)
    (tmp_path / "plain.npz").write_bytes(pickle.dumps(Malicious()))
    np.savez(tmp_path / "maps.npz", prnu=np.array([Malicious()], dtype=object))
    for name, read in (
        ("f.npy", read_raw),
        ("plain.npz", read_fpn_maps),
        ("maps.npz", read_fpn_maps),
    ):
        with pytest.raises(ms.InputError, match="cannot be read") as caught:
            read(tmp_path / name)
        assert "nowhere" not in str(caught.value)


def test_right_files_that_compress_well_are_read(tmp_path: Path) -> None:
    """A constant frame of 4 Mpx has 30 kB, and unpacks to 300 times as much, which is little."""
    frame = np.full((2000, 2000), 64, np.uint16)
    tifffile.imwrite(tmp_path / "f.tiff", frame, compression="zlib")
    np.savez_compressed(tmp_path / "maps.npz", prnu=frame.astype(float))
    np.testing.assert_array_equal(read_raw(tmp_path / "f.tiff").frames[0], frame)
    np.testing.assert_array_equal(read_fpn_maps(tmp_path / "maps.npz")["prnu"], frame)
    assert (tmp_path / "f.tiff").stat().st_size < frame.nbytes / 200


def test_toml_has_a_largest_size_and_a_depth(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    texts = ("x = " + "[" * 5000 + "]" * 5000, "[" + ".".join("a" * 5000) + "]")
    for text in (*texts, "x = " + "9" * 5000, "#" * (2**22 + 1)):
        file.write_text(text)
        for read in (ms.load_camera, read_motion):
            with pytest.raises(ms.InputError) as caught:
                read(file)
            assert len(str(caught.value)) < 300


def set_field(field: str) -> Callable[[Path], object]:
    return lambda path: ms.load_camera("konnik_table1").replace(**{field: str(path)})


PIPES: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys(("a.png", "a.tiff", "a.npy", "a.fits", "b.dng"), read_raw),
    **dict.fromkeys(("c.json", "c.npy", "c.csv", "c.xml", "c.yml", "c.dng"), import_camera),
    "light.exr": ms.read_irradiance,
    "maps.npz": read_fpn_maps,
    "camera.toml": ms.load_camera,
    "motion.toml": read_motion,
    "bench.toml": read_manifest,
    "dataset.toml": read_dataset,
    "scene.xml": lambda path: parse(path, {}),
    "lens.json": set_field("lens.prescription"),
    "lens.zmx": set_field("lens.prescription"),
    "curves.csv": set_field("quantum_efficiency.file"),
    "readouts.tiff": read_readouts,
}


@pytest.mark.parametrize("name", PIPES)
def test_a_pipe_whose_writer_never_comes_is_refused(name: str, tmp_path: Path) -> None:
    """As every reader would wait for it for ever."""
    os.mkfifo(tmp_path / name)
    with pytest.raises(ms.InputError, match=re.escape(name)):
        PIPES[name](tmp_path / name)


def laughs(levels: int) -> str:
    """YAML of some hundred bytes whose lists hold 9 aliases each."""
    names = "abcdefghijklmnopqrstuvwxyz"
    first = "a: &a [x,x,x,x,x,x,x,x,x]\n"
    return first + "".join(
        f"{n}: &{n} [{','.join([f'*{m}'] * 9)}]\n"
        for m, n in zip(names, names[1:levels], strict=False)
    )


ENTITY = '<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
STORAGE = "<opencv_storage>{}</opencv_storage>"
TEXT_BOMBS = {
    "aliases": ("a.yml", laughs(12)),
    "an alias of itself": ("a.yml", "camera_matrix: &a [*a]\n"),
    "deep YAML": ("a.yml", "a: " + "[" * 100_000),
    "entities": ("a.xml", f"{ENTITY}{STORAGE.format('&b;')}"),
    "entities of a report": ("a.xml", f"{ENTITY}<report>&b;</report>"),
    "an entity that is a file": (
        "a.xml",
        "<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/passwd'>]><report>&b;</report>",
    ),
    "deep XML": ("a.xml", "<report>" + "<a>" * 100_000),
    "deep OpenCV XML": ("a.xml", STORAGE.format("<a>" * 50 + "</a>" * 50)),
    "deep JSON": ("a.json", "[" * 100_000),
    "deep tables of JSON": ("a.json", '{"a":' * 40 + "1" + "}" * 40),
    "an integer of 4 MB": ("a.json", '{"algorithms": ' + "9" * 4_000_000 + "}"),
    "a long key": ("a.toml", f"[{'.'.join('a' * 1_000_000)}]"),
    "a long key behind a string": (
        "a.toml",
        'x = ["""a"""", {' + ".".join("k" * 1_000_000) + ' = 1}, "b"]',
    ),
    "a long quoted key": ("a.toml", ".".join(['"a"'] * 300_000) + " = 1"),
}


@pytest.mark.parametrize("name", TEXT_BOMBS)
def test_texts_that_expand_or_nest_without_end_are_refused(name: str, tmp_path: Path) -> None:
    """The aliases asked for 12 GB, the long key for minutes."""
    file, text = TEXT_BOMBS[name]
    (tmp_path / file).write_text(text)
    with pytest.raises(ms.InputError, match=file) as caught:
        import_camera(tmp_path / file)
    assert len(str(caught.value)) < 600 and "\n" not in str(caught.value)
    assert "sys." not in str(caught.value)


@pytest.mark.parametrize("read", [ms.load_camera, read_dataset, read_motion])
def test_thousands_of_unknown_keys_are_one_sentence(
    read: Callable[[Path], object], tmp_path: Path
) -> None:
    """The time once grew with the square of their number."""
    table = "[camera]\n" if read is read_motion else ""
    (tmp_path / "a.toml").write_text(table + "".join(f"kez{k} = 1\n" for k in range(1000)))
    with pytest.raises(ms.InputError) as caught:
        read(tmp_path / "a.toml")
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    "read", [ms.load_camera, read_motion, read_dataset, read_manifest, ms.check_camera]
)
def test_every_toml_is_read_within_limits(read: Callable[[Path], Any], tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f"[{'.'.join('a' * 1_000_000)}]\n")
    try:
        said = " ".join(map(str, read(tmp_path / "a.toml")))
    except ms.InputError as error:
        said = str(error)
    assert "a key has more than 32 parts" in said


def test_a_key_of_32_parts_and_texts_with_dots_are_read() -> None:
    dots = ".".join("a" * 1000)
    text = f'{".".join("a" * 31)} = 1\nb = \'{dots}\'\nc = """\n{dots} = 1\n"""\n# {dots}\nd = [1.5, 2.5]\n'
    assert toml_tables(text) == tomllib.loads(text)
    with pytest.raises(tomllib.TOMLDecodeError, match="32"):
        toml_tables(f"{'.'.join('a' * 33)} = 1")


def test_a_film_of_more_pixels_than_can_be_rendered_is_refused(tmp_path: Path) -> None:
    film = '<integer name="crop_width" value="100000"/><integer name="crop_height" value="100000"/>'
    text = (
        scene_text(SKY, film=film)
        .replace('value="12"', 'value="100000"')
        .replace('value="8"', 'value="100000"')
    )
    with pytest.raises(ms.InputError, match="has a film of 100000 × 100000 pixels"):
        render_aovs(
            write_scene(tmp_path, text),
            ms.load_camera("konnik_table1"),
            variant="scalar_spectral",
        )


NESTED = "".join(
    f'<default name="{name}" value="{10 * ("$" + inner)}"/>'
    for inner, name in itertools.pairwise("abcdefghijklm")
)
EXPANDING = {
    "parameters of parameters": {"scene": f'<default name="a" value="0123456789"/>{NESTED}'},
    "includes of includes": {
        name: f'<include filename="{inner}.xml"/>' * 20
        for name, inner in itertools.pairwise(("scene", *"abcdefgh"))
    },
    "an include of itself": {"scene": '<include filename="scene.xml"/>'},
}


@pytest.mark.parametrize("name", EXPANDING)
@pytest.mark.parametrize(
    "read",
    [
        lambda path: parse(path, {"variant": "scalar_spectral"}),
        lambda path: scene_references(path, {}),
    ],
    ids=["parsed", "looked through"],
)
def test_scenes_that_expand_without_end_are_refused(
    name: str, read: Callable[[Path], Any], tmp_path: Path
) -> None:
    """A thousand bytes asked for 10 GB and more; the last file of the includes has a sensor."""
    (tmp_path / "h.xml").write_text(scene_text(""))
    for file, inside in EXPANDING[name].items():
        text = f'<scene version="3.0.0">{inside}</scene>'
        (tmp_path / f"{file}.xml").write_text(text)
    with pytest.raises(ms.InputError, match=r"give each parameter a plain value|flatten"):
        read(tmp_path / "scene.xml")


@pytest.mark.parametrize("make", [exr, png, jpeg])
def test_textures_that_announce_more_pixels_than_the_file_can_have_are_refused(
    make: Callable[[Path], None], tmp_path: Path
) -> None:
    """Mitsuba takes the memory before it reads."""
    make(tmp_path / "sky")
    sky = '<emitter type="envmap"><string name="filename" value="sky"/></emitter>'
    with pytest.raises(ms.InputError, match=r"announces \d+ unpacked bytes"):
        render_aovs(
            write_scene(tmp_path, scene_text(sky)),
            ms.load_camera("konnik_table1"),
            variant="scalar_spectral",
        )
