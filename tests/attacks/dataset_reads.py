"""Attack what reads the index of a dataset: random plans, parts with gaps, any order of accesses, growth, processes.

    python tests/attacks/dataset_reads.py [places processes growing objects] [--tries N] [--json]

places     samples by number, slice, split and value, of parts of 1 to 10 000 numbers, some of them empty or not there
processes  the same of one open dataset in two processes that were forked and one to which it was pickled
growing    parts are replaced by ones with more samples while the dataset is open
objects    the same parts in a store of objects

Each line that is read is compared with what the plan says of its sample. Each try is of another plan; the summary says
how many lines were compared.
"""

from __future__ import annotations

import json
import multiprocessing
import pickle
import secrets
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import dataset_ground  # noqa: F401, says where the tests' helpers are
from dataset_attacks import Attack, run_attacks
from dataset_entries import summary

from mitsuba_sensor import Dataset
from mitsuba_sensor.core import InputError
from mitsuba_sensor.dataset.index import origin
from mitsuba_sensor.dataset.index import part as index_part
from mitsuba_sensor.dataset.index.origin import origin_of, write_origin
from mitsuba_sensor.dataset.index.part import InShard, Line, kinds_of, part_of
from mitsuba_sensor.dataset.index.writer import lines_of
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.store.record import INDEX
from mitsuba_sensor.files.objects import Objects

NUMBERS = (1, 7, 60, 10_000)
"""Of a part."""
SIZES = (1, 2, 7, 8, 59, 61, 300)
LARGE, EVERY = (9_999, 10_000, 10_001, 20_003), 40
"""Samples of a plan; of every so many-th plan a large number."""
ACCESSES, LONG = 30, 10
"""Samples and slices that are asked for; a slice of so many is not."""
SHARD = f"000000-{'0' * 12}-1-of-1-{'0' * 64}.tar"


class Made(NamedTuple):
    """A dataset of which only the index is there, and what its plan says of the samples in it.

    planned : of all samples.  there : of those that the index has.
    """

    plan: DatasetPlan
    planned: list[Line]
    there: list[Line]


def make(folder: Path, chance: Random, number: int) -> Made:
    """A dataset with random gaps."""
    shutil.rmtree(folder, ignore_errors=True)
    size = chance.choice(SIZES)
    numbers = chance.choice(NUMBERS)
    if number % EVERY == 0:
        size, numbers = chance.choice(LARGE), 10_000
    for module in (index_part, origin):
        module.NUMBERS = numbers
    plan = plan_of(size, chance)
    write_origin(plan, folder)
    (folder / INDEX).mkdir()
    in_shards = chance.random() < 0.5
    planned = [with_lists(line) for view in plan.views() for line in lines_of(view)]
    if in_shards:
        planned = [
            line._replace(place=InShard(SHARD, k * 512, 512, chance.choice([None, 0])))
            for k, line in enumerate(planned)
        ]
    lost = chance.choice([0.0, 0.0, 0.1, 0.9])
    there = [line for line in planned if chance.random() >= lost] or planned[-1:]
    write_parts(folder, Made(plan, planned, there))
    return Made(plan, planned, there)


def with_lists(line: Line) -> Line:
    """A line whose values have lists where they had tuples."""
    return line._replace(values=json.loads(json.dumps(line.values)))


def plan_of(size: int, chance: Random) -> DatasetPlan:
    """A plan of so many samples, or a few more of several values."""
    grid: dict[str, Any] = {"repetition": [*range(size)]}
    tables: dict[str, Any] = {
        "name": "reads",
        "render": {"spp": 16, "width": 16},
        "scenes": [{"name": "flat", "file": "flat_field"}],
        "cameras": [{"camera": "konnik_table1"}],
    }
    if chance.random() < 0.5:
        poses = [{"origin_m": [0, k, 4], "target_m": [0, 1, 0]} for k in range(1, 5)]
        tables["scenes"].append({"name": "b", "file": "flat_field", "views": poses})
        tables["splits"] = {"shares": {"train": 0.5, "test": 0.5}, "by": ["scene", "view"]}
    if chance.random() < 0.5:
        grid["exposure_s"] = chance.sample([0.01, 0.02, 1, "auto"], 2)
    return DatasetPlan(read_dataset({**tables, "grid": grid}), [Path()], "text")


def write_parts(folder: Path, made: Made) -> None:
    """Write the index anew; the parts of which nothing is there are not there, or are empty."""
    in_shards = made.planned[0].place is not None
    kinds, digest = kinds_of(made.plan.file, in_shards), origin_of(made.plan).digest
    for path in [*(folder / INDEX).iterdir()]:
        path.unlink()
    numbers = index_part.NUMBERS
    for number, start in enumerate(range(0, made.plan.numbers, numbers)):
        own = range(start, start + numbers)
        planned = sum(line.number in own for line in made.planned)
        lines = [line for line in made.there if line.number in own]
        if lines or number % 2:
            part, content = part_of(digest, number, lines, planned, kinds)
            (folder / INDEX / part.name).write_bytes(content)


def compare(dataset: Dataset, lines: list[Line], chance: Random) -> tuple[int, list[str]]:
    """How many lines were compared, and what was wrong."""
    problems, count, compared = list[str](), len(lines), 0
    if len(dataset) != count:
        problems.append(f"{len(dataset)} samples of {count}")
    for place in (count, -count - 1, 10**30, -(10**30)):
        try:
            dataset[place]
            problems.append(f"[{place}] of {count}")
        except IndexError:
            pass
    for _ in range(min(ACCESSES, 3 * count)):
        place = chance.randrange(-count, count)
        if dataset.lines[place] != lines[place]:
            problems.append(f"[{place}]")
        ends = [chance.choice([None, chance.randint(-count - 9, count + 9)]) for _ in "ab"]
        some = slice(*ends, chance.choice([None, -1, 1, 7, -50]))
        places = range(count)[some]
        compared += 1
        if len(places) < LONG and dataset.lines[some] != lines[some]:
            problems.append(f"{some}")
    if [*dataset.lines] != lines:
        problems.append("in order")
    return compared + count, problems


def compare_all(dataset: Dataset, lines: list[Line], chance: Random) -> tuple[int, list[str]]:
    """The whole dataset, each split of it, and those with a value."""
    compared, problems = compare(dataset, lines, chance)
    counts = {split: sum(x.split == split for x in lines) for split in {x.split for x in lines}}
    if dataset.splits != sorted(counts) or dataset.lines.counts("split") != counts:
        problems.append(f"splits {dataset.splits}, not {counts}")
    for name, value in [*(("split", x) for x in counts), ("scene", "b"), ("repetition", 0)]:
        own = [
            line for line in lines if {**line.values, "split": line.split}.get(name) == value
        ]
        if own:
            more, wrong = compare(dataset.where(**{name: value}), own, chance)
            compared, problems = compared + more, [*problems, *(f"{value}: {x}" for x in wrong)]
    return compared, problems


def attack(tries: int, seed: int, check: Callable[[Random, int], tuple[int, list[str]]]) -> Any:
    """Check so many plans."""
    problems, compared, chance = list[str](), 0, Random(seed)
    for number in range(tries):
        more, wrong = check(chance, number)
        compared += more
        if wrong:
            problems.append(f"plan {number}: {'; '.join(wrong[:5])}")
    return summary(tries, problems, compared=compared)


def places(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Any order of accesses."""

    def check(chance: Random, number: int) -> tuple[int, list[str]]:
        made = make(top / "made", chance, number)
        return compare_all(Dataset(top / "made"), made.there, chance)

    return attack(tries, seed, check)


def processes(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Two processes that are forked after the dataset was read, and one that gets it by a pickle."""
    fork, spawn = multiprocessing.get_context("fork"), multiprocessing.get_context("spawn")

    def check(chance: Random, number: int) -> tuple[int, list[str]]:
        made = make(top / "made", chance, number)
        opened = Dataset(top / "made")
        compared, problems = compare(opened, made.there, chance)
        jobs = [(pickle.dumps(opened), made.there, chance.random(), index_part.NUMBERS)] * 2
        with fork.Pool(2) as pool:
            found = pool.starmap(_compared_there, jobs)
        if number % EVERY == 1:
            with spawn.Pool(1) as pool:
                found += pool.starmap(_compared_there, jobs[:1])
        for more, wrong in found:
            compared, problems = compared + more, [*problems, *wrong]
        return compared, problems

    return attack(tries, seed, check)


def _compared_there(
    opened: bytes, lines: list[Line], seed: float, numbers: int
) -> tuple[int, list[str]]:
    for module in (index_part, origin):
        module.NUMBERS = numbers
    return compare_all(pickle.loads(opened), lines, Random(seed))


def growing(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """What was opened before gives its own lines, or says that it must be opened again."""

    def check(chance: Random, number: int) -> tuple[int, list[str]]:
        made = make(top / "made", chance, number)
        before = Dataset(top / "made")
        order = sorted(made.there, key=lambda line: line.number)
        missing = [line for line in made.planned if line not in made.there]
        ends = sorted(chance.sample(range(len(missing) + 1), min(3, len(missing) + 1)))
        compared, problems = 0, list[str]()
        for start, end in pairwise([0, *ends, len(missing)]):
            order = sorted([*order, *missing[start:end]], key=lambda line: line.number)
            write_parts(top / "made", made._replace(there=order))
            more, wrong = compare_all(Dataset(top / "made"), order, chance)
            compared, problems = compared + more, [*problems, *wrong]
            for place, line in enumerate(made.there[:ACCESSES]):
                try:
                    if before.lines[place] != line:
                        problems.append(f"before, [{place}]")
                except InputError as error:
                    if "open it again" not in str(error):
                        problems.append(str(error))
        return compared, problems

    return attack(tries, seed, check)


def objects(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """In the memory of this process."""

    def check(chance: Random, number: int) -> tuple[int, list[str]]:
        made = make(top / "made", chance, number)
        place = Objects(f"memory://{secrets.token_hex(8)}")
        for file in (top / "made").rglob("*"):
            if file.is_file():
                (place / file.relative_to(top / "made").as_posix()).put(file)
        return compare_all(Dataset(place.address), made.there, chance)

    return attack(tries, seed, check)


ATTACKS: dict[str, tuple[Attack, int]] = {
    "places": (places, 100),
    "processes": (processes, 40),
    "growing": (growing, 40),
    "objects": (objects, 40),
}
"""Name → attack, and how often it is tried if nothing is said."""


if __name__ == "__main__":
    run_attacks(__doc__, ATTACKS)
