"""A dataset on disk: one tar file for each task, which appears whole or not at all.

A task is one light and the samples exposed to it. A folder has

* ``dataset.json``: the record, i.e. the text of the dataset file, versions and the format. Every shard also has it.
* ``shards/TASK-SHA256.tar``: the finished tasks. A task is finished if a file with its key exists, and sound if the
  hash of the file is in its name. To recreate it, remove the file and repeat the run.
* ``index.parquet``: a row for each sample (table.py), made from the shards if it is missing or older.
* ``failed.jsonl``: a line for each task that could not be made (engine.py).
* ``earlier/``: shards of an earlier dataset file, which are not read.
* ``README.md``, ``contact_sheet.png``, ``samples.csv``: for people; written at the end of a run.

Members of a shard, in this order. KEY is the key of a sample; readers of WebDataset skip names without a dot::

    task/dataset,json         the record
    light/aovs,exr            files that all samples of the task share: aovs.exr, irradiance.exr, view.json
    KEY.frame.tiff            files of a sample, samples in the order of their keys
    KEY.sample.json
    task/rows,json            a list with an object for each sample, see Row, with the places of its members
    task/end,txt              the first byte of rows,json; it starts 2048 bytes before the end of the file

Bytes depend only on the samples and on the text of the dataset file: they hold no times, owners or rights.
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
"""Format of a folder; other formats are rejected."""
RECORD, SHARDS, EARLIER, INDEX = "dataset.json", "shards", "earlier", "index.parquet"
RECORD_MEMBER, ROWS_MEMBER = "task/dataset,json", "task/rows,json"
END_MEMBER = "task/end,txt"
LIGHT_FOLDER = "light/"
BLOCK_BYTES = 512
HEAD_BYTES_MAX = 2**26
"""Size of a record, or of the rows of a shard."""
_SHARD = re.compile(r"([0-9a-f]{24})-([0-9a-f]{64})\.tar")


class Shard(NamedTuple):
    """A finished task: its key, and the SHA-256 of its file."""

    task: str
    digest: str

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.task}-{self.digest}.tar"


class Row(BaseModel):
    """A sample without its files.

    number : of the sample in the order of the dataset file, when it was made.  values : what varies, by name, as in
    sample.json.  exposed : exposed_s [s], system_gain_dn_per_e [DN/e-] and black_level_dn of the first frame.
    offset, bytes : of its members in the shard.  light_offset, light_bytes : of the files that the samples of its task
    share; 0 bytes without such files.  shard : name of its file.
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
    """Origin of a dataset.

    text : of the dataset file, unchanged.  samples : number of samples of the complete dataset.  made_by : versions of
    the libraries that decide its pixels.
    """

    model_config = ConfigDict(frozen=True, strict=True)

    format: int = FORMAT
    made_by: dict[str, str | None]
    samples: int
    text: str

    def content(self) -> bytes:
        """Return JSON with a line for each field; the last line is the SHA-256 of the lines before it."""
        lines = [f"{json.dumps(name)}: {json.dumps(x, ensure_ascii=False)}" for name, x in self]
        body = "{\n" + ",\n".join(lines)
        return f'{body},\n"sha256": "{_digest(body)}"\n}}\n'.encode()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class Member(NamedTuple):
    """A file in a tar file.  start : of its header.  offset, size : of its content [bytes]."""

    name: str
    start: int
    offset: int
    size: int

    @property
    def end(self) -> int:
        """Start of the next member."""
        return self.offset + -(-self.size // BLOCK_BYTES) * BLOCK_BYTES


class Store:
    """The shards of a dataset. Any number of programs may write: two that make the same task write equal bytes."""

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.shards = self.folder / SHARDS

    def finished(self) -> dict[str, Shard]:
        """Return task → its shard, from the names of files."""
        matches = map(_SHARD.fullmatch, durable.names_of(self.shards))
        return {name[1]: Shard(name[1], name[2]) for name in matches if name}

    def commit(
        self,
        task: str,
        record: Record,
        light_files: Mapping[str, bytes],
        samples: Iterable[tuple[Config, Mapping[str, bytes]]],
    ) -> Shard:
        """Write a whole task. Once this returns, a power cut loses nothing of it. Raises DiskFull and InputError.

        light_files : shared by the samples.  samples : fields of the Row of each without its places, and its files.
        """
        chunks = _shard_bytes(record, light_files, samples)
        return Shard(
            task, durable.write_lasting(self.shards / f"{task}-{{digest}}.tar", chunks)
        )

    def is_sound(self, shard: Shard) -> bool:
        """Return True if the hash of a shard is in its name."""
        try:
            return durable.sha256_of(self.shards / shard.name) == shard.digest
        except OSError:
            return False

    def size(self) -> int:
        """Return the size of all shards [bytes]."""
        return sum((self.shards / x.name).stat().st_size for x in self.finished().values())

    def put_aside(self, shard: Shard) -> None:
        """Move a shard into EARLIER, which is not read."""
        durable.move_lasting(self.shards / shard.name, self.folder / EARLIER / shard.name)

    def rows(self, shard: Shard) -> list[Row]:
        """Return the rows of a shard. Raises InputError for a changed shard."""
        with self.opened(shard.name) as file:
            try:
                rows = json.loads(_rows_content(file))
                return [Row(**{**row, "shard": shard.name}) for row in rows]
            except (OSError, ValueError, TypeError, RecursionError):
                raise self.changed(shard.name) from None

    def members(self, shard: str, offset: int, size: int) -> dict[str, bytes]:
        """Return the content of the members in these bytes of a shard, by name without key or folder.

        Raises InputError.  shard : name of its file.
        ``members(row.shard, row.offset, row.bytes)["frame.tiff"]`` belongs to a sample;
        names of shared files have dots again, e.g. ``aovs.exr``.
        """
        contents = {}
        with self.opened(shard) as file:
            if not 0 <= offset <= offset + size <= os.fstat(file.fileno()).st_size:
                raise self.changed(shard)
            file.seek(offset)
            content = file.read(size)
        for member in members_in(content):
            body = content[member.offset : member.offset + member.size]
            if len(body) < member.size:
                break
            contents[short_name(member.name)] = body
        if not contents:
            raise self.changed(shard)
        return contents

    def opened(self, shard: str) -> BinaryIO:
        """Open a shard. Raises InputError if it is missing."""
        try:
            return durable.open_to_read(self.shards / shard)
        except OSError as error:
            raise InputError(
                f"{self.shards / shard} cannot be read: {error.strerror}; run the dataset again to recreate it, or "
                "open the dataset again if it has changed since it was opened."
            ) from None

    def changed(self, shard: str) -> InputError:
        """Return the error for a changed shard."""
        return InputError(
            f"{self.shards / shard} has changed since it was written; `mitsuba-sensor dataset verify {self.folder} "
            "--remove` removes damaged files, and `dataset run` recreates them."
        )

    def record(self) -> Record | None:
        """Return the record of the folder; if it is missing or damaged, the record of any shard.

        None without a dataset. Raises InputError for another format.
        """
        content_here = self._record_content()
        for content in (content_here, *map(self._record_in, self.finished().values())):
            if (record := record_of(content)) is not None:
                self._require_format(record.format, record.made_by)
                return record
        with suppress(ValueError, RecursionError):  # a later version has other fields
            facts = json.loads(content_here)
            if isinstance(facts, dict) and facts.get("format", FORMAT) != FORMAT:
                self._require_format(facts["format"], facts.get("made_by"))
        return None

    def _require_format(self, number: object, made_by: object) -> None:
        if number != FORMAT:
            versions = made_by if isinstance(made_by, dict) else {}
            raise InputError(
                f"{self.folder} holds a dataset of format {number!r:.20}, made with mitsuba-sensor "
                f"{versions.get('mitsuba-sensor')!s:.20}, but this version has format {FORMAT}; use that version, or "
                "give another folder."
            )

    def require_record(self) -> Record:
        """Return the record. Raises InputError without a dataset."""
        if (record := self.record()) is None:
            raise InputError(
                f"there is no dataset in {self.folder}; give the folder that `mitsuba-sensor dataset run FILE.toml "
                "-o FOLDER` made."
            )
        return record

    def write_record(self, record: Record) -> None:
        """Write the record if it differs."""
        if self._record_content() != record.content():
            durable.write_lasting(self.folder / RECORD, [record.content()])

    def clean(self) -> None:
        """Remove what killed programs left: files that were not written for an hour."""
        for folder in (self.folder, self.shards):
            durable.remove_unfinished(folder)

    def _record_content(self) -> bytes:
        return durable.read_small(self.folder / RECORD, HEAD_BYTES_MAX)

    def _record_in(self, shard: Shard) -> bytes:
        try:
            with durable.open_to_read(self.shards / shard.name) as file:
                member = member_of(file.read(BLOCK_BYTES), 0)
                if member is None or member.name != RECORD_MEMBER:
                    return b""
                return file.read(min(member.size, HEAD_BYTES_MAX))
        except OSError:
            return b""


def record_of(content: bytes) -> Record | None:
    """Return the record in these bytes; None if a single bit has changed."""
    try:
        body, _, end = content.decode().rpartition(',\n"sha256": ')
        record = Record.model_validate_json(body + "\n}")
    except (ValueError, RecursionError):
        return None
    return record if end == f'"{_digest(body)}"\n}}\n' else None


def short_name(member: str) -> str:
    """Return the name of a file in a shard, without key or folder."""
    if "/" in member:
        return member.rpartition("/")[2].replace(",", ".")
    return member.partition(".")[2]


def member_bytes(name: str, content: bytes) -> bytes:
    """Return a member of a tar file: mode 0644, owner 0, time 0.  name : at most 100 ASCII characters."""
    header = tarfile.TarInfo(name)
    header.size = len(content)
    block = header.tobuf(tarfile.USTAR_FORMAT, "ascii", "strict")
    return block + content + bytes(-len(content) % BLOCK_BYTES)


def member_of(header: bytes, start: int) -> Member | None:
    """Return the member whose header is at ``start``; None for other bytes."""
    try:
        entry = tarfile.TarInfo.frombuf(header, "ascii", "strict")
    except (tarfile.HeaderError, UnicodeDecodeError):
        return None
    return (
        Member(entry.name, start, start + BLOCK_BYTES, entry.size) if entry.size >= 0 else None
    )


def members_in(content: bytes) -> Iterator[Member]:
    """Yield the members in some bytes of a tar file, which start with a member."""
    start = 0
    while (member := member_of(content[start : start + BLOCK_BYTES], start)) is not None:
        yield member
        start = member.end


def _shard_bytes(
    record: Record,
    light_files: Mapping[str, bytes],
    samples: Iterable[tuple[Config, Mapping[str, bytes]]],
) -> Iterator[bytes]:
    """Yield the bytes of a shard, sample by sample; its rows and their place come last."""
    head = member_bytes(RECORD_MEMBER, record.content())
    light = b"".join(
        member_bytes(LIGHT_FOLDER + name.replace(".", ","), content)
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
    yield member_bytes(ROWS_MEMBER, text.encode())
    yield member_bytes(END_MEMBER, str(place).encode()) + bytes(2 * BLOCK_BYTES)


def _rows_content(file: BinaryIO) -> bytes:
    """Return the rows of a shard as JSON. Raises OSError and ValueError if they are missing."""
    file.seek(-4 * BLOCK_BYTES, os.SEEK_END)
    end = file.read(2 * BLOCK_BYTES)
    member = member_of(end[:BLOCK_BYTES], 0)
    if member is None or member.name != END_MEMBER or member.size > BLOCK_BYTES:
        raise ValueError(END_MEMBER)
    file.seek(int(end[BLOCK_BYTES : BLOCK_BYTES + member.size]))
    rows = member_of(file.read(BLOCK_BYTES), 0)
    if rows is None or rows.name != ROWS_MEMBER or rows.size > HEAD_BYTES_MAX:
        raise ValueError(ROWS_MEMBER)
    return file.read(rows.size)
