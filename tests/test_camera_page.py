"""docs/camera-file.md: its numbers are those of its camera, its findings those of the check, its commands run."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers import ROOT
from helpers.pages import fenced, lines

import mitsuba_sensor as ms
from mitsuba_sensor.stages.gains import gain_dn_per_e

PAGE = (ROOT / "docs" / "camera-file.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "cmv4000.toml"
COMMANDS = lines(fenced(PAGE, "sh"))
SMALL = "--width", "16", "--spp", "16", "--wavelength-nm", "550", "--no-denoise"
MISTAKES = re.findall(r"^\| `([\w.]+) = (\S+)` \| (error|warning) \| .*`(\S+)` \|$", PAGE, re.M)


def test_each_line_of_the_worked_example_is_in_the_camera_file() -> None:
    rows = re.findall(r"^\| [^|]+ \| `(\w+\.\w+)` \| ([^|]+) \|", PAGE, re.M)
    camera = tomllib.loads(EXAMPLE.read_text("utf-8"))
    assert len(rows) >= 12
    for dotted, text in rows:
        table, key = dotted.split(".")
        assert camera[table][key] == tomllib.loads(f"x = {text}")["x"], dotted


def test_the_example_is_the_camera_of_the_data_sheet() -> None:
    """0.075 LSB/e- and 13 e- in 10 bits, 125 e-/s at 25 °C, QE 60 % at 550 nm and 8 % at 900; every number sourced."""
    camera = ms.load_camera(EXAMPLE)
    assert gain_dn_per_e(camera) == pytest.approx(0.075, rel=1e-5) and not ms.check_camera(
        EXAMPLE
    )
    assert camera.qe([550.0, 900.0]).tolist() == [[0.6, 0.08]]
    assert camera.dark_current.cv == pytest.approx(3 / 0.075 / 125)
    missing = re.findall(r'(?m)^# ("[\w.]+") = ""$', camera.to_toml())
    assert not missing


@pytest.mark.parametrize(
    ("dotted", "value", "level", "said"), MISTAKES, ids=[one[0] for one in MISTAKES]
)
def test_a_mistake_of_the_page_gets_the_suggestion_of_the_page(
    dotted: str, value: str, level: str, said: str, tmp_path: Path
) -> None:
    table, key = dotted.split(".")
    meant = "full_well_e" if key == "full_wel_e" else key
    text = re.sub(rf"(?m)^{meant} = .*\n", "", EXAMPLE.read_text("utf-8"))
    path = tmp_path / "mine.toml"
    path.write_text(
        text.replace(f"\n[{table}]\n", f"\n[{table}]\n{key} = {value}\n"), encoding="utf-8"
    )
    found = ms.check_camera(path)
    assert found[0].level == level and said in found[0].text


def test_the_page_shows_every_kind_of_mistake() -> None:
    assert len(MISTAKES) == 10


def test_the_commands_of_the_page_run_in_their_order(
    checkout_folder: Path, cli: Callable[..., Any]
) -> None:
    """Renders of 16 columns, 16 samples and one wavelength here."""
    assert len(COMMANDS) == 6
    for command in COMMANDS:
        program, *arguments = shlex.split(command, comments=True)
        done = cli(*arguments, *(SMALL if arguments[0] == "render" else ()))
        assert program == "mitsuba-sensor" and done.exit_code == 0, (command, done.stderr)
    assert {path.name for path in checkout_folder.iterdir()} >= {
        "my.toml",
        "cold.toml",
        "my",
        "cmv4000",
    }


def test_the_gain_settings_of_the_page_are_those_of_a_camera() -> None:
    camera = ms.load_camera("konnik_table1").replace(**tomllib.loads(fenced(PAGE, "toml")))
    found = {one.label: gain_dn_per_e(camera.at_gain(one.label)) for one in camera.gains}
    assert found == pytest.approx({"100": 0.25, "800": 2.0, "1600": 4.0}, rel=1e-12)


def test_the_python_of_the_page_runs(checkout_folder: Path) -> None:
    names: dict[str, Any] = {}
    exec(fenced(PAGE, "python"), names)
    assert ms.load_camera("cold.toml") == names["camera"]
