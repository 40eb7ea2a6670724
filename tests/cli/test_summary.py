"""What `render` and `expose` print: a dozen lines, the notes that matter most first."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.scenes import SCENES

from mitsuba_sensor.cli.tables import number
from mitsuba_sensor.cli.terminal import NOTES_MAX, notes_shown
from mitsuba_sensor.core import Doubt

SMALL = ("--width", 16, "--spp", 4, "--no-denoise")


def test_a_render_prints_a_dozen_lines_with_photons_signal_and_noise(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    out, scene = tmp_path / "out", SCENES / "cornell_box.xml"
    said = cli("render", scene, "-o", out, *SMALL).stdout
    report = json.loads((out / "frame.json").read_text("utf-8"))
    assert len(said.splitlines()) <= 20
    last, photons = report["stages"][-1], report["photons"]
    assert f"signal: {number(last['mean_frame'])} DN on average" in said
    assert f"photons per pixel: {number(photons['min'])} … {number(photons['median'])}" in said
    assert "K = 0.1241 DN/e-" in said and "render noise:" in said and "wrote in" in said
    again = cli("expose", out / "irradiance.exr", "-o", tmp_path / "again").stdout
    assert len(again.splitlines()) <= 20


def test_notes_that_differ_in_numbers_or_groups_alone_are_one() -> None:
    notes = [
        "lamp: error bars are too small: 34.8% of the pixels",
        "window, sky: error bars are too small: 3% of the pixels",
        "error bars are too small: 9% of the pixels",
        "something else",
    ]
    shown, left_out = notes_shown(notes)
    assert shown == [f"{notes[0]} (2 more notes are alike)", "something else"] and not left_out


@pytest.mark.parametrize("count", [0, NOTES_MAX, NOTES_MAX + 3])
def test_few_notes_are_printed_and_doubts_come_first(count: int) -> None:
    notes: list[str] = ["abcdefgh"[n] * 9 for n in range(count)]
    doubt = Doubt("probably not what was wanted")
    shown, left_out = notes_shown([*notes, doubt])
    assert shown[0] == doubt and len(shown) == min(count + 1, NOTES_MAX)
    assert left_out == count + 1 - len(shown)
