"""A claim: a file that says that a process makes something which others wait for.

The process renews it while it lives. Nothing but time depends on it: where two claim at once, because one had seemed
dead, both make the same.
"""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from ..stopping import undone_if_stopped, whole_step
from .disk_errors import disk_sentences
from .worker_log import begun_by_this, forget, is_begun

RENEWED_EVERY_S = 5.0
DEAD_AFTER_S = 120.0
"""Without a renewal: a file server may tell of one a minute late."""
LOOKS_EVERY_S = 0.2
TRIES = 10
"""To make a claim in a folder that others remove when it is empty."""


@contextmanager
def claimed(path: Path) -> Iterator[bool]:
    """Claim what a path stands for while the block runs; False where another process has. Raises InputError."""
    with whole_step:
        is_ours = _claim(path)
    if not is_ours:
        yield False
        return
    remove, ended = partial(forget, path), threading.Event()
    with undone_if_stopped(remove):
        threading.Thread(target=_renew, args=(path, ended), daemon=True).start()
        try:
            yield True
        finally:
            ended.set()
            remove()


def _claim(path: Path) -> bool:
    said = begun_by_this()
    with disk_sentences(path, len(said)):
        for _ in range(TRIES):
            path.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):
                try:
                    with path.open("xb", buffering=0) as file:
                        file.write(said)
                except FileExistsError:
                    return False
                return True
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))


def _renew(path: Path, ended: threading.Event) -> None:
    while not ended.wait(RENEWED_EVERY_S):
        with suppress(OSError):  # a program that took this one for dead has removed it
            os.utime(path)


def wait_for_claim(
    path: Path, is_made: Callable[[], bool], waiting: Callable[[], object]
) -> None:
    """Wait until what a process has claimed is made, or the process has let go of it or is dead: then none has it.

    waiting : called again and again meanwhile.
    """
    renewed_ns, since_s = 0, time.monotonic()
    while not is_made():
        waiting()
        try:
            there = path.stat()
        except FileNotFoundError:
            return
        if there.st_mtime_ns != renewed_ns:
            renewed_ns, since_s = there.st_mtime_ns, time.monotonic()
        is_dead = there.st_size > 0 and not is_begun(
            path
        )  # it is written a moment after it is made
        if is_dead or time.monotonic() - since_s > DEAD_AFTER_S:
            forget(path)
            return
        time.sleep(LOOKS_EVERY_S)
