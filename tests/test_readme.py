"""README: each of its commands runs as it stands, in a fresh checkout; so do its Python, and the examples."""

from __future__ import annotations

import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml
from helpers import ROOT
from helpers.marks import exhaustive
from helpers.pages import fenced, lines
from PIL import Image

import mitsuba_sensor as ms

README = (ROOT / "README.md").read_text(encoding="utf-8")
FIRST = "mitsuba-sensor render scenes/first_frame.xml -o out/"
PROGRAMS = sorted((ROOT / "examples").glob("*.py"))
SMALL = {
    "stereo_sequence": ["--width", "48", "--spp", "4", "--views", "2"],
    "readme_pictures": ["out/irradiance.exr"],
}
"""Arguments of examples: those that take minutes without them, and one that reads the light of the first picture."""
SMALL_ELSEWHERE = {"train_a_denoiser"}
"""Examples that take minutes, which tests/dataset/test_training.py runs with less, and that need more packages."""
QUICK = {"photons_from_an_array"}
RUN = [path for path in PROGRAMS if path.stem not in SMALL_ELSEWHERE]
TOLD = [exhaustive(path) if path.stem in SMALL_ELSEWHERE else path for path in PROGRAMS]
EXAMPLES = [path if path.stem in QUICK else exhaustive(path) for path in RUN]


SHELL = lines(fenced(README, "sh"))
INLINE = re.findall(r"`(mitsuba-sensor [^`]+)`", README)
SMALLER = {"render night_crossing": " --width 64", "render scenes/first_frame": " --width 96"}
"""What is added to a command that takes a minute, by how it begins."""


def made_small(command: str) -> str:
    for begin, added in SMALLER.items():
        if begin in command:
            return command + added
    return command


COMMANDS = [made_small(line) for line in (FIRST, *INLINE) if " study " not in line]
"""Studies take minutes, and have tests of their own."""


LATER = [line if "cameras new" in line else exhaustive(line) for line in COMMANDS[1:]]
"""The first command is run by itself."""


def written_by(command: str) -> str:
    """What a command writes: the argument of -o, or "?"."""
    arguments = shlex.split(command, comments=True)
    return arguments[arguments.index("-o") + 1] if "-o" in arguments else "?"


class Checkout:
    """A folder that looks like a fresh checkout from inside: scenes/ is there, out/ is not."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.ran = folder, set[str]()
        for name in (
            "scenes",
            "examples",
        ):  # no links: a dataset reads nothing outside of the folder
            shutil.copytree(ROOT / name, folder / name)

    def run(self, command: str) -> str:
        """Run a line in a shell that finds this environment's programs; its standard output."""
        path = os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))
        done = subprocess.run(
            command,
            shell=True,
            cwd=self.folder,
            env={**os.environ, "PATH": path},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        self.ran.add(command)
        return done.stdout

    def run_what_is_read_by(self, command: str) -> None:
        """Run the commands that write a file that this one reads."""
        for earlier in COMMANDS[: COMMANDS.index(command)]:
            if earlier not in self.ran and written_by(earlier) in command.replace(
                f"-o {written_by(command)}", ""
            ):
                self.run(earlier)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Checkout:
    return Checkout(tmp_path_factory.mktemp("checkout"))


def test_two_commands_do_all_the_set_up() -> None:
    assert f"pip install '.[llvm]' && {FIRST}" in SHELL
    assert "pip install '.[test]' && pytest" in SHELL


@pytest.mark.parametrize("columns", [96, exhaustive(384)])
def test_the_first_command_makes_the_picture_of_the_readme(
    columns: int, checkout: Checkout
) -> None:
    """In colour, metered, neither black nor saturated; its visible noise is the camera's."""
    checkout.run(COMMANDS[0] if columns < 384 else FIRST)
    out = checkout.folder / "out"
    raw = tifffile.imread(out / "frame.tiff")
    report = json.loads((out / "frame.json").read_text(encoding="utf-8"))
    assert raw.shape == (columns * 2 // 3, columns) and raw.dtype == np.uint16
    assert {path.name for path in out.iterdir() if path.is_file()} == {
        "frame.tiff",
        "frame.png",
        "irradiance.exr",
        "frame.json",
    }
    assert np.mean(raw == 2 ** report["camera"]["adc"]["bits"] - 1) < 0.05
    metering = report["origin"]["metering"]
    assert (metering["percentile"], metering["share_of_saturation"]) == (95, 0.7)
    # The light of scalar variants is denoised without guides, and few pixels leave the denoiser more noise.
    if report["render"]["variant"].startswith("llvm"):
        assert len(report["notes"]) <= 1
        assert report["render_noise"]["share_of_variance_median"] < (
            0.15 if columns == 384 else 0.6
        )
    shown, own = (
        np.asarray(Image.open(path).resize((96, 64), Image.Resampling.BOX))
        for path in (ROOT / "docs/images/first_frame.png", out / "frame.png")
    )
    assert np.corrcoef(shown.ravel(), own.ravel())[0, 1] > 0.9


@pytest.mark.parametrize(
    "command", LATER, ids=lambda line: " ".join(shlex.split(line, comments=True)[1:5])
)
def test_a_command_of_the_readme_runs(
    command: str, checkout: Checkout, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    checkout.run_what_is_read_by(command)
    monkeypatch.chdir(checkout.folder)
    program, *arguments = shlex.split(command, comments=True)
    done = cli(*arguments)
    assert program == "mitsuba-sensor" and done.exit_code == 0, done.stderr


def test_the_python_of_the_readme_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its noise budget is of a frame that is not clipped: no stage takes noise away, and all that is added remains."""
    monkeypatch.chdir(tmp_path)
    exec(fenced(README, "python"), {})
    printed = capsys.readouterr().out
    fractions = re.findall(r"^(.+?) {2,}.* <?(-?[\d.]+)$", printed, flags=re.MULTILINE)
    found = {source: float(percent) for source, percent in fractions}
    assert found["photon shot noise"] > 10 and min(found.values()) >= 0
    assert found["total"] == pytest.approx(100, abs=1)
    shown = re.search(r"shot noise causes (\d+) %", README)
    assert shown and found["photon shot noise"] == pytest.approx(float(shown[1]), abs=1)
    assert len(fenced(README, "python").splitlines()) <= 10


def test_the_citation_is_of_this_version() -> None:
    told = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert (told["version"], told["license"]) == (ms.__version__, project["license"])
    assert [one["name"] for one in told["authors"]] == [
        one["name"] for one in project["authors"]
    ]
    for path in project["urls"].values():
        assert (ROOT / path).exists()


@pytest.mark.parametrize("example", TOLD, ids=[path.stem for path in PROGRAMS])
def test_an_example_says_its_arguments_before_it_does_anything(
    example: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if example.stem in SMALL_ELSEWHERE:
        pytest.importorskip("jax")
    monkeypatch.setattr(sys, "argv", [example.name, "--help"])
    with pytest.raises(SystemExit) as stopped:
        runpy.run_path(str(example), run_name="__main__")
    printed = capsys.readouterr().out
    assert stopped.value.code == 0 and printed.startswith(f"usage: {example.name} [-h]")


@pytest.mark.parametrize("example", EXAMPLES, ids=[path.stem for path in RUN])
def test_an_example_writes_where_it_is_told_and_nowhere_else(
    example: Path, checkout: Checkout
) -> None:
    arguments = SMALL.get(example.stem, [])
    if "out/irradiance.exr" in arguments and COMMANDS[0] not in checkout.ran:
        checkout.run(COMMANDS[0])
    before = {*checkout.folder.rglob("*")}
    told = checkout.folder / "examples_out" / example.stem
    told.parent.mkdir(exist_ok=True)
    is_picture = 'metavar="PICTURE"' in example.read_text(encoding="utf-8")
    out = str(told.with_suffix(".png") if is_picture else told)
    checkout.run(shlex.join([sys.executable, str(example), *arguments, "-o", out]))
    written = {*checkout.folder.rglob("*")} - before - {told.parent}
    assert written and all(path.is_relative_to(told.parent) for path in written)
