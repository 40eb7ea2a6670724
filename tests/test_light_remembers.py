"""Light remembers what it was rendered for, and every output says where its first pixel lies."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.marks import one_in
from helpers.scenes import SCENES
from PIL import Image
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.cli import app
from mitsuba_sensor.output import exr

CROPPED = (
    (SCENES / "color_checker.xml")
    .read_text("utf-8")
    .replace(
        '<string name="component_format"',
        '<integer name="crop_offset_x" value="25"/><integer name="crop_offset_y" value="217"/>'
        '<integer name="crop_width" value="16"/><integer name="crop_height" value="16"/>'
        '<string name="component_format"',
    )
)


def run(*arguments: object) -> Any:
    """frame.json of a command that must succeed."""
    done = CliRunner().invoke(app, [str(one) for one in (*arguments, "--json")])
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rendered")
    (folder / "scene.xml").write_text(CROPPED, encoding="utf-8")
    run("render", folder / "scene.xml", "-o", folder, "--camera", "bayer_2mp", "--set", "pixel.prnu=0.02", "--spp", 16,
        "--exposure-s", 0.03, "--temperature-k", 310, "--serial", 9)  # fmt: skip
    return folder


def test_an_exposure_takes_camera_time_temperature_and_serial_of_the_light(
    rendered: Path, tmp_path: Path
) -> None:
    """The same bytes without a single flag."""
    found = run("expose", rendered / "irradiance.exr", "-o", tmp_path)
    assert (tmp_path / "frame.tiff").read_bytes() == (rendered / "frame.tiff").read_bytes()
    assert (tmp_path / "frame.png").read_bytes() == (rendered / "frame.png").read_bytes()
    assert found["origin"]["as_rendered"] == ["camera", "exposure", "serial"]
    in_python = ms.capture(rendered / "irradiance.exr")
    np.testing.assert_array_equal(
        in_python.frames.digital, tifffile.imread(rendered / "frame.tiff")[None]
    )


@pytest.mark.parametrize(
    ("flags", "kept"),
    one_in(
        2,
        [
            (("--exposure-s", 0.01), ["camera", "serial"]),
            (("--camera", "konnik_table1"), ["exposure", "serial"]),
            (("--set", "adc.bits=10"), ["exposure", "serial"]),
            (("--serial", 2), ["camera", "exposure"]),
        ],
        several=True,
    ),
)
def test_what_is_told_otherwise_is_not_taken(
    rendered: Path, tmp_path: Path, flags: Any, kept: list[str]
) -> None:
    found = run("expose", rendered / "irradiance.exr", "-o", tmp_path, *flags)
    assert found["origin"]["as_rendered"] == kept
    assert found["camera"]["pixel"]["prnu"] == (0.02 if "--camera" not in flags else 0.005)
    assert found["exposure"]["temperature_k"] == 310


def test_a_plan_is_for_the_camera_of_the_light(rendered: Path) -> None:
    found = run("plan", rendered / "irradiance.exr", "--tolerance-dn", 1)
    assert found["camera"] == "bayer_2mp" and found["range"]["exposure"] == {
        "time_s": 0.03,
        "temperature_k": 310,
    }


def test_every_output_knows_first_pixel_filters_and_levels(rendered: Path) -> None:
    """The window begins at row 217, column 25 of the sensor, whose first rows are R G and G B."""
    image = json.loads((rendered / "frame.json").read_text("utf-8"))["image"]
    wanted = {
        "origin": [217, 25],
        "cfa_pattern": [["B", "G"], ["G", "R"]],
        "white_level_dn": 4095,
    }
    assert {name: image[name] for name in wanted} == wanted and image["black_level_dn"] == 4
    texts = Image.open(rendered / "frame.png").text  # type: ignore[attr-defined]
    assert {name: json.loads(texts[name]) for name in wanted} == wanted
    with tifffile.TiffFile(rendered / "frame.tiff") as file:
        tags = file.pages[0].tags  # type: ignore[union-attr]
        assert json.loads(tags["ImageDescription"].value) == image
        assert (tags["BlackLevel"].value, tags["WhiteLevel"].value) == (4, 4095)
        assert (
            tuple(tags["CFARepeatPatternDim"].value) == (2, 2)
            and bytes(tags["CFAPattern"].value) == b"\2\1\1\0"
        )


def test_the_illuminant_is_that_of_the_scene(rendered: Path) -> None:
    """CIE D65 through Mitsuba, its shape within 1 % of colour-science's table from 400 to 700 nm."""
    from mitsuba_sensor.optics.spectra import d65

    light = exr.read_irradiance_exr(rendered / "irradiance.exr").rendered_for
    assert light is not None and light.illuminant is not None
    middles, power = light.illuminant
    inside = (middles > 400) & (middles < 700)
    ratio = power[inside] / d65(middles[inside])
    assert np.ptp(ratio) / ratio.mean() < 0.02
    assert (power[middles > 835] == 0).all()
