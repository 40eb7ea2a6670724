"""Folders that appear whole or not at all, and never in the place of something that is not ours."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.files.whole_folder import LISTING, appearing_folder, inside


def write(path: Path, text: str = "a", force: bool = False, name: str = "deep/a.txt") -> None:
    with appearing_folder(path, force, {"format": "test"}) as folder:
        inside(folder, name).write_text(text, "utf-8")


def tree(folder: Path) -> dict[str, bytes]:
    return {
        str(one.relative_to(folder)): one.read_bytes()
        for one in sorted(folder.rglob("*"))
        if one.is_file()
    }


def test_a_folder_lists_its_files_with_their_hashes(tmp_path: Path) -> None:
    write(tmp_path / "not" / "there" / "yet")
    found = json.loads((tmp_path / "not/there/yet" / LISTING).read_text("utf-8"))
    assert found == {
        "format": "test",
        "files": {"deep/a.txt": [1, hashlib.sha256(b"a").hexdigest()]},
    }


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    write(tmp_path / "out", "old")
    before = tree(tmp_path)
    with pytest.raises(KeyError), appearing_folder(tmp_path / "out", True, {}) as folder:
        inside(folder, "b").write_text("new", "utf-8")
        raise KeyError
    assert tree(tmp_path) == before


def test_force_replaces_only_what_was_exported(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    write(out, "old")  # an empty folder is as good as none
    with pytest.raises(ms.InputError, match="--force replaces it"):
        write(out, "new")
    write(out, "new", force=True, name="b.txt")
    assert set(tree(tmp_path)) == {"out/b.txt", f"out/{LISTING}"}
    (out / "mine.txt").write_text("precious", "utf-8")
    with pytest.raises(ms.InputError, match=r"has mine.txt, which was not exported"):
        write(out, "newer", force=True)
    assert (out / "b.txt").read_text("utf-8") == "new"


def plain_folder(path: Path) -> None:
    path.mkdir()
    (path / "thesis.tex").write_text("…", "utf-8")


def false_listing(path: Path) -> None:
    plain_folder(path)
    (path / LISTING).write_text("[" * 10_000, "utf-8")


def link(path: Path) -> None:
    plain_folder(path.with_name("else"))
    path.symlink_to(path.with_name("else"))


@pytest.mark.parametrize(
    "make", [plain_folder, false_listing, link, lambda path: path.write_text("a", "utf-8")]
)
def test_what_is_no_export_is_never_replaced(
    tmp_path: Path, make: Callable[[Path], object]
) -> None:
    make(tmp_path / "out")
    before = tree(tmp_path)
    for force in (False, True):
        with pytest.raises(
            ms.InputError, match=r"out exists and (is no folder|was not exported)"
        ):
            write(tmp_path / "out", force=force)
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    "name", ["../a", "a/../../b", "/etc/a", "", ".", "a\\b", "c:a", ".hidden", "a/.b", "a\n"]
)
def test_a_name_that_leads_out_of_the_folder_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ms.InputError, match="no name of a file in an export"):
        write(tmp_path / "out", name=name)
    assert not list(tmp_path.iterdir())
