"""What a plan of ten million samples takes: seconds, memory and milliseconds for each sample.

python benchmarks/dataset_size.py   # about half a minute
"""

from __future__ import annotations

import multiprocessing
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.planned import DatasetPlan

SAMPLES = 10**7
ASKED_FOR = 2000
"""Samples from the middle whose keys are computed."""
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


def main() -> None:
    print(f"{SAMPLES} samples{'plan [s]':>19}{'peak [MB]':>12}{'sample [ms]':>12}")
    for name in CASES:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=context) as pool:
            print(pool.submit(measure, name).result())


if __name__ == "__main__":
    main()
