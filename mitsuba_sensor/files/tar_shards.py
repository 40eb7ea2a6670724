"""Tar shards of WebDataset: members key.extension, bounded size, the same bytes whenever they are written.

No times, owners or rights of files are in them. One sample is in memory at a time, or none where its files are copied.
"""

from __future__ import annotations

import io
import re
import tarfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..core import InputError
from .disk_errors import disk_sentences

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}")
KEY = re.compile(r"[A-Za-z0-9_-]{1,80}")
EXTENSION = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*")
BLOCK, RECORD = 512, 10_240  # of a tar file


class TarShards:
    """Writes samples into NAME-000000.tar, NAME-000001.tar, …; a shard is closed before it grows beyond its bounds.

    most_bytes, most_samples : of a shard; a sample that is larger has a shard of its own.
    shards : name → number of samples of all that were begun.
    Raises InputError for a name that no file should have.
    """

    def __init__(
        self, folder: Path, name: str, most_bytes: int = 10**9, most_samples: int = 10_000
    ) -> None:
        if not NAME.fullmatch(name):
            raise InputError(
                f"{name!r} is no name of a tar shard; it must be 1 to 80 letters, digits, -, _ and dots."
            )
        self.folder, self.name, self.most_bytes, self.most_samples = (
            folder,
            name,
            most_bytes,
            most_samples,
        )
        self.shards: dict[str, int] = {}
        self._open: tarfile.TarFile | None = None
        self._path, self._bytes = folder, 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def add(self, key: str, files: Mapping[str, bytes | Path]) -> None:
        """Append a sample.  files : extension → content, or the file that is copied. Raises InputError, DiskFull."""
        if not KEY.fullmatch(key):
            raise InputError(
                f"the key {key!r} is none of a tar shard; it must be letters, digits, - and _ (80 at most)."
            )
        if wrong := [one for one in files if not EXTENSION.fullmatch(one)]:
            raise InputError(
                f"{wrong[0]!r} is no extension of a file in a tar shard; e.g. png, or raw.npy."
            )
        sizes = {
            name: x.stat().st_size if isinstance(x, Path) else len(x)
            for name, x in files.items()
        }
        taken = sum(BLOCK + -(-size // BLOCK) * BLOCK for size in sizes.values())
        shard = self._shard_for(taken)
        with disk_sentences(self._path, taken), ExitStack() as stack:
            for name, content in files.items():
                entry = tarfile.TarInfo(
                    f"{key}.{name}"
                )  # mode 0644, owner 0 and time 0 by itself
                entry.size = sizes[name]
                source: Any = (
                    content.open("rb") if isinstance(content, Path) else io.BytesIO(content)
                )
                shard.addfile(entry, stack.enter_context(source))
        self.shards[self._path.name] += 1
        self._bytes += taken

    def _shard_for(self, taken: int) -> tarfile.TarFile:
        size = -(-(self._bytes + taken + 2 * BLOCK) // RECORD) * RECORD
        full = size > self.most_bytes or self.shards.get(self._path.name) == self.most_samples
        if self._open is None or full:
            self._close()
            self._path = self.folder / f"{self.name}-{len(self.shards):06d}.tar"
            with disk_sentences(self._path, RECORD):
                self._open = tarfile.open(self._path, "x:", format=tarfile.USTAR_FORMAT)  # noqa: SIM115, closed below
            self.shards[self._path.name], self._bytes = 0, 0
        return self._open

    def _close(self) -> None:
        if self._open is not None:
            with disk_sentences(self._path, RECORD):
                self._open.close()
        self._open = None


def npy(array: np.ndarray) -> bytes:
    """An array as the bytes of a .npy file."""
    content = io.BytesIO()
    np.save(content, array, allow_pickle=False)
    return content.getvalue()
