"""What `render` and `expose` print: a dozen lines, the whole with --verbose, and every note in frame.json."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.scenes import SCENES

from mitsuba_sensor.cli.short_summary import MOST_NOTES, notes_shown
from mitsuba_sensor.core import Doubt

SMALL = ("--width", 16, "--spp", 4, "--no-denoise")


def test_a_render_prints_a_dozen_lines_and_all_of_it_with_verbose(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    out, scene = tmp_path / "out", SCENES / "cornell_box.xml"
    short = cli("render", scene, "-o", out, *SMALL).stdout
    whole = cli("render", scene, "-o", out, *SMALL, "--verbose").stdout
    report = json.loads((out / "frame.json").read_text("utf-8"))
    assert len(short.splitlines()) <= 20 < len(whole.splitlines())
    last = report["stages"][-1]
    signal = (
        f"signal: {last['mean_frame']:.4g} DN on average" if last["mean_frame"] < 1e3 else ""
    )
    assert signal in short and "--verbose, or frame.json" in short
    for both in (short, whole):
        assert "K = 0.1241 DN/e-" in both and "render noise:" in both and "wrote in" in both
    assert "photon" in whole and "after" in whole and "after" not in short
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


@pytest.mark.parametrize("count", [0, MOST_NOTES, MOST_NOTES + 3])
def test_few_notes_are_printed_and_doubts_come_first(count: int) -> None:
    notes: list[str] = ["abcdefgh"[n] * 9 for n in range(count)]
    doubt = Doubt("probably not what was wanted")
    shown, left_out = notes_shown([*notes, doubt])
    assert shown[0] == doubt and len(shown) == min(count + 1, MOST_NOTES)
    assert left_out == count + 1 - len(shown)
