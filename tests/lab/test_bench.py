"""Raw frames from disk: every format as another program writes it, what belongs together, and what is refused."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from matplotlib.figure import Figure
from PIL import Image, TiffImagePlugin

import mitsuba_sensor as ms
from mitsuba_sensor.files.raw_files import read_raw
from mitsuba_sensor.lab.frames.bench import read_bench

FRAMES = np.random.default_rng(3).integers(0, 4096, (3, 6, 8), dtype=np.uint16)


def _as_fits(path: Path, frame: np.ndarray) -> None:
    image = fits.PrimaryHDU(frame)
    image.header.update(
        {
            "EXPTIME": 0.25,
            "CCD-TEMP": -10.0,
            "GAIN": 120,
            "BAYERPAT": "RGGB",
            "IMAGETYP": "Dark Frame",
        }
    )
    image.writeto(path)


def _as_dng(path: Path, frame: np.ndarray) -> None:
    """A DNG with the tags that its specification asks for, and no more."""
    tags = [
        (33421, 3, 2, (2, 2), False),  # CFARepeatPatternDim
        (33422, 1, 4, bytes([0, 1, 1, 2]), False),  # CFAPattern
        (50706, 1, 4, bytes([1, 4, 0, 0]), False),  # DNGVersion
        (50708, 2, 0, "a camera", False),  # UniqueCameraModel
        (50717, 4, 1, 4095, False),  # WhiteLevel
        (
            50721,
            10,
            9,
            tuple(x for i in range(9) for x in (int(i % 4 == 0), 1)),
            False,
        ),  # ColorMatrix1
        (50728, 5, 3, (1, 1) * 3, False),  # AsShotNeutral
        (33434, 5, 1, (1, 50), False),  # ExposureTime
    ]
    tifffile.imwrite(path, frame, photometric=32803, extratags=tags, metadata=None)


WRITERS: dict[str, Callable[[Path, np.ndarray], None]] = {
    "a.tif": tifffile.imwrite,
    "a.png": lambda path, frame: Image.fromarray(frame).save(path),
    "a.npy": np.save,
    "a.fits": _as_fits,
    "a.dng": lambda path, frame: _as_dng(
        path, np.tile(frame, (8, 8))
    ),  # LibRaw refuses tiny pictures
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_back_each_value_that_another_program_wrote(
    tmp_path: Path, name: str
) -> None:
    WRITERS[name](tmp_path / name, FRAMES[0])
    found = read_raw(tmp_path / name).frames
    np.testing.assert_array_equal(found[0, :6, :8], FRAMES[0])
    assert found.dtype == np.uint16 and len(found) == 1


@pytest.mark.usefixtures("few_windows")
def test_frames_of_this_package_are_a_bench_without_a_line_of_manifest(tmp_path: Path) -> None:
    """Photons of a flat field come from frame.json if they are alike in all pixels, and are photons."""
    camera = ms.load_camera("bayer_2mp")
    dark, even = np.zeros((6, 8)), np.full((6, 8), 500.0)
    lights = {
        "bias": (dark, 0.0), "dark_1s": (dark, 1.0), "dark_2s": (dark, 2.0), "flat": (even, 0.01),
        "flat_uneven": (even * np.linspace(0.9, 1.1, 8), 0.02),
        "flat_electrons": (ms.Photons(even, detected=True), 0.03),
    }  # fmt: skip
    for name, (light, exposure_s) in lights.items():
        frames = ms.expose(light, camera, ms.Exposure(exposure_s, 300), frames=3, origin=(1, 0))
        frames.save(tmp_path / name)
    bench = read_bench(tmp_path)
    assert [stack.exposure_s for stack in bench.stacks] == [0, 1, 2, 0.01, 0.02, 0.03]
    assert [len(stack) for stack in bench.stacks] == [3] * 6 and not bench.scenes
    assert all(stack.dark for stack in bench.darks)
    assert [flat.photons for flat in bench.flats] == [500.0, None, None]
    (note,) = bench.notes
    assert "photons vary by more than 10 % over the pixels of 1 flat fields" in note
    assert {(stack.bits, stack.temperature_k) for stack in bench.stacks} == {(12, 300)}
    assert bench.flats[0].tile == (("G", "B"), ("R", "G"))
    np.testing.assert_array_equal(bench.flats[2].frames, frames.digital)


def _folder(tmp_path: Path) -> Path:
    for number, frame in enumerate(FRAMES):
        np.save(tmp_path / f"dark_{number}.npy", frame)
        np.save(tmp_path / f"light_{number}.npy", frame + 1)
    return tmp_path


def test_a_manifest_says_what_the_files_do_not(tmp_path: Path) -> None:
    folder, read = _folder(tmp_path), list[tuple[int, int]]()
    (folder / "bench.toml").write_text(
        """
        bits = 12
        wavelength_nm = 550
        [[stack]]
        files = "dark_*.npy"
        kind = "dark"
        exposure_s = 0.5
        gain = 800
        [[stack]]
        files = ["light_0.npy", "light_2.npy"]
        kind = "flat"
        exposure_s = 0.5
        gain = 100
        photons = 1234.5
        temperature_k = 300
        """
    )
    bench = read_bench(folder, lambda *done: read.append(done))
    assert (
        read == [(n, 5) for n in range(1, 6)]
        and bench.wavelength_nm == 550
        and bench.gains == ("100", "800")
    )
    np.testing.assert_array_equal(bench.darks[0].frames, FRAMES)
    np.testing.assert_array_equal(bench.flats[0].frames, FRAMES[[0, 2]] + 1)
    assert (
        bench.flats[0].photons == 1234.5
        and bench.at_gain("800").flats == ()
        and bench.darks[0].bits == 12
    )


STACK = 'kind = "dark"\nexposure_s = 1\n'
WRONG = {
    "bits = 12": "has no [[stack]]",
    "stack = [1]": "has no [[stack]]",
    "[[stack]": "is not a manifest in TOML: ",
    f'[[stack]]\n{STACK}file = "a"': "Did you mean 'files'?",
    f'[[stack]]\n{STACK}files = "a*"': "stack 1: no file in ",
    f"[[stack]]\n{STACK}": "files is missing",
    f"[[stack]]\n{STACK}files = 3": "files is 3",
    '[[stack]]\nfiles = "d*.npy"\nkind = "drak"': "kind is 'drak'",
    '[[stack]]\nfiles = "d*.npy"\nkind = "dark"\nexposure_s = -1': "exposure_s is -1",
    '[[stack]]\nfiles = "d*.npy"\nkind = "dark"\nexposure_s = nan': "exposure_s is nan",
    '[[stack]]\nfiles = "d*.npy"\nkind = "dark"': "does not state its exposure time",
    f'bits = 99\n[[stack]]\nfiles = "d*.npy"\n{STACK}': "bits is 99",
}


def test_a_wrong_manifest_is_one_sentence(tmp_path: Path) -> None:
    folder = _folder(tmp_path)
    for text, sentence in WRONG.items():
        (folder / "bench.toml").write_text(text)
        with pytest.raises(ms.InputError) as error:
            read_bench(folder)
        assert sentence in str(error.value) and "bench.toml" in str(error.value)


def flat_fields(folder: Path, names: list[str]) -> None:
    """Bias, dark and flat fields of equal exposure, each level of light in files called by one of the names."""
    rng = np.random.default_rng(7)
    for name, electrons in (
        ("bias/a", 0),
        ("dark/a", 0),
        *zip(names, (1e3, 2e3, 4e3), strict=True),
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        for number in range(2):
            frame = np.rint(
                100 + 0.1 * rng.poisson(electrons, (64, 64)) + rng.normal(0, 2, (64, 64))
            )
            header = fits.Header({"EXPTIME": 0.1})
            fits.writeto(folder / f"{name}_{number}.fits", frame.astype(np.uint16), header)


def test_pictures_of_flat_fields_that_show_nothing_are_drawn_all_the_same() -> None:
    """One level: no K, so that the signal-to-noise ratio has no number above 0 on its logarithmic axes."""
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
    frames = ms.expose(np.full((40, 48), 5000.0), camera, exposure, frames=4).digital
    dark = ms.expose(np.zeros((40, 48)), camera, exposure, frames=4, seed=2).digital
    stack = ms.lab.Stack
    (measured,) = ms.lab.measure_bench(
        ms.lab.Bench((), (stack(dark, 0.1),), (stack(frames, 0.1),))
    )
    assert np.isnan(measured.figures["K"].value)
    for draw in (draw for title, draw in measured.drawings.items() if "logarithmic" in title):
        figure = Figure()
        draw(figure.subplots())
        figure.savefig(BytesIO())


def test_metadata_are_exposure_temperature_gain_and_mosaic(tmp_path: Path) -> None:
    """Of FITS, DNG, and the EXIF of a TIFF; pages are frames, and 8 bits stay 8."""
    for name in ("a.fits", "a.dng"):
        WRITERS[name](tmp_path / name, FRAMES[0])
    cold, raw = read_raw(tmp_path / "a.fits"), read_raw(tmp_path / "a.dng")
    assert (cold.exposure_s, cold.temperature_k, cold.gain) == (0.25, 263.15, "120")
    assert cold.kind == "dark" and cold.tile == raw.tile == (("R", "G"), ("G", "B"))
    assert raw.exposure_s == pytest.approx(0.02) and raw.bits == 12
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[34665] = {33434: TiffImagePlugin.IFDRational(1, 50), 34855: 400}  # ExposureTime, ISO
    Image.fromarray(FRAMES[0]).save(tmp_path / "a.tiff", tiffinfo=tags)
    found = read_raw(tmp_path / "a.tiff")
    assert (found.exposure_s, found.gain) == (0.02, "400")
    tifffile.imwrite(tmp_path / "b.tiff", FRAMES, photometric="minisblack")
    np.testing.assert_array_equal(read_raw(tmp_path / "b.tiff").frames, FRAMES)
    Image.fromarray(FRAMES[0].astype(np.uint8)).save(tmp_path / "b.png")
    assert read_raw(tmp_path / "b.png").frames.dtype == np.uint8


def test_folders_of_flat_fields_of_equal_exposure_are_levels_of_light(tmp_path: Path) -> None:
    """Levels in one folder are told apart by the user alone."""
    flat_fields(tmp_path / "good", ["flat_1/a", "flat_2/a", "flat_3/a"])
    bench = read_bench(tmp_path / "good")
    means = sorted(float(flat.frames.mean()) for flat in bench.flats)
    assert means == pytest.approx([200, 300, 500], abs=1)
    assert [len(flat.frames) for flat in bench.flats] == [2, 2, 2]
    flat_fields(tmp_path / "bad", ["flat/1", "flat/2", "flat/3"])
    with pytest.raises(ms.InputError, match=r"means from 200 to 500"):
        read_bench(tmp_path / "bad")


BROKEN: dict[str, tuple[dict[str, bytes | np.ndarray], str]] = {
    "other size": (
        {"dark_a.npy": FRAMES[0], "dark_b.npy": FRAMES[0][:4]},
        "shape of dark_a.npy",
    ),
    "other type": (
        {"dark_a.npy": FRAMES[0], "dark_b.npy": FRAMES[0] * 1.0},
        "type of dark_a.npy",
    ),
    "numpy": ({"dark_b.npy": b"\x93NUMPY\x01"}, "cannot be read: .*; omit it"),
    "tiff": ({"dark_b.tiff": b"II*\0"}, "cannot be read: .*; omit it"),
    "png": ({"dark_b.png": b"\x89PNG"}, "cannot be read: .*; omit it"),
    "dng": ({"dark_b.dng": b"II*\0"}, "cannot be read: .*; omit it"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_files_that_are_not_alike_or_broken_are_named(tmp_path: Path, name: str) -> None:
    files, said = BROKEN[name]
    for file, content in files.items():
        if isinstance(content, bytes):
            (tmp_path / file).write_bytes(content)
        else:
            np.save(tmp_path / file, content)
    (tmp_path / "bench.toml").write_text(f'[[stack]]\nfiles = "dark_*"\n{STACK}')
    with pytest.raises(ms.InputError, match=said):
        read_bench(tmp_path)


def test_what_no_name_tells_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(ms.InputError, match="holds no raw frames"):
        read_bench(tmp_path)
    np.save(tmp_path / "x.npy", FRAMES[0])
    with pytest.raises(ms.InputError, match=r"x.npy: is it one of bias, dark, flat, scene"):
        read_bench(tmp_path)
    with pytest.raises(ms.InputError, match=r"there is no .*nowhere"):
        read_bench(tmp_path / "nowhere")
    Image.new("RGB", (4, 4)).save(tmp_path / "y.png")
    for file, said in (
        ("y.png", "3 values per pixel"),
        ("z.jpg", "has an unknown format; give one of .tif"),
    ):
        with pytest.raises(ms.InputError, match=said):
            read_raw(tmp_path / file)


def test_frames_of_many_files_stay_on_disk(tmp_path: Path) -> None:
    """24 files of 0.5 MiB are read, joined and measured in less than 5 MiB."""
    frames = np.random.default_rng(9).integers(90, 110, (24, 512, 512), dtype=np.uint16)
    for number, frame in enumerate(frames):
        tifffile.imwrite(tmp_path / f"dark_{number:02}.tif", frame)
    (tmp_path / "bench.toml").write_text(f'[[stack]]\nfiles = "dark_*"\n{STACK}')
    tracemalloc.start()
    try:
        (dark,) = read_bench(tmp_path).darks
        found = dark.changes
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 5 * 2**20
    np.testing.assert_array_equal(dark.frames, frames)
    centred = frames - frames.mean(axis=(1, 2), keepdims=True)
    assert found.variance == pytest.approx(centred.var(axis=0, ddof=1).mean(), rel=1e-5)
