"""Samples in shards are the samples in folders: the same files, found, verified, repaired and gone on with alike."""

from __future__ import annotations

import hashlib
import io
import random
import shutil
import tarfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.datasets import SCENES, TABLES, make_parts_small

import mitsuba_sensor as ms
from mitsuba_sensor import InputError
from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.exports.export import export
from mitsuba_sensor.dataset.index.origin import write_origin
from mitsuba_sensor.dataset.index.repair import discard, holdings, verify
from mitsuba_sensor.dataset.index.writer import IndexWriter
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, PlannedView, load_plan
from mitsuba_sensor.dataset.run import places
from mitsuba_sensor.dataset.run.places import Files, place_of
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.dataset.store import pieces
from mitsuba_sensor.dataset.store.entry_files import ShardFiles
from mitsuba_sensor.dataset.store.faults import Fault
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files import durable
from mitsuba_sensor.files.tar_members import END, found_members, member_bytes, members
from mitsuba_sensor.files.tiff import tiff_bytes

TEXT = """
name = "small"
outputs = ["raw", "clean", "preview", "aovs", "dng"]
render = { width = 32, spp = 4 }
scenes = [{ name = "flat", file = "flat_field" }]
cameras = [{ camera = "konnik_table1" }]
grid = { exposure_s = [0.01, 0.1], repetition = [0, 1, 2], "parameters.radiance" = [1, 2] }
"""
"""Two views of six samples."""


def plan_of(shard_samples: int, **tables: Any) -> DatasetPlan:
    store = {"shard_samples": shard_samples}
    file = read_dataset({**TABLES, "outputs": ["raw"], **tables, "store": store})
    return DatasetPlan(file, [SCENES], "text")


def stand_in(
    folder: Path,
    plan: DatasetPlan,
    lost: frozenset[int] = frozenset(),
    numbers: range | None = None,
) -> int:
    """A run whose samples are small files that need no render; how many samples it made."""
    write_origin(plan, folder)
    writer = IndexWriter(plan, Store(folder), numbers or range(plan.numbers))
    made = 0
    for view in writer.tasks():
        made += make(Store(folder), view, lost)
        writer.ended(view.first, not lost)
    writer.index()
    return made


def make(store: Store, view: PlannedView, lost: frozenset[int]) -> int:
    chosen = {one.key: k for k, one in enumerate(view.samples, view.first) if k not in lost}
    with place_of(store, view) as place:
        missing = [one for one in place.missing() if one.key in chosen]
        place.add_view(lambda folder: {"view.json": {"key": view.key}})
        for one in missing:
            place.add(one, partial(files_of, one.key))
    return len(missing)


def files_of(key: str, folder: Path) -> Files:
    (folder / "a.bin").write_bytes(random.Random(key).randbytes(900))
    return {"sample.json": {"key": key}}


def faults_in(folder: Path) -> list[Fault]:
    return [*verify(folder, roots=[SCENES])]


def shards(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "shards").iterdir())}


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same dataset in folders and in shards of five samples, of which one has samples of both views."""
    top = tmp_path_factory.mktemp("both")
    for size, name in ((0, "folders"), (5, "shards")):
        file = top / f"{name}.toml"
        file.write_text(f"store = {{ shard_samples = {size} }}\n{TEXT}", "utf-8")
        make_dataset(file, top / name, workers=0, progress=False)
    return top / "folders", top / "shards"


def test_a_sample_in_a_shard_has_the_files_and_arrays_of_one_in_a_folder(
    both: tuple[Path, Path],
) -> None:
    pairs = [*zip(*map(ms.Dataset, both), strict=True)]
    assert len(pairs) == 12
    for one, other in pairs:
        assert one.key == other.key and one.values == other.values
        assert one.facts == other.facts and one.view == other.view
        for name in ("frame.tiff", "frame.png", "frame.dng", "clean.tiff"):
            assert one.files.content(name) == other.files.content(name)
        for name in ("raw", "clean", "depth_m"):
            np.testing.assert_array_equal(one.read(name), other.read(name))
    with pytest.raises(InputError, match=r"is in the shard .* and has no folder"):
        pairs[0][1].folder  # noqa: B018
    with pytest.raises(InputError, match=r"there is no .*: electrons.tiff.*make it again"):
        pairs[0][1].read("electrons")


def test_a_shard_is_a_tar_file_of_webdataset(both: tuple[Path, Path]) -> None:
    """Members of a sample follow one another, with its number before the first dot; no time, owner or rights."""
    names = list[str]()
    for content in shards(both[1]).values():
        with tarfile.open(fileobj=io.BytesIO(content)) as tar:
            for member in tar:
                assert (member.mtime, member.uid, member.mode) == (0, 0, 0o644)
                names.append(member.name)
    numbers = [int(name[:10]) for name in names]
    assert numbers == sorted(numbers) and {*numbers} == {*range(12)}
    of_sample = {number: list[str]() for number in numbers}
    for name in names:
        if name[10] == ".":
            of_sample[int(name[:10])].append(name[11:])
    assert {*map(tuple, of_sample.values())} == {tuple(of_sample[0])}  # the same of each
    assert {"frame.tiff", "clean.tiff", "frame.dng", "sample.json"} < {*of_sample[0]}
    assert sum(name.endswith("/record,json") for name in names) == 12
    of_view = [name for name in names if name.endswith("/view,json")]
    assert [int(name[:10]) for name in of_view] == [0, 5, 6, 10]  # first of a view in a shard


@pytest.mark.parametrize("format", ["coco", "card"])
def test_exports_of_both_forms_are_equal(
    both: tuple[Path, Path], tmp_path: Path, format: str
) -> None:
    found = []
    for folder in both:
        export(folder, format, tmp_path / folder.name)
        paths = sorted(path for path in (tmp_path / folder.name).rglob("*") if path.is_file())
        own = [path for path in paths if path.name not in ("README.md", "files.json")]
        found.append(
            {path.relative_to(tmp_path / folder.name): path.read_bytes() for path in own}
        )
    assert found[0] == found[1]


@pytest.mark.exhaustive
def test_workers_make_the_same_shards(both: tuple[Path, Path], tmp_path: Path) -> None:
    run(load_plan(both[1] / "dataset.toml"), tmp_path / "two", workers=2, progress=False)
    assert shards(tmp_path / "two") == shards(both[1])


def test_parts_of_a_run_make_the_same_shards(both: tuple[Path, Path], tmp_path: Path) -> None:
    plan = load_plan(both[1] / "dataset.toml")
    for number in (3, 1, 2, 2):
        run(plan, tmp_path / "parts", shard=(number, 3), progress=False)
    assert shards(tmp_path / "parts") == shards(both[1])
    assert run(plan, tmp_path / "parts", workers=0, progress=False).made == 0
    assert not faults_in(tmp_path / "parts")


@pytest.fixture
def made(tmp_path: Path) -> tuple[DatasetPlan, Path]:
    """Four shards of 5 samples of two views."""
    plan = plan_of(5, grid={"repetition": [*range(10)], "parameters.radiance": [1, 2]})
    assert stand_in(tmp_path / "made", plan) == 20
    return plan, tmp_path / "made"


def test_every_flipped_bit_is_found_and_one_sample_at_most_is_made_again(
    made: tuple[DatasetPlan, Path],
) -> None:
    """Of 60 bits of headers, contents, fillings and the end, 10 of them the first ones of a file."""
    (plan, folder), chance = made, random.Random(1)
    right = shards(folder)
    for turn in range(60):
        name = chance.choice([*right])
        content = bytearray(right[name])
        place = turn if turn < 10 else chance.randrange(len(content))
        content[place] ^= 1 << chance.randrange(8)
        (folder / "shards" / name).write_bytes(content)
        faults = faults_in(folder)
        assert {(fault.kind, fault.name) for fault in faults} == {("shards", name)}
        discard(folder, faults)
        assert stand_in(folder, plan) <= 1
        assert shards(folder) == right and not faults_in(folder)


def test_a_shard_that_is_lost_or_replaced_is_made_again(made: tuple[DatasetPlan, Path]) -> None:
    plan, folder = made
    right = shards(folder)
    one, two, three, _ = (folder / "shards" / name for name in right)
    one.unlink()
    two.write_bytes(three.read_bytes())
    three.unlink()
    three.mkdir()
    (folder / "shards" / "notes.txt").write_text("mine")
    faults = faults_in(folder)
    told = {(fault.name or fault.file, fault.what) for fault in faults}
    assert told >= {
        (one.name, "missing"),
        (three.name, "not a plain file"),
        ("notes.txt", "stray"),
    }
    assert {name for name, _ in told} == {one.name, two.name, three.name, "notes.txt"}
    discard(folder, faults)
    assert stand_in(folder, plan) == 15
    (folder / "shards" / "notes.txt").unlink()
    assert shards(folder) == right and not faults_in(folder)


def test_a_sample_of_a_shard_is_read_without_a_copy_and_damage_names_its_place(
    made: tuple[DatasetPlan, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(durable, "write_copy", None)
    sample = ms.Dataset(made[1])[0]
    assert sample.facts == {"key": sample.key}
    frames = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    content = tiff_bytes(frames)
    monkeypatch.setattr(ShardFiles, "has", lambda self, name: True)
    monkeypatch.setattr(ShardFiles, "content", lambda self, name: content)
    np.testing.assert_array_equal(sample.read("raw"), frames)
    for name, file in (("raw", "frame.tiff"), ("preview", "frame.png")):
        content = b"no picture"
        with pytest.raises(InputError, match=rf"\.tar \(sample at byte 0\): {file} "):
            sample.read(name)


def test_a_sample_of_another_key_is_not_kept(made: tuple[DatasetPlan, Path]) -> None:
    """Someone who knows how a record is made puts one sample into the place of another."""
    plan, folder = made
    right = shards(folder)
    name = next(iter(right))
    content = right[name]
    found = [*members(io.BytesIO(content))]
    of_one = [
        content[one.start : one.end] for one in found if one.name.startswith("0000000001")
    ]
    of_two = [one for one in found if one.name.startswith("0000000002")]
    forged = b"".join(
        member_bytes(two.name, part[512 : 512 + two.size])
        for two, part in zip(of_two, of_one, strict=True)
    )
    changed = content[: of_two[0].start] + forged + content[of_two[-1].end :]
    (folder / "shards" / name).write_bytes(changed)
    discard(folder, faults_in(folder))
    assert stand_in(folder, plan) == 1 and shards(folder) == right


def test_samples_that_could_not_be_made_leave_a_shard_of_the_rest_that_is_completed_later(
    tmp_path: Path, made: tuple[DatasetPlan, Path]
) -> None:
    """7 is lost, and 10, which has the files of its view."""
    (plan, whole), folder = made, tmp_path / "partly"
    assert stand_in(folder, plan, lost=frozenset({7, 10})) == 18
    counts = [name.split("-")[2:5] for name in shards(folder)]
    assert counts == [[n, "of", "5"] for n in ("5", "4", "4", "5")]
    found = ms.Dataset(folder)
    assert len(found) == 18 and not faults_in(folder)
    assert found[7].view["key"] == found[7].view_key
    with pytest.raises(InputError, match=r"there is no .*: view\.json"):
        found[9].view  # noqa: B018, of sample 11
    held = holdings(Store(folder), plan)
    assert (held.samples, held.there, held.others) == (20, 18, 0)
    assert stand_in(folder, plan) == 2
    assert shards(folder) == shards(whole)


def test_a_killed_run_goes_on_with_what_its_pieces_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A piece that a power cut has torn loses the sample that is torn."""
    monkeypatch.setattr(places, "LONGEST_S", -1.0)  # a piece for each sample
    plan, folder = plan_of(10, grid={"repetition": [*range(10)]}), tmp_path / "made"
    write_origin(plan, folder)
    (view,) = IndexWriter(plan, Store(folder), range(10)).tasks()
    make(Store(folder), view, lost=frozenset(range(6, 10)))
    place = folder / "shards" / view.block.stem  # type: ignore[union-attr]
    assert len([*place.iterdir()]) == 6
    torn = sorted(place.iterdir())[2]
    torn.write_bytes(torn.read_bytes()[:700])
    assert holdings(Store(folder), plan).there == 6
    assert stand_in(folder, plan) == 5
    assert not place.exists() and len(shards(folder)) == 1


def test_another_text_of_the_file_keeps_the_shards_whose_samples_are_the_same(
    made: tuple[DatasetPlan, Path],
) -> None:
    """A scene that is added at the end changes no shard that was full."""
    _, folder = made
    grid = {"repetition": [*range(10)], "parameters.radiance": [1, 2]}
    scenes = [*TABLES["scenes"], {"name": "more", "file": "cornell_box"}]
    longer = plan_of(5, grid=grid, scenes=scenes)
    before = shards(folder)
    assert stand_in(folder, longer) == 20 and before.items() <= shards(folder).items()
    shorter = plan_of(5, grid={**grid, "repetition": [*range(9)]})
    held = holdings(Store(folder), shorter)
    assert held.there == 5 and held.others == 35


def test_a_full_disk_keeps_the_samples_before_it_and_names_place_and_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, folder = plan_of(10, grid={"repetition": [*range(10)]}), tmp_path / "made"
    write_all, written = pieces.write_all, [0]

    def full(file: Any, content: bytes) -> None:
        written[0] += len(content)
        if len(content) > len(END) and written[0] > 12_000:
            file.write(content[:700])
            raise OSError(28, "No space left on device")
        write_all(file, content)

    monkeypatch.setattr(pieces, "write_all", full)
    with pytest.raises(DiskFull, match=r"shards/000000-.*No space left on device; \d+ bytes"):
        stand_in(folder, plan)
    monkeypatch.setattr(pieces, "write_all", write_all)
    made = stand_in(folder, plan)
    assert 0 < made < 10 and not faults_in(folder) and len(ms.Dataset(folder)) == 10


def test_small_datasets_have_folders_and_large_ones_shards() -> None:
    def size(count: int, **tables: Any) -> int:
        file = read_dataset({**TABLES, "grid": {"repetition": [*range(count)]}, **tables})
        return DatasetPlan(file, [SCENES]).shard_samples

    assert size(10_000) == 0 and size(10_001) == 1000
    assert size(20_000, store={"shard_samples": 0}) == 0
    with pytest.raises(InputError, match=r"shard_samples: is 300; it must be 0.*divide 10000"):
        size(1, store={"shard_samples": 300})


def test_a_folder_keeps_the_form_that_it_has(made: tuple[DatasetPlan, Path]) -> None:
    plan, folder = made
    other = plan_of(0, grid=plan.file.grid)
    with pytest.raises(InputError, match=r"shard_samples = 5, and .* asks for 0.*new folder"):
        run(other, folder, workers=0, progress=False)


def test_members_are_found_again_behind_what_is_none(tmp_path: Path) -> None:
    content = [member_bytes(f"{k}.bin", bytes([k]) * 600 * k) for k in range(4)]
    path = tmp_path / "a.tar"
    path.write_bytes(
        content[0] + b"x" * 512 + content[1] + bytes(1024) + content[2] + content[3]
    )
    assert [one.name for one in found_members(path)] == ["0.bin", "1.bin", "2.bin", "3.bin"]
    with tarfile.open(fileobj=io.BytesIO(content[3] + END)) as tar:
        assert tar.extractfile("3.bin").read() == b"\3" * 1800  # type: ignore[union-attr]


def test_parts_of_the_index_that_share_no_shard_name_those_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_parts_small(monkeypatch, 10)
    plan = plan_of(5, grid={"repetition": [*range(23)]})
    stand_in(tmp_path / "made", plan, numbers=range(0, 8))
    assert len(ms.Dataset(tmp_path / "made")) == 8
    stand_in(tmp_path / "made", plan, numbers=range(8, 23))
    found = ms.Dataset(tmp_path / "made")
    assert [one.facts["key"] for one in found] == [one.key for one in found]
    assert len(found) == 23 and len(shards(tmp_path / "made")) == 5


def test_every_shard_is_named_by_its_content(made: tuple[DatasetPlan, Path]) -> None:
    for name, content in shards(made[1]).items():
        assert name.endswith(f"-{hashlib.sha256(content).hexdigest()}.tar")


@pytest.fixture(autouse=True)
def no_copies_left(tmp_path: Path) -> Iterator[None]:
    """Large folders are not kept for the next test."""
    yield
    shutil.rmtree(tmp_path, ignore_errors=True)
