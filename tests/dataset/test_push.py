"""A dataset of shards in an object store reads as the folder that it was pushed from, whatever stopped the upload."""

from __future__ import annotations

import secrets
from pathlib import Path

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.stores import address, s3_server
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor import InputError
from mitsuba_sensor.cli.app import app
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.exports.export import export
from mitsuba_sensor.dataset.index.push import push
from mitsuba_sensor.dataset.index.verify_objects import verify_objects
from mitsuba_sensor.dataset.plan.planned import load_plan
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.files.objects import Objects

SAMPLES, SHARDS = 12, 3
FILE = """
name = "pushed"
store = { shard_samples = 5 }
render = { width = 16, spp = 16 }
outputs = ["raw", "clean", "aovs"]
scenes = [{ name = "flat", file = "flat_field" }]
cameras = [{ camera = "konnik_table1" }]
grid = { exposure_s = [0.01, 0.1], repetition = [0, 1, 2] }
random = { draws = 2, values = { "parameters.radiance" = { log_uniform = [1e-5, 1e-3] } } }
"""
__all__ = ["address", "s3_server"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of twelve samples of two views, in three shards of five, five and two."""
    place = tmp_path_factory.mktemp("made")
    (place / "pushed.toml").write_text(FILE)
    make_dataset(place / "pushed.toml", place / "pushed", workers=0, progress=False)
    assert len([*(place / "pushed" / "shards").glob("*.tar")]) == SHARDS
    return place / "pushed"


def assert_reads_alike(address: str, folder: Path) -> None:
    here, there = ms.Dataset(folder), ms.Dataset(address)
    assert len(here) == len(there) == SAMPLES
    for own, other in zip(here, there, strict=True):
        assert (own.key, own.split, own.values) == (other.key, other.split, other.values)
        assert own.facts == other.facts and own.view == other.view
        for name in ("raw", "clean", "depth_m"):
            np.testing.assert_array_equal(own.read(name), other.read(name))


def test_what_was_pushed_reads_as_its_folder(folder: Path, address: str) -> None:
    found = push(folder, address)
    assert (found.files, found.there) == (SHARDS + 1, 0)
    assert_reads_alike(address, folder)
    chosen = ms.Dataset(address).where(exposure_s=0.1, repetition=2)
    assert [sample.values["exposure_s"] for sample in chosen] == [0.1, 0.1]
    again = push(folder, address)
    assert (again.files, again.there) == (0, SHARDS + 1)


def test_a_sample_is_one_request(
    folder: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of its own bytes; the index is read before."""
    push(folder, address)
    sample, asked = ms.Dataset(address)[7], list[tuple[str, int, int | None]]()
    read = Objects.read

    def counted(self: Objects, start: int = 0, end: int | None = None) -> bytes:
        asked.append((self.address, start, end))
        return read(self, start, end)

    monkeypatch.setattr(Objects, "read", counted)
    assert sample.read("raw").shape == (1, 16, 16) and sample.read("clean").any()
    ((of, start, end),) = asked
    assert of.startswith(f"{address}/shards/") and end is not None and 0 < start < end


@pytest.mark.parametrize("stops_at", one_in(2, range(SHARDS + 4)))
def test_an_upload_that_is_stopped_leaves_nothing_torn_and_goes_on(
    folder: Path, stops_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At each of its files: a reader finds all samples, or no dataset yet."""
    address, done, put = f"memory://{secrets.token_hex(4)}", list[Path](), Objects.put

    def put_some(self: Objects, file: Path) -> None:
        if len(done) == stops_at:
            raise KeyboardInterrupt
        put(self, file)
        done.append(file)

    with monkeypatch.context() as stopped, pytest.raises(KeyboardInterrupt):
        stopped.setattr(Objects, "put", put_some)
        push(folder, address)
    if stops_at <= SHARDS + 2:
        with pytest.raises(
            InputError, match="put one there with `mitsuba-sensor dataset push`"
        ):
            ms.Dataset(address)
    else:
        assert_reads_alike(address, folder)
    found = push(folder, address)
    assert found.there == min(max(stops_at - 2, 0), SHARDS + 1)
    assert found.files + found.there == SHARDS + 1
    assert_reads_alike(address, folder)


def test_a_dataset_that_grows_is_pushed_again(
    folder: Path, tmp_path: Path, address: str
) -> None:
    """Its second half is made later; the first reader still finds what it had opened."""
    plan = load_plan(folder.parent / "pushed.toml")
    run(plan, tmp_path / "out", workers=0, shard=(1, 2), progress=False)
    push(tmp_path / "out", address)
    early = ms.Dataset(address)
    assert len(early) == SAMPLES // 2
    run(plan, tmp_path / "out", workers=0, progress=False)
    found = push(tmp_path / "out", address)
    assert found.files >= SHARDS - 1
    assert_reads_alike(address, folder)
    assert [sample.read("raw").shape for sample in early] == [(1, 16, 16)] * (SAMPLES // 2)


def test_an_object_of_another_size_is_put_again(
    folder: Path, address: str, tmp_path: Path
) -> None:
    """As a program that is none of ours may leave it."""
    push(folder, address)
    shard = next(iter((Objects(address) / "shards").sizes()))
    (tmp_path / "torn").write_bytes(b"torn")
    (Objects(address) / "shards" / shard).put(tmp_path / "torn")
    found = push(folder, address)
    assert (found.files, found.there) == (1, SHARDS)
    assert_reads_alike(address, folder)


def test_what_cannot_be_pushed_is_one_sentence_and_nothing_is_uploaded(
    folder: Path, tmp_path: Path
) -> None:
    address = f"memory://{secrets.token_hex(4)}"
    (tmp_path / "other.toml").write_text(
        FILE.replace("shard_samples = 5", "shard_samples = 0").replace('"pushed"', '"other"')
    )
    make_dataset(tmp_path / "other.toml", tmp_path / "other", workers=0, progress=False)
    with pytest.raises(InputError, match="an object store takes shards only"):
        push(tmp_path / "other", address)
    with pytest.raises(InputError, match="is no address of an object store"):
        push(folder, "bucket/pairs")
    with pytest.raises(InputError, match="is no dataset"):
        push(tmp_path, address)
    assert Objects(address).sizes() == {}
    (Objects(address) / "notes").put(tmp_path / "other.toml")
    with pytest.raises(InputError, match="holds other objects and no dataset"):
        push(folder, address)


def test_a_changed_shard_is_not_uploaded(folder: Path, tmp_path: Path) -> None:
    address, copy = f"memory://{secrets.token_hex(4)}", tmp_path / "copy"
    copy.mkdir()
    for path in [*folder.rglob("*")]:
        place = copy / path.relative_to(folder)
        if path.is_dir():
            place.mkdir(exist_ok=True)
        else:
            place.write_bytes(path.read_bytes())
    shard = min((copy / "shards").glob("*.tar"))
    content = bytearray(shard.read_bytes())
    content[1000] ^= 1
    shard.write_bytes(content)
    with pytest.raises(InputError, match=r"is not as it was written; .*repair"):
        push(copy, address)
    assert (Objects(address) / "shards").sizes() == {}


@pytest.mark.parametrize(
    "was, becomes", [('"pushed"', '"other"'), ("[0.01, 0.1]", "[0.01, 0.1, 1.0]")]
)
def test_another_dataset_or_file_that_has_grown_is_not_mixed_into_one_that_is_there(
    folder: Path, tmp_path: Path, address: str, was: str, becomes: str
) -> None:
    (tmp_path / "other.toml").write_text(FILE.replace(was, becomes))
    plan = load_plan(tmp_path / "other.toml")
    run(plan, tmp_path / "other", workers=0, shard=(1, 12), progress=False)
    push(folder, address)
    with pytest.raises(
        InputError, match="holds the dataset 'pushed' of another file or version"
    ):
        push(tmp_path / "other", address)


def test_a_run_makes_folders_only(folder: Path) -> None:
    with pytest.raises(InputError, match="-o is s3:/bucket/a, an address of an object store"):
        make_dataset(folder.parent / "pushed.toml", "s3://bucket/a")
    push(folder, address := f"memory://{secrets.token_hex(4)}")
    with pytest.raises(InputError, match="an export reads a folder of this machine"):
        export(address, "webdataset", folder.parent / "exported")


def test_the_command_says_what_it_uploaded(folder: Path) -> None:
    address = f"memory://{secrets.token_hex(4)}"
    done = CliRunner().invoke(app, ["dataset", "push", str(folder), address])
    assert done.exit_code == 0, done.output
    assert "4 shards and parts of the index uploaded" in " ".join(done.output.split())


def without_objects(place: Objects, name: str) -> None:
    """Remove an object, as only its owner does."""
    from fsspec.core import url_to_fs

    store, path = url_to_fs(str(place / name))
    store.rm(path)


def put_text(place: Objects, content: bytes, tmp_path: Path) -> None:
    (tmp_path / "content").write_bytes(content)
    place.put(tmp_path / "content")


def verified(address: str) -> list[tuple[str, str, str, str]]:
    return [tuple(fault) for fault in verify_objects(Objects(address))]  # type: ignore[misc]


def test_what_was_changed_in_the_store_is_named(
    folder: Path, tmp_path: Path, address: str
) -> None:
    """One bit of each object, each object removed, and objects that nobody pushed: each is found, and nothing else."""
    push(folder, address)
    place = Objects(address)
    assert not verified(address)
    (part,) = (path.name for path in (folder / "index").iterdir())
    shards = sorted(path.name for path in (folder / "shards").iterdir())
    of_name = {f"shards/{name}": ("shards", name, "") for name in shards}
    of_name |= {name: ("dataset", "", name) for name in ("record.json", "dataset.toml")}
    of_name[f"index/{part}"] = "dataset", "", f"index/{part}"
    for name, fault in of_name.items():
        content = bytearray((folder / name).read_bytes())
        content[len(content) // 2] ^= 1
        put_text(place / name, bytes(content), tmp_path)
        found = verified(address)
        assert (*fault, "changed") in found and len(found) <= 2
        without_objects(place, name)
        named = fault
        if name.startswith("index/"):
            named = "dataset", "", "index/000000"
        assert verified(address) == [(*named, "missing")]
        (place / name).put(folder / name)
        assert not verified(address)
    put_text(place / "shards/notes.txt", b"mine", tmp_path)
    put_text(place / "index/notes.txt", b"mine", tmp_path)
    assert verified(address) == [
        ("shards", "", "notes.txt", "stray"),
        ("dataset", "", "index/notes.txt", "stray"),
    ]


def test_a_store_without_a_dataset_is_one_sentence() -> None:
    with pytest.raises(InputError, match="is no dataset that was pushed; put one there"):
        verified(f"memory://{secrets.token_hex(4)}")


def test_the_command_verifies_a_store_and_says_how_to_mend_it(
    folder: Path, tmp_path: Path
) -> None:
    address = f"memory://{secrets.token_hex(4)}"
    push(folder, address)
    done = CliRunner().invoke(app, ["dataset", "verify", address])
    assert done.exit_code == 0 and "every file is as it was written" in done.output
    name = next((folder / "shards").iterdir()).name
    put_text(Objects(address) / "shards" / name, b"changed", tmp_path)
    done = CliRunner().invoke(app, ["dataset", "verify", address])
    said = " ".join(done.output.split())
    assert done.exit_code == 1 and f"dataset push DIR {address}" in said
    assert "dataset repair" not in said
