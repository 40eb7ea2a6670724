"""However a run ends, finished tasks stay, and the same command makes the rest with the same bytes."""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import (
    LIGHTS,
    contents,
    make_badly,
    make_quickly,
    no_renders,
    plan_of,
    toml_text,
)
from helpers.marks import exhaustive

import mitsuba_sensor as ms
from mitsuba_sensor.core import DiskFull, InputError
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset import engine, make_dataset
from mitsuba_sensor.dataset import run as run_module
from mitsuba_sensor.dataset.engine import Job, outcomes
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.run import read_failures, run
from mitsuba_sensor.dataset.store import Store
from mitsuba_sensor.files import durable

__all__ = ["no_renders"]
Cli = Callable[..., Any]
Run = Callable[..., Any]


@pytest.fixture
def made(no_renders: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Return a function that runs the dataset of 40 lights."""

    def make(out: str = "out", grid: Mapping[str, Any] = LIGHTS, **options: Any) -> Path:
        tables = options.pop("tables", {})
        run(
            plan_of(grid=grid, **tables),
            tmp_path / out,
            **{"workers": 0, "progress": False, **options},
        )
        return tmp_path / out

    return make


def fork(work: Callable[[], object]) -> Any:
    """Start a process."""
    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    return process


KILLS = signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP


@pytest.mark.parametrize("kills", [4, exhaustive(60)])
def test_a_run_that_is_killed_again_and_again_has_the_bytes_of_an_undisturbed_one(
    kills: int, made: Run, tmp_path: Path
) -> None:
    """One run, two runs at once, or two parts."""
    undisturbed, chance = contents(made("undisturbed")), random.Random(4)
    for number in range(kills):
        chosen = chance.choice([[{}], [{}, {}], [{"shard": (1, 2)}, {"shard": (2, 2)}]])
        runs = [fork(partial(made, "killed", **options)) for options in chosen]
        time.sleep(chance.uniform(0, 0.3))
        for one in runs:
            os.kill(one.pid, KILLS[number % len(KILLS)])
        for one in runs:
            one.join()
        there = Store(tmp_path / "killed").finished()
        assert all(map(Store(tmp_path / "killed").is_sound, there.values()))
        if number % 4 == 3:
            for path in (tmp_path / "killed" / "shards").glob("*.tar"):
                path.unlink()
    killed = contents(made("killed"))
    assert {n: x for n, x in killed.items() if durable.SCRATCH not in n} == undisturbed


def test_the_order_of_workers_parts_and_values_changes_no_byte(
    made: Run, no_renders: pytest.MonkeyPatch
) -> None:
    one = contents(made("one"))
    for part in (3, 1, 2):
        made("parts", shard=(part, 3))
    assert contents(made("parts")) == one
    turned = {name: [*reversed(values)] for name, values in LIGHTS.items()}
    shards = {name[:31] for name in one if name.startswith("shards/")}
    others = {name[:31] for name in contents(made("turned", turned)) if name[:7] == "shards/"}
    assert others == shards, "the keys of tasks"


def test_exposures_in_another_order_change_no_byte_of_a_sample(tmp_path: Path) -> None:
    """All files of rendered samples are equal, including sample.json."""
    found = []
    for order in ([0.01, 0.05], [0.05, 0.01]):
        tables: dict[str, Any] = {"outputs": ["raw", "clean", "electrons", "variance"]}
        plan = plan_of(grid={"exposure_s": order}, render={"width": 8, "spp": 4}, **tables)
        run(plan, tmp_path / str(order), workers=0, progress=False)
        samples = ms.Dataset(tmp_path / str(order))
        found.append({x.key: {name: x.files[name] for name in x.files} for x in samples})
    assert found[0] == found[1] and len(found[0]) == 2


def test_a_dataset_grows_and_nothing_else_of_it_changes(made: Run) -> None:
    """New values add tasks; outdated shards are moved away, not removed."""
    few = {name: values[:1] for name, values in LIGHTS.items()}
    out = made(grid=few)
    (old,) = Store(out).finished()
    more = {**few, "parameters.radiance": LIGHTS["parameters.radiance"][:3]}
    assert old in Store(made(grid=more)).finished() and not (out / "earlier").exists()
    assert len(ms.Dataset(made(grid=LIGHTS))) == 80
    assert [path.name[:24] for path in (out / "earlier").iterdir()].count(old) == 1


@pytest.mark.parametrize(
    ("tables", "named"),
    [
        ({"seed": 2}, "seed"),
        ({"render": {"spp": 8}}, r"\[render\]"),
        ({"outputs": ["raw"]}, "outputs"),
        ({"grid": {"exposure_s": [0.1]}}, "grid"),
        ({"cameras": [{"camera": "bayer_2mp"}]}, "cameras"),
        ({"splits": {"shares": {"all": 1.0}}}, r"\[splits\]"),
    ],
)
def test_another_dataset_in_a_folder_is_refused_and_what_differs_is_named(
    tables: dict[str, Any], named: str, made: Run
) -> None:
    before = contents(made())
    with pytest.raises(
        InputError, match=f"another dataset file, with other values of {named};"
    ):
        made(**({"grid": tables["grid"]} if "grid" in tables else {"tables": tables}))
    assert contents(made()) == before


def test_a_scene_that_was_changed_since_is_named(
    no_renders: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scene = plan_of().lights.places[0].read_text("utf-8")
    (tmp_path / "flat.xml").write_text(scene)
    tables = {"scenes": [{"name": "flat", "file": "flat.xml"}]}
    run(plan_of(tmp_path, **tables), tmp_path / "out", workers=0, progress=False)
    (tmp_path / "flat.xml").write_text(scene.replace("<scene", "<!-- mine --><scene", 1))
    with pytest.raises(InputError, match=r"made from another scene 'flat'"):
        run(plan_of(tmp_path, **tables), tmp_path / "out", workers=0, progress=False)


WHY = {
    2: "ValueError: a bug",
    3: "its process died 2 times (the renderer is on fire)",
    5: "took longer than the time limit",
    6: "GB of memory",
}
"""Radiance [1e-4] of a light that make_badly does not make → why."""


@pytest.mark.parametrize(
    ("workers", "timeout_s", "numbers"),
    [(1, 3.0, (5, 4, 2, 1)), exhaustive(2, 8.0, (5, 3, 6, 4, 2, 1, 7))],
)
def test_a_task_that_raises_dies_takes_too_long_or_too_much_costs_that_task_alone(
    workers: int,
    timeout_s: float,
    numbers: tuple[int, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """4 dies once. The slowest task is the first; made tasks have the bytes that this process makes."""
    monkeypatch.setattr(engine, "TRIES_MAX", 2)
    plan = plan_of(grid={"parameters.radiance": [1e-4 * k for k in numbers]})
    options = complete(RunOptions, {"workers": workers, "timeout_s": timeout_s})
    job = Job(str(tmp_path), plan.record(len(numbers)), 0.8, make=make_badly)
    for task, outcome in outcomes(plan.tasks(), job, options):
        number = round(1e4 * float(task.config["parameters"]["radiance"]))
        assert bool(outcome.failed) == (number in WHY)
        assert WHY.get(number, "") in outcome.failed
        assert number != 2 or "make_badly" in outcome.log
        if not outcome.failed:
            make_quickly(Store(tmp_path / "here"), plan.record(len(numbers)), task)
    assert len(Store(tmp_path).finished()) == len({*numbers} - {*WHY})
    assert Store(tmp_path).finished() == Store(tmp_path / "here").finished()
    assert not [path for path in tmp_path.rglob(f"{durable.SCRATCH}*") if path.suffix == ".log"]


def test_what_could_not_be_made_is_noted_and_tried_again_when_asked(
    made: Run, no_renders: pytest.MonkeyPatch, cli: Cli
) -> None:
    good = run_module.Job
    no_renders.setattr(run_module, "Job", lambda *given: Job(*given, make=make_badly))
    few = {"parameters.radiance": [1e-4, 2e-4]}
    out = made(grid=few)
    (failure,) = read_failures(Store(out)).values()
    assert failure.why == "ValueError: a bug" and failure.samples == 1
    done = cli("dataset", "status", out)
    assert "1 of 2 samples" in done.stdout and "a bug" in done.stdout
    no_renders.setattr(run_module, "Job", good)
    assert len(ms.Dataset(made(grid=few))) == 1, "it is not tried again"
    assert len(ms.Dataset(made(grid=few, retry=True))) == 2
    assert not (out / "failed.jsonl").exists()


def test_a_full_disk_ends_a_run_and_what_is_there_stays(
    made: Run, no_renders: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls, sync = [0], os.fsync

    def full(file: int) -> None:
        calls[0] += 1
        if calls[0] > 20:
            raise OSError(28, "No space left on device")
        sync(file)

    no_renders.setattr(os, "fsync", full)
    with pytest.raises(DiskFull, match="No space left"):
        made()
    no_renders.setattr(os, "fsync", sync)
    there = Store(tmp_path / "out").finished()
    assert 3 < len(there) < 40
    assert contents(made()) == contents(made("other"))


def test_a_complete_dataset_is_not_written_again(made: Run) -> None:
    out = made()
    times = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    made()
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == times


STOPPED = """
import sys
from mitsuba_sensor.stopping import begin_command, stop_at_signals
stop_at_signals()
begin_command()
from functools import partial
from pathlib import Path
from helpers import datasets
from mitsuba_sensor.dataset import card, run
from mitsuba_sensor.dataset.engine import Job
run.Job = lambda *given: Job(*given, make=datasets.make_slowly)
run.check_scenes = lambda plan: None
card.write_overview = lambda *given: ""
run.run(datasets.plan_of(grid=datasets.LIGHTS), Path(sys.argv[1]), workers=int(sys.argv[2]), progress=False)
"""


@pytest.mark.parametrize(
    ("workers", "kill"),
    [exhaustive(2, os.killpg), exhaustive(2, os.kill), (0, os.killpg)],
)
def test_ctrl_c_says_how_many_samples_are_complete_of_all_runs(
    workers: int, kill: Callable[[int, int], None], tmp_path: Path
) -> None:
    """A terminal also signals the workers; another program signals only the run."""
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    make_quickly(
        Store(tmp_path), plan_of(grid=LIGHTS).record(80), next(plan_of(grid=LIGHTS).tasks())
    )
    process = subprocess.Popen(
        [sys.executable, "-c", STOPPED, str(tmp_path), str(workers)],
        env=variables,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while len(Store(tmp_path).finished()) < 4 and process.poll() is None:
        time.sleep(0.02)
    kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    time.sleep(0.5)
    complete = int(said.split("stopped; ")[1].split()[0])
    assert complete == 2 * len(Store(tmp_path).finished()) >= 8, said
    assert said.strip().endswith("the same command continues from there"), said
    assert not [*tmp_path.rglob(f"{durable.SCRATCH}*")], "what was unfinished is undone"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"shard": "3/2"}, "give i/n with i from 1 to n"),
        ({"workers": 0, "timeout_s": 5.0}, "workers is 0"),
        ({"scheduler": "tcp://127.0.0.1:1", "memory_gb": 5.0}, "--memory-limit"),
    ],
)
def test_options_that_contradict_are_refused(
    options: dict[str, Any], said: str, made: Run
) -> None:
    with pytest.raises(InputError, match=said):
        made(**{"workers": None, **options})


@pytest.mark.parametrize("out", ["", "s3://bucket/pairs"])
def test_no_folder_is_no_current_folder(out: str, no_renders: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="out= is"):
        run(plan_of(grid=LIGHTS), out, workers=0, progress=False)


def test_the_command_makes_shows_and_verifies_a_dataset(tmp_path: Path, cli: Cli) -> None:
    file = tmp_path / "small.toml"
    tables = {
        "name": "small",
        "render": {"width": 8, "spp": 4},
        "scenes": [{"name": "flat", "file": "flat_field"}],
    }
    file.write_text(toml_text({**tables, "cameras": [{"camera": "konnik_table1"}]}))
    planned = cli("dataset", "plan", file, "--json")
    assert planned.exit_code == 0 and json.loads(planned.stdout)["forecast"]["seconds"] > 0
    done = cli("dataset", "run", file, "-o", tmp_path / "out", "--workers", "0")
    assert done.exit_code == 0 and "1 new sample," in done.stdout
    again = cli("dataset", "run", file, "-o", tmp_path / "out", "--workers", "0")
    assert "0 new samples, 1 already existed" in again.stdout
    status = json.loads(cli("dataset", "status", tmp_path / "out", "--json").stdout)
    assert status["there"] == status["samples"] == 1 and not status["failed"]
    assert "every file is unchanged" in cli("dataset", "verify", tmp_path / "out").stdout
    (shard,) = (tmp_path / "out" / "shards").iterdir()
    content = bytearray(shard.read_bytes())
    content[5000] ^= 1
    shard.write_bytes(content)
    assert cli("dataset", "verify", tmp_path / "out", "--remove").exit_code == 1
    assert make_dataset(file, tmp_path / "out", workers=0, progress=False).made == 1
    assert cli("dataset", "verify", tmp_path / "out").exit_code == 0
