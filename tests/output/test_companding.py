"""Companding by a table of knees and back: in files, through LibRaw, and from tuning files of libcamera."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rawpy
import tifffile

import mitsuba_sensor as ms
from mitsuba_sensor.camera.companding import CompandingSection
from mitsuba_sensor.output.dng import linearization_table, steps_of_table
from mitsuba_sensor.output.importers.import_camera import import_camera

KNEES = [[0, 0], [1_023, 1_023], [16_383, 2_559], [1_048_575, 4_095]]
SHORT = ms.Exposure(0.01)
READOUTS = [
    {"name": "high", "fields": {"readout.gain_dn_per_e": 1.6, "adc.black_level_dn": 64}},
    {"name": "low", "fields": {"readout.gain_dn_per_e": 0.01, "adc.black_level_dn": 64}},
]


def hdr(name: str = "bayer_2mp", **changes: Any) -> ms.Camera:
    values = {"pixel.full_well_e": 400_000.0, "adc.bits": 12, "readouts": READOUTS}
    return ms.load_camera(name).replace(**{**values, "companding.knees": KNEES, **changes})


def test_a_code_that_is_companded_and_expanded_is_within_half_a_step_of_its_line() -> None:
    section = CompandingSection(bits=12, knees=tuple(map(tuple, KNEES)))
    codes = np.unique(np.geomspace(1, 1_048_575, 20_000).astype(np.uint32))
    back = section.expand(section.compand(codes)).astype(float)
    steps = np.select([codes <= 1_023, codes <= 16_383], [1, 15_360 / 1_536], 1_032_192 / 1_536)
    assert np.all(np.abs(back - codes) <= steps / 2 + 0.5)
    assert np.array_equal(back[codes <= 1_023], codes[codes <= 1_023])


def test_companded_codes_are_inverted_by_their_own_table() -> None:
    section = CompandingSection(bits=12, knees=tuple(map(tuple, KNEES)))
    every = np.arange(4_096, dtype=np.uint16)
    assert np.array_equal(section.compand(section.expand(every)), every)


@pytest.mark.parametrize("name", ["bayer_2mp", "sony_imx174"])
def test_libraw_inverts_every_companded_code_within_one(name: str, tmp_path: Path) -> None:
    """Steps of the table are 16 linear codes of 20 bits."""
    camera = hdr(name)
    frames = ms.expose(ms.Photons(np.full((64, 64), 10.0), detected=True), camera, SHORT)
    linear = camera.companding.expand(np.arange(4_096).reshape(1, 64, 64))
    every = dataclasses.replace(frames, digital=linear)
    every.save_dng(tmp_path / "every.dng")
    with rawpy.imread(str(tmp_path / "every.dng")) as opened:
        raw, black = opened.raw_image.astype(float), opened.black_level_per_channel
    assert steps_of_table(camera) == 16
    assert np.abs(raw * 16 - linear[0]).max() <= 16
    assert np.array_equal(raw.ravel(), linearization_table(camera))
    assert black[0] == pytest.approx(camera.combined_readouts.black_level_dn / 16, abs=1)


def test_files_hold_the_companded_code(tmp_path: Path) -> None:
    light = ms.Photons(np.tile(np.geomspace(1, 300_000, 32), (32, 1)), detected=True)
    frames = ms.expose(light, hdr(), SHORT)
    frames.save(tmp_path)
    with tifffile.TiffFile(tmp_path / "readouts.tiff") as tiff:
        pages = {page.tags[285].value: page.asarray() for page in tiff.pages}
    companded = pages["frame 0, companded"]
    assert frames.companded is not None and np.array_equal(companded, frames.companded[0])
    assert companded.dtype == np.uint16 and companded.max() <= 4_095


def test_a_camera_of_more_than_16_bits_needs_knees_for_a_dng(tmp_path: Path) -> None:
    camera = hdr(**{"companding.knees": None})
    frames = ms.expose(ms.Photons(np.full((32, 32), 10.0), detected=True), camera, SHORT)
    with pytest.raises(ms.InputError, match=r"companding\.knees"):
        frames.save_dng(tmp_path / "frame.dng")
    assert frames.companded is None


@pytest.mark.parametrize(
    ("knees", "said"),
    [
        ([[0, 0]], "at least one more"),
        ([[5, 0], [10, 5]], "starts with"),
        ([[0, 0], [10, 5], [10, 6]], "both codes must rise"),
        ([[0, 0], [10, 20]], "at most as many"),
        ([[0, 0], [10_000, 5_000]], "raise bits"),
    ],
)
def test_knees_that_cannot_be_inverted_are_refused(knees: list[list[int]], said: str) -> None:
    with pytest.raises(ms.InputError, match=said):
        hdr(**{"companding.knees": knees})


def test_the_decompanding_curve_of_libcamera_becomes_knees(tmp_path: Path) -> None:
    tuning = {
        "version": 2.0,
        "algorithms": [
            {"rpi.black_level": {"black_level": 4096}},
            {"rpi.noise": {"reference_constant": 0, "reference_slope": 2.5}},
            {
                "rpi.decompand": {
                    "bitdepth": 12,
                    "decompand_curve": [0, 0, 8_192, 8_192, 40_960, 24_576, 65_535, 65_535],
                }
            },
        ],
    }
    file = tmp_path / "hdr.json"
    file.write_text(json.dumps(tuning))
    camera = import_camera(file, like="raspberry_pi_hq")
    assert (camera.adc.bits, camera.companding.bits) == (16, 12)
    assert camera.companding.knees == ((0, 0), (8_192, 512), (24_576, 2_560), (65_535, 4_095))
