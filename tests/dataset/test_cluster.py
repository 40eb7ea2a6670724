"""Workers of a Dask cluster come and go: who is there has views to make, and who has other versions is refused."""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from helpers.clusters import cluster as dask_processes
from helpers.makers import dies_loading, load_slowly, make_counted, write_text
from helpers.waiting import wait_until

from mitsuba_sensor import InputError, __version__
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, load_plan
from mitsuba_sensor.dataset.run import cluster
from mitsuba_sensor.dataset.run.cluster import ClusterWorkers, cluster_workers
from mitsuba_sensor.dataset.run.engine import outcomes
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.dataset.run.task import TaskLimits
from mitsuba_sensor.dataset.run.workers import local_workers
from mitsuba_sensor.dataset.store import keys
from mitsuba_sensor.dataset.store.store import Store

LIGHT = {"parameters.radiance": {"log_uniform": [1e-5, 1e-3]}}
FILE = """
name = "eight"
render = { width = 16, spp = 16 }
outputs = ["raw"]
scenes = [{ name = "flat", file = "flat_field" }]
cameras = [{ camera = "konnik_table1" }]
random = { draws = 8, values = { "parameters.radiance" = { log_uniform = [1e-5, 1e-3] } } }
"""
ANOTHER_VERSION = "import mitsuba_sensor\nmitsuba_sensor.__version__ = '9.9.9'\n"
"""What the worker runs first."""
WAITED_S = 1.0
"""For a worker that begins late: far longer than a view takes here."""


def planned(views: int) -> DatasetPlan:
    """A dataset of so many views of one sample."""
    tables: dict[str, Any] = {
        "name": "views",
        "render": {"width": 16, "spp": 16},
        "outputs": ["raw"],
        "scenes": [{"name": "flat", "file": "flat_field"}],
        "cameras": [{"camera": "konnik_table1"}],
        "random": {"draws": views, "values": LIGHT},
    }
    return DatasetPlan(read_dataset(tables), [Path()])


def told(what: str, done: int) -> None:
    """Nobody listens."""


@contextmanager
def dask_cluster(count: int, threads: int = 1) -> Iterator[Any]:
    """A scheduler and workers in this process."""
    import distributed

    quiet: Any = {"processes": False, "dashboard_address": None, "memory_limit": 0}
    with distributed.LocalCluster(
        n_workers=count, threads_per_worker=threads, **quiet
    ) as found:
        yield found


def made_by_worker(folder: Path) -> dict[str, list[int]]:
    """Worker → for each of the samples that it made, how many were being made at once."""
    counts = defaultdict[str, list[int]](list)
    for path in folder.rglob("a.txt"):
        worker, count = path.read_text().split()
        counts[worker].append(int(count))
    return counts


def test_workers_that_come_late_have_views_to_make(tmp_path: Path) -> None:
    """The first comes a second after the run has begun, the second one in its middle."""
    with dask_cluster(0) as dask:
        asked = complete(RunOptions, {"workers": 0, "scheduler": dask.scheduler_address})
        threading.Timer(WAITED_S, dask.scale, [1]).start()
        found = 0
        for one in outcomes(Store(tmp_path), planned(60).views(), asked, told, make_counted):
            assert (one.samples, one.failed) == (1, "")
            found += 1
            if found == 10:
                dask.scale(2)
    assert found == 60
    made = made_by_worker(tmp_path)
    assert len(made) == 2 and min(map(len, made.values())) >= 10


def test_each_worker_has_a_view_to_make_and_one_that_waits_and_the_scheduler_is_not_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three workers are counted once, when the run begins, and not after each of 40 views."""
    counted, most = [0], [0]
    own_count = ClusterWorkers._count_workers

    def count(self: ClusterWorkers) -> None:
        counted[0] += 1
        own_count(self)

    monkeypatch.setattr(ClusterWorkers, "_count_workers", count)
    with dask_cluster(3) as dask:
        limits = TaskLimits(make=write_text)
        with cluster_workers(dask.scheduler_address, Store(tmp_path), told, limits) as workers:
            views = iter(planned(40).views())
            under_way = ended = 0
            while ended < 40:
                while under_way < workers.count and (view := next(views, None)) is not None:
                    workers.begin(view)
                    under_way += 1
                    most[0] = max(most[0], under_way)
                if (found := workers.next_ended()) is not None:
                    assert found[1] is not None and found[1].samples == 1
                    under_way, ended = under_way - 1, ended + 1
    assert most == [6] and counted == [1]


def test_a_worker_of_another_version_is_refused_with_both_versions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The package has one version in this process, so that the run is told of another one when it begins."""
    versions, views = {**keys.made_by(), "mitsuba-sensor": "9.9.9"}, list(planned(2).views())
    monkeypatch.setattr(cluster, "made_by", partial(next, iter([versions]), keys.made_by()))
    with dask_cluster(1) as dask:
        asked = complete(RunOptions, {"workers": 0, "scheduler": dask.scheduler_address})
        with pytest.raises(
            InputError,
            match=rf"has mitsuba-sensor {__version__}, and this run has 9\.9\.9; give",
        ):
            list(outcomes(Store(tmp_path), views, asked, told, write_text))
    assert not (tmp_path / "samples").exists()


def test_a_worker_that_does_not_have_the_package_is_refused(tmp_path: Path) -> None:
    """What it is sent names a module that it does not find."""
    with dask_cluster(1) as dask:
        asked = complete(RunOptions, {"workers": 0, "scheduler": dask.scheduler_address})
        views = list(planned(2).views())
        with pytest.raises(
            InputError,
            match=rf"cannot read what mitsuba-sensor {__version__} sends \(.*install it there, in the same",
        ):
            list(outcomes(Store(tmp_path), views, asked, told, Unreadable()))  # type: ignore[arg-type]


class Unreadable:
    """What no worker can read, as one without the package reads no view."""

    def __reduce__(self) -> tuple[Any, ...]:
        return importlib.import_module, ("mitsuba_sensor.module_of_another_version",)


def test_views_of_one_worker_with_several_threads_are_made_one_after_another(
    tmp_path: Path,
) -> None:
    """What is printed goes into the log of one view, and a render uses all processors."""
    with dask_cluster(1, threads=4) as dask:
        asked = complete(RunOptions, {"workers": 0, "scheduler": dask.scheduler_address})
        found = list(outcomes(Store(tmp_path), planned(8).views(), asked, told, make_counted))
    assert len(found) == 8
    (counts,) = made_by_worker(tmp_path).values()
    assert counts == [1] * 8


def test_a_process_that_dies_while_it_loads_what_renders_counts_for_no_view(
    tmp_path: Path,
) -> None:
    """Four processes, where three that die of a view put it into quarantine."""
    make = partial(dies_loading, times=4)
    asked = complete(RunOptions, {"workers": 1})
    store = Store(tmp_path / "out")
    found = list(outcomes(store, planned(2).views(), asked, told, make))
    assert [(one.samples, one.failed) for one in found] == [(1, "")] * 2
    assert len([*(tmp_path / "begun").iterdir()]) == 4 and not store.quarantined()


def test_a_worker_may_load_what_renders_for_longer_than_a_view_may_take(tmp_path: Path) -> None:
    """Both workers begin for two seconds, where a view has half of one."""
    make = partial(load_slowly, load_s=2.0)
    asked = complete(RunOptions, {"workers": 2, "timeout_s": 0.5})
    found = list(outcomes(Store(tmp_path), planned(2).views(), asked, told, make))
    assert [(one.samples, one.failed) for one in found] == [(1, "")] * 2


def test_a_process_has_its_next_view_while_this_one_is_busy(tmp_path: Path) -> None:
    """Both views of one process are made although nobody asks for the outcome of the first."""
    views, limits, store = (
        list(planned(3).views()),
        TaskLimits(make=write_text),
        Store(tmp_path),
    )
    with local_workers(store, 1, None, told, limits) as processes:
        assert processes.count == 2
        for view in views[:2]:
            processes.begin(view)
        first, _ = processes.next_ended()
        wait_until(lambda: store.exists(views[1].samples[0].entry))
        second, _ = processes.next_ended()
    assert (first.first, second.first) == (0, 1)


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
    paths = [path for path in place.rglob("*") if path.is_file()]
    return {str(path.relative_to(place)): path.read_bytes() for path in paths}


@pytest.mark.exhaustive
def test_a_worker_that_comes_late_makes_samples_and_a_scheduler_that_is_killed_loses_nothing(
    tmp_path: Path,
) -> None:
    """The run waits for the worker, and the scheduler is killed at its first sample. One sentence says so; the rest is
    made here, with the bytes of a run without a cluster, and the next run has nothing to do."""
    with dask_processes(tmp_path) as dask:
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
    with dask_processes(tmp_path) as dask:
        dask.begin_worker({"PYTHONPATH": path})
        command = begun(tmp_path, dask.address)
        said, errors = command.communicate()
    sentence = " ".join(errors.split())
    assert (command.returncode, said) == (2, "")
    assert f"has mitsuba-sensor 9.9.9, and this run has {__version__}; give them" in sentence
    assert not (tmp_path / "out" / "samples").exists()
