"""Attack the files of a dataset: kill writers, fill disks, cut the power, corrupt files; and count what is damaged.

    python tests/attacks/dataset_store.py [kills calls writers full power corruptions speed] [--tries N] [--json]

kills        SIGKILL at random moments while entries are made, cleaned and repaired, each time resumed
calls        SIGKILL at every system call that a run makes (strace, as root)
writers      several programs on one folder at once, some of them killed, some of them repairing
full         a disk that is full at every write: the n-th call fails (strace), small disks in memory (as root)
power        the power fails at every system call that writes: a real ext4 loses all that was not flushed (as root)
corruptions  random corruptions; each must be found, and nothing else
speed        entries a second of commit, scan and verify, and memory over many entries

Each line says how often that was tried and how many tries left damage: an entry that is torn, lost, doubled or wrong, a
file that belongs to none, or a folder that after resuming is not that of an undisturbed run.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import dataset_calls as calls
import dataset_disks as disks
import dataset_ground
import dataset_speed as speed
from dataset_attacks import Attack, run_attacks
from dataset_damage import CORRUPTIONS, Named
from dataset_entries import (
    ALL_FILES_S,
    Program,
    Told,
    break_some,
    damage,
    difference,
    entries,
    expected,
    fresh,
    summary,
    work,
)

from mitsuba_sensor.dataset.store.record import Entry
from mitsuba_sensor.dataset.store.store import Store

WRITES = (
    "mkdir",
    "openat",
    "write",
    "pwrite64",
    "ftruncate",
    "fsync",
    "rename",
    "unlink",
    "rmdir",
    "unlinkat",
)
FAILING = {
    "ENOSPC": ("mkdir", "write", "fsync", "rename"),
    "EDQUOT": ("mkdir", "write"),
    "EIO": ("write", "fsync"),
}


LONGEST_S = 0.5
"""That a program works before it is killed; a busy machine would take longer for all entries."""


class Ground(dataset_ground.Ground):
    """A folder for a dataset with some entries broken, the right contents, and what is checked after each attack."""

    def __init__(self, top: Path, count: int, broken: int = 3) -> None:
        super().__init__(top)
        self.wanted = entries(count)
        self.right, self.broken = expected(self.wanted), set(self.wanted[:broken])
        break_some(fresh(self.template), self.wanted[:broken])

    def start(self, seed: int = 0) -> Callable[[Told], object]:
        """Begin anew; returns the job of a run."""
        fresh(self.out, self.template)
        return self.again(seed)

    def again(self, seed: int = 0) -> Callable[[Told], object]:
        """The job of a run on what is there."""
        return lambda told: work(Store(self.out), self.wanted, seed, told)

    def elsewhere(self, folder: Path) -> Callable[[Told], object]:
        """The job of a run on a copy in another folder."""
        store = fresh(folder, self.template)
        return lambda told: work(store, self.wanted, 0, told)

    def check_full(self, where: str, ended: tuple[int, str], expects_full: bool = True) -> None:
        """A clean stop, and what ended well is right."""
        if ended[0] == 0 and (found := difference(Store(self.out), self.right)):
            self.problems.append(f"{where}: said nothing, and {found[0]}")
        super().check_full(where, ended, expects_full)

    def check(self, where: str, told: set[Entry]) -> None:
        """After a kill: nothing torn, lost or stray."""
        found = damage(Store(self.out), self.right, told, self.broken)
        self.problems += [f"{where}: {found[0]}"] if found else []

    def resume(self, where: str) -> None:
        """Another run in this process; after it all is as if nothing had happened."""
        store = Store(self.out)
        work(store, self.wanted, 1, lambda entry: None)
        store.clean(ALL_FILES_S)
        found = difference(store, self.right)
        self.problems += [f"{where}, resumed: {found[0]}"] if found else []


def kills(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """SIGKILL at random moments."""
    ground, chance, done, ends = Ground(top, 16), Random(seed), 0, 0
    job, told = ground.start(), set[Entry]()
    began = time.monotonic()
    Program(job).wait()
    whole_s = min(time.monotonic() - began, LONGEST_S)
    job = ground.start()
    while done < tries:
        program = Program(
            lambda told, job=job: (Store(ground.out).clean(ALL_FILES_S), job(told))
        )
        time.sleep(chance.uniform(0, 0.7 * whole_s))
        program.kill()
        code, made, said = program.wait()
        told |= made
        if code == 0:
            found = difference(Store(ground.out), ground.right)
            ground.problems += [f"run {ends}: {found[0]}"] if found else []
            job, told, ends = ground.start(seed + ends), set(), ends + 1
        elif code == -9:
            done += 1
            ground.check(f"kill {done}", told)
        else:
            raise SystemExit(said)
    ground.resume("the last one")
    return summary(done, ground.problems, runs_completed=ends)


def each_call(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """SIGKILL at every system call of a run of two entries, one of them broken.  tries : of each name at most."""
    if not calls.possible():
        return {"skipped": "needs strace, as root"}
    return Ground(top, 2, broken=1).kill_each_call(tries, seed, top / "log")


def writers(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Programs on one folder at once."""
    ground, chance, made, killed = Ground(top, 10, broken=6), Random(seed), 0, 0
    for number in range(tries):
        ground.start()
        programs = []
        for one in range(chance.choice([2, 2, 3, 4])):
            programs.append(Program(ground.again(number + one), held=True))
        for program in programs:
            program.go()
        doomed = programs[1:] if number % 2 else []
        for program in doomed:
            time.sleep(chance.uniform(0, 0.05))
            program.kill()
        for program in programs:
            code, told, said = program.wait()
            made, killed = made + len(told), killed + (code == -9)
            if code not in (0, -9):
                ground.problems.append(f"round {number}: {said.splitlines()[-1]}")
        ground.check(f"round {number}", set())
        if doomed:
            ground.resume(f"round {number}")
        elif found := difference(Store(ground.out), ground.right):
            ground.problems.append(f"round {number}: {found[0]}")
    return summary(tries, ground.problems, killed=killed)


def full(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """A disk that is full at every write.  tries : of each name, and of disk sizes, at most."""
    if not calls.possible():
        return {"skipped": "needs strace, as root"}
    found = {}
    for error, names in FAILING.items():
        ground = Ground(top / error, 2, broken=1)
        found[error] = ground.fail_each_call(error, names, tries, seed, top / error / "log")
    return found | {"disks": disks.small_disks(tries, Ground, top)}


def power(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """The power fails at every call that changes the disk.  tries : of each name at most."""
    if not calls.possible():
        return {"skipped": "needs strace and mount, as root"}
    return disks.power_cuts(tries, WRITES, Ground, top)


def corruptions(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Random corruptions, one at a time."""
    ground, chance = Ground(top, 9, broken=0), Random(seed)
    ground.start()
    store, counts = Store(ground.out), dict.fromkeys((one.__name__ for one in CORRUPTIONS), 0)
    work(store, ground.wanted, 0, lambda entry: None)
    whole = top / "whole"
    shutil.copytree(ground.out, whole)
    for number in range(tries):
        corrupt = CORRUPTIONS[number % len(CORRUPTIONS)]
        must = corrupt(store, ground.wanted, chance)
        found = {(fault.kind, fault.name) for fault in store.verify_all()}
        counts[corrupt.__name__] += 1
        if found != must:
            ground.problems.append(
                f"{corrupt.__name__} {number}: found {found} instead of {must}"
            )
        if number % 50 == 0:
            must |= {entry[:2] for entry in ground.wanted}
        restore(store, whole, must)
    ground.resume("all")
    return summary(tries, ground.problems, **counts)


def restore(store: Store, whole: Path, spoilt: Named) -> None:
    """Put back what was spoilt."""
    for kind, name in spoilt:
        if not name:
            for place in store.verify_all():
                shutil.rmtree(store.folder / kind / place.file, ignore_errors=True)
            continue
        source, folder = whole / kind / name, store.folder_of(kind, name)
        shutil.rmtree(folder, ignore_errors=True)
        if source.exists():
            shutil.copytree(source, folder)


ATTACKS: dict[str, tuple[Attack, int]] = {
    "kills": (kills, 1000),
    "calls": (each_call, 10_000),
    "writers": (writers, 1000),
    "full": (full, 10_000),
    "power": (power, 10_000),
    "corruptions": (corruptions, 10_000),
    "speed": (speed.speed, 20_000),
}
"""Name → attack, and how often it is tried if nothing is said."""


if __name__ == "__main__":
    run_attacks(__doc__, ATTACKS)
