"""A dataset in a folder that cannot be written: what is complete is used, what is not is one sentence."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import SCENES, here
from helpers.marks import exhaustive

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.store.record import FILE, INDEX

__all__ = ["here"]
Cli = Callable[..., Any]
TEXT = """
name = "small"
outputs = ["raw", "preview"]
render = { width = 16, spp = 16 }
scenes = [{ name = "flat", file = "flat_field.xml" }]
cameras = [{ camera = "konnik_table1" }]
grid = { exposure_s = [0.01, 0.1] }
"""


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Nobody can write below the folder: by the modes of its files, or for root, who needs none, by a mount."""
    if os.geteuid():
        subprocess.run(["chmod", "-R", "a-w", folder], check=True)
        yield
        subprocess.run(["chmod", "-R", "u+w", folder], check=True)
        return
    try:
        subprocess.run(["mount", "--bind", folder, folder], check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("root can mount nothing here")
    try:
        subprocess.run(["mount", "-o", "remount,ro,bind", folder], check=True)
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.toml").write_text(TEXT)
    shutil.copy(SCENES / "flat_field.xml", folder)
    assert ms.dataset.make_dataset(folder / "small.toml", folder / "out", workers=0).made == 2
    return folder


RUN = ("run", "small.toml", "-o", "out")


def test_a_complete_dataset_that_is_read_only_is_there_and_read(here: Path, cli: Cli) -> None:
    with read_only(here / "out"):
        done = cli("dataset", *RUN)
        assert done.exit_code == 0 and "0 samples made, 2 were there already" in done.stdout
        assert "not written" not in done.stdout
        assert cli("dataset", *RUN, "--shard", "1/2").exit_code == 0
        for command in (("status", "out"), ("verify", "out"), ("repair", "out")):
            assert cli("dataset", *command).exit_code == 0
        assert cli("dataset", "export", "webdataset", "out", "-o", "shards").exit_code == 0
        assert len([one.read("raw") for one in ms.Dataset("out")]) == 2


@pytest.mark.parametrize("what", ["sample", INDEX, FILE, "record.json", "another file"])
def test_what_is_missing_of_one_that_is_read_only_is_one_sentence(
    what: str, here: Path, cli: Cli
) -> None:
    if what == "sample":
        shutil.rmtree(here / "out/samples")
        shutil.rmtree(here / "out" / INDEX)
    elif what == "another file":
        (here / "small.toml").write_text(TEXT.replace("0.1]", "0.1, 0.2]"))
    elif what == INDEX:
        shutil.rmtree(here / "out" / INDEX)
    else:
        (here / "out" / what).unlink()
    with read_only(here / "out"):
        done = cli("dataset", *RUN)
    assert done.exit_code == 2 and done.stderr.count("\n") == 1
    assert "cannot write into out, which is read-only here" in done.stderr


@pytest.mark.parametrize("workers", [0, exhaustive(2)])
def test_where_nothing_can_be_noted_a_run_ends_with_the_file_that_was_not_written(
    workers: int, here: Path, cli: Cli
) -> None:
    shutil.rmtree(here / "out")
    (here / "out/quarantine").mkdir(parents=True)
    shutil.copy(here / "small.toml", here / "out" / FILE)
    with read_only(here / "out/quarantine"):
        done = cli("dataset", *RUN, "--workers", workers)
    assert done.exit_code == 3 and done.stderr.count("\n") == 1
    assert "cannot write out/quarantine/" in done.stderr and "another place" in done.stderr


def test_a_repair_of_one_that_is_read_only_removes_nothing(here: Path, cli: Cli) -> None:
    frame = next(iter(ms.Dataset("out"))).folder / "frame.tiff"
    frame.write_bytes(frame.read_bytes()[:-1])
    before = sorted(here.rglob("*"))
    with read_only(here / "out"):
        done = cli("dataset", "repair", "out")
    assert done.exit_code == 2 and done.stderr.count("\n") == 1
    assert "Read-only file system" in done.stderr or "Permission denied" in done.stderr
    assert sorted(here.rglob("*")) == before
