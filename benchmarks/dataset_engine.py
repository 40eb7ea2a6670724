"""What engine and commits of a dataset cost beside the samples, and the memory of the driver over many of them.

    python benchmarks/dataset_engine.py [--samples 60] [--seconds 1.0] [--tiny 100000] [--workers 2] [--json]

Views and samples go through the engine and the store that `mitsuba-sensor dataset run` uses. A sample is made by
waiting and writing as many bytes as one of examples/low_light_pairs.toml has, in as many files, so that all other time
is that of engine and store. The memory is the driver's own, while that many samples of 8 bytes are made.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from dataset_waiting import make

from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.engine import outcomes
from mitsuba_sensor.dataset.keys import key_of
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.planned import PlannedSample, PlannedView
from mitsuba_sensor.dataset.store import Store

SAMPLES_PER_VIEW = 10


def views(samples: int, seconds: float, size: int) -> Iterator[PlannedView]:
    """As many samples, ten to a view.  size : bytes of its one file; 0 for those of FILES."""
    for first in range(0, samples, SAMPLES_PER_VIEW):
        config = {"seconds": seconds, "size": size}
        numbers = range(first, min(first + SAMPLES_PER_VIEW, samples))
        own = tuple(PlannedSample(key_of({**config, "sample": n}), config, {"number": n}, "") for n in numbers)
        yield PlannedView(key_of({**config, "view": first}), config, (), "none", "", own)


def megabytes() -> float:
    """Resident memory of this process."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return next(int(line.split()[1]) / 1e3 for line in status.splitlines() if line.startswith("VmRSS"))


def overhead(samples: int, seconds: float, workers: int) -> float:
    """Share of the time that is not the samples' own; the start of the processes is not counted."""
    with tempfile.TemporaryDirectory() as folder:
        ends = []
        asked = complete(RunOptions, {"workers": workers})
        for _ in outcomes(Store(Path(folder)), views(samples, seconds, 0), asked, lambda what, done: None, make):
            ends.append(time.monotonic())
        step = max(workers, 1)  # views that end together
        rounds = (len(ends) - 1) // step
        took = ends[rounds * step] - ends[0]
        return took / (rounds * SAMPLES_PER_VIEW * seconds) - 1


def memory(samples: int, workers: int) -> list[tuple[int, float]]:
    """(samples made, MB of the driver), ten times over the run."""
    found, done = [], 0
    with tempfile.TemporaryDirectory() as folder:
        asked = complete(RunOptions, {"workers": workers})
        for one in outcomes(Store(Path(folder)), views(samples, 0.0, 8), asked, lambda what, done: None, make):
            if (done + one.samples) * 10 // samples > done * 10 // samples:
                found.append((done + one.samples, megabytes()))
            done += one.samples
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--tiny", type=int, default=100_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    fewest = SAMPLES_PER_VIEW * (given.workers + 1)
    if given.samples < fewest:
        parser.error(f"--samples is {given.samples}; take {fewest} or more, so that every process makes two views")
    found = {
        "overhead_in_process": overhead(given.samples, given.seconds, 0),
        "overhead_of_workers": overhead(given.samples, given.seconds, given.workers),
        "memory_mb": memory(given.tiny, given.workers),
    }
    if given.json:
        print(json.dumps(found))
        return
    print(f"overhead at {given.seconds:g} s per sample: {found['overhead_in_process']:.2%} in this process")
    print(f"  and {found['overhead_of_workers']:.2%} in {given.workers} processes")
    for done, size in found["memory_mb"]:
        print(f"{done:8d} samples made: driver {size:.1f} MB")


if __name__ == "__main__":
    main()
