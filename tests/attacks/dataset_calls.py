"""Stop a program at its n-th system call of each kind, by strace: kill it, or let the call fail.

Threads have counts of their own, as strace has them: call n is that of the thread which makes n of them first.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from dataset_entries import Program, Told

from mitsuba_sensor.dataset.store.record import Entry

READY_S, TRIES = 5.0, 5
CALL = re.compile(r"^(\d+) +(\w+)\(")


def possible() -> bool:
    """Whether strace is installed and may look at other processes."""
    return shutil.which("strace") is not None and os.geteuid() == 0


def traced(job: Callable[[Told], object], *arguments: str) -> tuple[int, set[Entry], str]:
    """Exit code, entries made and last sentence of a program below strace."""
    for _ in range(TRIES):
        program = Program(job, held=True)
        command = ["strace", "-f", "-qqq", "-p", str(program.pid), *arguments]
        with subprocess.Popen(
            command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        ) as tracer:
            taken = _wait_for_tracer(program.pid, tracer)
            if taken:
                program.go()
            else:  # a busy machine
                program.kill()
                tracer.kill()
            ended = program.wait()
            tracer.wait()
        if taken:
            return ended
    raise SystemExit(f"{command} does nothing; run this as root.")


def _wait_for_tracer(pid: int, tracer: subprocess.Popen[bytes]) -> bool:
    end = time.monotonic() + READY_S
    while time.monotonic() < end and tracer.poll() is None:
        if not re.search(r"TracerPid:\s+0\n", Path(f"/proc/{pid}/status").read_text()):
            return True
        time.sleep(0.001)
    return False


def calls_of(job: Callable[[Told], object], log: Path) -> dict[str, int]:
    """How many system calls of each kind an undisturbed run makes, of the thread that makes most of them."""
    code, _, said = traced(job, "-o", str(log))
    if code:
        raise SystemExit(f"the undisturbed run failed: {said}")
    found = [CALL.match(line) for line in log.read_text("utf-8", "replace").splitlines()]
    counts = Counter((one[2], one[1]) for one in found if one)
    return {
        name: max(counts[pair] for pair in counts if pair[0] == name)
        for name, _ in sorted(counts)
    }


def each_call(
    calls: dict[str, int], what: str, start: Callable[[], Callable[[Told], object]]
) -> Iterator[tuple[str, tuple[int, set[Entry], str]]]:
    """Stop or spoil every call once: its name and number, and how the program ended.

    calls : how many there are of each name.  what : of strace's inject, ``signal=KILL`` or ``error=ENOSPC``.
    start : prepares the folder, and returns the job.
    """
    for name, count in calls.items():
        for number in range(1, count + 1):
            inject = f"inject={name}:{what}:when={number}"
            yield (
                f"{name} {number}",
                traced(start(), "-o", "/dev/null", "-e", f"trace={name}", "-e", inject),
            )
