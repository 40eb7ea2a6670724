"""Whoever makes a dataset, it has the same bytes; what cannot be made is put aside, and the rest is made."""

from __future__ import annotations

import hashlib
import os
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import SCENES

from mitsuba_sensor import InputError
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset import engine
from mitsuba_sensor.dataset.engine import outcomes
from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.planned import DatasetPlan, PlannedSample, PlannedView, load_plan
from mitsuba_sensor.dataset.run import run
from mitsuba_sensor.dataset.store import Store

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
    paths = [*(path for path in (folder / "samples").rglob("*") if path.is_file()), folder / "index.jsonl"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def test_processes_shards_and_a_cluster_make_the_same_bytes(plan: DatasetPlan, tmp_path: Path) -> None:
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
        1, threads_per_worker=1, dashboard_address="127.0.0.1:0", host="127.0.0.1"
    ) as cluster:
        run(plan, tmp_path / "socket", scheduler=cluster.scheduler_address)
    for folder in ("two", "shards", "socket"):
        assert contents(tmp_path / folder) == expected


def test_a_view_that_ends_its_process_is_put_aside_and_the_rest_is_made(plan: DatasetPlan, tmp_path: Path) -> None:
    """The first view aborts, as a renderer does that fails an assertion."""
    views = list(plan.views())
    bad = views[0].key

    def make(store: Store, view: PlannedView, told: Callable[[str], object]) -> Iterator[PlannedSample]:
        if view.key == bad:
            os.abort()
        for sample in view.samples:
            store.commit("samples", sample.key, lambda folder: (folder / "a.txt").write_text("a"))
            yield sample

    asked = complete(RunOptions, {"workers": 1})
    found = {one.view: one for one in outcomes(Store(tmp_path), iter(views), asked, lambda what, done: None, make)}
    assert "died 3 times (Fatal Python error: Aborted)" in found.pop(bad).failed
    assert len(found) == len(views) - 1 and all(one.samples == 4 and not one.failed for one in found.values())
    assert set(Store(tmp_path).quarantined()) == {bad}


def test_processes_that_die_before_they_begin_end_the_run(
    plan: DatasetPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No view is to blame, so none is put into quarantine."""
    driver = os.getpid()

    class Deadly:
        @property
        def key(self) -> str:
            if os.getpid() != driver:
                os.kill(os.getpid(), signal.SIGKILL)
            return "0" * 24

    log = tmp_path / "quarantine" / f"{'0' * 24}.log"  # of an earlier run, in which a process did begin, and died
    log.parent.mkdir()
    log.write_text(f"# begun by {socket.gethostname()} 1 0\n\n# died\n")
    monkeypatch.setattr(engine, "MOST_EARLY_DEATHS", 2)
    asked = complete(RunOptions, {"workers": 1})
    views: Any = iter([Deadly()])
    with pytest.raises(InputError, match="2 processes in a row have died before they began a view"):
        list(outcomes(Store(tmp_path), views, asked, lambda what, done: None))
    assert not Store(tmp_path).quarantined()


def test_a_limit_of_time_ends_a_render(plan: DatasetPlan, tmp_path: Path) -> None:
    tables: dict[str, Any] = {**plan.file.model_dump(exclude_none=True), "render": {"spp": 2**20, "width": 16}}
    tables["random"] = {"draws": 1, "values": {"parameters.radiance": {"uniform": [1e-4, 1e-3]}}}
    endless = DatasetPlan(read_dataset(tables), plan.roots)
    found = run(endless, tmp_path / "out", workers=1, timeout_s=1)
    assert found.made == 0 and "Timeout" in found.failed[0].failed


def test_a_folder_holds_one_dataset(plan: DatasetPlan, tmp_path: Path) -> None:
    run(plan, tmp_path / "out", workers=0, shard=(1, 4))
    other = DatasetPlan(read_dataset({**plan.file.model_dump(exclude_none=True), "name": "other"}), plan.roots)
    with pytest.raises(InputError, match="holds the dataset 'four'"):
        run(other, tmp_path / "out", workers=0)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("keep")
    with pytest.raises(InputError, match="no dataset"):
        run(plan, tmp_path / "mine", workers=0)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]
