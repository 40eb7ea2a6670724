"""Files and folders appear whole or not at all, outlive a power cut, and are an error where the disk is full."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.files import durable, npz, png, texts, tiff, user_cache
from mitsuba_sensor.files.appearing import output_folder, output_folders
from mitsuba_sensor.files.openexr import Plane, write_planes
from mitsuba_sensor.files.whole_folder import LISTING, appearing_folder, inside
from mitsuba_sensor.output import dng

resource = pytest.importorskip("resource")
NAMES = ("a.txt", "b.txt")
TRIES = 25
IMAGE = np.random.default_rng(1).random((40, 24)).astype(np.float32)
RAW, PICTURE = (IMAGE * 4000).astype(np.uint16), (IMAGE * 255).astype(np.uint8)
FRAMES = ms.expose(np.full((24, 24), 100.0), ms.load_camera("konnik_table1"), ms.Exposure(0.01))
WRITERS: dict[str, Callable[[Path], object]] = {
    "one.tiff": lambda path: tiff.write_tiff(path, RAW),
    "three.tiff": lambda path: tiff.write_tiff(path, RAW[None].repeat(3, 0)),
    "named.tiff": lambda path: tiff.write_named_pages(path, [("a", RAW), ("b", RAW)], None),
    "frame.dng": lambda path: dng.write_dng(path, FRAMES),
    "small.exr": lambda path: write_planes(path, {}, {"Y": Plane(IMAGE[:4, :4])}),
    "tail.exr": lambda path: write_planes(path, {}, {c: Plane(IMAGE[:34]) for c in "RGB"}),
    "large.exr": lambda path: write_planes(path, {}, {"Y": Plane(IMAGE.repeat(27, 0))}),
    "maps.npz": lambda path: npz.write_fpn_maps(path, {"prnu": IMAGE}),
    "frame.json": lambda path: texts.write_json(path, {"values": IMAGE.tolist()}),
    "page.html": lambda path: texts.write_page(path, "text" * 100),
    "frame.png": lambda path: png.write_png(path, PICTURE),
    "video.webp": lambda path: png.write_webp(path, [PICTURE, PICTURE.T.reshape(40, 24)], 0.1),
    "shard-{digest}.tar": lambda path: durable.write_lasting(path, [b"abc", b"def"]),
}
"""Every writer of one file."""


def write_folder(
    path: Path, text: str = "a", force: bool = False, name: str = "d/a.txt"
) -> None:
    with appearing_folder(path, force, {"format": "test"}) as folder:
        inside(folder, name).write_text(text, "utf-8")


def write_set(path: Path) -> None:
    with output_folder(path, NAMES) as folder:
        for name in NAMES:
            texts.write_page(folder / name, "new")


def write_frames(path: Path) -> None:
    with output_folders(path, ["left", "right"], ["frame.*"]) as folders:
        for folder in folders.values():
            FRAMES.save(folder)


FOLDERS: dict[str, Callable[[Path], object]] = {
    "set of files": write_set,
    "sets of frames": write_frames,
    "export": write_folder,
    "log": lambda path: [durable.make_lasting(path), durable.append_lasting(path / "a", b"x")],
    "moved": lambda path: durable.move_lasting(path.parents[1] / "old", path / "new"),
}
"""Every writer of several files, or of one in a folder that it makes."""


@pytest.mark.parametrize("name", [*WRITERS, *FOLDERS, "cache"])
def test_bytes_are_flushed_before_a_file_has_its_name_and_the_folder_after_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut takes what was not flushed: the bytes of a file, or the name that a folder has for it. Flushes and
    renames are recorded with the inode that they are of, and for every file that is there in the end: its last flush
    had all its bytes; after it had its name, the folder was flushed, and so was each folder above after it was made."""
    events = list[tuple[str, int, int]]()
    fsync, replace, rename, mkdir = os.fsync, os.replace, os.rename, os.mkdir

    def flushed(file: int) -> None:
        fsync(file)
        events.append(("flush", os.fstat(file).st_ino, os.fstat(file).st_size))

    def named(move: Callable[..., None], old: Any, new: Any) -> None:
        move(old, new)
        events.append(("name", os.lstat(new).st_ino, 0))

    def made(path: Any, *given: Any, **more: Any) -> None:
        mkdir(path, *given, **more)
        events.append(("name", os.lstat(path).st_ino, 0))

    (tmp_path / "old").write_text("old")
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", flushed)
        patch.setattr(os, "replace", lambda old, new: named(replace, old, new))
        patch.setattr(os, "rename", lambda old, new: named(rename, old, new))
        patch.setattr(os, "mkdir", made)
        if name == "cache":
            patch.setenv("XDG_CACHE_HOME", str(tmp_path / "deep" / "cache"))
            user_cache.keep("x", {"a": IMAGE})
        elif name in WRITERS:
            WRITERS[name](tmp_path / name)
        else:
            FOLDERS[name](tmp_path / "deep" / "out")
    paths = [path for path in tmp_path.rglob("*") if path.name != "old"]
    assert any(path.is_file() for path in paths)
    for path in paths:
        inode, parent = path.stat().st_ino, path.parent.stat().st_ino
        names = [k for k, (what, of, _) in enumerate(events) if (what, of) == ("name", inode)]
        flushes = [
            k for k, (what, of, _) in enumerate(events) if (what, of) == ("flush", inode)
        ]
        if path.is_file():
            assert flushes and events[flushes[-1]][2] == path.stat().st_size, path
            assert not names or min(flushes) < names[-1], path
        since = names[-1] if names else 0
        assert ("flush", parent) in [event[:2] for event in events[since:]], path


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """The kernel lets no file grow beyond ``size`` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("name", WRITERS)
def test_a_disk_that_is_full_at_any_byte_is_an_error_and_no_file(
    name: str, tmp_path: Path
) -> None:
    """NumPy (tofile) and OpenEXR do not say so themselves when the last bytes of a file find no place."""
    WRITERS[name](tmp_path / name)
    (path,) = tmp_path.iterdir()
    size = path.stat().st_size
    path.unlink()
    for limit in sorted({size * number // TRIES for number in range(TRIES)} | {size - 1}):
        with files_up_to(limit), pytest.raises(DiskFull) as caught:
            WRITERS[name](tmp_path / name)
        assert caught.value.path.parent == tmp_path and caught.value.size
        assert not list(tmp_path.iterdir()), f"of {size} bytes {limit} were written"
    with files_up_to(size):
        WRITERS[name](tmp_path / name)


def test_a_full_disk_is_named_by_the_folder_that_was_asked_for(tmp_path: Path) -> None:
    """Not by the scratch folders inside of one another."""
    with (
        pytest.raises(DiskFull) as caught,
        output_folder(tmp_path / "a", ["x.tiff"]) as outer,
        output_folder(outer, ["x.tiff"]) as inner,
        files_up_to(1000),
    ):
        tiff.write_tiff(inner / "x.tiff", RAW)
    assert caught.value.path == tmp_path / "a" / "x.tiff" and not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has it")
def test_an_exr_that_openexr_loses_without_an_error_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenEXR 3.5 reports no error when a file below 4 kB meets a full disk: it is lost when its buffer is closed."""
    monkeypatch.setattr(durable, "scratch_name", lambda folder: folder / "scratch")
    (tmp_path / "scratch").symlink_to("/dev/full")
    with pytest.raises(DiskFull):
        write_planes(tmp_path / "x.exr", {}, {"Y": Plane(IMAGE[:2, :2])})
    assert list(tmp_path.iterdir()) == []


def tree(folder: Path) -> dict[str, bytes]:
    files = (one for one in sorted(folder.rglob("*")) if one.is_file())
    return {str(one.relative_to(folder)): one.read_bytes() for one in files}


def test_all_files_of_a_job_appear_together(tmp_path: Path) -> None:
    with output_folder(tmp_path / "new" / "out", NAMES) as folder:
        for name in NAMES:
            (folder / name).write_text("new")
        assert not tree(tmp_path).keys() & {f"new/out/{name}" for name in NAMES}
    assert tree(tmp_path) == {f"new/out/{name}": b"new" for name in NAMES}


@pytest.mark.parametrize("end", [KeyboardInterrupt, ms.InputError, SystemExit])
@pytest.mark.parametrize("older", [{}, {"a.txt": b"old"}])
def test_a_job_that_fails_leaves_everything_as_it_was(
    tmp_path: Path, end: type[BaseException], older: dict[str, bytes]
) -> None:
    place = tmp_path if older else tmp_path / "new" / "out"
    for name, content in older.items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(end), output_folder(place, NAMES) as folder:
        (folder / "a.txt").write_text("half")
        raise end
    assert tree(tmp_path) == older and len(list(tmp_path.iterdir())) == len(older)


@pytest.mark.parametrize("renames", range(1, 6))
@pytest.mark.parametrize("end", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_what_stops_right_after_any_rename_loses_no_older_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, renames: int, end: BaseException
) -> None:
    """Of a.txt, which only the older run had, b.txt of both, c.txt of the new one, and a link that is replaced."""
    for name in ("a.txt", "b.txt", "target.txt"):
        (tmp_path / name).write_text(f"old {name}")
    (tmp_path / "link.txt").symlink_to("target.txt")
    old, real, done = tree(tmp_path), os.replace, []

    def replace(source: Path, target: Path) -> None:
        real(source, target)
        done.append(target)
        if len(done) == renames:
            raise end

    monkeypatch.setattr(os, "replace", replace)
    names = ("a.txt", "link.txt", "b.txt", "c.txt")
    with pytest.raises((KeyboardInterrupt, DiskFull)), output_folder(tmp_path, names) as folder:
        for name in names[2:]:
            (folder / name).write_text("new")
    assert tree(tmp_path) == old and (tmp_path / "link.txt").is_symlink()


def test_files_in_the_place_of_folders_are_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(ms.InputError, match="is a folder"), output_folder(tmp_path, NAMES):
        pytest.fail("the job was begun")
    (tmp_path / "file").touch()
    with pytest.raises(ms.InputError, match="file/maps"):
        npz.write_fpn_maps(tmp_path / "file" / "maps.npz", {})


@pytest.mark.parametrize(
    "write", [lambda path: npz.write_fpn_maps(path, {"prnu": IMAGE}), write_set, write_folder]
)
def test_a_name_with_a_null_byte_is_refused(
    tmp_path: Path, write: Callable[[Path], object]
) -> None:
    with pytest.raises(ms.InputError, match="null byte"):
        write(tmp_path / "a\0b")
    assert not list(tmp_path.iterdir())


def test_an_exported_folder_lists_its_files_and_is_replaced_only_by_force(
    tmp_path: Path,
) -> None:
    out = tmp_path / "not" / "yet"
    write_folder(out)
    found = json.loads((out / LISTING).read_text("utf-8"))
    hashes = {"d/a.txt": [1, hashlib.sha256(b"a").hexdigest()]}
    assert found == {"format": "test", "files": hashes}
    before = tree(tmp_path)
    with pytest.raises(KeyError), appearing_folder(out, True, {}) as folder:
        inside(folder, "b").write_text("new", "utf-8")
        raise KeyError
    with pytest.raises(ms.InputError, match="force=True"):
        write_folder(out, "new")
    assert tree(tmp_path) == before
    write_folder(out, "new", force=True, name="b.txt")
    assert set(tree(out)) == {"b.txt", LISTING}
    (out / "mine.txt").write_text("precious", "utf-8")
    with pytest.raises(ms.InputError, match="mine"):
        write_folder(out, "newer", force=True)
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


@pytest.mark.parametrize("make", [plain_folder, false_listing, link, Path.touch])
@pytest.mark.parametrize("force", [False, True])
def test_what_is_no_export_is_never_replaced(
    tmp_path: Path, make: Callable[[Path], object], force: bool
) -> None:
    make(tmp_path / "out")
    before = tree(tmp_path)
    with pytest.raises(ms.InputError, match="out exists"):
        write_folder(tmp_path / "out", force=force)
    assert tree(tmp_path) == before


@pytest.mark.parametrize(
    "name", ["../a", "a/../../b", "/etc/a", "", ".", "a\\b", "c:a", ".hidden", "a/.b", "a\n"]
)
def test_a_name_that_leads_out_of_the_folder_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ms.InputError):
        write_folder(tmp_path / "out", name=name)
    assert not list(tmp_path.iterdir())
