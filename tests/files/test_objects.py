"""Objects are listed, read by ranges and appear whole, in memory, on this machine and on a server that speaks S3."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest
from helpers.stores import address, s3_server

from mitsuba_sensor import InputError
from mitsuba_sensor.files.objects import Objects, is_address

__all__ = ["address", "s3_server"]
CONTENTS = bytes(range(256)) * 4000, bytes(range(255, -1, -1)) * 4000


@pytest.fixture
def place(address: str) -> Objects:
    """An empty place of each kind."""
    return Objects(address)


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """Two files of equal size that differ in each byte."""
    paths = tmp_path / "first", tmp_path / "second"
    for path, content in zip(paths, CONTENTS, strict=True):
        path.write_bytes(content)
    return paths


def test_what_was_put_is_listed_and_read_whole_and_by_ranges(
    place: Objects, files: tuple[Path, Path]
) -> None:
    assert place.sizes() == {} and (place / "shards").sizes() == {}
    for name, file in zip(("b.tar", "a.tar"), files, strict=True):
        (place / "shards" / name).put(file)
    (place / "record.json").put(files[0])
    size = len(CONTENTS[0])
    assert (place / "shards").sizes() == {"a.tar": size, "b.tar": size}
    assert place.sizes() == {"record.json": size}
    first = place / "shards" / "b.tar"
    assert first.read() == CONTENTS[0]
    for start, end in ((0, 1), (0, 512), (511, 1025), (size - 3, size), (1000, None)):
        assert first.read(start, end) == CONTENTS[0][start:end], (start, end)


def test_an_object_that_is_put_again_has_the_new_bytes(
    place: Objects, files: tuple[Path, Path]
) -> None:
    for file, content in zip(files, CONTENTS, strict=True):
        (place / "page").put(file)
        assert (place / "page").read() == content
    assert [*place.sizes()] == ["page"]


def test_of_two_that_write_one_object_at_once_a_reader_sees_one_whole(
    place: Objects, files: tuple[Path, Path]
) -> None:
    """Forty uploads by two threads; the store in memory, which fills an object byte by byte, has one writer only."""
    target, seen, stop = place / "page", set[bytes](), threading.Event()
    target.put(files[0])
    writers = [threading.Thread(target=put_often, args=(target, file)) for file in files]
    reader = threading.Thread(target=lambda: read_often(target, seen, stop))
    if place.address.startswith("memory:"):
        writers, reader = writers[:1], threading.Thread()
    for thread in (reader, *writers):
        thread.start()
    for thread in writers:
        thread.join()
    stop.set()
    reader.join()
    seen.add(target.read())
    assert seen <= {*CONTENTS}
    assert [*place.sizes()] == ["page"]


def put_often(target: Objects, file: Path) -> None:
    for _ in range(20):
        target.put(file)


def read_often(target: Objects, seen: set[bytes], stop: threading.Event) -> None:
    while not stop.is_set():
        seen.add(target.read())


def test_what_cannot_be_reached_is_one_sentence(place: Objects) -> None:
    with pytest.raises(InputError, match=r"none cannot be read: .+; check the address"):
        (place / "none").read()


@pytest.mark.parametrize(
    ("address", "said"),
    [("nowhere://a/b", "nowhere"), ("abfs://a/b", "adlfs")],
)
def test_stores_that_are_not_known_or_not_installed_say_so(address: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Objects(address).read()


def test_addresses_are_told_from_paths() -> None:
    for text in ("s3://a/b", "memory://x", "file:///data/x", "gs://b"):
        assert is_address(text)
    for path in (
        "pairs",
        "./s3:/a",
        "C:/pairs",
        "s3:",
        "://x",
        Path("s3://a"),
        b"s3://a",
        os.sep,
    ):
        assert not is_address(path)


def test_a_store_whose_package_is_not_there_is_a_sentence_with_the_way_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def url_to_fs(address: str) -> None:
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr("fsspec.core.url_to_fs", url_to_fs)
    with pytest.raises(InputError, match="Install s3fs to access S3") as raised:
        Objects("s3://bucket/pairs").sizes()
    assert "`pip install 'mitsuba-sensor[s3]'`" in str(raised.value)
