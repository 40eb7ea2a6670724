"""What a user can do wrong, by data/wrong_inputs.txt: one line, exit code 2, no file."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.files import png, texts, tiff
from mitsuba_sensor.files.disk_errors import disk_sentences
from mitsuba_sensor.render.load.scene import Scene
from mitsuba_sensor.sensor.expose import PreparedExposure

TABLE = Path(__file__).parent.parent / "data" / "wrong_inputs.txt"
ROWS = [line for line in TABLE.read_text("utf-8").splitlines() if not line.startswith("#")]
SCENE_RENDER = "render TMP/wrong.xml -o OUT --variant scalar_spectral --spp 16"
CAMERA_EXPOSE = "expose LIGHT -o OUT --camera TMP/wrong.toml"


@pytest.fixture
def places(tmp_path: Path, scene_file: Path, light_file: Path) -> dict[str, str]:
    """A good scene and good light, and bad files of every kind."""
    folder = tmp_path / "files"
    for name in ("folder.toml", "blocked/frame.json"):
        (folder / name).mkdir(parents=True)
    (folder / "text.toml").write_text("some text\n")
    (folder / "broken.toml").write_text("[adc\nbits = 12")
    (folder / "half.exr").write_bytes(light_file.read_bytes()[:-300])
    os.mkfifo(folder / "pipe.exr")
    np.savez(folder / "names.npz", prnnu=np.ones((12, 16)))
    np.savez(folder / "shape.npz", prnu=np.ones((3, 3)))
    new = str(tmp_path / "new" / "out")
    return {"SCENE": str(scene_file), "LIGHT": str(light_file), "OUT": new, "TMP": str(folder)}


def filled(text: str, places: dict[str, str]) -> str:
    """With the paths in place of their names."""
    for name, place in places.items():
        text = place if text == name else text.replace(f"{name}/", f"{place}/")
    return text


def edited(text: str, edit: str) -> str:
    """With old → new, whose new text may be empty."""
    old, new = (part.strip() for part in f"{edit} ".split(" → "))
    assert old in text, old
    return text.replace(old, new, 1)


def in_python(call: str, light: Any, folder: Path) -> str:
    """What a call says that is refused."""
    grey, camera = np.full((4, 6), 1e4), ms.load_camera("konnik_table1")
    known = {"ms": ms, "np": np, "grey": grey, "light": light, "tmp": folder}
    with pytest.raises(ms.InputError) as caught:
        eval(call, known | {"camera": camera, "exposure": ms.Exposure(0.1), "list": list})
    return str(caught.value)


@pytest.mark.parametrize("row", one_in(4, ROWS))
def test_a_wrong_input_is_one_line_exit_2_and_no_file(
    row: str, places: dict[str, str], light: Any, cli: Callable[..., Any], monkeypatch: Any
) -> None:
    """Every third command is asked for JSON, and says the same in JSON."""
    monkeypatch.setenv("COLUMNS", "400")
    monkeypatch.chdir(places["TMP"])
    given, words = (part.strip() for part in row.split(" => "))
    kind, _, what = given.partition(": ")
    folder = Path(places["TMP"])
    if kind == "SCENE":
        scene = edited(Path(places["SCENE"]).read_text("utf-8"), what)
        (folder / "wrong.xml").write_text(scene, "utf-8")
    if kind == "CAMERA":
        camera = edited(ms.load_camera("konnik_table1").to_toml(), what)
        (folder / "wrong.toml").write_text(camera, "utf-8")
    before = sorted(folder.parent.rglob("*"))
    if kind == "PYTHON":
        said = in_python(what, light, folder)
    else:
        line = {"SCENE": SCENE_RENDER, "CAMERA": CAMERA_EXPOSE}.get(kind, given)
        as_json = ROWS.index(row) % 3 == 0 and "--json" in cli(*commands_of(line), "-h").stdout
        asked = [filled(one, places) for one in shlex.split(line)]
        done = cli(*asked, *(["--json"] if as_json else []))
        assert done.exit_code == 2, (done.exit_code, done.exception, done.output)
        *notes, last = done.stderr.splitlines()
        assert all(note.startswith("note: ") for note in notes), done.stderr
        assert last.startswith("error: ")
        said = last.removeprefix("error: ")
        assert done.stdout == "" if not as_json else json.loads(done.stdout) == {"error": said}
    missing = [one for one in words.split("|") if filled(one.strip(), places) not in said]
    assert not missing, f"{missing} not in: {said}"
    assert "\n" not in said and "Traceback" not in said and said[-1] in ".?)h", said
    assert sorted(folder.parent.rglob("*")) == before


def commands_of(line: str) -> list[str]:
    """The words that call a command."""
    words = line.split()
    return words[: 2 if words[0] in ("cameras", "scenes", "study", "dataset") else 1]


def test_an_unknown_command_is_told_in_json_if_json_is_asked_for(
    cli: Callable[..., Any],
) -> None:
    done = cli("rendr", "--json")
    assert done.exit_code == 2 and "'render'" in json.loads(done.stdout)["error"]


def test_the_table_is_one_of_a_hundred_different_inputs() -> None:
    assert len({*ROWS}) == len(ROWS) > 100


@pytest.mark.parametrize("where", ["file", "file/out", "folder"])
def test_a_place_that_takes_no_files_is_found_before_the_render(
    where: str, tmp_path: Path, scene_file: Path, cli: Callable[..., Any], monkeypatch: Any
) -> None:
    (tmp_path / "file").write_text("kept")
    (tmp_path / "folder" / "frame.json").mkdir(parents=True)
    monkeypatch.setattr(Scene, "render", lambda *_: pytest.fail("rendered before looking"))
    done = cli("render", scene_file, "-o", tmp_path / where)
    assert done.exit_code == 2 and str(tmp_path / where) in done.stderr
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize(
    "writer", [(tiff, "write_tiff"), (png, "write_png"), (texts, "write_json")]
)
def test_a_disk_that_fills_up_ends_with_code_3_and_leaves_the_older_result_alone(
    writer: tuple[Any, str],
    light_file: Path,
    tmp_path: Path,
    cli: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "out"
    assert cli("expose", light_file, "-o", out).exit_code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def full(path: Path, *_: Any) -> None:
        with disk_sentences(path):
            raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(*writer, full)
    done = cli("expose", light_file, "-o", out, "--seed", 2)
    assert done.exit_code == 3 and "No space left on device" in done.stderr
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_running_out_of_memory_is_a_sentence(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def huge(*_: Any, **__: Any) -> None:
        raise MemoryError("Unable to allocate 1 TiB")

    monkeypatch.setattr(PreparedExposure, "frames", huge)
    done = cli("expose", light_file, "-o", tmp_path / "out")
    assert done.exit_code == 2 and re.search(r"Unable to allocate 1 TiB.*--width", done.stderr)
    assert not (tmp_path / "out").exists()
