"""Small datasets for tests, and tasks that need no render."""

import hashlib
import json
import os
import random
import time
from pathlib import Path
from typing import Any

import pytest

from mitsuba_sensor.dataset import card, run
from mitsuba_sensor.dataset.cameras import Folders
from mitsuba_sensor.dataset.engine import Job
from mitsuba_sensor.dataset.file import read_dataset_text
from mitsuba_sensor.dataset.plan import DatasetPlan, PlannedSample, Task
from mitsuba_sensor.dataset.store import Record, Store
from mitsuba_sensor.files.shipped_scenes import scenes_folder

SCENES = scenes_folder()
"""Scenes of the package: a scene of a checkout next to an installed package would be the user's own."""
TABLES: dict[str, Any] = {
    "name": "small",
    "render": {"spp": 16, "width": 16},
    "scenes": [{"name": "flat", "file": "flat_field.xml"}],
    "cameras": [{"camera": "konnik_table1"}],
}
LIGHTS = {"parameters.radiance": [1e-4 * k for k in range(1, 41)], "exposure_s": [0.1, 0.2]}
"""A grid of 40 lights of two samples."""


def toml_text(tables: dict[str, Any]) -> str:
    """Return tables as TOML, with a line for each value."""
    return "\n".join(f"{name} = {_inline(value)}" for name, value in tables.items()) + "\n"


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{json.dumps(n)} = {_inline(x)}' for n, x in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    return json.dumps(value).replace("NaN", "nan")


def plan_of(*roots: Path, untrusted: bool = False, **tables: Any) -> DatasetPlan:
    """Return the plan of the small dataset with these tables."""
    text = toml_text({**TABLES, **tables})
    return DatasetPlan(
        read_dataset_text(text, "the tables"), Folders(roots or [SCENES], untrusted), text
    )


def tasks_of(**tables: Any) -> list[Task]:
    """Return the tasks of the small dataset."""
    return [*plan_of(**tables).tasks()]


def samples_of(tasks: list[Task]) -> list[PlannedSample]:
    """Return the samples of tasks, in the order of the file."""
    return sorted((x for task in tasks for x in task.samples), key=lambda x: x.number)


def make_quickly(store: Store, record: Record, task: Task) -> None:
    """Commit a task whose files follow from its keys, without a render."""
    exposed = {"exposed_s": 0.1, "system_gain_dn_per_e": 0.5, "black_level_dn": 1.0}

    def samples() -> Any:
        for x in task.samples:
            row = {"number": x.number, "key": x.key, "split": x.split, "exposed": exposed}
            content = random.Random(x.key).randbytes(3000)
            yield {**row, "values": x.values}, {"frame.tiff": content, "sample.json": b"{}"}

    store.commit(task.key, record, {"view.json": task.light_key.encode()}, samples())


def make_slowly(store: Store, record: Record, task: Task) -> None:
    """Commit a task in a tenth of a second."""
    time.sleep(0.1)
    make_quickly(store, record, task)


def make_badly(store: Store, record: Record, task: Task) -> None:
    """Commit a task, or fail as the radiance of its light [1e-4] says."""
    what = round(
        task.config["parameters"]["radiance"]
        and 1e4 * float(task.config["parameters"]["radiance"])
    )
    tried = store.folder / f"tried-{task.key}"
    tried.write_text(tried.read_text() + "x" if tried.exists() else "x")
    if what == 2:
        raise ValueError("a bug")
    if what == 3 or (what == 4 and tried.read_text() == "x"):
        os.write(2, b"the renderer is on fire\n")
        os.kill(os.getpid(), 9)
    if what == 5:
        time.sleep(600)
    if what == 6:
        held = bytearray(900_000_000)
        time.sleep(600)
        assert held
    make_quickly(store, record, task)


@pytest.fixture
def no_renders(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Let runs use :func:`make_quickly`, and write nothing for people."""
    monkeypatch.setattr(run, "Job", lambda *given: Job(*given, make=make_quickly))
    monkeypatch.setattr(run, "check_scenes", lambda plan: None)
    monkeypatch.setattr(card, "write_overview", lambda *given: "")
    return monkeypatch


def contents(folder: Path) -> dict[str, str]:
    """Return name → hash of every file below a folder."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
