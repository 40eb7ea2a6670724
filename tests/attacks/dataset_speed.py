"""Speed of commit, scan and verify, and memory over many entries."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from mitsuba_sensor.dataset.store.record import RECORD, Entry, Record, text_of
from mitsuba_sensor.dataset.store.store import Store

FILES = 8
COMMITS = 60
FILE_BYTES = 100_000


def speed(tries: int, seed: int, top: Path) -> dict[str, Any]:
    """Of ``tries`` entries of 8 tiny files each; commits of 8 files of 100 kB."""
    few, many = max(tries // 10, 1), tries
    tiny_entries(top / "few", few)
    tiny_entries(top / "many", many)
    commit_ms, write_ms = commits(top / "commits")
    scans = [in_process(scan, str(top / "many")) for _ in range(3)]
    verified = {
        n: in_process(verify, str(top / name)) for name, n in (("few", few), ("many", many))
    }
    scanned = in_process(scan, str(top / "few"))
    return {
        "commit_of_8_files_of_100_kB": {"median_ms": commit_ms, "plain_writing_ms": write_ms},
        "scan": {
            "entries": many,
            "records_per_s": statistics.median(one["per_s"] for one in scans),
        },
        "verify": {"entries": many, "entries_per_s": verified[many]["per_s"]},
        "memory": {
            "entries": f"{few} and {many}",
            "scan_mib": f"{scanned['peak_mib']:.1f} and {scans[0]['peak_mib']:.1f}",
            "verify_mib": f"{verified[few]['peak_mib']:.1f} and {verified[many]['peak_mib']:.1f}",
        },
    }


def tiny_entries(folder: Path, count: int) -> None:
    """As :meth:`Store.commit` makes them, without flushing."""
    store, content = Store(folder), b"x"
    files = {
        f"frame_{number:04d}.tiff": (1, hashlib.sha256(content).hexdigest())
        for number in range(FILES)
    }
    for number in range(count):
        key = hashlib.sha256(b"%d" % number).hexdigest()[:24]
        name = f"scene/view_{number % 256:04d}/{key}"
        place = store.folder_of("samples", name)
        place.mkdir(parents=True)
        for file in files:
            (place / file).write_bytes(content)
        (place / RECORD).write_bytes(text_of(Record("samples", name, key, files)))


def commits(folder: Path) -> tuple[float, float]:
    """Median milliseconds of a commit, and of writing the same files without any care."""
    store, contents = Store(folder / "out"), [os.urandom(FILE_BYTES) for _ in range(FILES)]

    def write(place: Path) -> None:
        for number, content in enumerate(contents):
            (place / f"{number}.bin").write_bytes(content)

    careful, plain = [], []
    for number in range(COMMITS):
        began = time.perf_counter()
        store.commit(Entry("samples", f"scene/view_0000/{number}", f"{number:024x}"), write)
        careful.append(time.perf_counter() - began)
        (folder / f"plain{number}").mkdir()
        began = time.perf_counter()
        write(folder / f"plain{number}")
        plain.append(time.perf_counter() - began)
    return statistics.median(careful) * 1e3, statistics.median(plain) * 1e3


def in_process(measure: Callable[[str], Any], folder: str) -> Any:
    """What a function says in a process of its own, whose memory holds nothing else."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(measure, folder).result()


def scan(folder: str) -> dict[str, float]:
    """In a process of its own."""
    began = time.perf_counter()
    count = sum(1 for _ in Store(Path(folder)).scan("samples"))
    return {"per_s": count / (time.perf_counter() - began), "peak_mib": peak_mib()}


def verify(folder: str) -> dict[str, float]:
    """In a process of its own."""
    done = 0

    def show(now: int, total: int) -> None:
        nonlocal done
        done = now

    began = time.perf_counter()
    faults = list(Store(Path(folder)).verify_all(show))
    assert not faults
    return {"per_s": done / (time.perf_counter() - began), "peak_mib": peak_mib()}


def peak_mib() -> float:
    """Peak of resident memory."""
    text = Path("/proc/self/status").read_text()
    return int(text.split("VmHWM:")[1].split()[0]) / 1024
