"""What a notebook sees: public names, objects that show themselves, frames and light in a few calls."""

from __future__ import annotations

import base64
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive
from helpers.scenes import SCENES
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.bench.virtual_bench import Setup, virtual_bench

MONO, BAYER, RGBIR = (
    ms.load_camera(name) for name in ("konnik_table1", "bayer_2mp", "rgbir_2mp")
)
EXPOSURE = ms.Exposure(0.01)
MOST_BYTES = 300_000
VOID = ("img",)  # elements without an end


class Page(HTMLParser):
    """Fails where an element is not closed; collects text and pictures."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open, self.text, self.tags = list[str](), "", list[str]()
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data + "\n"


def shown(thing: Any) -> tuple[Page, np.ndarray]:
    """The page of an object, and its picture."""
    html = thing._repr_html_()
    assert len(html.encode()) < MOST_BYTES
    found = re.findall(r"base64,([^\"]+)", html)
    return Page(html), np.array(
        Image.open(io.BytesIO(base64.b64decode(found[0])))
    ) if found else np.empty(0)


def noisy(camera: ms.Camera, shape: tuple[int, int], **options: Any) -> ms.Frames:
    photons = np.random.default_rng(1).uniform(0, 3e4, (*shape, 1))
    return ms.expose(photons, camera, EXPOSURE, wavelengths_nm=[550.0], **options)


@pytest.mark.parametrize(
    "camera", [BAYER, *map(exhaustive, (MONO, RGBIR))], ids=lambda camera: camera.name
)
@pytest.mark.parametrize("shape", [(1, 1), (3, 3), (1, 1900), (240, 250), (700, 300)])
def test_frames_of_any_shape_show_their_first_one(
    camera: ms.Camera, shape: tuple[int, int]
) -> None:
    """Small frames are the preview itself, pixel by pixel; larger ones have its proportions."""
    frames = noisy(camera, shape)
    page, picture = shown(frames)
    assert camera.name in page.text and f"1 × {shape[1]} × {shape[0]} pixels" in page.text
    if shape[0] * shape[1] < 60_000:
        np.testing.assert_array_equal(picture, frames.preview())
    else:
        assert picture.shape[0] / picture.shape[1] == pytest.approx(
            shape[0] / shape[1], rel=0.05
        )


def test_no_text_becomes_an_element() -> None:
    named = BAYER.replace(name="<script>&\"'", description="<b>bold</b>")
    frames = noisy(named, (4, 4))
    plan = ms.plan(named, EXPOSURE, frames.light)
    for one in (named, frames, plan):
        page, _ = shown(one)
        assert "<script>&\"'" in page.text and "script" not in page.tags
    assert "<b>bold</b>" in shown(named)[0].text


def test_camera_plan_and_budget_show_their_numbers() -> None:
    frames = noisy(MONO, (16, 16))
    plan, budget = (
        ms.plan(MONO, EXPOSURE, frames.light, tolerance_dn=0.02),
        frames.noise_budget(),
    )
    for effect in plan.effects:
        assert (
            f"{effect.stage}\n{'kept' if effect.kept else 'left out'}\n" in shown(plan)[0].text
        )
    for row in budget.rows:
        text = " ".join(shown(budget)[0].text.split())
        assert " ".join((row.source, *row.cells)) in text
    assert all(
        text in shown(MONO)[0].text
        for text in ("1900 × 1300 pixels", "33000 e-", "12 bits", "f/2.8")
    )


def test_figures_and_measurements_show_their_numbers() -> None:
    figures = MONO.emva1288()
    for one in figures.table():
        assert " ".join((one.name, one.symbol, f"{one.value:.4g}")) in " ".join(
            shown(figures)[0].text.split()
        )
    camera = MONO.replace(**{"sensor.rows": 24, "sensor.columns": 32})
    (measured,) = ms.lab.measure_bench(virtual_bench(camera, Setup()))
    assert len(repr(measured)) < 160 and "\n" not in repr(measured)
    text = " ".join(shown(measured)[0].text.split())
    gain = measured.figures["K"]
    assert f"K {gain.name} {gain.shown} {gain.low:.4g} to {gain.high:.4g}" in text


def test_light_of_one_wavelength_is_grey_and_of_the_visible_has_its_colour(light: Any) -> None:
    """A red band beside dark ones is red; in a single band nothing is known of colours."""
    data = np.zeros((4, 5, 3), np.float32)
    data[..., 2] = 1e-5
    red = replace(
        light,
        data=data,
        wavelengths_nm=np.array([450.0, 550.0, 620.0]),
        bandwidths_nm=np.full(3, 10.0),
    )
    page, picture = shown(red)
    assert "5 × 4 pixels" in page.text
    assert (picture[..., 0] == 255).all() and (picture[..., 1:] < 100).all()
    one = replace(
        light,
        data=data[..., 2:],
        wavelengths_nm=np.array([850.0]),
        bandwidths_nm=np.array([10.0]),
    )
    assert shown(one)[1].shape == (4, 5)


@pytest.fixture(scope="module")
def taken() -> ms.Capture:
    scene = str(SCENES / "color_checker.xml")
    return ms.capture(scene, BAYER, ms.Exposure(0.02, 310.0), serial=9, seed=4, spp=4, width=24)


def test_a_preview_is_the_frame_png_in_the_light_of_the_scene(
    taken: ms.Capture, tmp_path: Path
) -> None:
    taken.save(tmp_path)
    np.testing.assert_array_equal(
        np.array(Image.open(tmp_path / "frame.png")), taken.frames.preview()
    )
    alone = noisy(BAYER, (6, 6))
    assert (
        alone.preview(gain=2.0).mean() > alone.preview().mean()
    ) and alone.light.illuminant is None


def test_frames_save_what_a_capture_saves_but_the_light(
    taken: ms.Capture, tmp_path: Path
) -> None:
    taken.save(tmp_path / "capture")
    taken.frames.save(tmp_path / "frames")
    for name in ("frame.tiff", "frame.png"):
        assert (tmp_path / "frames" / name).read_bytes() == (
            tmp_path / "capture" / name
        ).read_bytes()
    frames, whole = (
        json.loads((tmp_path / one / "frame.json").read_text()) for one in ("frames", "capture")
    )
    same = set(frames) - {"notes", "counts"}
    assert {"camera", "exposure", "seeds", "image", "colour", "stages"} < same
    assert {name: frames[name] for name in same} == {name: whole[name] for name in same}


def test_no_clean_frame_of_an_older_capture_stays_beside_frames_that_are_saved(
    taken: ms.Capture, tmp_path: Path
) -> None:
    ms.capture(taken.light, clean=True).save(tmp_path)
    assert (tmp_path / "clean.tiff").exists() and (tmp_path / "temporal_variance.tiff").exists()
    taken.frames.save(tmp_path)
    assert sorted(one.name for one in tmp_path.iterdir()) == [
        "frame.json",
        "frame.png",
        "frame.tiff",
        "frame_brightened.png",
    ]


def test_frames_are_saved_all_or_none(tmp_path: Path) -> None:
    (tmp_path / "frame.json").mkdir()
    with pytest.raises(ms.InputError, match=r"frame\.json is a folder"):
        noisy(MONO, (4, 4)).save(tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == ["frame.json"]


def test_an_exposure_of_light_is_that_of_its_photons(taken: ms.Capture) -> None:
    """Camera, exposure and serial number as rendered, or as told; the seed is the exposure's own."""
    light = taken.light
    np.testing.assert_array_equal(ms.expose(light, seed=4).digital, taken.frames.digital)
    np.testing.assert_array_equal(next(ms.stream(light, seed=4)), taken.frames.digital[0])
    other = ms.expose(ms.collect(light, BAYER, EXPOSURE), BAYER, EXPOSURE, serial=2)
    np.testing.assert_array_equal(
        ms.expose(light, BAYER, EXPOSURE, serial=2).digital, other.digital
    )
    sensor = ms.Sensor(BAYER, serial=2)
    np.testing.assert_array_equal(sensor.expose(light, EXPOSURE).digital, other.digital)
