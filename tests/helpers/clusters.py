"""A Dask scheduler and workers in processes of their own, as their user begins them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from helpers.waiting import wait_until

QUIET: dict[str, Any] = {"stderr": subprocess.DEVNULL}


class Cluster:
    """file : of the scheduler, which says its address.  processes : the scheduler, and then the workers."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.file, self._stack = folder / "scheduler.json", stack
        self.processes = list[subprocess.Popen[bytes]]()
        self._begin("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
        wait_until(lambda: self.file.exists() and self.file.read_text().endswith("}"))

    @property
    def address(self) -> str:
        """Of the scheduler."""
        address: str = json.loads(self.file.read_text())["address"]
        return address

    def begin_worker(self, environment: Mapping[str, str] | None = None) -> None:
        """Begin a worker.  environment : variables of it beside those of this process."""
        self._begin("dask_worker", "--nthreads", "1", environment=environment)

    def _begin(
        self, name: str, *options: str, environment: Mapping[str, str] | None = None
    ) -> None:
        variables = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            **(environment or {}),
        }
        program = [sys.executable, "-m", f"distributed.cli.{name}", *options]
        command = [*program, "--scheduler-file", str(self.file), "--no-dashboard"]
        process = subprocess.Popen(command, env=variables, **QUIET)
        self.processes.append(process)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """A scheduler without workers; all that it has begun ends with the block."""
    with ExitStack() as stack:
        yield Cluster(folder, stack)
