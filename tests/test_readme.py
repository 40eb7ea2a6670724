"""The README keeps its promises: its commands run as they stand, its Python runs, and so do the examples."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from helpers import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
FIRST = "mitsuba-sensor render scenes/cornell_box.xml -o out/"
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def blocks(language: str) -> list[str]:
    """The fenced blocks of the README in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that looks like a fresh checkout from inside: scenes/ is there, out/ is not."""
    folder = tmp_path_factory.mktemp("checkout")
    (folder / "scenes").symlink_to(ROOT / "scenes")
    return folder


def run(command: str, folder: Path) -> str:
    """Run a line in a shell that finds this environment's programs; its standard output."""
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ.get("PATH", "")))
    done = subprocess.run(
        command, shell=True, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{command}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def first_picture(checkout: Path) -> Path:
    """What the README's first command leaves, after its `pip install .`, which is how this very test came to run."""
    line = next(line for line in "".join(blocks("sh")).splitlines() if line.startswith("pip install . && "))
    assert line.removeprefix("pip install . && ") == FIRST
    run(FIRST, checkout)
    return checkout / "out"


def test_two_commands_do_all_the_set_up() -> None:
    lines = "".join(blocks("sh")).splitlines()
    assert f"pip install . && {FIRST}" in lines
    assert "pip install '.[test]' && pytest" in lines


def test_the_first_command_makes_a_picture_worth_looking_at(first_picture: Path) -> None:
    raw = tifffile.imread(first_picture / "frame.tiff")
    report = json.loads((first_picture / "frame.json").read_text(encoding="utf-8"))
    assert raw.shape == (256, 256) and raw.dtype == np.uint16
    assert {path.name for path in first_picture.iterdir()} == {
        "frame.tiff",
        "frame.png",
        "irradiance.exr",
        "frame.json",
    }
    saturated = np.mean(raw == 2 ** report["camera"]["adc"]["bits"] - 1)
    assert saturated < 0.2, "the default exposure should not burn the picture out"
    assert np.median(raw) > 200, "nor leave it black"


def test_the_other_commands_of_the_readme_work_too(first_picture: Path) -> None:
    text = "".join(blocks("sh")).replace("\\\n", " ")  # a command may go on in the next line
    lines = [line for line in text.splitlines() if line.startswith("mitsuba-sensor")]
    assert len(lines) >= 4
    for line in lines:
        run(line, first_picture.parent)


def test_the_library_in_ten_lines_runs(checkout: Path) -> None:
    """One program from the first block to the last: later ones go on with the names of the earlier."""
    code = "\n".join(blocks("python"))
    assert "kept" in run(f'"{sys.executable}" -c {quoted(code)}', checkout)


@pytest.mark.parametrize("example", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_the_examples_run(example: Path, first_picture: Path) -> None:
    """An example that wants files gets the first picture's light and a folder to leave pictures in."""
    folder = first_picture.parent / example.stem
    folder.mkdir()
    words = f"out/irradiance.exr {folder.name}" if "irradiance_file" in example.read_text(encoding="utf-8") else ""
    said = run(f'"{sys.executable}" "{example}" {words}', first_picture.parent)
    assert said.strip() or list(folder.iterdir())


def quoted(code: str) -> str:
    return "'" + code.replace("'", "'\"'\"'") + "'"
