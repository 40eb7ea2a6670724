"""`dataset run --scheduler` with a scheduler and workers of their own: late, of another version, killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.clusters import cluster
from helpers.waiting import wait_until

from mitsuba_sensor import __version__
from mitsuba_sensor.dataset.plan.planned import load_plan
from mitsuba_sensor.dataset.run.run import run

FILE = """
name = "eight"
render = { width = 16, spp = 16 }
outputs = ["raw"]
scenes = [{ name = "flat", file = "flat_field" }]
cameras = [{ camera = "konnik_table1" }]
random = { draws = 8, values = { "parameters.radiance" = { log_uniform = [1e-5, 1e-3] } } }
"""
ANOTHER_VERSION = "import mitsuba_sensor\nmitsuba_sensor.__version__ = '9.9.9'\n"
"""A sitecustomize.py."""


def begun(folder: Path, address: str) -> subprocess.Popen[str]:
    """The command, begun."""
    (folder / "eight.toml").write_text(FILE)
    command = [
        sys.executable,
        "-m",
        "mitsuba_sensor",
        "dataset",
        "run",
        str(folder / "eight.toml"),
    ]
    options = ["-o", str(folder / "out"), "--scheduler", address, "--json"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*command, *options], stdout=pipe, stderr=pipe, text=True, env=environment
    )


def samples_in(folder: Path) -> dict[str, bytes]:
    place = folder / "samples"
    return {str(path.relative_to(place)): path.read_bytes() for path in place.rglob("*.*")}


@pytest.mark.exhaustive
def test_a_worker_that_comes_late_makes_samples_and_a_scheduler_that_is_killed_loses_nothing(
    tmp_path: Path,
) -> None:
    """The run waits for the worker, and the scheduler is killed at its first sample. One sentence says so; the rest is
    made here, with the bytes of a run without a cluster, and the next run has nothing to do."""
    with cluster(tmp_path) as dask:
        command = begun(tmp_path, dask.address)
        wait_until(lambda: (tmp_path / "out" / "record.json").exists())
        dask.begin_worker()
        wait_until(lambda: any((tmp_path / "out").glob("samples/*/*/*/record.json")))
        os.kill(dask.processes[0].pid, signal.SIGKILL)
        said, errors = command.communicate()
    assert command.returncode == 0, errors
    found = json.loads(said)
    assert (found["made"], found["there"], found["failed"]) == (8, 0, [])
    (remark,) = (one for one in found["remarks"] if "scheduler" in one)
    assert (
        remark
        == f"the Dask scheduler at {dask.address} was gone; this machine alone has made the rest."
    )
    plan = load_plan(tmp_path / "eight.toml")
    run(plan, tmp_path / "alone", workers=0)
    assert samples_in(tmp_path / "out") == samples_in(tmp_path / "alone")
    assert run(plan, tmp_path / "out", workers=0).made == 0


@pytest.mark.exhaustive
def test_a_worker_of_another_version_ends_the_command_with_one_sentence(tmp_path: Path) -> None:
    """Exit code 2; no sample is made."""
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "sitecustomize.py").write_text(ANOTHER_VERSION)
    path = os.pathsep.join([str(tmp_path / "other"), *sys.path])
    with cluster(tmp_path) as dask:
        dask.begin_worker({"PYTHONPATH": path})
        command = begun(tmp_path, dask.address)
        said, errors = command.communicate()
    sentence = " ".join(errors.split())
    assert (command.returncode, said) == (2, "")
    assert f"has mitsuba-sensor 9.9.9, and this run has {__version__}; give them" in sentence
    assert not (tmp_path / "out" / "samples").exists()
