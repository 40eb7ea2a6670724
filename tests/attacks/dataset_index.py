"""Attack the index of a dataset: kill runs that write its parts, fill the disk, let shards write one part at once.

    python tests/attacks/dataset_index.py [kills calls full shards] [--tries N] [--json]

kills   SIGKILL at random moments while parts are written and older ones removed, each time resumed
calls   SIGKILL at every system call of that (strace, as root)
full    a disk that is full or broken at every write: the n-th call fails (strace, as root)
shards  two processes, each with half of the samples of a part, some of them killed

Each line says how often that was tried and how many tries left damage: a part that is torn, or names a sample that is
not there, or a folder that after resuming is not that of an undisturbed run.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import dataset_calls as calls
import dataset_ground
from dataset_attacks import Attack, run_attacks
from dataset_entries import ALL_FILES_S, Program, Told, summary

from mitsuba_sensor.core import InputError
from mitsuba_sensor.dataset.index import origin, repair
from mitsuba_sensor.dataset.index import part as index_part
from mitsuba_sensor.dataset.index import writer as index_writer
from mitsuba_sensor.dataset.index.origin import write_origin
from mitsuba_sensor.dataset.index.part import OpenPart, all_parts
from mitsuba_sensor.dataset.index.repair import verify
from mitsuba_sensor.dataset.index.writer import IndexWriter
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.store.record import INDEX, Entry
from mitsuba_sensor.dataset.store.store import Store

NUMBERS, SAMPLES = 7, 20
"""Of a part, and of the dataset."""
TABLES = {
    "name": "parts",
    "render": {"spp": 16, "width": 16},
    "scenes": [{"name": "flat", "file": "flat_field"}],
    "cameras": [{"camera": "konnik_table1"}],
    "grid": {"repetition": [*range(SAMPLES)]},
}
FAILING = {"ENOSPC": ("mkdir", "write", "fsync", "rename"), "EIO": ("write", "fsync")}


class Ground(dataset_ground.Ground):
    """A dataset whose samples are all there, and of its index one part with a sample less than there is now."""

    def __init__(self, top: Path) -> None:
        super().__init__(top)
        for module in (index_part, index_writer, origin, repair):
            module.NUMBERS = NUMBERS
        self.plan = DatasetPlan(read_dataset(TABLES), [Path()], "text")
        right = top / "right"
        for folder in (self.template, right):
            write_origin(self.plan, folder)
        *others, last = (sample.entry for view in self.plan.views() for sample in view.samples)
        commit(Store(self.template), others)
        self.follow(Store(self.template), numbers=range(SAMPLES // NUMBERS * NUMBERS, SAMPLES))
        commit(Store(self.template), [last])
        commit(Store(right), [*others, last])
        self.follow(Store(right))
        self.right = sorted(os.listdir(right / INDEX))

    def follow(self, store: Store, numbers: range = range(SAMPLES)) -> None:
        """What a run does when it has made all samples that it can."""
        writer = IndexWriter(self.plan, store, numbers)
        for view in writer.tasks():
            writer.ended(view.first, False)
        writer.index()

    def start(self, seed: int = 0) -> Callable[[Told], object]:
        """Begin anew; returns the job of a run."""
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.template, self.out)
        return lambda told: self.follow(Store(self.out))

    def check(self, where: str, told: set[Entry]) -> None:
        """Each part that is there is whole, and names nothing that is not there."""
        for part in all_parts(self.out):
            try:
                lines = [*OpenPart(self.out, part).lines()]
            except InputError as error:
                self.problems.append(f"{where}: {error}")
                continue
            entries = [Entry("samples", line.name, line.key) for line in lines]
            if not all(map(Store(self.out).exists, entries)):
                self.problems.append(f"{where}: {part.name} names what is not there")

    def resume(self, where: str) -> None:
        """After another run all is as if nothing had happened."""
        store = Store(self.out)
        self.follow(store)
        store.clean(ALL_FILES_S)
        found = sorted(os.listdir(self.out / INDEX))
        if found != self.right or [*verify(self.out)]:
            self.problems.append(f"{where}, resumed: {found}, {[*verify(self.out)]}")


def commit(store: Store, entries: list[Entry]) -> None:
    """Samples of one small file."""
    for entry in entries:
        store.commit(entry, lambda folder: (folder / "a.txt").write_text("a"))


def kills(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """SIGKILL at random moments."""
    ground, chance, done = Ground(top), Random(seed), 0
    began = time.monotonic()
    Program(ground.start()).wait()
    whole_s = time.monotonic() - began
    while done < tries:
        program = Program(ground.start())
        time.sleep(chance.uniform(0, whole_s))
        program.kill()
        code, _, said = program.wait()
        if code not in (0, -9):
            raise SystemExit(said)
        done += code == -9
        ground.check(f"kill {done}", set())
        ground.resume(f"kill {done}")
    return summary(done, ground.problems)


def each_call(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """SIGKILL at every system call.  tries : of each name at most."""
    if not calls.possible():
        return {"skipped": "needs strace, as root"}
    return Ground(top).kill_each_call(tries, seed, top / "log")


def full(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """A disk that is full at every write.  tries : of each name at most."""
    if not calls.possible():
        return {"skipped": "needs strace, as root"}
    found = {}
    for error, names in FAILING.items():
        ground = Ground(top / error)
        shutil.rmtree(ground.template / INDEX)  # so that it is made, too
        found[error] = ground.fail_each_call(error, names, tries, seed, top / error / "log")
    return found


def shards(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Two runs at once that both have samples of the part in the middle; each makes its own samples first."""
    ground, chance, killed = Ground(top), Random(seed), 0
    halves = range(SAMPLES // 2), range(SAMPLES // 2, SAMPLES)
    for number in range(tries):
        ground.start()
        shutil.rmtree(ground.out / INDEX)
        shutil.rmtree(ground.out / "samples")
        jobs = [partial(_make_half, ground, half, chance.uniform(0, 0.01)) for half in halves]
        programs = [Program(job, held=True) for job in jobs]
        for program in programs:
            program.go()
        if number % 2:
            time.sleep(chance.uniform(0, 0.2))
            programs[1].kill()
        codes = [program.wait()[0] for program in programs]
        killed += -9 in codes
        ground.check(f"round {number}", set())
        if -9 in codes:
            for half in halves:
                _make_half(ground, half, 0.0, lambda entry: None)
            Store(ground.out).clean(ALL_FILES_S)
        if sorted(os.listdir(ground.out / INDEX)) != ground.right:
            ground.problems.append(f"round {number}: {codes} {os.listdir(ground.out / INDEX)}")
    return summary(tries, ground.problems, killed=killed)


def _make_half(ground: Ground, half: range, pause_s: float, told: Told) -> None:
    store = Store(ground.out)
    writer = IndexWriter(ground.plan, store, half)
    for view in writer.tasks():
        time.sleep(pause_s)
        commit(store, [sample.entry for sample in view.samples])
        writer.ended(view.first, True)
    writer.index()


ATTACKS: dict[str, tuple[Attack, int]] = {
    "kills": (kills, 300),
    "calls": (each_call, 10_000),
    "full": (full, 10_000),
    "shards": (shards, 100),
}
"""Name → attack, and how often it is tried if nothing is said."""


if __name__ == "__main__":
    run_attacks(__doc__, ATTACKS)
