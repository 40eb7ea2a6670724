"""Reads thousands of damaged files of every kind that is read: each is accepted, or refused in one sentence.

    python tests/attacks/fuzz_files.py --cases 5000

Every case is a right file of this repository with changed bytes, values, names or tags (``fuzz_cases.py``), made by its
number alone. Batches are read in processes of their own, with a limit of time for each case. A fault is any exception
but InputError, a refusal that is not one line, a value that was ignored or changed in silence, a case that takes too
long, and one that ends the process.
"""

from __future__ import annotations

import argparse
import json
import os
import selectors
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

SECONDS = 20.0  # of one case; the first one of a process imports
BATCH = 250  # cases of a process
MARK = "case: "  # before what the reading process says; Mitsuba writes there too


def read_batch(start: int, count: int) -> None:
    """In a process of its own: one line before and one after each case."""
    from fuzz_cases import examined, numbered

    with tempfile.TemporaryDirectory() as folder:
        for kind, number in numbered(start, count):
            print(MARK + json.dumps([kind, number]), flush=True)
            print(
                MARK + json.dumps([kind, number, *examined(kind, number, Path(folder))]),
                flush=True,
            )


def run_batch(start: int, count: int) -> list[list[Any]]:
    """(kind, number, result, why) of some cases; after one that ends the process or takes too long, in another one."""
    found: list[list[Any]] = []
    while len(found) < count:
        begun, why = _run_process(start + len(found), count - len(found), found)
        if why:
            found.append([*begun, "fault", why])
    return found


def _run_process(start: int, count: int, found: list[list[Any]]) -> tuple[list[Any], str]:
    """Read cases until the process ends; returns the case that did not, and why."""
    command = [sys.executable, __file__, "--read", str(start), str(count)]
    begun: list[Any] = ["", start]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        rest = b""
        with selectors.DefaultSelector() as ready:
            ready.register(process.stdout, selectors.EVENT_READ)
            while True:
                if not ready.select(SECONDS):
                    process.kill()
                    return begun, f"takes more than {SECONDS:g} s"
                if not (more := process.stdout.read()):
                    break
                *lines, rest = (rest + more).split(b"\n")
                for line in lines:
                    if line.startswith(MARK.encode()):
                        begun = json.loads(line[len(MARK) :])
                        found += [begun] if len(begun) > 2 else []
        code = process.wait()
    return begun, "" if code == 0 else f"ends the process with {code}"


def report(cases: int, first: int = 0) -> dict[str, Any]:
    """Counts of results by kind, and all faults."""
    found: list[list[Any]] = []
    for start in range(first, first + cases, BATCH):
        found += run_batch(start, min(BATCH, first + cases - start))
        print(
            f"{len(found)} cases, {sum(one[2] == 'fault' for one in found)} faults",
            file=sys.stderr,
            flush=True,
        )
    counts = Counter((kind, result) for kind, _, result, _ in found)
    faults = [
        f"{kind} {number}: {why}" for kind, number, result, why in found if result == "fault"
    ]
    return {
        "cases": len(found),
        "counts": {f"{a} {b}": n for (a, b), n in sorted(counts.items())},
        "faults": faults,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument(
        "--read",
        type=int,
        nargs=2,
        metavar=("FIRST", "COUNT"),
        help="read these in this process",
    )
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if asked.read:
        read_batch(*asked.read)
        return
    found = report(asked.cases, asked.first)
    print(
        json.dumps(found, indent=2)
        if asked.json
        else "\n".join([*map(str, found["counts"].items()), *found["faults"]])
    )
    sys.exit(1 if found["faults"] else 0)


if __name__ == "__main__":
    main()
