"""What is not as it was written is found, all of it, and exactly that is made again."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor import cli
from mitsuba_sensor.dataset.index.repair import discard, verify
from mitsuba_sensor.dataset.store.record import INDEX
from mitsuba_sensor.dataset.store.store import Store

TEXT = """
name = "small"
outputs = ["raw", "clean", "aovs"]
render = { width = 16, spp = 16 }
scenes = [{ name = "flat", file = "flat_field" }]
cameras = [{ camera = "bayer_2mp" }]
grid = { exposure_s = [0.01, 0.1], serial = [1, 2] }
"""


def dataset(*arguments: str) -> tuple[int, Any]:
    """Exit code and JSON of a command of dataset."""
    done = CliRunner().invoke(cli.app, ["dataset", *arguments, "--json"])
    return done.exit_code, json.loads(done.stdout)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.toml").write_text(TEXT)
    code, said = dataset(
        "run",
        str(folder / "small.toml"),
        "-o",
        str(folder / "out"),
        "--workers",
        "0",
    )
    assert (code, said["made"]) == (0, 4)
    return folder / "out"


@pytest.fixture
def broken(made: Path, tmp_path: Path) -> Path:
    """A copy, which is to be broken."""
    return Path(shutil.copytree(made, tmp_path / "out"))


def test_nothing_is_found_in_what_was_just_made(made: Path) -> None:
    assert dataset("verify", str(made)) == (0, [])


def test_what_is_found_is_made_again_and_nothing_else(made: Path, broken: Path) -> None:
    first, second, third, _ = ms.Dataset(broken)
    pixel = first.folder / "frame.tiff"
    content = bytearray(pixel.read_bytes())
    content[-1] ^= 1
    pixel.write_bytes(content)
    (second.folder / "clean.tiff").unlink()
    shutil.rmtree(third.folder)
    (first.view_folder / "more.txt").write_text("more")
    untouched = (broken / "samples").rglob("sample.json")
    inodes = {
        path: path.stat().st_ino
        for path in untouched
        if path.parent not in (first.folder, second.folder)
    }

    code, found = dataset("verify", str(broken))
    assert code == 1
    assert {(one["name"], one["file"], one["what"]) for one in found} == {
        (name_of(first.folder), "frame.tiff", "changed"),
        (name_of(second.folder), "clean.tiff", "missing"),
        (name_of(third.folder), "", "missing"),
        (name_of(first.view_folder), "more.txt", "extra"),
    }
    code, said = dataset("repair", str(broken), "--workers", "0")
    assert (code, said["made"], len(said["broken"])) == (0, 3, 4)
    assert contents(broken) == contents(made)
    assert inodes and all(path.stat().st_ino == inode for path, inode in inodes.items())


def name_of(folder: Path) -> str:
    """The name of the entry in this folder."""
    return "/".join(folder.parts[-3:])


def part_in(folder: Path) -> Path:
    """The only file of the index."""
    (path,) = (folder / INDEX).iterdir()
    return path


@pytest.mark.parametrize("what", ["changed", "missing"])
def test_the_index_is_written_again(made: Path, broken: Path, what: str) -> None:
    part, name = part_in(broken), f"{INDEX}/000000"
    if what == "missing":
        part.unlink()
    else:
        part.write_bytes(part.read_bytes()[:-1] + b"x")
        name = f"{INDEX}/{part.name}"
    code, found = dataset("verify", str(broken))
    assert (code, found) == (1, [{"kind": "dataset", "name": "", "file": name, "what": what}])
    code, said = dataset("repair", str(broken), "--workers", "0")
    assert (code, said["made"], said["broken"]) == (0, 0, [])
    assert contents(broken) == contents(made)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of Unix")
def test_nobody_waits_for_a_pipe_in_place_of_the_index(made: Path, broken: Path) -> None:
    part = part_in(broken)
    part.unlink()
    os.mkfifo(part)
    name = f"{INDEX}/{part.name}"
    assert dataset("verify", str(broken)) == (
        1,
        [{"kind": "dataset", "name": "", "file": name, "what": "changed"}],
    )
    assert dataset("repair", str(broken), "--workers", "0")[0] == 0
    assert contents(broken) == contents(made)


def test_other_entries_are_read_where_the_index_was_changed(broken: Path) -> None:
    pixel = next(iter(ms.Dataset(broken))).folder / "frame.tiff"
    pixel.write_bytes(pixel.read_bytes()[:-1])
    part_in(broken).write_text("{}\n")
    _, found = dataset("verify", str(broken))
    assert [(one["file"], one["what"]) for one in found] == [
        ("frame.tiff", "short"),
        (f"{INDEX}/{part_in(broken).name}", "changed"),
    ]


def test_files_that_do_not_belong_into_the_index_are_named(broken: Path) -> None:
    (broken / INDEX / "notes.txt").write_text("mine")
    assert dataset("verify", str(broken))[1] == [
        {"kind": "dataset", "name": "", "file": f"{INDEX}/notes.txt", "what": "stray"}
    ]
    assert dataset("repair", str(broken), "--workers", "0")[0] == 0
    assert (broken / INDEX / "notes.txt").exists()


def test_a_repair_that_is_stopped_forgets_the_index_before_the_samples(
    made: Path, broken: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a part of the index would name samples that are gone, and no run would look for them."""
    folder = next(iter(ms.Dataset(broken))).folder
    (folder / "frame.tiff").unlink()

    def stopped(store: Store, kind: str, key: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Store, "discard", stopped)
    with pytest.raises(KeyboardInterrupt):
        discard(broken, [*verify(broken)])
    monkeypatch.undo()
    assert not [*(broken / INDEX).iterdir()]
    assert dataset("repair", str(broken), "--workers", "0")[0] == 0
    assert contents(broken) == contents(made)
