"""Workers of a Dask cluster make the same bytes as this machine; other versions are rejected."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.clusters import cluster
from helpers.datasets import LIGHTS, contents, make_slowly, no_renders, plan_of

from mitsuba_sensor import InputError
from mitsuba_sensor.dataset import engine
from mitsuba_sensor.dataset import run as run_module
from mitsuba_sensor.dataset.run import run
from mitsuba_sensor.dataset.store import Store
from mitsuba_sensor.files import durable

__all__ = ["no_renders"]


@pytest.fixture
def address() -> Iterator[str]:
    """Start a scheduler in this process, with two workers of two threads."""
    import distributed

    quiet: Any = {"processes": False, "dashboard_address": None, "memory_limit": 0}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=2, **quiet) as found:
        yield found.scheduler_address


def make(out: Path, **options: Any) -> dict[str, str]:
    """Run the dataset of 40 lights, and return its contents."""
    run(plan_of(grid=LIGHTS), out, progress=False, **options)
    return {name: x for name, x in contents(out).items() if durable.SCRATCH not in name}


@pytest.mark.exhaustive
def test_a_cluster_makes_what_this_process_makes(
    address: str, no_renders: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = make(tmp_path / "cluster", scheduler=address)
    assert made == make(tmp_path / "here", workers=0) and len(made) == 42


@pytest.mark.exhaustive
def test_a_worker_of_another_version_is_refused_with_both_versions(
    address: str, no_renders: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made_by: Callable[[], dict[str, str | None]] = engine.made_by

    def other() -> dict[str, str | None]:
        is_worker = threading.current_thread() is not threading.main_thread()
        return {**made_by(), **({"mitsuba": "0.1"} if is_worker else {})}

    no_renders.setattr(engine, "made_by", other)
    with pytest.raises(InputError, match=r"a worker .* has mitsuba 0\.1, but this run has 3"):
        make(tmp_path / "out", scheduler=address)


def test_no_scheduler_is_one_sentence(no_renders: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"there is no Dask scheduler at nowhere://1"):
        make(tmp_path / "out", scheduler="nowhere://1")
    with pytest.raises(InputError, match=r"no Dask scheduler at tls://"):
        make(tmp_path / "out", scheduler="tls://127.0.0.1:1", tls_ca="no_such_file.pem")


@pytest.mark.exhaustive
def test_of_a_scheduler_that_dies_what_is_made_stays_and_the_same_command_goes_on(
    no_renders: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    no_renders.setattr(run_module, "Job", lambda *given: engine.Job(*given, make=make_slowly))
    out = tmp_path / "out"
    with cluster(tmp_path) as dask:
        dask.begin_worker()

        def kill() -> None:
            while len(Store(out).finished()) < 5:
                pass
            dask.processes[0].kill()

        threading.Thread(target=kill, daemon=True).start()
        with pytest.raises(InputError, match="scheduler"):
            make(out, scheduler=dask.address)
    assert 5 <= len(Store(out).finished()) < 40
    assert make(out, workers=0) == make(tmp_path / "here", workers=0)
