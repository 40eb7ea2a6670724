"""What is done to the parts of an index is found by name, and repaired; tests/attacks/dataset_index.py does more."""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.datasets import commit, follow, make_parts_small, plan_of, whole

from mitsuba_sensor.core import DiskFull, InputError
from mitsuba_sensor.dataset.index.origin import write_origin
from mitsuba_sensor.dataset.index.repair import discard, verify
from mitsuba_sensor.dataset.index.writer import lines_of
from mitsuba_sensor.dataset.store.record import INDEX
from mitsuba_sensor.dataset.store.store import Store

PLAN = plan_of(grid={"repetition": [*range(20)]})


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A dataset of 20 samples, whose index has three parts."""
    make_parts_small(monkeypatch, 7)
    write_origin(PLAN, tmp_path / "made")
    make_again(tmp_path / "made")
    return tmp_path / "made"


def make_again(folder: Path) -> None:
    writer = whole(PLAN, Store(folder))
    follow(writer)
    writer.index()


def parts(folder: Path) -> list[Path]:
    return sorted((folder / INDEX).iterdir())


def faults(folder: Path) -> set[tuple[str, str]]:
    """Names, and what is wrong with them."""
    return {(fault.file.removeprefix(f"{INDEX}/"), fault.what) for fault in verify(folder)}


def repaired(folder: Path) -> set[tuple[str, str]]:
    """What is still wrong after a repair."""
    discard(folder, [*verify(folder)])
    make_again(folder)
    return faults(folder)


def test_a_flipped_bit_a_lost_tail_and_more_bytes_are_found_wherever_they_are(
    made: Path,
) -> None:
    """In the magic, every page of a column, the footer, its length: 60 bits, and both ends. None is missed."""
    path, chance = parts(made)[1], random.Random(1)
    content = path.read_bytes()
    places = [0, 4, len(content) - 5, len(content) - 1, *chance.sample(range(len(content)), 60)]
    spoilt = [content[:k] + bytes([content[k] ^ 1 << k % 8]) + content[k + 1 :] for k in places]
    spoilt += [b"", content[:100], content[:-1], content + b"\0"]
    for other in spoilt:
        path.write_bytes(other)
        assert faults(made) == {(path.name, "changed")}
    assert not repaired(made) and path.read_bytes() == content


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("-000001-", "-000009-", "stray or changed"),
        ("-7-of-7-", "-8-of-7-", "changed"),
        ("-7-of-7-", "-7-of-8-", "changed"),
        ("-000001-", "-0000001-", "stray"),
        ("-7-of-", "-07-of-", "stray"),
        (".parquet", ".bak", "stray"),
    ],
)
def test_a_part_with_another_name_is_found_and_the_right_one_is_made(
    made: Path, old: str, new: str, what: str
) -> None:
    path = parts(made)[1]
    other = path.with_name(path.name.replace(old, new))
    path.rename(other)
    assert dict(faults(made))[other.name] in what
    assert repaired(made) <= {(other.name, "stray")} and path.exists()


@pytest.mark.parametrize(
    "put",
    [
        Path.mkdir,
        lambda path: path.symlink_to("/nowhere"),
        pytest.param(
            lambda path: os.mkfifo(path),
            marks=pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes"),
        ),
    ],
)
def test_what_stands_in_the_place_of_a_part_is_replaced(
    made: Path, put: Callable[[Path], object]
) -> None:
    path = parts(made)[1]
    path.unlink()
    put(path)
    assert faults(made) == {(path.name, "changed")} and not repaired(made)


def test_one_repair_is_enough_for_a_spoilt_part_and_a_lost_sample_of_another_part(
    made: Path,
) -> None:
    lines = [line for view in PLAN.views() for line in lines_of(view)]
    parts(made)[0].write_bytes(b"x")
    shutil.rmtree(Store(made).folder_of("samples", lines[15].name))
    assert faults(made) == {(parts(made)[0].name, "changed"), ("", "missing")}
    assert not repaired(made)


def test_parts_of_another_plan_and_older_ones_are_named(made: Path) -> None:
    """pandas would read them together with the right ones."""
    older = parts(made)[1].with_name(parts(made)[1].name.replace("-7-of-", "-6-of-"))
    shutil.copy(parts(made)[1], older)
    assert faults(made) == {(older.name, "stray")} and not repaired(made)
    write_origin(plan_of(grid={"repetition": [*range(21)]}), made)
    strays = {(path.name, "stray") for path in parts(made)}
    assert faults(made) == strays | {(f"{number:06d}", "missing") for number in range(3)}


def test_a_file_or_a_full_disk_in_the_place_of_the_index_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, view = Store(tmp_path / "out"), next(PLAN.views())
    commit(store, view.samples[0])
    (store.folder / INDEX).write_text("x")
    with pytest.raises(InputError, match="index: File exists"):
        follow(whole(PLAN, store))
    (store.folder / INDEX).unlink()
    mkdir = os.mkdir

    def full(path: Path, *more: int) -> None:
        if path == store.folder / INDEX:
            raise OSError(28, "No space left on device")
        mkdir(path, *more)

    monkeypatch.setattr(os, "mkdir", full)
    with pytest.raises(DiskFull, match="index: No space left on device; 4096 bytes"):
        follow(whole(PLAN, store))
