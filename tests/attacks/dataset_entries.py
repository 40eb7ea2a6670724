"""Entries of a small dataset with known contents, programs that write them and are killed, and what they leave."""

from __future__ import annotations

import contextlib
import hashlib
import os
import random
import shutil
import signal
import socket
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.dataset.store.record import RECORD, Entry, Kind
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files import texts, tiff
from mitsuba_sensor.files.appearing import write_drawing

Told: TypeAlias = Callable[[Entry], object]

ALL_FILES_S = -3600.0
"""Age for :meth:`Store.clean` when no other program runs: whatever is left over goes."""
FULL = 3
"""Exit code of a program that met a full disk."""


def entries(count: int) -> list[Entry]:
    """Samples and views by turns, in two folders of each kind, so that programs meet in them."""
    found = []
    for number in range(count):
        key = hashlib.sha256(b"%d" % number).hexdigest()[:24]
        kind: Kind = "samples" if number % 3 else "views"
        found.append(entry_called(kind, f"scene/view_{number % 2:04d}/{key}"))
    return found


def entry_called(kind: Kind, name: str) -> Entry:
    """The entry whose folder has this name, which ends with its key."""
    return Entry(kind, name, name[-24:])


def write(entry: Entry, folder: Path) -> None:
    """Frames, facts and bytes, all decided by the key; some files are empty."""
    rng = np.random.default_rng(int(entry.key, 16))
    tiff.write_tiff(folder / "frame.tiff", rng.integers(0, 4096, (2, 8, 12)).astype(np.uint16))
    texts.write_json(
        folder / "sample.json", {"key": entry.key, "temperature_k": rng.uniform(250, 350)}
    )
    write_drawing(
        folder / "data.bin", rng.bytes(int(rng.integers(0, 3)) * int(rng.integers(1, 9000)))
    )


def expected(wanted: list[Entry]) -> dict[str, bytes]:
    """Path → content of all files, records too, that an undisturbed run leaves."""
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder) / "out")
        work(store, wanted, 0, lambda entry: None)
        return tree(store.folder)


def tree(folder: Path) -> dict[str, bytes]:
    """Path → content of all files below a folder; folders that are no entry's, with None for a content, too."""
    found = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return {path.relative_to(folder).as_posix(): content for path, content in found.items()}


def work(store: Store, wanted: list[Entry], seed: int, told: Told) -> None:
    """What a run does: clean, make what is missing, repair what is broken, in an order of its own.

    told : called with each entry of which :meth:`Store.commit` has said that it is there for good.
    """
    order = random.Random(seed)
    store.clean()
    for entry in order.sample(wanted, len(wanted)):
        store.commit(entry, lambda folder, entry=entry: write(entry, folder))
        told(entry)
    for kind, name in sorted(
        {(fault.kind, fault.name) for fault in store.verify_all() if fault.name}
    ):
        store.discard(kind, name)
        entry = entry_called(kind, name)
        store.commit(entry, lambda folder, entry=entry: write(entry, folder))


def break_some(store: Store, some: list[Entry]) -> None:
    """Entries as older damage has left them: a flipped bit, a file that is short, no record, by turns."""
    for number, entry in enumerate(some):
        store.commit(entry, lambda folder, entry=entry: write(entry, folder))
        path = (
            store.folder_of(entry.kind, entry.name)
            / ("frame.tiff", "frame.tiff", RECORD)[number % 3]
        )
        content = path.read_bytes()
        if number % 3 == 0:
            path.write_bytes(content[:100] + bytes([content[100] ^ 1]) + content[101:])
        elif number % 3 == 1:
            path.write_bytes(content[:100])
        else:
            path.unlink()


def damage(
    store: Store, right: dict[str, bytes], told: set[Entry], broken: set[Entry]
) -> list[str]:
    """What is wrong while a run is not finished.

    told : entries that are there for good.  broken : those that were broken before, and may still be.
    """
    found = []
    for kind in ("samples", "views"):
        there = set(store.names(kind))
        for name in there:
            folder, entry = store.folder_of(kind, name), entry_called(kind, name)
            same = all(
                right[(folder / file).relative_to(store.folder).as_posix()] == x
                for file, x in tree(folder).items()
            )
            if entry not in broken and (
                store.verify(kind, name) or not store.exists(entry) or not same
            ):
                found.append(f"torn: {kind} {name} {store.verify(kind, name)}")
        found += [
            f"lost: {kind} {one.name}"
            for one in told - broken
            if one.kind == kind and one.name not in there
        ]
    return found + [
        f"stray: {fault}"
        for fault in store.verify_all()
        if not fault.name and fault.what != "unfinished"
    ]


def difference(store: Store, right: dict[str, bytes]) -> list[str]:
    """What is wrong after a run that ended well: any file or folder that an undisturbed run does not leave."""
    left, faults = tree(store.folder), list(store.verify_all())
    paths = {path for path in left.keys() | right.keys() if left.get(path) != right.get(path)}
    return (
        sorted(paths)
        + [str(fault) for fault in faults]
        + [str(path) for path in store.folder.rglob(".*")]
    )


class Program:
    """A child process that works, and tells which entries it has made.

    held : it waits until :meth:`go`.
    """

    def __init__(self, job: Callable[[Told], object], held: bool = False) -> None:
        self.mine, theirs = socket.socketpair()
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            self.mine.close()
            _run(job, theirs)
        theirs.close()
        if not held:
            self.go()

    def go(self) -> None:
        """Let it begin; it may be dead already, in the call in which it waits."""
        with contextlib.suppress(BrokenPipeError):
            self.mine.send(b"!")

    def kill(self) -> None:
        """SIGKILL, wherever it is."""
        os.kill(self.pid, signal.SIGKILL)

    def wait(self) -> tuple[int, set[Entry], str]:
        """Its exit code, negative for a signal; the entries that it has made; what it said at its end."""
        _, status = os.waitpid(self.pid, 0)
        with self.mine:
            lines = b"".join(self._received()).decode().splitlines()
        told = {
            entry_called(kind, name)  # type: ignore[arg-type]
            for kind, _, name in (line[1:].partition(" ") for line in lines if line[:1] == "+")
        }
        return (
            os.waitstatus_to_exitcode(status),
            told,
            "\n".join(line for line in lines if line[:1] != "+"),
        )

    def _received(self) -> Iterator[bytes]:
        with suppress(ConnectionResetError):  # it was killed before it began
            yield from iter(lambda: self.mine.recv(2**16), b"")


def _run(job: Callable[[Told], object], theirs: socket.socket) -> None:
    """In the child: never returns. A socket tells, because writes to files are what the attacks spoil."""
    code = 1
    try:
        theirs.recv(1)
        job(lambda entry: theirs.sendall(f"+{entry.kind} {entry.name}\n".encode()))
        code = 0
    except DiskFull as error:
        theirs.sendall(f"full: {error.path} {error.size}\n".encode())
        code = FULL
    except BaseException:
        theirs.sendall(traceback.format_exc().encode())
    finally:
        theirs.close()
        os._exit(code)


@contextmanager
def folder_for_all() -> Iterator[Path]:
    """A folder for datasets that is removed in the end."""
    folder = Path(tempfile.mkdtemp(prefix="dataset-store-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def fresh(folder: Path, template: Path | None = None) -> Store:
    """A store in an empty folder, or in a copy of another one's."""
    shutil.rmtree(folder, ignore_errors=True)
    if template is not None and template.exists():
        shutil.copytree(template, folder)
    return Store(folder)


def summary(tries: int, problems: list[str], **more: Any) -> dict[str, Any]:
    """One line of the table."""
    return {
        "tries": tries,
        **more,
        "damaged": len(problems),
        **({"first": problems[0]} if problems else {}),
    }
