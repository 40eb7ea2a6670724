"""The folder of a dataset: a task appears whole or not at all, and every damage is found and named."""

from __future__ import annotations

import json
import os
import random
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.datasets import LIGHTS, contents, make_quickly, no_renders, plan_of
from helpers.marks import exhaustive

from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.run import run
from mitsuba_sensor.dataset.store import RECORD, Store, record_of
from mitsuba_sensor.dataset.table import Table, remove_faults, verify

__all__ = ["no_renders"]
Cli = Callable[..., Any]


@pytest.fixture
def made(tmp_path: Path, no_renders: pytest.MonkeyPatch) -> Path:
    """Return a dataset of 40 shards with two samples each."""
    run(plan_of(grid=LIGHTS), tmp_path / "made", workers=0, progress=False)
    return tmp_path / "made"


def test_a_shard_is_flushed_then_renamed_then_its_folder_is_flushed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut takes what was not flushed: the bytes of a file, or its name in a folder. Every
    call that flushes or names is recorded, in its order."""
    calls = list[tuple[str, str]]()
    flush, replace, make = os.fsync, os.replace, os.mkdir

    def path_of(file: int) -> str:
        return os.path.relpath(os.readlink(f"/proc/self/fd/{file}"), tmp_path)

    def flushed(file: int) -> None:
        calls.append(("flush", path_of(file)))
        flush(file)

    def replaced(old: Any, new: Any) -> None:
        path = os.path.relpath(old, tmp_path)
        assert {("flush", path), ("rename", path)} & {*calls}, "its bytes are not flushed"
        replace(old, new)
        calls.append(("rename", os.path.relpath(new, tmp_path)))

    def folder_made(path: Any, *given: Any) -> None:
        make(path, *given)
        calls.append(("make", os.path.relpath(path, tmp_path)))

    monkeypatch.setattr(os, "fsync", flushed)
    monkeypatch.setattr(os, "replace", replaced)
    monkeypatch.setattr(os, "mkdir", folder_made)
    store, plan = Store(tmp_path / "a" / "out"), plan_of(grid=LIGHTS)
    store.write_record(plan.record(2))
    make_quickly(store, plan.record(2), next(plan.tasks()))
    (shard,) = store.finished().values()
    store.put_aside(shard)
    for place, (what, path) in enumerate(calls):
        if what != "flush":
            later = [
                number
                for number in range(place + 1, len(calls))
                if calls[number][0] == "rename"
            ]
            before_the_next = calls[place : later[0] if later else None]
            name = f"the name of {path} is not flushed"
            assert ("flush", os.path.dirname(path) or ".") in before_the_next, name
    assert [path for what, path in calls if what == "rename"] == [
        f"a/out/{RECORD}",
        f"a/out/shards/{shard.name}",
        f"a/out/earlier/{shard.name}",
    ]


def test_a_shard_is_a_tar_of_webdataset_with_the_record_first_and_the_rows_last(
    made: Path,
) -> None:
    store = Store(made)
    for shard in store.finished().values():
        with tarfile.open(store.shards / shard.name) as tar:
            names = tar.getnames()
            first = tar.extractfile(names[0])
            assert first is not None and record_of(first.read()) == store.record()
        keys = [row.key for row in store.rows(shard)]
        assert keys == sorted(keys) and names[:2] == ["task/dataset,json", "light/view,json"]
        of_samples = [f"{key}.{name}" for key in keys for name in ("frame.tiff", "sample.json")]
        assert names[2:] == [*of_samples, "task/rows,json", "task/end,txt"]
    for line in Table(store):
        members = store.members(line.shard, line.offset, line.bytes)
        assert members["frame.tiff"] == random.Random(line.key).randbytes(3000)
        shared = store.members(line.shard, line.light_offset, line.light_bytes)
        assert list(shared) == ["view.json"]


def test_the_table_is_made_again_whenever_it_is_missing_damaged_or_older(made: Path) -> None:
    path = made / "index.parquet"
    table = Table(Store(made))
    assert [line.number for line in table] == [*range(80)]
    assert pq.read_table(path).num_rows == 80 and len(table.where("exposure_s", 0.1)) == 40
    whole = path.read_bytes()
    for content in (None, b"", whole[: len(whole) // 2], b"no parquet"):
        path.unlink()
        if content is not None:
            path.write_bytes(content)
        assert len(Table(Store(made))) == 80 and path.read_bytes() == whole
    (made / "shards" / table[79].shard).unlink()  # the last rows: all before them are equal
    assert verify(Store(made)) == []  # an older table is no fault
    assert len(Table(Store(made))) == 78
    made.chmod(0o500)
    if not os.access(made, os.W_OK):  # root may write anywhere
        path.unlink()
        assert len(Table(Store(made))) == 78
    made.chmod(0o700)


def test_readers_need_the_shards_alone(made: Path, cli: Cli) -> None:
    for path in made.iterdir():
        if path.is_file():
            path.unlink()
    assert len(Table(Store(made))) == 80
    done = cli("dataset", "status", made)
    assert done.exit_code == 0 and "80 of 80 samples" in done.stdout
    run(plan_of(grid=LIGHTS), made, workers=0, progress=False)
    assert record_of((made / RECORD).read_bytes()) == Store(made).record()


def damage(path: Path, chance: random.Random) -> None:
    """Flip a bit, cut the end off, write zeros or remove a file."""
    content, how = bytearray(path.read_bytes()), chance.randrange(4)
    if how == 3:
        path.unlink()
        return
    place = chance.randrange(len(content))
    if how == 0:
        content[place] ^= 1 << chance.randrange(8)
    elif how == 1:
        content = content[:place]
    else:
        content[place : place + 512] = bytes(len(content[place : place + 512]))
    path.write_bytes(content)


@pytest.mark.parametrize("damages", [12, exhaustive(300)])
def test_every_damage_is_named_and_mended(damages: int, made: Path) -> None:
    """Damage to shards, record and table; a change that changes nothing (zeros over zeros) is not damage."""
    chance, before = random.Random(5), contents(made)
    for _ in range(damages):
        path = made / chance.choice(sorted(before))
        name = path.relative_to(made).as_posix()
        damage(path, chance)
        now = contents(made)
        faults = {fault.file for fault in verify(Store(made))}
        missing_shard = name not in now and name.startswith("shards/")
        is_same = now == before or missing_shard  # a task that is not there is no fault
        assert faults == (set() if is_same else {name}), (name, faults)
        remove_faults(Store(made), verify(Store(made)))
        run(plan_of(grid=LIGHTS), made, workers=0, progress=False)
        assert contents(made) == before, name


FORGED = {
    "rows that are none": (b'"number":', b'"numbre":'),
    "a place beyond the file": (b'"offset":', b'"offset":9'),
    "a key that is none": (b'"key":"', b'"key":"/'),
}


@pytest.mark.parametrize("name", FORGED)
def test_what_somebody_has_forged_is_one_sentence(name: str, made: Path, cli: Cli) -> None:
    shard = sorted((made / "shards").iterdir())[0]
    content = shard.read_bytes()
    start = content.index(b"[{", content.index(b"task/rows,json"))
    old, new = FORGED[name]
    changed = content[:start] + content[start:].replace(old, new, 1)[: len(content) - start]
    shard.write_bytes(changed)
    for file in ("index.parquet", RECORD):
        (made / file).unlink()
    for command in (["status"], ["verify"], ["show", "0"]):
        done = cli("dataset", command[0], made, *command[1:])
        assert done.exit_code in (0, 1, 2) and "Traceback" not in done.stderr, done.stderr
    assert cli("dataset", "verify", made).exit_code == 1


@pytest.mark.parametrize("field", ["format", "made_by"])
def test_another_format_or_version_is_refused_with_both_named(field: str, made: Path) -> None:
    record = Store(made).require_record()
    other: dict[str, Any] = {"format": 99, "made_by": {**record.made_by, "mitsuba": "99.1.0"}}
    changed = record.model_copy(update={field: other[field]})
    (made / RECORD).write_bytes(changed.content())
    before = contents(made)
    with pytest.raises(InputError, match=r"99.*" + ("6" if field == "format" else r"3\.9")):
        run(plan_of(grid=LIGHTS), made, workers=0, progress=False)
    assert contents(made) == before


def test_what_is_no_dataset_says_so(tmp_path: Path, cli: Cli) -> None:
    (tmp_path / "shards").mkdir()
    (tmp_path / RECORD).write_text(json.dumps({"format": 6}))
    for command in ("status", "verify"):
        done = cli("dataset", command, tmp_path)
        assert done.exit_code == 2 and "there is no dataset in" in done.stderr
