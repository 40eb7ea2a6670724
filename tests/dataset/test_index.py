"""The index of a dataset: parts that appear whole, which other programs read, and any line is found at once."""

from __future__ import annotations

import gc
import os
import pickle
import random
import shutil
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.datasets import SCENES, TABLES, commit, follow, make_parts_small, plan_of, whole
from helpers.marks import one_in
from helpers.stores import address, s3_server

import mitsuba_sensor as ms
from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.index import index
from mitsuba_sensor.dataset.index import part as index_part
from mitsuba_sensor.dataset.index.index import Index
from mitsuba_sensor.dataset.index.origin import index_of, origin_of, write_origin
from mitsuba_sensor.dataset.index.part import Line, all_parts, kinds_of, part_of, parts_of
from mitsuba_sensor.dataset.index.writer import IndexWriter, lines_of
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.store.record import Entry
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files import durable
from mitsuba_sensor.files.objects import Objects
from mitsuba_sensor.files.parquet import END_BYTES, ParquetRows, about_at_end, parquet_bytes

__all__ = ["address", "s3_server"]
ROWS = 7
"""Of a part, in these tests."""
SEVERAL: dict[str, Any] = {
    "grid": {
        "exposure_s": [0.01, "auto", 1],
        "traverse.lamp": [[1.0, 2.0, 3.0], 0.5],
        "serial": [1, 2**64 - 1],
    },
    "list": [{"temperature_k": 290}, {"gain": "low", "parameters.glass": True}],
    "scenes": [
        {"name": "a", "file": "flat_field.xml"},
        {
            "name": "b",
            "file": "flat_field.xml",
            "views": [{"origin_m": [0, k, 4], "target_m": [0, 1, 0]} for k in (1, 2)],
        },
    ],
}
"""Values of every kind, some of them in some samples only."""


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    make_parts_small(monkeypatch, ROWS)


def test_every_value_of_every_line_comes_back(tmp_path: Path) -> None:
    """Numbers as numbers, texts as texts, lists as lists, and what a sample does not have is not there."""
    kinds = kinds_of(read_dataset({**TABLES, **SEVERAL}))
    values: list[Any] = [
        {"scene": "a", "camera": "c", "exposure_s": 0.01, "serial": 2**64 - 1},
        {"scene": "b", "camera": "c", "exposure_s": "auto", "traverse.lamp": [1.0, 2.0, 3.0]},
        {"scene": "b", "camera": "c", "exposure_s": 1, "traverse.lamp": 0.5, "gain": "low"},
        {"scene": "x\u2028y\x85z", "camera": "c", "parameters.glass": True, "view": 3},
    ]
    pose = {"origin_m": [0.0, 1.0, 4.0], "target_m": [0.0, 1.0, 0.0], "up": [0.0, 1.0, 0.0]}
    values[3]["pose"] = pose
    lines = [
        Line(k, f"{k:024x}", f"a/view_0000/{k}", "train", "f" * 24, False, x)
        for k, x in enumerate(values)
    ]
    part, content = part_of("0" * 64, 0, lines, 4, kinds)
    (tmp_path / "index").mkdir()
    (tmp_path / "index" / part.name).write_bytes(content)
    found = Index(tmp_path, all_parts(tmp_path))
    assert [*found] == lines == [found[k] for k in range(4)] and found[-1] == lines[-1]
    assert found.where("exposure_s", "auto")[0] == lines[1]
    assert found.where("traverse.lamp", (1.0, 2.0, 3.0))[0] == lines[1]
    assert [*found.where("pose", pose)] == [lines[3]]
    assert found.counts("exposure_s") == {"0.01": 1, "1.0": 1, "auto": 1}


def test_names_with_brackets_and_large_numbers_come_back(tmp_path: Path) -> None:
    """ "a (text)" is a name of its own, and the column of the texts of "a"."""
    names: dict[str, list[Any]] = {
        "parameters.a": ["x", 2**63 - 1],
        "parameters.a (text)": [3, "q"],
        "parameters.a (b)": [1, 0.5, "t", True],
        "parameters.a (b) c": [-(2**63), "z"],
        "parameters.d": [2**53 - 1, 0.5],
    }
    plan = plan_of(grid=names)
    lines = [line for view in plan.views() for line in lines_of(view)]
    part, content = part_of("0" * 64, 0, lines, len(lines), kinds_of(plan.file))
    (tmp_path / "index").mkdir()
    (tmp_path / "index" / part.name).write_bytes(content)
    found = Index(tmp_path, all_parts(tmp_path))
    assert [*found] == lines and set(names) < {*found.names()}
    with pytest.raises(InputError, match="Give a larger one as a text"):
        plan_of(grid={"parameters.a": [2**63]}).scenes  # noqa: B018


def test_pandas_reads_all_parts_at_once(small_parts: None, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    plan = plan_of(**{**SEVERAL, "list": []})
    follow(whole(plan, Store(tmp_path)))
    table = pandas.read_parquet(tmp_path / "index")
    assert table.number.tolist() == [*range(plan.samples)] and len(table.columns) == 15
    assert table.exposure_s.dtype == float and set(table["exposure_s (text)"].dropna()) == {
        "auto"
    }
    assert table[table.scene == "b"].pose.iloc[0]["origin_m"].tolist() == [0, 1, 4]


def test_a_part_appears_when_the_last_of_its_samples_is_there(
    small_parts: None, tmp_path: Path
) -> None:
    plan, store = plan_of(grid={"repetition": [*range(20)]}), Store(tmp_path)
    writer, known = whole(plan, store), list[int]()
    for view in writer.tasks():
        for sample in view.samples:
            commit(store, sample)
        assert len(all_parts(tmp_path)) == len(known), "not before it has ended"
        writer.ended(view.first, True)
        known.append(view.first)
    parts = [*parts_of(origin_of(plan).digest, all_parts(tmp_path)).values()]
    assert [(one.number, one.rows, one.is_whole) for one in parts] == [
        (0, 7, True),
        (1, 7, True),
        (2, 6, True),
    ]
    assert whole(plan, store).is_whole and whole(plan, store).there == 20


def test_what_is_lost_is_in_no_part_and_found_by_the_next_run(
    small_parts: None, tmp_path: Path
) -> None:
    plan, store = plan_of(grid={"repetition": [*range(20)]}), Store(tmp_path)
    writer = whole(plan, store)
    follow(writer, frozenset({3, 19}))
    assert [line.number for line in writer.index()] == [*(set(range(20)) - {3, 19})]
    again = whole(plan, store)
    assert not again.is_whole and again.there == 7
    assert sum(len(view.samples) for view in whole(plan, store).tasks()) == 13
    follow(again)
    assert [line.number for line in again.index()] == [*range(20)]
    assert len(all_parts(tmp_path)) == 3, "parts with fewer samples are gone"


@pytest.mark.parametrize("seed", one_in(2, range(4)))
def test_shards_in_any_order_write_the_parts_of_one_run(
    small_parts: None, tmp_path: Path, seed: int
) -> None:
    """Their borders are in the middle of parts and views; each shard looks for what the others have."""
    chance = random.Random(seed)
    scenes = [{"name": n, "file": "flat_field.xml", "parameters": {"a": n}} for n in "ab"]
    plan = plan_of(
        scenes=scenes,
        grid={"serial": [*range(13)], "exposure_s": [0.1, 0.2]},
        splits={"shares": {"train": 0.5, "test": 0.5}},
    )
    alone, shared = Store(tmp_path / "alone"), Store(tmp_path / "shared")
    follow(whole(plan, alone))
    ends = [0, *sorted(chance.sample(range(1, plan.numbers), 5)), plan.numbers]
    numbers = [range(*pair) for pair in zip(ends, ends[1:], strict=False)]
    writers = [IndexWriter(plan, shared, some) for some in numbers]
    tasks = [(writer, writer.tasks()) for writer in writers]
    while tasks:  # all at once, a task of any of them at a time
        writer, some = chance.choice(tasks)
        if (view := next(some, None)) is None:
            tasks.remove((writer, some))
            continue
        for sample in view.samples:
            commit(shared, sample)
        writer.ended(view.first, True)
    names = [{one.name for one in all_parts(store.folder)} for store in (alone, shared)]
    assert names[0] == names[1] and plan.samples < plan.numbers
    lines = [line for view in plan.views() for line in lines_of(view)]
    assert [
        (one.key, one.split)
        for one in Index(tmp_path / "shared", all_parts(tmp_path / "shared"))
    ] == [(one.key, one.split) for one in lines]


def test_a_part_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut leaves the whole part or none."""
    told, flush, replace = list[str](), durable.flush, durable.os.replace
    monkeypatch.setattr(durable, "flush", lambda *x: told.append("flush") or flush(*x))
    monkeypatch.setattr(durable.os, "replace", lambda *x: told.append("name") or replace(*x))
    monkeypatch.setattr(durable, "sync_folder", lambda folder: told.append("folder"))
    durable.write_lasting(tmp_path / "a", b"a")
    assert told == ["flush", "name", "folder"] and (tmp_path / "a").read_bytes() == b"a"


def test_parts_of_another_origin_are_passed_over_and_removed_at_the_end(
    small_parts: None, tmp_path: Path
) -> None:
    before, plan = (plan_of(grid={"repetition": [*range(n)]}) for n in (9, 8))
    store = Store(tmp_path)
    follow(whole(before, store))
    write_origin(plan, tmp_path)
    writer = whole(plan, store)
    assert writer.there == 0 and not len(index_of(tmp_path))
    follow(writer)
    assert len(writer.index()) == 8 and len(all_parts(tmp_path)) == 2


@pytest.mark.parametrize(
    "tables",
    [
        {"seed": 2},
        {"grid": {"exposure_s": [0.2, 0.1]}},
        {"outputs": ["raw"]},
        {"render": {"spp": 17, "width": 16}},
        {"cameras": [{"camera": "konnik_table1", "set": {"adc.bits": 10}}]},
    ],
)
def test_whatever_changes_keys_or_their_order_changes_the_digest(tables: Any) -> None:
    grid = {"exposure_s": [0.1, 0.2]}
    assert plan_of(grid=grid).digest == plan_of(grid=grid, description="new").digest
    assert plan_of(grid=grid).digest != plan_of(**{"grid": grid, **tables}).digest


def test_a_file_that_one_text_of_the_grid_names_changes_the_digest(tmp_path: Path) -> None:
    text = (SCENES / "flat_field.xml").read_text("utf-8")
    bitmap = '<texture type="bitmap"><string name="filename" value="$name"/></texture></scene>'
    scene = text.replace("</scene>", bitmap).replace(
        "<default", '<default name="name" value="a.png"/><default', 1
    )
    (tmp_path / "scene.xml").write_text(scene, "utf-8")
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(b"1")
    tables = {
        **TABLES,
        "scenes": [{"name": "s", "file": "scene.xml"}],
        "grid": {"parameters.name": ["a.png", "b.png"]},
    }
    first = DatasetPlan(read_dataset(tables), [tmp_path]).digest
    (tmp_path / "b.png").write_bytes(b"2")
    assert DatasetPlan(read_dataset(tables), [tmp_path]).digest != first


def stand_in(folder: Path, parts: int, rows: int) -> None:
    """An index of so many lines, whose keys are numbers."""
    (folder / "index").mkdir(parents=True)
    plan = plan_of(grid={"repetition": [*range(10)]})
    kinds, digest = kinds_of(plan.file), origin_of(plan).digest
    write_origin(plan, folder)
    for number in range(parts):
        first = number * index_part.NUMBERS
        lines = [
            Line(
                k,
                f"{k:024x}",
                f"flat/view_0000/{k}",
                ("test", "train")[k % 3 > 0],
                "0" * 24,
                False,
                {"scene": "flat", "repetition": k % 10},
            )
            for k in range(first, first + rows)
        ]
        part, content = part_of(digest, number, lines, rows, kinds)
        (folder / "index" / part.name).write_bytes(content)


def test_any_line_is_found_by_its_place_also_of_a_split_and_in_another_process(
    tmp_path: Path,
) -> None:
    stand_in(tmp_path, 3, 2000)
    samples, train = ms.Dataset(tmp_path), ms.Dataset(tmp_path, split="train")
    expected = [k for p in range(3) for k in range(p * 10_000, p * 10_000 + 2000)]
    assert [int(one.key, 16) for one in samples] == expected
    kept = [k for k in expected if k % 3]
    assert [int(one.key, 16) for one in train] == kept
    places = np.random.default_rng(1).integers(-len(kept), len(kept), 50).tolist()
    again = pickle.loads(pickle.dumps(train))
    assert [int(again[k].key, 16) for k in places] == [kept[k] for k in places]
    assert [int(x.key, 16) for x in train[5:4000:777]] == kept[5:4000:777]
    tens = train.where(repetition=4)
    assert [int(one.key, 16) for one in tens] == [k for k in kept if k % 10 == 4]
    assert repr(samples).startswith(f"<Dataset: 6000 samples (test {6000 - len(kept)}, train ")
    with pytest.raises(IndexError):
        samples[6000]


def test_a_split_is_opened_by_the_ends_of_the_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No part is read whole before one of its samples is asked for."""
    stand_in(tmp_path, 3, 2000)

    def refuse(path: Path) -> bytes:
        raise AssertionError(path)

    with monkeypatch.context() as patch:
        patch.setattr(index_part, "bytes_of", refuse)
        train = ms.Dataset(tmp_path, split="train")
        assert len(train) == sum(
            1 for p in range(3) for k in range(2000) if (p * 10_000 + k) % 3
        )
        assert ms.Dataset(tmp_path).splits == ["test", "train"]
    assert int(train[-1].key, 16) == 21_998


def test_a_split_in_a_store_of_objects_is_opened_by_the_ends_of_the_parts(
    tmp_path: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One request for each part, of 64 kB at most."""
    stand_in(tmp_path / "here", 2, 5000)
    place, lengths, read = Objects(address), list[int](), Objects.read
    for path in (tmp_path / "here").rglob("*.*"):
        (place / path.relative_to(tmp_path / "here").as_posix()).put(path)

    def counted(self: Objects, start: int = 0, end: int | None = None) -> bytes:
        content = read(self, start, end)
        if self.address.endswith(".parquet"):
            lengths.append(len(content))
        return content

    monkeypatch.setattr(Objects, "read", counted)
    train, expected = ms.Dataset(address, split="train"), ms.Dataset(tmp_path / "here", "train")
    assert lengths == [END_BYTES] * 2
    places = np.random.default_rng(1).integers(-len(train), len(train), 20).tolist()
    assert [train.lines[k] for k in places] == [expected.lines[k] for k in places]


@pytest.mark.parametrize("seed", one_in(3, range(3)))
def test_a_bit_flipped_in_a_part_is_a_sentence_or_changes_nothing_that_is_read(
    tmp_path: Path, seed: int
) -> None:
    """The ends are read without the rest, by which a hash would tell. 150 bits: every fourth in the texts, which hold
    the numbers of samples of each split. No sample has another place unless the part says that it was changed."""
    stand_in(tmp_path, 3, 20)
    expected = [sample.key for sample in ms.Dataset(tmp_path, split="train")]
    path, chance = sorted((tmp_path / "index").iterdir())[1], random.Random(seed)
    last = range(len(expected) - 13, len(expected))  # of the next part
    content = path.read_bytes()
    texts = content.index(b"train", -3000)
    for k in range(150):
        place = texts + chance.randrange(-20, 60)
        if k % 4:
            place = len(content) - 1 - chance.randrange(2000)
        spoilt = bytearray(content)
        spoilt[place] ^= 1 << chance.randrange(8)
        path.write_bytes(spoilt)
        with pytest.raises(InputError, match="was changed"):
            train = ms.Dataset(tmp_path, split="train")
            assert [train[place].key for place in last] == [expected[place] for place in last]
            assert [sample.key for sample in train] == expected
    path.write_bytes(content)


@pytest.mark.parametrize("content", [b"", b"PAR1", b"\xff" * 12, b"\xff" * 10**5])
def test_other_bytes_in_the_place_of_a_part_are_a_sentence(
    tmp_path: Path, content: bytes
) -> None:
    stand_in(tmp_path, 2, 3)
    sorted((tmp_path / "index").iterdir())[1].write_bytes(content)
    with pytest.raises(InputError, match="was changed"):
        ms.Dataset(tmp_path, split="train")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes")
def test_a_pipe_or_a_folder_in_the_place_of_a_part_is_a_sentence(tmp_path: Path) -> None:
    """Nobody waits for somebody who writes into the pipe."""
    stand_in(tmp_path, 2, 3)
    path = sorted((tmp_path / "index").iterdir())[1]
    for put in (os.mkfifo, os.mkdir):
        (path.rmdir if path.is_dir() else path.unlink)()
        put(path)
        with pytest.raises(InputError, match="cannot be read"):
            ms.Dataset(tmp_path, split="train")


def test_a_footer_longer_than_what_is_read_at_first_is_read_whole() -> None:
    kinds: dict[str, Any] = {f"column {k}": "integer" for k in range(600)}
    content = parquet_bytes({name: [*range(2500)] for name in kinds}, kinds, {"a": "b"})
    asked = list[int]()

    def read_end(most: int) -> bytes:
        asked.append(most)
        return content[-most:]

    assert about_at_end(read_end) == (2500, {"a": "b"})
    assert asked[0] == END_BYTES < asked[1] < len(content)


def test_parts_that_are_read_at_random_are_let_go_at_once(tmp_path: Path) -> None:
    """Without the garbage collector, which runs too seldom for buffers of which it does not know the sizes."""
    stand_in(tmp_path, 12, 3)
    samples, kept = ms.Dataset(tmp_path), weakref.WeakSet[ParquetRows]()
    gc.collect()
    gc.disable()
    try:
        for k in range(0, 36, 3):
            samples[k]
            kept.add(index.opened(tmp_path, samples.lines.parts[k // 3]).rows)
            assert len(kept) <= index.MOST_KEPT
    finally:
        gc.enable()
    assert len(kept) == index.MOST_KEPT


def test_a_dataset_that_changed_since_it_was_opened_says_so(tmp_path: Path) -> None:
    stand_in(tmp_path, 1, 3)
    samples = ms.Dataset(tmp_path)
    shutil.rmtree(tmp_path / "index")
    with pytest.raises(InputError, match="open it again"):
        samples[0]
    with pytest.raises(InputError, match=r"has no index yet.*dataset run` goes on"):
        ms.Dataset(tmp_path)
    with pytest.raises(InputError, match="no dataset that has complete samples"):
        ms.Dataset(tmp_path / "empty")


def test_a_split_that_no_sample_has_is_a_sentence(tmp_path: Path) -> None:
    stand_in(tmp_path, 1, 3)
    with pytest.raises(InputError, match="split is 'tran'; the samples have test, train"):
        ms.Dataset(tmp_path, split="tran")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a process to kill")
@pytest.mark.parametrize("step", one_in(3, range(7)))
def test_a_run_that_is_killed_while_it_writes_parts_is_resumed_to_the_same(
    small_parts: None, tmp_path: Path, step: int
) -> None:
    """Killed before the flush, the name, the flush of the folder, or the removal of a part with fewer samples; of three
    parts, of which the first has been written without its last sample before."""
    plan = plan_of(grid={"repetition": [*range(20)]})
    alone, store = Store(tmp_path / "alone"), Store(tmp_path / "out")
    follow(whole(plan, alone))
    follow(IndexWriter(plan, store, range(7)), frozenset({6}))
    if (child := os.fork()) == 0:
        steps = iter(range(100))
        for name in ("flush", "sync_folder", "remove_folder"):
            die_at(name, steps, step, store.folder / "index")
        follow(whole(plan, store))
        os._exit(0)
    assert os.WEXITSTATUS(os.waitpid(child, 0)[1]) == 9
    index = Index(
        store.folder, parts_of(origin_of(plan).digest, all_parts(store.folder)).values()
    )
    assert all(store.exists(Entry("samples", x.name, x.key)) for x in index), (
        "each part is true"
    )
    follow(whole(plan, store))
    store.clean(older_s=-60)
    whole(plan, store).index()
    names = [sorted(os.listdir(one.folder / "index")) for one in (alone, store)]
    assert names[0] == names[1]


def die_at(name: str, steps: Iterator[int], step: int, folder: Path) -> None:
    """End this process at the call of this number, of those that have to do with a folder."""
    before = getattr(durable, name)

    def call(path: Path, *more: object) -> None:
        if path.is_relative_to(folder) and next(steps) == step:
            os._exit(9)
        before(path, *more)

    setattr(durable, name, call)
