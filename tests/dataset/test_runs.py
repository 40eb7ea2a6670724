"""Whoever makes a dataset, it has the same bytes; what cannot be made is put aside, and the rest is made."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest
from helpers.clusters import cluster
from helpers.datasets import SCENES
from helpers.makers import listening, make_large, make_slowly, make_text
from helpers.waiting import wait_until

from mitsuba_sensor import InputError
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, load_plan
from mitsuba_sensor.dataset.run import engine, task
from mitsuba_sensor.dataset.run.engine import outcomes
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.dataset.store import keys
from mitsuba_sensor.dataset.store.store import Store

FLAT = (SCENES / "flat_field.xml").read_text(encoding="utf-8")
FILE = """
name = "four"
render = { width = 16, spp = 16 }
outputs = ["raw", "clean"]
scenes = [{ name = "flat", file = "flat.xml" }]
cameras = [{ camera = "konnik_table1" }]
grid = { exposure_s = [0.01, 0.1], serial = [1, 2] }
random = { draws = 2, values = { "parameters.radiance" = { log_uniform = [1e-5, 1e-3] } } }
"""


@pytest.fixture
def plan(tmp_path: Path) -> DatasetPlan:
    (tmp_path / "flat.xml").write_text(FLAT)
    (tmp_path / "four.toml").write_text(FILE)
    return load_plan(tmp_path / "four.toml")


def contents(folder: Path) -> dict[str, str]:
    """Every file of the samples, and the index."""
    paths = [
        *(path for path in (folder / "samples").rglob("*") if path.is_file()),
        *(folder / "index").iterdir(),
    ]
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in paths
    }


@pytest.mark.exhaustive
def test_processes_shards_and_a_cluster_make_the_same_bytes(
    plan: DatasetPlan, tmp_path: Path
) -> None:
    """Two processes; three shards, the last one twice; a Dask scheduler over a socket, as dask-jobqueue starts one."""
    import distributed
    import mitsuba

    mitsuba.set_variant("scalar_spectral")  # what is set in this process changes nothing
    run(plan, tmp_path / "alone", workers=0)
    expected = contents(tmp_path / "alone")
    assert len(expected) == 8 * 4 + 1
    assert run(plan, tmp_path / "two", workers=2).made == 8
    assert sum(run(plan, tmp_path / "shards", shard=(k, 3)).made for k in (3, 1, 2, 2)) == 8
    with distributed.LocalCluster(
        1,
        processes=False,  # a worker in a process of its own is in the exhaustive tests
        threads_per_worker=1,
        protocol="tcp",
        dashboard_address="127.0.0.1:0",
        host="127.0.0.1",
    ) as cluster:
        run(plan, tmp_path / "socket", scheduler=cluster.scheduler_address)
    for folder in ("two", "shards", "socket"):
        assert contents(tmp_path / folder) == expected


class Deadly:
    """A view that ends the process that it comes to."""

    first = 0

    @property
    def task_key(self) -> str:
        if multiprocessing.parent_process() is not None:
            os.kill(os.getpid(), signal.SIGKILL)
        return "0" * 24


def test_a_view_that_ends_its_process_is_put_aside_and_the_rest_is_made(
    plan: DatasetPlan, tmp_path: Path
) -> None:
    """The first view aborts, as a renderer does that fails an assertion."""
    views = list(plan.views())
    bad = views[0].key
    make = partial(make_text, dies=bad)
    asked = complete(RunOptions, {"workers": 1})
    found = {
        one.view: one
        for one in outcomes(Store(tmp_path), iter(views), asked, lambda what, done: None, make)
    }
    assert "died 3 times (Fatal Python error: Aborted)" in found.pop(bad).failed
    assert len(found) == len(views) - 1 and all(
        one.samples == 4 and not one.failed for one in found.values()
    )
    assert set(Store(tmp_path).quarantined()) == {bad}


@pytest.mark.exhaustive
def test_processes_that_die_before_they_begin_end_the_run(
    plan: DatasetPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No view is to blame, so none is put into quarantine."""
    log = (
        tmp_path / "quarantine" / f"{'0' * 24}.log"
    )  # of an earlier run, in which a process did begin, and died
    log.parent.mkdir()
    log.write_text(f"# begun by {socket.gethostname()} 1 0\n\n# died\n")
    monkeypatch.setattr(engine, "MOST_EARLY_DEATHS", 2)
    asked = complete(RunOptions, {"workers": 1})
    views: Any = iter([Deadly()])
    with pytest.raises(
        InputError, match="2 processes in a row have died before they began a view"
    ):
        list(outcomes(Store(tmp_path), views, asked, lambda what, done: None))
    assert not Store(tmp_path).quarantined()


@pytest.mark.exhaustive
def test_no_process_of_a_run_listens_to_anybody(plan: DatasetPlan, tmp_path: Path) -> None:
    """Whoever else works on this machine could send it commands."""
    views = list(plan.views())
    asked = complete(RunOptions, {"workers": 2})
    told = list[str]()
    found = list(
        outcomes(Store(tmp_path), views, asked, lambda what, done: told.append(what), make_text)
    )
    assert [one.samples for one in found] == [4, 4] and told.count("sample") == 8
    assert {path.read_text() for path in tmp_path.rglob("a.txt")} == {"[]"}
    with socket.create_server(("127.0.0.1", 0)):
        assert len(listening()) == 1, "it would be seen"


def test_a_process_that_takes_too_much_memory_is_ended(
    plan: DatasetPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(task, "MOST_TRIES", 1)
    view = next(iter(plan.views()))
    asked = complete(RunOptions, {"workers": 1, "memory_gb": 0.5})
    (found,) = outcomes(Store(tmp_path), [view], asked, lambda what, done: None, make_large)
    assert "died 1 times" in found.failed and "too little memory" in found.failed


@pytest.mark.exhaustive
def test_workers_of_a_cluster_have_the_versions_of_the_run_and_it_goes_on_where_the_scheduler_dies(
    plan: DatasetPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed after the first sample; the worker of the cluster, which sees the same folder, makes what it has begun."""
    (tmp_path / "out").mkdir()
    remarks = list[str]()
    with cluster(tmp_path) as dask:
        dask.begin_worker()
        address = dask.address
        (tmp_path / "out" / "scheduler").write_text(str(dask.processes[0].pid))
        asked = complete(RunOptions, {"workers": 0, "scheduler": address})
        views = list(plan.views())
        store = Store(tmp_path / "out")
        with (
            monkeypatch.context() as other,
            pytest.raises(
                InputError, match=r"and this run has 9\.9\.9; give them the same version"
            ),
        ):
            other.setattr(keys, "__version__", "9.9.9")
            list(outcomes(store, views, asked, lambda what, done: None, make_slowly))
        list(
            outcomes(store, views, asked, lambda what, done: None, make_slowly, remarks.append)
        )
    assert remarks == [
        f"the Dask scheduler at {address} was gone; this machine alone has made the rest."
    ]
    assert all(store.exists(sample.entry) for view in views for sample in view.samples)


@pytest.mark.exhaustive
def test_a_limit_of_time_ends_a_render(plan: DatasetPlan, tmp_path: Path) -> None:
    tables: dict[str, Any] = {
        **plan.file.model_dump(exclude_none=True),
        "render": {"spp": 2**20, "width": 16},
    }
    tables["random"] = {
        "draws": 1,
        "values": {"parameters.radiance": {"uniform": [1e-4, 1e-3]}},
    }
    endless = DatasetPlan(read_dataset(tables), plan.roots)
    found = run(endless, tmp_path / "out", workers=1, timeout_s=1)
    assert found.made == 0 and "Timeout" in found.failed[0].failed


def test_a_dataset_with_equal_samples_is_refused_before_anything_is_made(
    plan: DatasetPlan, tmp_path: Path
) -> None:
    tables = {**plan.file.model_dump(exclude_none=True), "list": [{"temperature_k": 290}] * 2}
    twice = DatasetPlan(read_dataset(tables), plan.roots)
    with pytest.raises(InputError, match="are the same"):
        run(twice, tmp_path / "out", workers=0)
    assert not (tmp_path / "out").exists()


def test_a_view_is_not_to_blame_where_the_program_that_asked_for_it_is_killed(
    plan: DatasetPlan, tmp_path: Path
) -> None:
    """Its worker tells of samples that nobody hears of, and ends."""
    code = f"""
import sys
sys.path[:] = {sys.path!r}
from pathlib import Path
from helpers.makers import make_and_kill
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.run.engine import outcomes
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.plan.planned import load_plan
from mitsuba_sensor.dataset.store.store import Store
asked = complete(RunOptions, {{"workers": 1}})
views = load_plan({str(tmp_path / "four.toml")!r}).views()
list(outcomes(Store(Path({str(tmp_path / "out")!r})), views, asked, lambda what, done: None, make_and_kill))
"""
    done = subprocess.run([sys.executable, "-c", code])
    assert done.returncode == -signal.SIGKILL
    worker, store = int((tmp_path / "worker").read_text()), Store(tmp_path / "out")
    try:
        wait_until(lambda: not lives(worker) or bool(store.quarantined()))
        assert not lives(worker) and not store.quarantined()
    finally:
        with suppress(ProcessLookupError):
            os.kill(worker, signal.SIGKILL)


def lives(pid: int) -> bool:
    """Whether a process runs, which nobody may have waited for."""
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


def test_a_folder_holds_one_dataset(plan: DatasetPlan, tmp_path: Path) -> None:
    run(plan, tmp_path / "out", workers=0, shard=(1, 4))
    other = DatasetPlan(
        read_dataset({**plan.file.model_dump(exclude_none=True), "name": "other"}), plan.roots
    )
    with pytest.raises(InputError, match="holds the dataset 'four'"):
        run(other, tmp_path / "out", workers=0)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("keep")
    with pytest.raises(InputError, match="no dataset"):
        run(plan, tmp_path / "mine", workers=0)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]
