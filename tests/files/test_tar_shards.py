"""Tar shards: the tar and WebDataset readers of others find every sample; the bytes are the same each time."""

from __future__ import annotations

import io
import json
import tarfile
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.errors import DiskFull
from mitsuba_sensor.files.tar_shards import TarShards, npy

RAW = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)


def sample(number: int) -> dict[str, bytes]:
    return {
        "raw.npy": npy(RAW + np.uint16(number)),
        "json": json.dumps({"number": number}).encode(),
        "png": b"p" * 700,
    }


def write(folder: Path, count: int = 25, **bounds: int) -> dict[str, int]:
    folder.mkdir(parents=True, exist_ok=True)
    with TarShards(folder, "train", **bounds) as shards:
        for number in range(count):
            shards.add(f"{number:024x}", sample(number))
    return shards.shards


def test_shards_are_bounded_and_hold_every_sample_in_order(tmp_path: Path) -> None:
    bounds = {"most_bytes": 30_720, "most_samples": 7}
    found = write(tmp_path, **bounds)
    assert (
        list(found) == [f"train-{number:06d}.tar" for number in range(len(found))]
        and sum(found.values()) == 25
    )
    names = []
    for name, count in found.items():
        assert (tmp_path / name).stat().st_size <= 30_720 and 0 < count <= 7
        with tarfile.open(tmp_path / name) as tar:
            for one in tar:
                assert (one.mtime, one.uid, one.gid, one.uname, one.gname, one.mode) == (
                    0,
                    0,
                    0,
                    "",
                    "",
                    0o644,
                )
                names.append(one.name)
    assert names == [
        f"{number:024x}.{end}" for number in range(25) for end in ("raw.npy", "json", "png")
    ]
    assert max(found.values()) == 7  # 7 × 3584 bytes and the end of the file


def test_the_same_samples_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write(tmp_path / name, most_samples=10)
    for one in sorted((tmp_path / "a").iterdir()):
        assert one.read_bytes() == (tmp_path / "b" / one.name).read_bytes()


def test_webdataset_reads_and_decodes_the_samples(tmp_path: Path) -> None:
    wds = pytest.importorskip("webdataset")
    shards = [str(tmp_path / name) for name in write(tmp_path, most_samples=10)]
    stream = wds.WebDataset(shards, shardshuffle=False, empty_check=False)
    found = list(
        stream.decode(wds.handle_extension("png", bytes)).to_tuple("__key__", "raw.npy", "json")
    )
    assert [key for key, _, _ in found] == [f"{number:024x}" for number in range(25)]
    for number, (_, raw, facts) in enumerate(found):
        np.testing.assert_array_equal(raw, RAW + number)
        assert raw.dtype == np.uint16 and facts == {"number": number}


def test_a_large_sample_has_a_shard_of_its_own_and_files_are_copied_in_pieces(
    tmp_path: Path,
) -> None:
    large = tmp_path / "large"
    with large.open("wb") as file:
        file.truncate(50_000_000)
    tracemalloc.start()
    with TarShards(tmp_path, "shard", most_bytes=1_000_000) as shards:
        for key, content in (("a", b"1"), ("b", large), ("c", b"3")):
            shards.add(key, {"bin": content})
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert list(shards.shards.values()) == [1, 1, 1] and most < 5_000_000


@pytest.mark.parametrize(
    ("key", "end"), [("a.b", "png"), ("../a", "png"), ("", "png"), ("a", "../x"), ("a", "")]
)
def test_a_key_or_an_extension_that_webdataset_would_split_is_refused(
    tmp_path: Path, key: str, end: str
) -> None:
    with TarShards(tmp_path, "shard") as shards, pytest.raises(ms.InputError):
        shards.add(key, {end: b""})
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_said_with_the_path_and_the_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tarfile.TarFile, "addfile", full)
    with (
        TarShards(tmp_path, "shard") as shards,
        pytest.raises(DiskFull, match=r"shard-000000\.tar") as caught,
    ):
        shards.add("a", {"bin": b"1"})
    assert caught.value.size == 1024


def test_an_array_is_npy_without_pickle() -> None:
    np.testing.assert_array_equal(np.load(io.BytesIO(npy(RAW)), allow_pickle=False), RAW)
    with pytest.raises(ValueError, match="pickle"):
        npy(np.array([object()]))
