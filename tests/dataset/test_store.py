"""Entries of a dataset appear whole or not at all, and say what is wrong with them."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import pickle
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.dataset.store.record import Entry, Record, record_of, text_of
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files import durable, tiff

KEY, OTHER = "ab" * 12, "ab" + "cd" * 11
NAME = "scene/view_0000/settings"
SAMPLE = Entry("samples", NAME, KEY)
VIEW = Entry("views", f"scene/view_0000/{KEY}", KEY)
OTHER_VIEW = Entry("views", f"scene/view_0000/{OTHER}", OTHER)
CONTENT = {"frame.tiff": b"raw" * 100, "sample.json": b"{}", "nothing.bin": b""}


def writer(content: dict[str, bytes] = CONTENT) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        for name, data in content.items():
            (folder / name).write_bytes(data)

    return write


def tree(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def endless(path: Path) -> None:
    path.touch()
    os.truncate(path, 2**40)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "out")


def test_an_entry_is_a_folder_of_the_files_and_a_record_of_their_hashes(store: Store) -> None:
    record = store.commit(SAMPLE, writer())
    folder = store.folder / "samples" / "scene" / "view_0000" / "settings"
    assert store.folder_of("samples", NAME) == folder and record == store.record(
        "samples", NAME
    )
    assert record.files == {
        name: (len(data), hashlib.sha256(data).hexdigest()) for name, data in CONTENT.items()
    }
    assert {
        path.name: path.read_bytes() for path in folder.iterdir() if path.name != "record.json"
    } == CONTENT
    said = json.loads((folder / "record.json").read_bytes())
    assert (said["kind"], said["key"], set(said["files"])) == ("samples", KEY, set(CONTENT))
    assert [path.name for path in folder.parent.iterdir()] == ["settings"]
    assert folder.stat().st_mode == folder.parent.stat().st_mode  # others may read it


def test_the_first_writer_wins_and_the_second_one_does_nothing(store: Store) -> None:
    first = store.commit(VIEW, writer())
    assert store.commit(VIEW, lambda folder: pytest.fail("it is there")) == first

    def both(folder: Path) -> None:
        writer()(folder)
        store.commit(OTHER_VIEW, writer({"a": b"another program was faster"}))

    record = store.commit(OTHER_VIEW, both)
    assert list(record.files) == ["a"] and not list(store.verify_all())
    assert set(store.names("views")) == {VIEW.name, OTHER_VIEW.name} and not list(
        store.folder.rglob(".unfinished*")
    )


def test_a_broken_entry_is_replaced(store: Store) -> None:
    store.commit(SAMPLE, writer())
    (store.folder_of("samples", NAME) / "frame.tiff").write_bytes(b"short")
    assert not store.exists(SAMPLE)
    store.commit(SAMPLE, writer())
    assert store.exists(SAMPLE) and not list(store.verify_all())
    store.discard("samples", NAME)
    store.folder_of("samples", NAME).write_text("a file in the place of a folder")
    store.commit(SAMPLE, writer())
    assert not list(store.verify_all()) and not list(store.folder.rglob(".unfinished*"))


def test_what_goes_wrong_while_writing_leaves_nothing(store: Store) -> None:
    def fails(folder: Path) -> None:
        writer()(folder)
        raise RuntimeError("the renderer")

    with pytest.raises(RuntimeError, match="the renderer"):
        store.commit(SAMPLE, fails)
    for name in (".hidden", "record.json"):
        with pytest.raises(ValueError, match="plain files only"):
            store.commit(SAMPLE, writer({name: b""}))
    with pytest.raises(ValueError, match="plain files only"):
        store.commit(SAMPLE, lambda folder: (folder / "inner").mkdir())
    assert not tree(store.folder) and not list(store.folder.rglob(".unfinished*"))
    for key in ("../../../etc", "ab", KEY.upper(), KEY + "\n", "a/" + KEY):
        with pytest.raises(ValueError, match="24 hex digits"):
            store.commit(Entry("samples", NAME, key), writer())
    for name in ("../../../etc", "a/b", "a/b/c/d", "a/../c", "a//c", "a/b/.c", "a/b/c\n", ""):
        with pytest.raises(ValueError, match="scene/pose/settings"):
            store.commit(Entry("samples", name, KEY), writer())


def test_the_writers_of_files_name_the_final_place_and_the_bytes_of_a_full_disk(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    place = store.folder_of("samples", NAME)
    with monkeypatch.context() as patch, pytest.raises(DiskFull) as caught:
        patch.setattr("tifffile.TiffWriter.write", full)
        frames = np.zeros((2, 8, 4), np.uint16)
        store.commit(SAMPLE, lambda folder: tiff.write_tiff(folder / "frame.tiff", frames))
    assert (caught.value.path, caught.value.size) == (place / "frame.tiff", 128)
    said = f"cannot write {place / 'frame.tiff'}: {os.strerror(errno.ENOSPC)}; 128 bytes were to be written; make space"
    assert str(caught.value).startswith(said) and str(
        pickle.loads(pickle.dumps(caught.value))
    ) == str(caught.value)
    with monkeypatch.context() as patch, pytest.raises(DiskFull) as caught:
        patch.setattr(os, "fsync", full)
        store.commit(SAMPLE, writer({"frame.tiff": b"raw"}))
    assert (caught.value.path.parent, caught.value.size) == (
        place,
        3,
    ) or caught.value.path == place
    with pytest.raises(DiskFull):
        store.commit(SAMPLE, full)
    assert not tree(store.folder) and not list(store.folder.rglob(".unfinished*"))


def test_a_file_that_reads_back_changed_is_no_entry(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync = os.fsync

    def spoil(file: int) -> None:
        sync(file)
        if os.fstat(file).st_size == 300:
            os.pwrite(file, b"!", 7)

    monkeypatch.setattr(os, "fsync", spoil)
    with pytest.raises(
        ms.InputError, match=r"frame\.tiff: it reads back changed; check the disk"
    ):
        store.commit(SAMPLE, writer())
    assert not store.exists(SAMPLE) and not list(store.folder.rglob(".unfinished*"))


def test_all_files_of_an_entry_are_flushed_before_an_error_of_one_is_said(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody writes into the folder any more when it is removed."""
    ended, flush = list[str](), durable.flush

    def flush_some(path: Path, *facts: Any) -> None:
        if path.name == "a":
            raise OSError(errno.EIO, "broken")
        time.sleep(0.2)
        flush(path, *facts)
        ended.append(path.name)

    monkeypatch.setattr(durable, "flush", flush_some)
    with pytest.raises((OSError, ms.InputError), match="broken"):
        store.commit(
            Entry("samples", "a/view_0000/b", "0" * 24),
            lambda folder: [(folder / name).write_bytes(b"x") for name in "abc"],
        )
    assert sorted(ended) == ["b", "c", "record.json"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_a_process_that_was_forked_flushes_with_threads_of_its_own(store: Store) -> None:
    def commit(key: str) -> None:
        entry = Entry("samples", f"a/view_0000/{key[:4]}", key)
        store.commit(entry, lambda folder: (folder / "a").write_bytes(b"x"))

    commit("0" * 24)
    if (child := os.fork()) == 0:
        signal.alarm(60)  # threads of the parent would never flush
        commit("1" * 24)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert store.find(Entry("samples", "a/view_0000/1111", "1" * 24))


def test_left_over_folders_are_removed_by_age_and_by_the_clock_of_the_files(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.commit(SAMPLE, writer())
    dead, alive = (
        durable.scratch_name(store.folder_of("samples", NAME).parent) for _ in range(2)
    )
    for folder in (dead, alive):
        folder.mkdir()
        (folder / "frame.tiff").write_bytes(b"half")
        os.utime(folder, (0, 0))
    os.utime(dead / "frame.tiff", (0, 0))
    monkeypatch.setattr(time, "time", lambda: 0.0)  # the clock of this machine is wrong
    assert store.clean(older_s=60) == 1 and not dead.exists() and alive.exists()
    (rest,) = store.verify_all()
    assert rest.what == "unfinished" and not rest.is_damage, "it may be in work"
    assert store.clean(older_s=-60) == 1 and not alive.exists() and store.exists(SAMPLE)


def test_left_over_pages_are_removed_by_age_and_nobody_elses_files(store: Store) -> None:
    store.folder.mkdir(parents=True, exist_ok=True)
    dead, alive, foreign = (
        store.folder / name for name in (".dataset.toml.12", ".record.json.13", ".gitignore")
    )
    for path in (dead, alive, foreign):
        path.write_text("half")
    os.utime(dead, (0, 0))
    os.utime(foreign, (0, 0))
    assert store.clean() == 1 and not dead.exists() and alive.exists() and foreign.exists()


def test_a_program_that_was_taken_for_dead_publishes_nothing(store: Store) -> None:
    def slow(folder: Path) -> None:
        writer()(folder)
        assert store.clean(older_s=-60) == 1

    with pytest.raises(ms.InputError, match="another program has removed its unfinished files"):
        store.commit(SAMPLE, slow)
    assert not tree(store.folder)


def test_views_in_quarantine_are_known_by_key_until_they_are_released(store: Store) -> None:
    assert store.quarantined() == {}
    store.quarantine(KEY, {"log": "it aborts"})
    store.quarantine(OTHER, {"log": "it aborts too"})
    assert store.quarantined() == {KEY: {"log": "it aborts"}, OTHER: {"log": "it aborts too"}}
    (store.folder / "quarantine" / f"{OTHER}.json").write_bytes(b'{"log": "it ab')
    assert set(store.quarantined()) == {KEY}
    assert [(one.kind, one.name, one.what) for one in store.verify_all()] == [
        ("quarantine", OTHER, "changed")
    ]
    store.release(KEY)
    store.release(KEY)
    assert store.quarantined() == {}
    with pytest.raises(ValueError, match="24 hex digits"):
        store.release("../../etc/passwd")


def test_records_that_name_other_places_are_no_records() -> None:
    """Whoever wrote them: the hash of the record is right each time."""
    digest = "0" * 64
    assert record_of(text_of(Record("samples", NAME, KEY, {"a": (1, digest)}))) is not None
    for name in ("../a", "/etc/passwd", "a/b", "a\\b", "..", ".a", "", "record.json", "a\0b"):
        assert record_of(text_of(Record("samples", NAME, KEY, {name: (1, digest)}))) is None
    for size in (-1, 1.0, True, "1", None):
        assert record_of(text_of(Record("samples", NAME, KEY, {"a": (size, digest)}))) is None  # type: ignore[dict-item]
    for kind, key in (("other", KEY), ("samples", "ab"), ("samples", 5)):
        assert record_of(text_of(Record(kind, NAME, key, {}))) is None  # type: ignore[arg-type]
    for content in (b"", b"{}", b"[" * 100_000, b"\xff" * 100, b'{"kind": "samples"}\n'):
        assert record_of(content) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of Unix")
def test_pipes_links_and_endless_files_are_faults_and_stop_nothing(
    store: Store, tmp_path: Path
) -> None:
    store.commit(SAMPLE, writer())
    folder = store.folder_of("samples", NAME)
    kept = (folder / "record.json").read_bytes()
    for make in (os.mkfifo, lambda path: path.symlink_to("/dev/zero"), endless):
        (folder / "record.json").unlink()
        make(folder / "record.json")
        assert not store.exists(SAMPLE) and len(store.verify("samples", NAME)) == 1
    (folder / "record.json").unlink()
    (folder / "record.json").write_bytes(kept)
    assert store.exists(SAMPLE)
    (folder / "frame.tiff").rename(tmp_path / "elsewhere")
    (folder / "frame.tiff").symlink_to(tmp_path / "elsewhere")
    assert not store.exists(SAMPLE)
    assert store.verify("samples", NAME) == [
        ("samples", NAME, "frame.tiff", "not a plain file")
    ]
    store.discard("samples", NAME)
    assert (tmp_path / "elsewhere").read_bytes() == CONTENT["frame.tiff"], (
        "what a link leads to stays"
    )
