"""Small disks that are full at any block, and an ext4 disk whose power fails: what they leave of a dataset."""

from __future__ import annotations

import fcntl
import os
import shutil
import struct
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dataset_calls as calls
from dataset_entries import Program, summary

BLOCK = 4096
EXT4_IOC_SHUTDOWN, WITHOUT_FLUSHING = (
    0x8004587D,
    2,
)  # include/uapi/linux/ext4.h: nothing more reaches the disk
DISK_MIB = 8


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}: {done.stderr.strip()}")


@contextmanager
def mounted(place: Path, *arguments: str) -> Iterator[None]:
    """A file system at ``place`` while the block runs."""
    place.mkdir(parents=True, exist_ok=True)
    _run("mount", *arguments, str(place))
    try:
        yield
    finally:
        _run("umount", str(place))


def small_disks(tries: int, ground_of: Callable[..., Any], top: Path) -> dict[str, Any]:
    """Disks in memory of every number of blocks and of files up to one that is large enough."""
    ground, done, stopped = ground_of(top / "disk", 3), 0, 0
    template, ground.out = ground.template, top / "disk" / "mounted" / "out"
    used = sum(
        -(-path.stat().st_size // BLOCK) for path in template.rglob("*") if path.is_file()
    )
    for option, first, unit in (
        ("size", used, BLOCK),
        ("nr_inodes", 4 + len(list(template.rglob("*"))), 1),
    ):
        for number in range(first, first + tries):
            place = ground.out.parent
            with mounted(place, "-t", "tmpfs", "-o", f"{option}={number * unit}", "none"):
                shutil.copytree(template, ground.out)
                code, told, said = Program(ground.again()).wait()
                done, stopped = done + 1, stopped + (code != 0)
                ground.check(f"{option} {number}", told)
                ground.check_full(f"{option} {number}", (code, said))
                _run("mount", "-o", f"remount,size={2**30},nr_inodes=100000", str(place))
                ground.resume(f"{option} {number}")
            if code == 0:
                break
    return summary(done, ground.problems, stopped=stopped)


def power_cuts(
    tries: int, names: tuple[str, ...], ground_of: Callable[..., Any], top: Path
) -> dict[str, Any]:
    """SIGKILL at each of these calls, and no byte that was not flushed reaches the disk any more."""
    ground, done, lost = ground_of(top / "ground", 2, broken=1), 0, 0
    image, place = top / "disk.img", top / "mounted"
    ground.out = place / "out"
    known = calls.calls_of(ground.elsewhere(top / "trial"), top / "log")
    for name in names:
        for number in range(1, min(known.get(name, 0), tries) + 1):
            where = f"{name} {number}"
            _run("truncate", "-s", f"{DISK_MIB}M", str(image))
            _run("mkfs.ext4", "-q", "-F", str(image))
            with mounted(place, "-o", "loop", str(image)):
                shutil.copytree(ground.template, ground.out)
                os.sync()
                inject = (
                    "-o",
                    "/dev/null",
                    "-e",
                    f"trace={name}",
                    "-e",
                    f"inject={name}:signal=KILL:when={number}",
                )
                code, told, said = calls.traced(ground.again(), *inject)
                cut_power(place)
            if code not in (0, -9):
                raise SystemExit(said)
            with mounted(place, "-o", "loop", str(image)):
                done += 1
                ground.check(where, told)
                lost += len(ground.wanted) - len(told)
                ground.resume(where)
            image.unlink()
    return summary(done, ground.problems)


def cut_power(place: Path) -> None:
    """From now on the disk takes nothing, neither data nor journal."""
    file = os.open(place, os.O_RDONLY)
    try:
        fcntl.ioctl(file, EXT4_IOC_SHUTDOWN, struct.pack("I", WITHOUT_FLUSHING))
    finally:
        os.close(file)
