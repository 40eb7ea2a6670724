"""What a user can do wrong, by the table of data/bad_inputs.txt: one sentence, exit code 2, nothing written.

A sentence must hold the value, the allowed range or the way out, as the table says.
"""

from __future__ import annotations

import errno
import os
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import CAMERAS
from helpers.bad_inputs import CALLS, DATASHEETS, NO_NAME, SCENES
from helpers.marks import one_in
from PIL import Image

import mitsuba_sensor as ms

TABLE = Path(__file__).parent.parent / "data" / "bad_inputs.txt"
LINES = [line for line in TABLE.read_text("utf-8").splitlines() if "=>" in line]


@pytest.fixture(scope="module")
def places(
    tmp_path_factory: pytest.TempPathFactory, scene_file: Path, light: Any
) -> dict[str, str]:
    """Good files, and bad ones of every kind."""
    import OpenEXR

    from mitsuba_sensor.output.exr import write_irradiance_exr

    folder = tmp_path_factory.mktemp("bad")
    good = tmp_path_factory.mktemp("light") / "irradiance.exr"
    write_irradiance_exr(good, light)
    for name in ("folder.toml", "folder.npz", "folder.exr", "blocked/frame.json"):
        (folder / name).mkdir(parents=True)
    (folder / "text.toml").write_text("some text\n")
    (folder / "broken.toml").write_text("[adc\nbits = 12")
    (folder / "camera.toml").write_text(
        (CAMERAS / "konnik_table1.toml").read_text("utf-8"), "utf-8"
    )
    for name in ("empty.xml", "empty.exr"):
        (folder / name).touch()
    Image.new("L", (4, 4)).save(folder / "picture.png")
    content = good.read_bytes()
    (folder / "half.exr").write_bytes(content[: len(content) // 2])
    (folder / "head.exr").write_bytes(content[:100])
    with OpenEXR.File(
        {"type": OpenEXR.scanlineimage}, {"RGB": np.ones((4, 4, 3), np.float32)}
    ) as rgb:
        rgb.write(str(folder / "rgb.exr"))
    maps = {"names": {"prnnu": np.ones((12, 16))}, "shape": {"prnu": np.ones((3, 3))}}
    maps |= {
        "nan": {"prnu": np.full((12, 16), np.nan)},
        "text": {"prnu": np.full((12, 16), "a")},
    }
    for name, found in maps.items():
        np.savez(folder / f"{name}.npz", **found)
    (folder / "cut.npz").write_bytes((folder / "nan.npz").read_bytes()[:200])
    return {
        "SCENE": str(scene_file),
        "LIGHT": str(good),
        "OUT": str(folder / "new" / "out"),
        "TMP": str(folder),
    }


def filled(text: str, places: dict[str, str]) -> str:
    """With the paths in place of their names."""
    for name, place in places.items():
        text = place if text == name else text.replace(f"{name}/", f"{place}/")
    return text


def there(places: dict[str, str]) -> set[str]:
    return {str(path) for path in Path(places["TMP"]).rglob("*")}


@pytest.mark.parametrize("line", one_in(3, LINES))
def test_a_bad_input_is_one_sentence_exit_2_and_no_file(
    line: str, places: dict[str, str], cli: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(places["TMP"])
    monkeypatch.setenv("COLUMNS", "400")
    before = there(places)
    command, words = (part.strip() for part in line.split("=>"))
    done = cli(*(filled(one, places) for one in shlex.split(command)))
    said = " ".join(done.stderr.replace("│", " ").split())
    assert done.exit_code == 2, (done.exit_code, done.exception, said, done.stdout)
    as_arguments = re.sub(r"--([a-z][a-z-]*)", lambda flag: flag[1].replace("-", "_"), said)
    missing = [
        one
        for one in words.split("|")
        if filled(one.strip(), places) not in said + "\n" + as_arguments
    ]
    assert not missing, f"{missing} not in: {said}"
    assert "Traceback" not in said and done.stdout == ""
    assert not re.search(r"[^./][.;,:] ?[.;,:](?![./\w])", said), said  # doubled stops
    if said.startswith("error: "):
        assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert there(places) == before


def edited(scene_file: Path, edits: str, folder: Path) -> Path:
    """The good scene with old → new."""
    text = scene_file.read_text("utf-8")
    for old, new in (edit.split(" → ") for edit in edits.split(" && ")):
        assert old in text, old
        text = text.replace(old, new, 1)
    (folder / "wrong.xml").write_text(text, "utf-8")
    return folder / "wrong.xml"


@pytest.mark.parametrize("edits", one_in(4, SCENES))
def test_a_mistake_in_a_scene_is_one_sentence_with_the_path_of_the_file(
    edits: str, scene_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    scene = edited(scene_file, edits, tmp_path)
    done = cli(
        "render", scene, "-o", tmp_path / "out", "--variant", "scalar_spectral", "--spp", 16
    )
    assert done.exit_code == 2, (done.exception, done.stdout)
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert str(scene) in done.stderr or NO_NAME in SCENES[edits], done.stderr
    missing = [one for one in SCENES[edits] if one not in done.stderr]
    assert not missing, f"{missing} not in: {done.stderr}"
    assert list(tmp_path.iterdir()) == [scene]


@pytest.mark.parametrize("edit", one_in(3, DATASHEETS))
def test_a_mistake_in_a_camera_file_is_one_sentence_with_file_and_line(
    edit: str, light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    text = ms.load_camera("konnik_table1").to_toml()
    old, new = edit.split(" → ")
    assert f"\n{old}" in text, old
    wrong = text.replace(f"\n{old}", f"\n{new}", 1)
    file = tmp_path / "wrong.toml"
    file.write_text(wrong, "utf-8")
    done = cli("expose", light_file, "-o", tmp_path / "out", "--camera", file)
    assert done.exit_code == 2 and not (tmp_path / "out").exists(), done.stdout
    assert len(done.stderr.strip().splitlines()) == 1 and "wrong.toml" in done.stderr, (
        done.stderr
    )
    missing = [one for one in DATASHEETS[edit] if one not in done.stderr]
    assert not missing, f"{missing} not in: {done.stderr}"
    assert f"{file}:" in cli("cameras", "check", file).stdout


@pytest.mark.parametrize("call", CALLS)
def test_a_mistake_in_python_is_one_sentence(call: str, light: Any, tmp_path: Path) -> None:
    camera, exposure = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
    names = {
        "ms": ms,
        "np": np,
        "camera": camera,
        "exposure": exposure,
        "light": light,
        "tmp": tmp_path,
    }
    with pytest.raises(ms.InputError) as caught:
        eval(call, names | {"grey": np.full((4, 6), 1e4), "list": list})
    missing = [one for one in CALLS[call] if one not in str(caught.value)]
    assert not missing, f"{missing} not in: {caught.value}"
    assert "\n" not in str(caught.value) and list(tmp_path.iterdir()) == []


@pytest.mark.exhaustive
def test_a_sensor_at_25_kelvin_is_allowed_and_doubted(
    light_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    for kelvin, doubted in ((25, True), (0, True), (500, True), (77, False), (298.15, False)):
        done = cli("expose", light_file, "-o", tmp_path, "--temperature-k", kelvin)
        assert done.exit_code == 0 and ("temperature_k is" in done.stdout) == doubted, (
            done.stdout
        )
        assert kelvin != 25 or "if 25 is in °C, write 298.15" in " ".join(done.stdout.split())


@pytest.mark.parametrize(
    "command", ["cameras new FILE.toml", "fpn-maps -o FILE.npz --rows 4 --width 4"]
)
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_a_full_or_read_only_disk_is_one_sentence_with_a_way_out(
    command: str,
    number: int,
    tmp_path: Path,
    cli: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "replace", refused)
    file = str(tmp_path / "my")
    done = cli(*command.replace("FILE", file).split())
    way_out = (
        "make space there" if number == errno.ENOSPC else "give a place that can be written"
    )
    assert (
        done.exit_code == (3 if number == errno.ENOSPC else 2)
        and done.stdout == ""
        and list(tmp_path.iterdir()) == []
    )
    assert (
        f"{file}." in done.stderr
        and os.strerror(number) in done.stderr
        and way_out in done.stderr
    )


def test_the_table_holds_at_least_300_inputs() -> None:
    assert len(LINES) + len(SCENES) + len(DATASHEETS) + len(CALLS) >= 300
    assert len(set(LINES)) == len(LINES)
