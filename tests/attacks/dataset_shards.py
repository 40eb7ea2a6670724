"""Attack the shards of a dataset: kill runs, fill disks, cut the power, corrupt bytes, let several write one shard.

    python tests/attacks/dataset_shards.py [kills calls writers full disks power corruptions] [--tries N] [--json]

kills        SIGKILL at random moments of a run, each time resumed
calls        SIGKILL at every system call of a run (strace, as root)
writers      two to four runs at once on one folder, some with a part of the numbers, half of them killed
full         a disk that is full or broken at every write: the n-th call fails (strace, as root)
disks        small disks in memory of every size (as root)
power        the power fails at every system call that writes: a real ext4 loses all that was not flushed (as root)
corruptions  bits, tails, zeros, swapped and edited shards; each must be found, and only what is damaged is made again

Each line says how often that was tried and how many tries left damage: a shard that is torn, a sample that was there
and is lost or wrong, or a folder that after resuming is not that of an undisturbed run.
"""

from __future__ import annotations

import hashlib
import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import dataset_calls as calls
import dataset_disks as disks
import dataset_ground
from dataset_attacks import Attack, run_attacks
from dataset_damage import put_something_else
from dataset_entries import ALL_FILES_S, Entry, Program, Told, summary, tree

from mitsuba_sensor.core import InputError
from mitsuba_sensor.dataset.index import origin, repair
from mitsuba_sensor.dataset.index import part as index_part
from mitsuba_sensor.dataset.index import writer as index_writer
from mitsuba_sensor.dataset.index.origin import write_origin
from mitsuba_sensor.dataset.index.repair import discard, verify
from mitsuba_sensor.dataset.index.writer import IndexWriter
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, PlannedView
from mitsuba_sensor.dataset.read.reader import Dataset
from mitsuba_sensor.dataset.run import places
from mitsuba_sensor.dataset.run.places import Files, place_of
from mitsuba_sensor.dataset.store.record import RECORD, SHARDS, record_of, text_of
from mitsuba_sensor.dataset.store.store import Store

NUMBERS, OF_SHARD = 10, 5
"""Of a part of the index, and of a shard."""
TABLES = {
    "name": "shards",
    "outputs": ["raw", "aovs"],
    "store": {"shard_samples": OF_SHARD},
    "render": {"spp": 16, "width": 16},
    "scenes": [{"name": "flat", "file": "flat_field"}],
    "cameras": [{"camera": "konnik_table1"}],
    "grid": {"repetition": [*range(7)], "parameters.radiance": [1e-5, 2e-5]},
}
"""Two lights of seven samples: three shards, of which the second has samples of both."""
FAILING = {"ENOSPC": ("mkdir", "write", "fsync", "rename"), "EIO": ("write", "fsync")}
WRITES = ("mkdir", "openat", "write", "fsync", "rename", "unlink", "rmdir", "unlinkat")


def names_of(told: set[Entry]) -> set[str]:
    """Of the samples that a program has told of."""
    return {name for _, name, *_ in told}


def content(key: str) -> bytes:
    """Of the only large file of a sample, decided by its key."""
    return Random(key).randbytes(1500)


class Ground(dataset_ground.Ground):
    """A dataset of which one shard is whole, one has a torn piece and one was changed.

    count, broken : of the other ground (dataset_store.py), whose attacks this one is given to; passed by.
    """

    def __init__(self, top: Path, count: int = 0, broken: int = 0) -> None:
        super().__init__(top)
        for module in (index_part, index_writer, origin, repair):
            module.NUMBERS = NUMBERS
        self.plan = DatasetPlan(read_dataset(TABLES), [Path()], "text")
        self.keys = [sample.key for view in self.plan.views() for sample in view.samples]
        self.names = [sample.name for view in self.plan.views() for sample in view.samples]
        self.wanted = self.keys
        right = top / "right"
        self.work(right)
        self.right = tree(right)
        self.work(self.template)
        shards = sorted((self.template / SHARDS).iterdir())
        flip(shards[0], 700)
        place = self.template / SHARDS / shards[1].name[:19]
        place.mkdir()
        shards[1].rename(place / f"5-3-{'0' * 64}.tar")
        discard(self.template, [*verify(self.template)])

    def work(
        self,
        folder: Path,
        told: Told = lambda entry: None,
        numbers: range = range(10**6),
        seed: int = 0,
    ) -> None:
        """What a run does.  told : called with a sample that a power cut does not take any more."""
        places.LONGEST_S = Random(seed).choice([-1.0, 0.001, 20.0])
        store = Store(folder)
        write_origin(self.plan, folder)
        store.clean()
        numbers = range(numbers.start, min(numbers.stop, self.plan.numbers))
        writer = IndexWriter(self.plan, store, numbers)
        for view in writer.tasks():
            make(store, view)
            assert view.block is not None
            if any(shard.is_whole for shard in Store(folder).shards.of(view.block)):
                for sample in view.samples:
                    told(sample.entry)
            writer.ended(view.first, True)
        writer.index()

    def start(self, seed: int = 0) -> Callable[[Told], object]:
        """Begin anew; returns the job of a run."""
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.template, self.out)
        return self.again(seed)

    def again(self, seed: int = 0) -> Callable[[Told], object]:
        """The job of a run on what is there."""
        return lambda told: self.work(self.out, told, seed=seed)

    def elsewhere(self, folder: Path) -> Callable[[Told], object]:
        """The job of a run on a copy in another folder."""
        shutil.copytree(self.template, folder)
        return lambda told: self.work(folder, told)

    def check(self, where: str, told: set[Entry]) -> None:
        """Every shard is what its name says, what the index names is right, and what was told is there."""
        found = [
            str(fault)
            for fault in verify(self.out)
            if fault.kind == "shards" and fault.what != "unfinished"
        ]
        there = set[str]()
        for block in range(-(-len(self.keys) // OF_SHARD)):
            numbers = Store(self.out).shards.numbers(self.plan.block(block)[0])
            own = range(block * OF_SHARD, min((block + 1) * OF_SHARD, len(self.keys)))
            there |= {self.names[number] for number in own if number in numbers}
        found += [f"lost: {name}" for name in names_of(told) if name not in there]
        try:
            for sample in Dataset(self.out):
                if sample.files.content("a.bin") != content(sample.key):
                    found.append(f"wrong: {sample.key}")
                if sample.view_files.content("view.json") != b'{"key": "%s"}' % (
                    sample.view_key.encode()
                ):
                    found.append(f"wrong view: {sample.key}")
        except InputError as error:
            if "has no index yet" not in str(error):
                found.append(str(error))
        self.problems += [f"{where}: {found[0]}"] if found else []

    def resume(self, where: str) -> None:
        """After another run all is as if nothing had happened."""
        self.work(self.out)
        Store(self.out).clean(ALL_FILES_S)
        left = tree(self.out)
        wrong = {
            path for path in left.keys() | self.right if left.get(path) != self.right.get(path)
        }
        wrong |= {str(path) for path in self.out.rglob(".*")}
        wrong |= {str(path) for path in (self.out / SHARDS).iterdir() if path.is_dir()}
        if wrong:
            self.problems.append(f"{where}, resumed: {sorted(wrong)[0]} of {len(wrong)}")


def make(store: Store, view: PlannedView) -> int:
    """Make what is missing of a task; how many samples that are."""
    with place_of(store, view) as place:
        missing = place.missing()
        place.add_view(lambda folder: {"view.json": {"key": view.key}})
        for sample in missing:
            place.add(sample, partial(files_of, sample.key))
    return len(missing)


def files_of(key: str, folder: Path) -> Files:
    """The files of a sample, one of them written to a path."""
    (folder / "a.bin").write_bytes(content(key))
    return {"sample.json": {"key": key}}


def kills(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """SIGKILL at random moments, resumed by a run that is killed too, now and then by one that ends."""
    ground, chance, done, ends = Ground(top), Random(seed), 0, 0
    began = time.monotonic()
    Program(ground.start()).wait()
    whole_s, told = time.monotonic() - began, set[Entry]()
    job = ground.start(seed)
    while done < tries:
        program = Program(job)
        time.sleep(chance.uniform(0, whole_s))
        program.kill()
        code, made, said = program.wait()
        told |= made
        if code not in (0, -9):
            raise SystemExit(said)
        done += code == -9
        ground.check(f"kill {done}", told)
        if code == 0:
            ground.resume(f"kill {done}")
            ends, told = ends + 1, set()
            ground.start()
        job = ground.again(seed + done)
    ground.resume("the last one")
    return summary(done, ground.problems, runs_completed=ends)


def each_call(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """SIGKILL at every system call.  tries : of each name at most."""
    if not calls.possible():
        return {"skipped": "needs strace, as root"}
    return Ground(top).kill_each_call(tries, seed, top / "log")


def writers(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Runs on one folder at once."""
    ground, chance, killed = Ground(top), Random(seed), 0
    for number in range(tries):
        ground.start()
        programs = []
        for one in range(chance.choice([2, 2, 3, 4])):
            first, end = sorted(chance.choices([0, 3, 5, 8, 14], k=2))
            numbers = range(first, end) if chance.random() < 0.5 and first < end else range(14)
            job = partial(ground.work, ground.out, numbers=numbers, seed=number + one)
            programs.append(Program(job, held=True))
        for program in programs:
            program.go()
        doomed = programs[1:] if number % 2 else []
        for program in doomed:
            time.sleep(chance.uniform(0, 0.1))
            program.kill()
        for program in programs:
            code, _, said = program.wait()
            killed += code == -9
            if code not in (0, -9):
                ground.problems.append(f"round {number}: {said.splitlines()[-1]}")
        ground.check(f"round {number}", set())
        ground.resume(f"round {number}")
    return summary(tries, ground.problems, killed=killed)


def full(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """A disk that is full at every write.  tries : of each name at most."""
    if not calls.possible():
        return {"skipped": "needs strace, as root"}
    found = {}
    for error, names in FAILING.items():
        ground = Ground(top / error)
        found[error] = ground.fail_each_call(error, names, tries, seed, top / error / "log")
    return found


def small_disks(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Disks of every size.  tries : of disk sizes at most."""
    if not calls.possible():
        return {"skipped": "needs mount, as root"}
    return disks.small_disks(tries, Ground, top)


def power(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """The power fails at every call that changes the disk.  tries : of each name at most."""
    if not calls.possible():
        return {"skipped": "needs strace and mount, as root"}
    return disks.power_cuts(tries, WRITES, Ground, top)


def flip(path: Path, place: int) -> None:
    """One bit of a file is another one."""
    changed = bytearray(path.read_bytes())
    changed[place] ^= 1
    path.write_bytes(changed)


def corruptions(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Random corruptions, one at a time; of flipped bits one sample at most is made again."""
    ground, chance, again = Ground(top), Random(seed), 0
    ground.work(ground.out)
    whole = top / "whole"
    shutil.copytree(ground.out, whole)
    for number in range(tries):
        name, least = CORRUPTIONS[number % len(CORRUPTIONS)](ground.out / SHARDS, chance)
        faults = [*verify(ground.out)]
        if {fault.name or fault.file for fault in faults} != name:
            ground.problems.append(f"{number}: found {faults} instead of {name}")
        discard(ground.out, faults)
        made = remake(ground)
        again += made
        if made > least:
            ground.problems.append(f"{number}: {made} samples were made again")
        for stray in name - {fault.name for fault in (whole / SHARDS).iterdir()}:
            (ground.out / SHARDS / stray).unlink()
        ground.resume(f"corruption {number}")
    return summary(tries, ground.problems, samples_made_again=again)


def remake(ground: Ground) -> int:
    """Repair; how many samples were made."""
    writer, made = IndexWriter(ground.plan, Store(ground.out), range(ground.plan.numbers)), 0
    for view in writer.tasks():
        made += make(writer.store, view)
        writer.ended(view.first, True)
    return made


def one_bit(folder: Path, chance: Random) -> tuple[set[str], int]:
    """A flipped bit anywhere."""
    path = chance.choice(sorted(folder.iterdir()))
    flip(path, chance.randrange(path.stat().st_size))
    return {path.name}, 1


def a_tail(folder: Path, chance: Random) -> tuple[set[str], int]:
    """The tail is lost."""
    path = chance.choice(sorted(folder.iterdir()))
    path.write_bytes(path.read_bytes()[: chance.randrange(path.stat().st_size)])
    return {path.name}, OF_SHARD


def more(folder: Path, chance: Random) -> tuple[set[str], int]:
    """Bytes behind the end."""
    path = chance.choice(sorted(folder.iterdir()))
    path.write_bytes(path.read_bytes() + chance.randbytes(chance.randint(1, 3000)))
    return {path.name}, 0


def zeros(folder: Path, chance: Random) -> tuple[set[str], int]:
    """A block of zeros over the start of a sample or in it."""
    path = chance.choice(sorted(folder.iterdir()))
    content, first = path.read_bytes(), chance.randrange(path.stat().st_size - 2000)
    path.write_bytes(content[:first] + bytes(600) + content[first + 600 :])
    return {path.name}, 2


def two_shards(folder: Path, chance: Random) -> tuple[set[str], int]:
    """Two shards are swapped."""
    one, two = chance.sample(sorted(folder.iterdir()), 2)
    contents = one.read_bytes(), two.read_bytes()
    one.write_bytes(contents[1])
    two.write_bytes(contents[0])
    return {one.name, two.name}, 2 * OF_SHARD


def gone(folder: Path, chance: Random) -> tuple[set[str], int]:
    """A shard is removed, or something else stands there."""
    path = chance.choice(sorted(folder.iterdir()))
    put_something_else(path, chance)
    return {path.name}, OF_SHARD


def stray(folder: Path, chance: Random) -> tuple[set[str], int]:
    """A file that no run made."""
    name = chance.choice(["more.tar", "README", "000000-12-of-12.tar"])
    (folder / name).write_bytes(b"")
    return {name}, 0


def edited(folder: Path, chance: Random) -> tuple[set[str], int]:
    """A sample is another one's, record and all, by someone who knows how its hash is made."""
    path = chance.choice(sorted(folder.iterdir()))
    content = path.read_bytes()
    start = content.index(b'{"kind"')
    record = record_of(content[start : content.index(b"\n", start) + 1])
    assert record is not None and RECORD
    other = text_of(record._replace(key=hashlib.sha256(b"x").hexdigest()[:24]))
    path.write_bytes(content[:start] + other + content[start + len(other) :])
    return {path.name}, 1


CORRUPTIONS = (one_bit, a_tail, more, zeros, two_shards, gone, stray, edited)
ATTACKS: dict[str, tuple[Attack, int]] = {
    "kills": (kills, 230),
    "calls": (each_call, 20),
    "writers": (writers, 30),
    "full": (full, 8),
    "disks": (small_disks, 10_000),
    "power": (power, 12),
    "corruptions": (corruptions, 480),
}
"""Name → attack, and how often it is tried if nothing is said."""


if __name__ == "__main__":
    run_attacks(__doc__, ATTACKS)
