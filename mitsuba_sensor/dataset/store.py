"""A dataset on disk: one tar file for each task, which is there whole or not at all.

A task is one light and the samples that are exposed to it. A folder has

* ``dataset.json``: the record, i.e. the text of the dataset file, versions and the format. Every shard has it too.
* ``shards/TASK-SHA256.tar``: the tasks that are finished. There = a file of the task's key exists; sound = its hash is
  its name; made again = removed, and run again.
* ``index.parquet``: a row for each sample (table.py), made from the shards whenever it is missing or older.
* ``failed.jsonl``: a line for each task that could not be made (engine.py).
* ``earlier/``: shards of an earlier text of the dataset file; nothing reads them.
* ``README.md``, ``contact_sheet.png``, ``samples.csv``: for people; made at the end of a run.

Members of a shard, in this order. KEY is that of a sample, and readers of WebDataset pass over names without a dot::

    task/dataset,json         the record
    light/aovs,exr            files that all samples of the task share: aovs.exr, irradiance.exr, view.json
    KEY.frame.tiff            files of a sample, samples in the order of their keys
    KEY.sample.json
    task/rows,json            a list with an object for each sample, see Row: it says where the members are
    task/end,txt              where rows,json begins, in bytes of the file; of 2048 bytes before its end

Bytes depend on the samples and on the text of the dataset file alone: no times, owners or rights are in them.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from ..core import InputError
from ..files import durable
from .keys import Config, Facts

FORMAT = 6
"""Of a folder; another one is refused."""
RECORD, SHARDS, EARLIER, INDEX = "dataset.json", "shards", "earlier", "index.parquet"
OF_RECORD, OF_ROWS, OF_END = "task/dataset,json", "task/rows,json", "task/end,txt"
OF_LIGHT = "light/"
BLOCK = 512
MOST_BYTES_OF_HEAD = 2**26
"""Of a record, or of the rows of a shard."""
_SHARD = re.compile(r"([0-9a-f]{24})-([0-9a-f]{64})\.tar")


class Shard(NamedTuple):
    """A finished task: its key, and the SHA-256 of its file."""

    task: str
    digest: str

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.task}-{self.digest}.tar"


class Row(BaseModel):
    """What is known of a sample without its files.

    number : of the sample in the order of the dataset file, when it was made.  values : what varies, by name; as in
    sample.json.  exposed : exposed_s [s], system_gain_dn_per_e [DN/e-] and black_level_dn of the first frame.
    offset, bytes : of its members in the shard.  light_offset, light_bytes : of the files that the samples of its task
    share; 0 bytes where there are none.  shard : name of its file.
    """

    model_config = ConfigDict(frozen=True, strict=True)

    number: int = Field(ge=0)
    key: str = Field(pattern=r"^[0-9a-f]{24}$")
    split: str
    values: Facts
    exposed: dict[str, float]
    offset: int = Field(ge=0)
    bytes: int = Field(ge=0)
    light_offset: int = Field(ge=0)
    light_bytes: int = Field(ge=0)
    shard: str = ""


class Record(BaseModel):
    """What a dataset is made from.

    text : of the dataset file, as it was written.  samples : number of samples of the complete dataset.  made_by :
    versions of everything that pixels depend on.
    """

    model_config = ConfigDict(frozen=True, strict=True)

    format: int = FORMAT
    made_by: dict[str, str | None]
    samples: int
    text: str

    def content(self) -> bytes:
        """JSON with a line for each field, at its end the SHA-256 of all lines before."""
        lines = [f"{json.dumps(name)}: {json.dumps(x, ensure_ascii=False)}" for name, x in self]
        body = "{\n" + ",\n".join(lines)
        return f'{body},\n"sha256": "{_digest(body)}"\n}}\n'.encode()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class Member(NamedTuple):
    """A file in a tar file.  start : of its header.  offset, size : of its content."""

    name: str
    start: int
    offset: int
    size: int

    @property
    def end(self) -> int:
        """Where the next member starts."""
        return self.offset + -(-self.size // BLOCK) * BLOCK


class Store:
    """The shards of a dataset. Any number of programs may write; of two that make one task the bytes are equal."""

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.shards = self.folder / SHARDS

    def finished(self) -> dict[str, Shard]:
        """Task → its shard. A look at names alone."""
        found = map(_SHARD.fullmatch, durable.names_of(self.shards))
        return {name[1]: Shard(name[1], name[2]) for name in found if name}

    def commit(
        self,
        task: str,
        record: Record,
        light_files: Mapping[str, bytes],
        samples: Iterable[tuple[Config, Mapping[str, bytes]]],
    ) -> Shard:
        """Write a task whole. When this returns, a power cut loses nothing of it. Raises DiskFull and InputError.

        light_files : that the samples share.  samples : fields of the Row of each but for places, and its files.
        """
        chunks = _shard_bytes(record, light_files, samples)
        return Shard(
            task, durable.write_lasting(self.shards / f"{task}-{{digest}}.tar", chunks)
        )

    def is_sound(self, shard: Shard) -> bool:
        """Whether the bytes of a shard are those that its name says."""
        try:
            return durable.sha256_of(self.shards / shard.name) == shard.digest
        except OSError:
            return False

    def size(self) -> int:
        """Bytes of all shards."""
        return sum((self.shards / x.name).stat().st_size for x in self.finished().values())

    def remove(self, shard: Shard) -> None:
        """Remove a shard; a run makes it again."""
        durable.remove_file(self.shards / shard.name)

    def put_aside(self, shard: Shard) -> None:
        """Move a shard into EARLIER, where nothing reads it."""
        durable.move_lasting(self.shards / shard.name, self.folder / EARLIER / shard.name)

    def rows(self, shard: Shard) -> list[Row]:
        """The rows of a shard. Raises InputError where it is not as it was written."""
        with self.opened(shard.name) as file:
            try:
                rows = json.loads(_rows_content(file))
                return [Row(**{**row, "shard": shard.name}) for row in rows]
            except (OSError, ValueError, TypeError, RecursionError):
                raise self.changed(shard.name) from None

    def members(self, shard: str, offset: int, size: int) -> dict[str, bytes]:
        """Content of the members that begin in these bytes of a shard, by their names without the key or folder.

        shard : name of its file.  ``members(row.shard, row.offset, row.bytes)["frame.tiff"]`` is that of a sample;
        of the files that samples share the names have dots again, ``aovs.exr``. Raises InputError.
        """
        found = {}
        with self.opened(shard) as file:
            if not 0 <= offset <= offset + size <= os.fstat(file.fileno()).st_size:
                raise self.changed(shard)
            file.seek(offset)
            content = file.read(size)
        for member in members_in(content):
            body = content[member.offset : member.offset + member.size]
            if len(body) < member.size:
                break
            found[short_name(member.name)] = body
        if not found:
            raise self.changed(shard)
        return found

    def opened(self, shard: str) -> BinaryIO:
        """A shard that is read by places. Raises InputError where it is not there."""
        try:
            return durable.open_to_read(self.shards / shard)
        except OSError as error:
            raise InputError(
                f"{self.shards / shard} cannot be read: {error.strerror}; run the dataset again to make it, or open "
                "it again if it has changed since it was opened."
            ) from None

    def changed(self, shard: str) -> InputError:
        """What is said of a shard that is not as it was written."""
        return InputError(
            f"{self.shards / shard} is not as it was written; `mitsuba-sensor dataset verify {self.folder}` finds what "
            "is damaged: remove that, and run the dataset again."
        )

    def record(self) -> Record | None:
        """The record of the folder; where it is missing or damaged, that of any of its shards. None where there is no
        dataset. Raises InputError for one of another format."""
        own = self._record_content()
        for content in (own, *map(self._record_in, self.finished().values())):
            if (record := record_of(content)) is not None:
                self._require_format(record.format, record.made_by)
                return record
        with suppress(ValueError, RecursionError):  # of a later version, which has other fields
            facts = json.loads(own)
            if isinstance(facts, dict) and facts.get("format", FORMAT) != FORMAT:
                self._require_format(facts["format"], facts.get("made_by"))
        return None

    def _require_format(self, number: object, made_by: object) -> None:
        if number != FORMAT:
            versions = made_by if isinstance(made_by, dict) else {}
            raise InputError(
                f"{self.folder} holds a dataset of format {number!r:.20}, made with mitsuba-sensor "
                f"{versions.get('mitsuba-sensor')!s:.20}, and this version has format {FORMAT}; use that version, or "
                "give another folder."
            )

    def require_record(self) -> Record:
        """The same. Raises InputError where there is no dataset."""
        if (record := self.record()) is None:
            raise InputError(
                f"there is no dataset in {self.folder}; give the folder that `mitsuba-sensor dataset run FILE.toml "
                "-o FOLDER` made."
            )
        return record

    def write_record(self, record: Record) -> None:
        """Write the record where another one, or none, is there."""
        if self._record_content() != record.content():
            durable.write_lasting(self.folder / RECORD, [record.content()])

    def clean(self) -> None:
        """Remove what programs that were killed have left: of which nothing was written for an hour."""
        for folder in (self.folder, self.shards):
            durable.remove_unfinished(folder)

    def _record_content(self) -> bytes:
        return durable.read_small(self.folder / RECORD, MOST_BYTES_OF_HEAD)

    def _record_in(self, shard: Shard) -> bytes:
        try:
            with durable.open_to_read(self.shards / shard.name) as file:
                member = member_of(file.read(BLOCK), 0)
                if member is None or member.name != OF_RECORD:
                    return b""
                return file.read(min(member.size, MOST_BYTES_OF_HEAD))
        except OSError:
            return b""


def record_of(content: bytes) -> Record | None:
    """The record in bytes that anybody may have written; None where one bit of it is another."""
    try:
        body, _, end = content.decode().rpartition(',\n"sha256": ')
        record = Record.model_validate_json(body + "\n}")
    except (ValueError, RecursionError):
        return None
    return record if end == f'"{_digest(body)}"\n}}\n' else None


def short_name(member: str) -> str:
    """The name of a file in a shard, without the key or folder before it."""
    if "/" in member:
        return member.rpartition("/")[2].replace(",", ".")
    return member.partition(".")[2]


def member_bytes(name: str, content: bytes) -> bytes:
    """A member of a tar file: mode 0644, owner 0, time 0.  name : of at most 100 characters of ASCII."""
    header = tarfile.TarInfo(name)
    header.size = len(content)
    block = header.tobuf(tarfile.USTAR_FORMAT, "ascii", "strict")
    return block + content + bytes(-len(content) % BLOCK)


def member_of(header: bytes, start: int) -> Member | None:
    """The member whose header stands at ``start``; None where there is none."""
    try:
        entry = tarfile.TarInfo.frombuf(header, "ascii", "strict")
    except (tarfile.HeaderError, UnicodeDecodeError):
        return None
    return Member(entry.name, start, start + BLOCK, entry.size) if entry.size >= 0 else None


def members_in(content: bytes) -> Iterator[Member]:
    """The members of some bytes of a tar file, from the first one on."""
    start = 0
    while (member := member_of(content[start : start + BLOCK], start)) is not None:
        yield member
        start = member.end


def _shard_bytes(
    record: Record,
    light_files: Mapping[str, bytes],
    samples: Iterable[tuple[Config, Mapping[str, bytes]]],
) -> Iterator[bytes]:
    """The bytes of a shard, sample by sample; its rows come last, and behind them where they begin."""
    head = member_bytes(OF_RECORD, record.content())
    light = b"".join(
        member_bytes(OF_LIGHT + name.replace(".", ","), content)
        for name, content in sorted(light_files.items())
    )
    yield head + light
    place, rows = len(head) + len(light), list[Facts]()
    for row, files in samples:
        content = b"".join(
            member_bytes(f"{row['key']}.{name}", content) for name, content in files.items()
        )
        at = {"offset": place, "bytes": len(content)}
        of_light = {"light_offset": len(head), "light_bytes": len(light)}
        rows.append({**row, **at, **of_light})
        yield content
        place += len(content)
    text = json.dumps(rows, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    yield member_bytes(OF_ROWS, text.encode())
    yield member_bytes(OF_END, str(place).encode()) + bytes(2 * BLOCK)


def _rows_content(file: BinaryIO) -> bytes:
    """The rows of a shard. Raises OSError and ValueError where they are not there."""
    file.seek(-4 * BLOCK, os.SEEK_END)
    end = file.read(2 * BLOCK)
    member = member_of(end[:BLOCK], 0)
    if member is None or member.name != OF_END or member.size > BLOCK:
        raise ValueError(OF_END)
    file.seek(int(end[BLOCK : BLOCK + member.size]))
    rows = member_of(file.read(BLOCK), 0)
    if rows is None or rows.name != OF_ROWS or rows.size > MOST_BYTES_OF_HEAD:
        raise ValueError(OF_ROWS)
    return file.read(rows.size)
