"""Folders of samples say what is in them, by the settings of the sample alone."""

from __future__ import annotations

import random
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import TABLES, plan_of

from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.plan.configured import PlannedSample
from mitsuba_sensor.dataset.store.names import (
    LONGEST,
    is_name_of_entry,
    name_of_sample,
    with_piece,
)
from mitsuba_sensor.dataset.store.record import Entry
from mitsuba_sensor.dataset.store.store import Store

KEY, OTHER = "ab" * 12, "cd" * 12


def planned(**tables: Any) -> list[PlannedSample]:
    return [sample for view in plan_of(**tables).views() for sample in view.samples]


def names(**tables: Any) -> dict[str, str]:
    """Key → name of each sample."""
    return {sample.key: sample.name for sample in planned(**tables)}


VIEWS = [{"origin_m": [0, k, 4], "target_m": [0, 1, 0]} for k in (1, 2, 3)]


def test_a_name_is_scene_pose_and_settings() -> None:
    scenes = [{"name": "hall", "file": "flat_field.xml", "views": VIEWS}]
    tables = {"grid": {"serial": [2], "temperature_k": [290.0], "exposure_s": ["auto", 0.01]}}
    tables["grid"]["exposure_ev"] = [-2]
    assert [*names(scenes=scenes, **tables).values()][2:4] == [
        "hall/view_0001/konnik_table1,exposure_s=auto,exposure_ev=-2,temperature_k=290,serial=2",
        "hall/view_0001/konnik_table1,exposure_s=0.01,exposure_ev=-2,temperature_k=290,serial=2",
    ]
    (only,) = names().values()
    assert only == "flat/view_0000/konnik_table1,serial=1", "no pose is the one of the file"
    cameras = [{"camera": "konnik_table1", "name": "left"}]
    (drawn, _) = names(
        cameras=cameras,
        random={"draws": 2, "values": {"camera.adc.black_level_dn": {"integer": [60, 60]}}},
    ).values()
    assert drawn == "flat/view_0000/left,camera.adc.black_level_dn=60,draw=0,serial=1"


def test_a_data_set_that_grows_keeps_the_names_it_had() -> None:
    """More values, other orders, other axes at the value of a sample for which nothing is said, other scenes."""
    grid = {"exposure_s": [0.01, 0.1], "serial": [1, 2]}
    before = names(grid=grid)
    axes = {
        "repetition": [0, 1],
        "frames": [1, 4],
        "exposure_ev": [0, -2],
        "serial": [3, 2, 1],
        "exposure_s": [1, 0.1, 0.01],
    }
    scenes = [{"name": "new", "file": "cornell_box.xml"}, *TABLES["scenes"]]
    after = names(grid=axes, scenes=scenes)
    assert before.items() <= after.items() and len(after) == 2 * 72
    assert len({*after.values()}) == len(after)


def test_names_are_unique_and_safe_on_file_systems() -> None:
    tables = {
        "grid": {
            "exposure_s": ["auto", 1e-05, 0.5, 2],
            "lights.lamp": [0.2, "2 pwm(100, 0.5)", "2 pwm(100; 0.5)", "2/pwm"],
            "traverse.a b": [[0.5, 1.0, 2.0], [0.5, 1.0]],
        },
        "list": [{"gain": 1}, {"gain": 1.5, "parameters.name": "../../x\u2028é"}],
    }
    rng, found, count = random.Random(1), set[str](), 0
    for cell in product(*tables["grid"].values()):
        for row in tables["list"]:
            values = {"scene": "a", **dict(zip(tables["grid"], cell, strict=True)), **row}
            key = f"{rng.getrandbits(96):024x}"
            name = name_of_sample(values, "dir/camera.toml", -1, key)
            assert is_name_of_entry(name) and name.isascii() and len(name) < 200
            assert key[:12] in name, "what was replaced could be the same"
            found.add(name.casefold())
            count += 1
    assert len(found) == count == 64


def test_a_long_name_ends_with_a_piece_of_the_key() -> None:
    values = {"scene": "a", **{f"camera.very.long.name.of.field.{k}": k for k in range(20)}}
    name = name_of_sample(values, "c", -1, KEY)
    assert name.endswith(f",{KEY[:12]}") and len(name) < LONGEST + 40


@pytest.mark.parametrize(
    "name", ["a/b", "a/b/c/d", "/a/b/c", "a/b/.c", "a/b/c d", "a/b/" + "c" * 300]
)
def test_other_texts_are_no_names(name: str) -> None:
    assert not is_name_of_entry(name)


def test_samples_of_an_edited_file_stand_beside_those_of_the_same_settings(
    tmp_path: Path,
) -> None:
    """Both are found, whichever was first, and nothing is lost."""
    store, name = Store(tmp_path), "a/view_0000/c,serial=1"
    entries = [Entry("samples", name, key) for key in (KEY, OTHER)]
    for entry in (*entries, *entries):
        store.commit(entry, lambda folder, key=entry.key: (folder / "a").write_text(key))
    assert [*store.names("samples")] == [name, with_piece(name, OTHER)]
    for entry in entries:
        record = store.find(entry)
        assert (
            record and (store.folder_of("samples", record.name) / "a").read_text() == entry.key
        )
    assert not [*store.verify_all()]
    store.discard("samples", name)
    assert store.exists(entries[1]) and not store.exists(entries[0])


def test_of_two_writers_of_one_name_at_once_the_second_one_is_told(tmp_path: Path) -> None:
    """They have other dataset files: nothing is written over, and another run finds the name taken."""
    store, name = Store(tmp_path), "a/view_0000/c,serial=1"

    def slow(folder: Path) -> None:
        (folder / "a").write_text("slow")
        store.commit(Entry("samples", name, KEY), lambda folder: (folder / "a").write_text("x"))

    with pytest.raises(InputError, match="something else is put there again"):
        store.commit(Entry("samples", name, OTHER), slow)
    assert [*store.names("samples")] == [name] and not [*store.verify_all()]
