"""The light of a view that several tasks need is rendered once in all, and its samples have the bytes of one task."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import SCENES, TABLES
from helpers.makers import make_and_log_renders, run_and_log_renders
from helpers.waiting import wait_until

from mitsuba_sensor.core import InputError
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.index.origin import write_origin
from mitsuba_sensor.dataset.index.repair import discard, verify
from mitsuba_sensor.dataset.index.writer import IndexWriter
from mitsuba_sensor.dataset.options import RunOptions
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.run import lights, make
from mitsuba_sensor.dataset.run.engine import outcomes
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.dataset.run.view_render import ViewRender
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.render.light.irradiance import Irradiance

CORNELL = {"name": "cornell", "file": "cornell_box.xml"}
PANS = {"camera": {"rotate_deg_per_s": 5, "axis": [0, 1, 0]}}
AUTO = {"exposure_s": ["auto"], "serial": [1, 2, 3, 4]}
FIXED = {"exposure_s": [0.01], "serial": [1, 2, 3, 4]}
STAGGERED = [{"name": "long"}, {"name": "short", "of": "exposure", "exposure_ratio": 0.1}]
CASES: dict[str, dict[str, Any]] = {
    "metered, all outputs": {
        "render": {"spp": 16, "width": 32},
        "grid": {"exposure_s": ["auto"], "exposure_ev": [0, -3], "serial": [4, 5]},
        "cameras": [{"camera": "bayer_2mp"}],
        "outputs": [
            *("raw", "dng", "clean", "electrons", "variance", "noise_budget", "preview"),
            *("aovs", "irradiance"),
        ],
    },
    "cube": {"render": {"spp": 16, "width": 16, "spectral": "cube"}, "grid": FIXED},
    "light groups": {
        "render": {"spp": 16, "width": 16, "light_groups": "auto"},
        "grid": {"exposure_s": ["auto"], "lights.other": [0.5, 1, 2, "2 pwm(100, 0.5)"]},
    },
    "denoised": {"render": {"spp": 16, "width": 32, "denoise": True}, "grid": FIXED},
    "noise ratio": {"render": {"noise_ratio": 2, "max_spp": 32, "width": 16}, "grid": AUTO},
    "motion": {"scenes": [{**CORNELL, "motion": PANS}], "grid": AUTO},
    "read-outs of a moving scene": {
        "scenes": [{**CORNELL, "motion": PANS}],
        "cameras": [{"camera": "sony_imx174", "set": {"readouts": STAGGERED}}],
        "grid": FIXED,
    },
    "dual pixels": {
        "scenes": [{"name": "still", "file": "still_life.xml"}],
        "cameras": [{"camera": "sony_imx174", "set": {"sensor.dual_pixel": True}}],
        "grid": FIXED,
    },
    "polarisers": {
        "scenes": [{"name": "table", "file": "polarisation.xml"}],
        "cameras": [{"camera": "sony_imx250mzr"}],
        "grid": FIXED,
    },
}


def planned(**tables: Any) -> DatasetPlan:
    return DatasetPlan(read_dataset({**TABLES, **tables}), [SCENES], "text")


@pytest.fixture
def renders(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Keys of the views that were rendered."""
    rendered, own = list[str](), ViewRender.light

    def light(self: ViewRender) -> Irradiance:
        rendered.append(self.view.key)
        return own(self)

    monkeypatch.setattr(ViewRender, "light", light)
    yield rendered


def hashes(folder: Path, *kinds: str) -> dict[str, str]:
    paths = [path for kind in kinds for path in (folder / kind).rglob("*") if path.is_file()]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in paths
    }


@pytest.mark.parametrize(
    "case",
    [pytest.param(x, marks=pytest.mark.exhaustive if x != "cube" else ()) for x in CASES],
)
def test_samples_of_a_stored_light_are_those_of_the_render(
    case: str, tmp_path: Path, renders: list[str]
) -> None:
    """Four tasks of one view, each as if in a process of its own, of which one renders."""
    tables = {"scenes": [CORNELL], "outputs": ["raw", "clean", "electrons"], **CASES[case]}
    plan = planned(**tables)
    assert not run(plan, tmp_path / "whole", workers=0).failed
    (view,) = renders
    for number in (3, 1, 2, 4):
        make._KEPT.clear()
        assert not run(plan, tmp_path / "parts", workers=0, shard=(number, 4)).failed
    assert renders == [view, view]
    kinds = "samples", "views", "index"
    found = hashes(tmp_path / "parts", *kinds)
    assert found == hashes(tmp_path / "whole", *kinds) and len(found) >= 9
    assert not (tmp_path / "parts" / "lights").exists()


TWO_VIEWS = {
    "outputs": ["raw"],
    "store": {"shard_samples": 5},
    "grid": {"repetition": [*range(12)], "parameters.radiance": [1e-5, 2e-5]},
}
"""Each of three blocks at least, of which one has samples of both."""


def only_light(folder: Path) -> Path:
    (light,) = (folder / "lights").glob("*/*/*/0.exr")
    return light


def test_a_light_stays_until_all_its_samples_are_there_and_a_restart_takes_it(
    tmp_path: Path, renders: list[str]
) -> None:
    """Parts of a run end within the first view, behind it, and at the end."""
    plan, folder = planned(**TWO_VIEWS), tmp_path / "out"
    run(plan, tmp_path / "whole", workers=0)
    assert len(renders) == 2 and not (tmp_path / "whole" / "lights").exists()
    make._KEPT.clear()
    run(plan, folder, workers=0, shard=(1, 4))
    light = only_light(folder)
    make._KEPT.clear()
    run(plan, folder, workers=0, shard=(2, 4))
    assert not light.exists() and renders == [renders[0], renders[1], renders[0]]
    make._KEPT.clear()
    run(plan, folder, workers=0, shard=(4, 4))
    assert only_light(folder).parent != light.parent and len(renders) == 4
    make._KEPT.clear()
    run(plan, folder, workers=0)
    assert len(renders) == 4 and not (folder / "lights").exists()
    assert hashes(folder, "shards", "index") == hashes(tmp_path / "whole", "shards", "index")


def test_a_stored_light_that_was_changed_is_named_and_rendered_again(
    tmp_path: Path, renders: list[str]
) -> None:
    plan, folder = planned(**TWO_VIEWS), tmp_path / "out"
    run(plan, folder, workers=0, shard=(1, 4))
    light = only_light(folder)
    content = bytearray(light.read_bytes())
    content[len(content) // 2] ^= 1
    light.write_bytes(content)
    faults = [fault for fault in verify(folder, roots=[SCENES]) if fault.is_damage]
    name = light.parent.relative_to(folder / "lights").as_posix()
    assert {fault.kind for fault in faults} == {"lights"}
    assert [(fault.name, fault.file, fault.what) for fault in faults] == [
        (name, "0.exr", "changed")
    ]
    make._KEPT.clear()
    run(plan, folder, workers=0, shard=(2, 4))
    assert renders == [renders[0]] * 2 + renders[2:]
    light.parent.mkdir(parents=True)
    light.write_bytes(content)
    discard(folder, [fault._replace(file="0.exr") for fault in faults])
    assert not light.exists()


def test_a_light_that_cannot_be_read_holds_nobody_up(
    tmp_path: Path, renders: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each task renders then."""

    def fail(path: Path) -> None:
        raise InputError("it cannot be read")

    monkeypatch.setattr(lights, "read_irradiance_exr", fail)
    plan = planned(outputs=["raw"], grid=FIXED)
    for number in (1, 2):
        make._KEPT.clear()
        assert run(plan, tmp_path / "out", workers=0, shard=(number, 2)).made == 2
    assert len(renders) == 2 and not (tmp_path / "out" / "lights").exists()


def test_another_order_of_cameras_is_another_light() -> None:
    """It is rendered for the first one, whose photoelectrons its errors are of."""
    cameras = [
        {"camera": "konnik_table1"},
        {"camera": "konnik_table1", "name": "b", "set": {"pixel.full_well_e": 19000.0}},
    ]
    (one,), (other,) = (planned(cameras=x).views() for x in (cameras, cameras[::-1]))
    assert one.key == other.key and one.light_entry.key != other.light_entry.key


@pytest.mark.exhaustive
def test_two_processes_render_a_view_of_many_tasks_once(tmp_path: Path) -> None:
    """The second one has a task of the view that the first one renders, and waits for its light."""
    plan, store = planned(**TWO_VIEWS), Store(tmp_path / "out")
    run(plan, tmp_path / "whole", workers=0)
    write_origin(plan, store.folder)
    writer = IndexWriter(plan, store, range(plan.numbers))
    asked = complete(RunOptions, {"workers": 2})
    for one in outcomes(store, writer.tasks(), asked, lambda *told: None, make_and_log_renders):
        assert not one.failed
        writer.ended(one.first, True)
    assert len((tmp_path / "renders").read_text().split()) == 2
    found = hashes(store.folder, "shards", "index", "lights")
    assert found == hashes(tmp_path / "whole", "shards", "index")


@pytest.mark.exhaustive
def test_runs_at_once_share_a_render_and_one_that_is_killed_leaves_it_to_the_other(
    tmp_path: Path,
) -> None:
    """Two halves of one view at once; the one that renders is killed in its render, and made again at the end."""
    tables = {**TABLES, "outputs": ["raw"], "grid": {"repetition": [*range(6)]}}
    folder, log = tmp_path / "out", tmp_path / "renders"
    run(planned(**tables), tmp_path / "whole", workers=0)
    context = get_context("spawn")
    halves = {
        number: context.Process(
            target=run_and_log_renders, args=(tables, SCENES, folder, (number, 2))
        )
        for number in (1, 2)
    }
    for half in halves.values():
        half.start()
    wait_until(lambda: log.exists() and log.read_text().endswith("\n"))
    killed = int(log.read_text())
    for half in halves.values():
        if half.pid == killed:
            os.kill(killed, signal.SIGKILL)
    for half in halves.values():
        half.join()
    assert sorted(half.exitcode for half in halves.values()) == [-9, 0]  # type: ignore[type-var]
    assert len(log.read_text().split()) == 2
    assert run(planned(**tables), folder, workers=0).made == 3
    assert len(log.read_text().split()) == 2 and not (folder / "lights").exists()
    assert hashes(folder, "samples", "index") == hashes(tmp_path / "whole", "samples", "index")
