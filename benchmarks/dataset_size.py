"""What datasets of ten million samples take: plan, index, random access, a run with nothing to do, a tiny sample.

python benchmarks/dataset_size.py   # about six minutes, 0.5 GB in a temporary folder

The overhead of a sample is all processor time of its task but for the render and for the arrays that its files hold
(raw, clean, variance, electrons): files, hashes, tar, index. What is loaded or compiled once is not counted.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from mitsuba_sensor import Dataset
from mitsuba_sensor.dataset.index.origin import index_of, origin_of, write_origin
from mitsuba_sensor.dataset.index.part import InShard, Line, kinds_of, part_of
from mitsuba_sensor.dataset.index.writer import IndexWriter
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, load_plan
from mitsuba_sensor.dataset.run.make import rendered_light
from mitsuba_sensor.dataset.run.places import place_of
from mitsuba_sensor.dataset.store.names import name_of_sample
from mitsuba_sensor.dataset.store.record import CARD, INDEX
from mitsuba_sensor.dataset.store.shard_size import NUMBERS
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files.parquet import parquet_bytes

SAMPLES = 10**7
ASKED_FOR = 2000
"""Samples from the middle whose keys are computed."""
ACCESSES, READ, READS = 500, 10**5, 100
"""Lines that are read at random, and in order; and samples whose raw frames are read."""
SPLIT_NAMES = ("train", "test")
SHARD_NAME = f"{{:06d}}-{'0' * 12}-1000-of-1000-{'0' * 64}.tar"
INDEXED = """
name = "size"
scenes = [{{ name = "flat", file = "flat_field" }}]
cameras = [{{ camera = "konnik_table1" }}]
grid = {{ repetition = {repetitions}, exposure_s = {exposures} }}
"""
TINY, TINY_SAMPLES = (
    """
name = "tiny"
render = {{ width = 16, spp = 16 }}
scenes = [{{ name = "flat", file = "flat_field" }}]
cameras = [{{ camera = "konnik_table1" }}]
grid = {{ exposure_s = [0.05, 0.1], repetition = {repetitions} }}
""",
    200,
)
SHARD = 1000
FORMS = {"folders": 0, "shards": SHARD}
SCENE = {"name": "flat", "file": "flat_field"}
KEYS = [{"time_s": k, "origin_m": [k, 0, 1], "target_m": [k, 0, 0]} for k in (0, 1)]
EXPOSURES_S = [0.001 * k for k in range(1, 1001)]
LIGHT = {"parameters.radiance": {"log_uniform": [1e-5, 1e-3]}}
SPLITS = {"shares": {"train": 0.8, "test": 0.2}, "by": ["scene", "view"], "chips": 1}
CASES: dict[str, dict[str, Any]] = {
    "1 light": {"grid": {"repetition": [*range(10**4)], "exposure_s": EXPOSURES_S}},
    "10^7 random lights": {"random": {"draws": 10**7, "values": LIGHT}},
    "10^6 poses": {
        "scenes": [{**SCENE, "path": {"views": 10**6, "keys": KEYS}}],
        "grid": {"serial": [*range(10)]},
    },
    "10^5 poses in splits": {
        "scenes": [{**SCENE, "path": {"views": 10**5, "keys": KEYS}}],
        "grid": {"repetition": [*range(100)]},
        "splits": SPLITS,
    },
}


def measure(name: str) -> str:
    """A line on one dataset, in a process of its own."""
    tables = {
        "name": "size",
        "render": {"spp": 16, "width": 16},
        "scenes": [SCENE],
        "cameras": [{"camera": "konnik_table1"}],
        **CASES[name],
    }
    began = time.perf_counter()
    plan = DatasetPlan(read_dataset(tables), [Path()])
    assert plan.samples == plan.numbers == SAMPLES
    planned_s = time.perf_counter() - began
    began, middle = time.perf_counter(), SAMPLES // 2
    found = sum(len(view.samples) for view in plan.views(middle, middle + ASKED_FOR))
    sample_ms = (time.perf_counter() - began) / found * 1e3
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return f"{name:24}{planned_s:10.2f}{memory_mb:12.0f}{sample_ms:12.3f}"


def write_stand_in(folder: Path, samples: int) -> None:
    """A dataset of which only the index is there: lines as a run writes them, whose keys are of no sample."""
    values = {"scene": "flat", "camera": "konnik_table1", "serial": 1}
    plan, text = plan_of_index(samples)
    file = folder.with_suffix(".toml")
    file.write_text(text, "utf-8")
    write_origin(plan, folder)
    kinds, digest = kinds_of(plan.file, in_shards=True), origin_of(plan).digest
    (folder / INDEX).mkdir()
    for number in range(samples // NUMBERS):
        lines = list[Line]()
        for k in range(number * NUMBERS, (number + 1) * NUMBERS):
            key = hashlib.blake2b(str(k).encode(), digest_size=12).hexdigest()
            own = {**values, "repetition": k // 1000, "exposure_s": EXPOSURES_S[k % 1000]}
            name = name_of_sample(own, "konnik_table1", -1, key)
            place = InShard(SHARD_NAME.format(k // SHARD), k % SHARD * 20_480, 20_480, None)
            split = SPLIT_NAMES[k % 5 == 0]
            lines.append(Line(k, key, name, split, "0" * 24, False, own, place))
        part, content = part_of(digest, number, lines, NUMBERS, kinds)
        (folder / INDEX / part.name).write_bytes(content)
    (folder / CARD).write_text(index_of(folder).digest, "utf-8")  # else a run would write it


def plan_of_index(samples: int) -> tuple[DatasetPlan, str]:
    """A dataset of so many samples of one light, and its text."""
    text = INDEXED.format(repetitions=[*range(samples // 1000)], exposures=EXPOSURES_S)
    tables = tomllib.loads(text)
    return DatasetPlan(read_dataset(tables), [Path()], text), text


def peak_mb() -> float:
    """Memory that this process has taken at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def measure_reader(folder: Path) -> str:
    """Opens the index, and reads samples at random and in order."""
    before_mb, began = peak_mb(), time.perf_counter()
    samples = Dataset(folder)
    open_s = time.perf_counter() - began
    random_ms = random_access_ms(samples)
    began = time.perf_counter()
    train = Dataset(folder, split="train")
    split_s = time.perf_counter() - began
    split_ms = random_access_ms(train)
    began = time.perf_counter()
    assert sum(1 for _ in islice(samples, READ)) == READ
    each_us = (time.perf_counter() - began) / READ * 1e6
    return (
        f"{len(samples):12}{open_s:10.3f}{random_ms:14.2f}{split_s:12.2f}{split_ms:12.2f}{each_us:14.1f}"
        f"{peak_mb() - before_mb:12.0f}"
    )


def random_access_ms(samples: Dataset) -> float:
    """Median time of a sample at a random place, of another part nearly each time."""
    places, took = np.random.default_rng(1).integers(len(samples), size=ACCESSES), list[float]()
    for place in places.tolist():
        began = time.perf_counter()
        samples[place]
        took.append(time.perf_counter() - began)
    return statistics.median(took) * 1e3


def measure_empty_run(folder: Path) -> str:
    """The command `dataset run` where nothing is left to do, from its start to its end."""
    file, began = folder.with_suffix(".toml"), time.perf_counter()
    command = [sys.executable, "-m", "mitsuba_sensor", "dataset", "run", str(file), "-o"]
    done = subprocess.run([*command, str(folder), "--json"], capture_output=True, check=True)
    said = json.loads(done.stdout)
    assert said["made"] == 0 and not said["remarks"], said
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    return f"{said['there']:12}{time.perf_counter() - began:10.2f}{peak:12.0f}"


def measure_driver(samples: int) -> str:
    """Plans and indexes samples that others have made; its memory must not grow."""
    plan, _ = plan_of_index(10**6)
    before_mb, began = peak_mb(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        writer = IndexWriter(plan, Store(Path(folder)), range(samples))
        for view in writer.tasks():
            writer.ended(view.first, True)
        each_ms = (time.process_time() - began) / samples * 1e3
    return f"{samples:12}{each_ms:12.3f}{peak_mb() - before_mb:12.0f}"


def measure_tiny(form: str) -> str:
    """Makes samples of 16 × 16 pixels of one render, in one process, and reads some of them."""
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder) / "tiny.toml", Path(folder) / "out"
        text = TINY.format(repetitions=[*range(TINY_SAMPLES)])
        file.write_text(f"store = {{ shard_samples = {FORMS[form]} }}\n{text}", "utf-8")
        plan = load_plan(file)
        write_origin(plan, out)
        writer = IndexWriter(plan, Store(out), range(plan.numbers))
        (view,) = writer.tasks()
        rendered, scratch = rendered_light(writer.store, view), Path(folder)
        rendered.files_of(view.samples[0], scratch)
        parquet_bytes({"a": [1]}, {"a": "integer"}, {})  # what is loaded once
        arrays_s, began = 0.0, time.process_time()
        with place_of(writer.store, view) as place:
            for sample in place.missing():
                arrays_began = time.process_time()
                frames, _ = rendered.expose(sample)
                assert frames.clean.shape == frames.temporal_variance.shape
                arrays_s += time.process_time() - arrays_began
                place.add(sample, partial(rendered.files_of, sample))
        writer.ended(view.first, True)
        all_s, count = time.process_time() - began, len(view.samples)
        inodes = sum(1 for _ in (out / ("samples", "shards")[form == "shards"]).rglob("*"))
        samples, took = Dataset(out), list[float]()
        for place_read in np.random.default_rng(1).integers(count, size=READS).tolist():
            read_began = time.perf_counter()
            samples[place_read].read("raw")
            took.append(time.perf_counter() - read_began)
    # the arrays are computed twice in it, once for their files
    overhead_ms, arrays_ms = (all_s - 2 * arrays_s) / count * 1e3, arrays_s / count * 1e3
    return (
        f"{form:10}{arrays_ms:13.2f}{overhead_ms:15.2f}{statistics.median(took) * 1e3:15.2f}"
        f"{inodes / count * 1e6:20.0f}"
    )


def measured(function: Callable[..., str], *arguments: object) -> str:
    """What a function says in a process of its own."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(function, *arguments).result()


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("tiny samples  arrays [ms]  overhead [ms]  read raw [ms]  inodes of 10^6")
    for form in FORMS:
        print(measured(measure_tiny, form))
    print(f"{SAMPLES} samples{'plan [s]':>19}{'peak [MB]':>12}{'sample [ms]':>12}")
    for name in CASES:
        print(measured(measure, name))
    print(
        "   followed   each [ms]  more [MB]  (processor time of a driver that has nothing rendered)"
    )
    for samples in (10**4, 5 * 10**4):
        print(measured(measure_driver, samples))
    with tempfile.TemporaryDirectory() as scratch:
        for samples in (10**6, 10**7):
            write_stand_in(Path(scratch) / str(samples), samples)
            size = sum(
                one.stat().st_size for one in (Path(scratch) / str(samples)).rglob("*.parquet")
            )
            print(f"index of {samples} samples: {size / 1e6:.0f} MB")
        print(
            "     samples  open [s]   random [ms]   split [s]  there [ms]   in order [µs]  more [MB]"
        )
        for samples in (10**6, 10**7):
            print(measured(measure_reader, Path(scratch) / str(samples)))
        print("       there   run [s]   peak [MB]  (nothing to do)")
        for samples in (10**6, 10**7):
            print(measured(measure_empty_run, Path(scratch) / str(samples)))


if __name__ == "__main__":
    main()
