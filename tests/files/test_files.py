"""Files that are written can be read back, and appear whole or not at all."""

from __future__ import annotations

import json
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import colour
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

from mitsuba_sensor import InputError
from mitsuba_sensor.files import png, texts, tiff
from mitsuba_sensor.output import exr


def test_irradiance_comes_back_exactly(light: Any, light_file: Path) -> None:
    back = exr.read_irradiance_exr(light_file)
    assert back.statistics == light.statistics
    for field in fields(light):
        if field.name != "statistics":
            found, wanted = getattr(back, field.name), getattr(light, field.name)
            if field.name == "standard_error":  # in half precision
                np.testing.assert_allclose(found, wanted, rtol=2.0**-11)
            else:
                np.testing.assert_array_equal(found, wanted, err_msg=field.name)


def test_raw_light_comes_back_from_its_own_layer(light: Any, tmp_path: Path) -> None:
    """And neither this reader nor colour-science takes it for the light."""
    done = {"by": "a filter", "raw_weight": 0.5}
    raw = replace(light, data=2 * light.data, in_band=light.relative_error)
    both = replace(
        raw, data=light.data, statistics=replace(light.statistics, denoised=done), raw=raw
    )
    exr.write_irradiance_exr(tmp_path / "x.exr", both)
    back = exr.read_irradiance_exr(tmp_path / "x.exr")
    np.testing.assert_array_equal(back.data, light.data)
    assert back.statistics.denoised == done and back.raw is not None
    assert back.before_denoising().data is back.raw.data
    np.testing.assert_array_equal(back.raw.data, raw.data)
    np.testing.assert_array_equal(back.raw.in_band, raw.in_band)
    assert back.raw.statistics == raw.statistics
    bands = colour.read_spectral_image_Fichet2021(str(tmp_path / "x.exr"))
    np.testing.assert_array_equal(bands["S0"][1][..., np.argsort(bands["S0"][0])], light.data)


def test_infinite_and_tiny_irradiance_comes_back_exactly(light: Any, tmp_path: Path) -> None:
    data = light.data.copy()
    data[0, 0], data[1, 1], data[2, 2] = (
        np.inf,
        np.finfo(np.float32).smallest_subnormal,
        np.finfo(np.float32).max,
    )
    exr.write_irradiance_exr(tmp_path / "x.exr", type(light)(**{**vars(light), "data": data}))
    np.testing.assert_array_equal(exr.read_irradiance_exr(tmp_path / "x.exr").data, data)


@pytest.mark.parametrize("power", [0, -80, 60])
def test_half_precision_rounds_by_one_part_in_2048(
    light: Any, tmp_path: Path, power: int
) -> None:
    """However dim or bright the light is; infinite pixels stay infinite, and what is not half stays as it is."""
    factor = np.float32(2.0**power)
    data = light.data * factor
    data[0, 0] = np.inf
    asked = replace(
        light,
        data=data,
        standard_error=light.standard_error * factor,
        pass_error=light.relative_error * 3,
    )
    exr.write_irradiance_exr(tmp_path / "x.exr", asked, half=True)
    back = exr.read_irradiance_exr(tmp_path / "x.exr")
    for name in ("data", "standard_error"):
        wanted, found = getattr(asked, name), getattr(back, name)
        assert found.dtype == np.float32
        finite = np.isfinite(wanted) & (wanted > wanted[np.isfinite(wanted)].max() * 2.0**-28)
        np.testing.assert_allclose(found[finite], wanted[finite], rtol=2.0**-11, atol=0)
        assert (np.isinf(found) == np.isinf(wanted)).all()
    assert np.abs(back.data[1:] / asked.data[1:] - 1).max() > 1e-5  # rounded indeed
    np.testing.assert_array_equal(back.relative_error, asked.relative_error)
    np.testing.assert_array_equal(back.pass_error, asked.pass_error)
    with OpenEXR.File(str(tmp_path / "x.exr"), separate_channels=True) as file:
        unit = float(file.header()["emissiveUnits"].split()[0])
        band = next(name for name in file.channels() if name.startswith("S0."))
        pixels = file.channels()[band].pixels
    assert pixels.dtype == np.float16
    number = list(light.wavelengths_nm).index(float(band[3:-2].replace(",", ".")))
    np.testing.assert_allclose(
        pixels[1:].astype(float) * unit, asked.data[1:, :, number], rtol=2.0**-11
    )


def test_colour_science_reads_our_bands(light: Any, light_file: Path) -> None:
    bands, specification = colour.read_spectral_image_Fichet2021(
        str(light_file), additional_data=True
    )
    assert specification.is_emissive and not specification.is_polarised
    assert list(bands) == ["S0"], "the standard errors must not be taken for light"
    wavelengths_nm, values = bands["S0"]
    order = np.argsort(wavelengths_nm)
    np.testing.assert_array_equal(wavelengths_nm[order], light.wavelengths_nm)
    np.testing.assert_array_equal(values[..., order], light.data)
    attributes = {attribute.name: attribute.value for attribute in specification.attributes}
    assert attributes["spectralLayoutVersion"] == "1.0"
    assert attributes["emissiveUnits"] == "W.m^-2.nm^-1"


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32])
def test_tiff_holds_every_code_of_every_frame(tmp_path: Path, kind: type) -> None:
    frames = np.random.default_rng(1).integers(
        0, np.iinfo(kind).max, (3, 5, 7), dtype=kind, endpoint=True
    )
    tiff.write_tiff(tmp_path / "x.tiff", frames)
    back = tifffile.imread(tmp_path / "x.tiff")
    assert back.dtype == kind
    np.testing.assert_array_equal(back, frames)


def test_a_tiff_takes_facts_in_any_script(tmp_path: Path) -> None:
    facts = {"black_level_dn": 4.0, "white_level_dn": 255, "cfa_pattern": [["grün", "緑"]]}
    tiff.write_tiff(tmp_path / "x.tiff", np.zeros((2, 3), dtype=np.uint8), facts)
    with tifffile.TiffFile(tmp_path / "x.tiff") as file:
        assert json.loads(file.pages.first.description) == facts


@pytest.mark.parametrize("shape", [(4, 6), (4, 6, 3)])
def test_png_holds_the_picture(tmp_path: Path, shape: tuple[int, ...]) -> None:
    picture = np.random.default_rng(1).integers(0, 255, shape, dtype=np.uint8)
    png.write_png(tmp_path / "x.png", picture)
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "x.png")), picture)


@pytest.mark.parametrize("columns", [16, 17, 31, 40, 60, 96, 128, 384])
@pytest.mark.parametrize(
    "caption", ["2 x brighter", "32768 x brighter than exposed (15 stops)"]
)
def test_a_caption_is_whole_below_a_picture_of_any_width(columns: int, caption: str) -> None:
    """All the ink that its words have where there is room; the picture is itself, each pixel a square."""
    picture = np.random.default_rng(1).integers(0, 255, (5, columns, 3), dtype=np.uint8)
    shown = png.captioned(picture, caption)
    factor = shown.shape[1] // columns
    assert shown.shape[1] == factor * columns and (factor == 1 or columns < 96)
    np.testing.assert_array_equal(shown[: 5 * factor : factor, ::factor], picture)
    lines = shown[5 * factor :]
    words = [png.captioned(np.zeros((1, 1000), np.uint8), word)[1:] for word in caption.split()]
    ink = sum(word.sum(dtype=float) for word in words)
    assert lines[..., 0].sum(dtype=float) == pytest.approx(ink, rel=0.05)
    assert not lines[:, -1].any()


def test_json_is_strict_whatever_stands_in_the_report(tmp_path: Path) -> None:
    report = {
        "nan": float("nan"),
        "inf": np.float64("inf"),
        "array": np.arange(3),
        "path": Path("a"),
        "λ": (1, True),
    }
    texts.write_json(tmp_path / "x.json", report)
    back = json.loads(
        (tmp_path / "x.json").read_text(encoding="utf-8"), parse_constant=pytest.fail
    )
    assert back == {"nan": None, "inf": None, "array": [0, 1, 2], "path": "a", "λ": [1, True]}


def test_what_is_not_our_exr_or_cut_short_is_refused(light_file: Path, tmp_path: Path) -> None:
    whole = light_file.read_bytes()
    wrong = {
        str(length): whole[:length] for length in (6, 200, len(whole) // 2, len(whole) - 1)
    }
    for name, content in {**wrong, "text": b"hello"}.items():
        (tmp_path / name).write_bytes(content)
    kind = {"type": OpenEXR.scanlineimage}
    with OpenEXR.File(kind, {"Y": np.ones((4, 4), np.float32)}) as file:
        file.write(str(tmp_path / "strange"))
    for name in (*wrong, "text", "strange", "missing", "."):
        with pytest.raises(InputError, match=re.escape(str(tmp_path / name))):
            exr.read_irradiance_exr(tmp_path / name)


@pytest.mark.parametrize("half", [False, True])
def test_an_exr_that_is_written_some_rows_at_a_time_is_the_same_file(
    light: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half: bool
) -> None:
    images = ("data", "standard_error", "relative_error", "in_band", "pass_error")
    found = {name: getattr(light, name) for name in images}
    tall = replace(
        light,
        **{name: None if x is None else np.repeat(x, 4, axis=0) for name, x in found.items()},
    )
    exr.write_irradiance_exr(tmp_path / "once.exr", tall, half)
    monkeypatch.setattr("mitsuba_sensor.files.openexr.VALUES_AT_ONCE", 1)
    exr.write_irradiance_exr(tmp_path / "strips.exr", tall, half)
    assert (tmp_path / "strips.exr").read_bytes() == (tmp_path / "once.exr").read_bytes()
