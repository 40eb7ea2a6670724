"""Variation in a dataset: every combination once, distributions of random values, poses on a path, shared light."""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import scipy.stats
from helpers.datasets import TABLES, plan_of, samples_of, tasks_of

from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.checks import checked_counts
from mitsuba_sensor.dataset.file import Distribution
from mitsuba_sensor.dataset.sweep import Poses, drawn, share_of

POSE = {"origin_m": [0, 0, 1], "target_m": [0, 0, 0]}


def test_a_hundred_exposures_of_five_chips_are_one_render() -> None:
    grid = {"exposure_s": [0.001 * k for k in range(1, 101)], "serial": [1, 2, 3, 4, 5]}
    views = tasks_of(grid=grid)
    assert len(views) == 1 and len({one.key for one in views[0].samples}) == 500


@pytest.mark.parametrize(
    ("name", "values", "renders"),
    [
        ("temperature_k", [250, 300], 1),
        ("frames", [1, 2], 1),
        ("repetition", [0, 1], 1),
        ("camera.adc.bits", [10, 12], 1),
        ("camera.pixel.full_well_e", [10_000, 20_000], 1),
        ("exposure_ev", [0, 1], 1),
        ("f_number", [2.0, 4.0], 2),
        ("parameters.radiance", [1e-4, 2e-4], 2),
        ("camera.quantum_efficiency.value", [0.5, 0.6], 2),
        ("camera.pixel.pitch_x_um", [5.0, 6.0], 2),
    ],
)
def test_only_what_changes_the_light_is_rendered_anew(
    name: str, values: list[Any], renders: int
) -> None:
    views = tasks_of(grid={name: values})
    assert (len(views), len(samples_of(views))) == (renders, 2)


def test_a_cube_is_shared_by_cameras_of_one_band_and_lens() -> None:
    cameras = [
        {"camera": "konnik_table1", "name": "a", "set": {"quantum_efficiency.value": 0.6}},
        {"camera": "konnik_table1", "name": "b", "set": {"quantum_efficiency.value": 0.3}},
    ]
    assert len(tasks_of(cameras=cameras)) == 2
    assert len(tasks_of(cameras=cameras, render={"spectral": "cube", "spp": 16})) == 1


def test_every_combination_is_made_once() -> None:
    file_tables: dict[str, Any] = {
        "grid": {"exposure_s": [0.1, 0.2], "parameters.radiance": [1e-4, 2e-4, 3e-4]},
        "list": [{"serial": 1, "temperature_k": 280}, {"serial": 2, "temperature_k": 300}],
        "random": {"draws": 4, "values": {"exposure_ev": {"uniform": [-1, 1]}}},
    }
    views = tasks_of(**file_tables)
    found = samples_of(views)
    assert len(found) == 2 * 3 * 2 * 4
    assert len({tuple(sorted(one.values.items())) for one in found}) == len(found)
    assert len(views) == 3 and len({one.key for one in found}) == 48


def test_a_sample_does_not_depend_on_what_else_is_in_the_dataset() -> None:
    values = {"temperature_k": {"uniform": [270, 300]}}
    alone = tasks_of(grid={"exposure_s": [0.1]}, random={"draws": 1, "values": values})
    among = tasks_of(
        description="another text",
        licence="CC0-1.0",
        scenes=[{"name": "wedge", "file": "step_wedge.xml"}, *TABLES["scenes"]],
        grid={"exposure_s": [0.2, 0.1]},
        random={"draws": 7, "values": values},
    )
    assert samples_of(alone)[0].key in {one.key for one in samples_of(among)}


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2},
        {"outputs": ["raw"]},
        {"render": {"spp": 32, "width": 16}},
        {"render": {"spp": 16, "width": 17}},
        {"grid": {"exposure_s": [0.2]}},
        {"grid": {"exposure_s": [0.1], "serial": [2]}},
        {"grid": {"exposure_s": [0.1], "frames": [2]}},
        {"grid": {"exposure_s": [0.1], "repetition": [1]}},
        {"grid": {"exposure_s": [0.1], "temperature_k": [299]}},
        {"cameras": [{"camera": "konnik_table1", "set": {"adc.bits": 11}}]},
        {"cameras": [{"camera": "konnik_table1", "without": ["prnu"]}]},
        {
            "scenes": [
                {"name": "flat", "file": "flat_field.xml", "parameters": {"radiance": 3e-4}}
            ]
        },
        {"scenes": [{"name": "flat", "file": "flat_field.xml", "integrator": "direct"}]},
        {"scenes": [{"name": "flat", "file": "step_wedge.xml"}]},
        {
            "scenes": [
                {
                    "name": "flat",
                    "file": "flat_field.xml",
                    "views": [{"origin_m": [0, 0, 1], "target_m": [0, 0, 0]}],
                }
            ]
        },
    ],
)
def test_everything_that_decides_a_sample_is_in_its_key(change: Mapping[str, Any]) -> None:
    usual = {"grid": {"exposure_s": [0.1]}}
    assert (
        samples_of(tasks_of(**usual))[0].key
        != samples_of(tasks_of(**{**usual, **change}))[0].key
    )


def test_names_and_texts_for_people_are_not_in_the_key() -> None:
    usual = samples_of(tasks_of(grid={"exposure_s": [0.1]}))[0].key
    named = [{"camera": "konnik_table1", "name": "mine", "set": {}}]
    other = tasks_of(
        grid={"exposure_s": [0.1]},
        cameras=named,
        scenes=[{"name": "other", "file": "flat_field.xml"}],
        name="b",
    )
    assert samples_of(other)[0].key == usual


LAWS: list[tuple[dict[str, Any], Any]] = [
    ({"uniform": [2.0, 5.0]}, scipy.stats.uniform(2, 3)),
    ({"log_uniform": [1e-3, 10.0]}, scipy.stats.loguniform(1e-3, 10)),
    ({"normal": [298.0, 3.0]}, scipy.stats.norm(298, 3)),
]


@pytest.mark.parametrize(("law", "expected"), LAWS)
def test_random_numbers_follow_their_law(law: dict[str, Any], expected: Any) -> None:
    """Kolmogorov-Smirnov at 1e-4, fixed names."""
    values = [drawn(Distribution(**law), share_of(7, "scene", "x", k)) for k in range(20_000)]
    assert scipy.stats.kstest(values, expected.cdf).pvalue > 1e-4


@pytest.mark.parametrize("law", [{"integer": [3, 8]}, {"choice": [3, 4, 5, 6, 7, 8]}])
def test_whole_numbers_and_choices_are_equally_likely(law: dict[str, Any]) -> None:
    """χ² at 1e-4."""
    values = [drawn(Distribution(**law), share_of(3, "scene", "x", k)) for k in range(12_000)]
    assert scipy.stats.chisquare([values.count(k) for k in range(3, 9)]).pvalue > 1e-4


def test_a_draw_is_the_same_for_every_camera_and_row_and_other_for_every_scene() -> None:
    file_tables: dict[str, Any] = {
        "scenes": [{"name": name, "file": "flat_field.xml"} for name in ("a", "b")],
        "cameras": [{"camera": "konnik_table1"}, {"camera": "bayer_2mp"}],
        "random": {"draws": 5, "values": {"exposure_s": {"log_uniform": [0.01, 1]}}},
    }
    found: dict[tuple[str, int], set[float]] = {}
    for one in samples_of(tasks_of(**file_tables)):
        scene_and_draw = one.values["scene"], one.config["draw"]
        found.setdefault(scene_and_draw, set()).add(one.values["exposure_s"])
    assert all(len(values) == 1 for values in found.values())
    assert len(set.union(*found.values())) == 10


CORNERS = [[1, 0, 1], [1, 0, -1], [-1, 0, -1], [-1, 0, 1], [1, 0, 1]]
ROUND = [
    [1, 0, 1],
    [1, 0, 0],
    [1, 0, -1],
    [0, 0, -1],
    [-1, 0, -1],
    [-1, 0, 0],
    [-1, 0, 1],
    [0, 0, 1],
]


@pytest.mark.parametrize(
    ("times_s", "origins", "last_up", "expected"),
    [
        ([0, 1, 3], [[0, 0, 4], [2, 0, 4], [2, 4, 4]], [0, 1, 0],
         [[0, 0, 4], [1, 0, 4], [2, 0, 4], [2, 1, 4], [2, 2, 4], [2, 3, 4], [2, 4, 4]]),
        (range(5), CORNERS, [0, 1, 0], ROUND),  # a loop has each pose once
        (range(5), CORNERS, [0, 1, 1], [*ROUND, CORNERS[0]]),
    ],
)  # fmt: skip
def test_a_path_goes_through_its_keys_in_even_steps(
    times_s: Any, origins: list[list[float]], last_up: list[float], expected: Any
) -> None:
    keys = [
        {"time_s": time_s, "origin_m": origin, "target_m": [0.5, 0, 0]}
        for time_s, origin in zip(times_s, origins, strict=True)
    ]
    keys[-1]["up"] = last_up
    scene = {**TABLES["scenes"][0], "path": {"views": len(expected), "keys": keys}}
    found = [view for view in Poses(plan_of(scenes=[scene]).file.scenes[0]) if view is not None]
    np.testing.assert_allclose([view.origin_m for view in found], expected, atol=1e-6)
    assert {view.target_m for view in found} == {(0.5, 0.0, 0.0)}


def test_samples_stream_without_a_list_of_them() -> None:
    """A plan keeps eight bytes of each sample, to find equal samples."""
    draws = {"parameters.radiance": {"log_uniform": [1e-5, 1e-3]}}
    plan = plan_of(random={"draws": 500, "values": draws}, grid={"repetition": [0, 1]})
    next(plan.tasks())
    tracemalloc.start()
    counts = checked_counts(plan)
    assert (counts.samples, counts.tasks) == (1000, 500)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_samples_of_a_light_with_many_are_several_tasks_of_one_light() -> None:
    tasks = tasks_of(grid={"repetition": [*range(2500)]})
    assert [len(task.samples) for task in tasks] == [1000, 1000, 500]
    assert (
        len({task.light_key for task in tasks}) == len({str(task.lead) for task in tasks}) == 1
    )
    large = tasks_of(
        grid={"repetition": [*range(200)]}, cameras=[{"camera": "sony_a7s2"}], render={"spp": 4}
    )
    assert 1 < len(large) <= 200 // 16 + 1, "samples of 12 million pixels"


@pytest.mark.parametrize(
    ("tables", "places"),
    [
        ({"grid": {"exposure_s": [1, 0.1, 1.0]}}, "grid.exposure_s.0 and grid.exposure_s.2"),
        ({"list": [{"exposure_s": 0.1}, {"exposure_s": 0.1}]}, "list.0 and list.1"),
        (
            {"scenes": [{"name": name, "file": "flat_field.xml"} for name in ("a", "b")]},
            "scenes.0 and scenes.1",
        ),
        (
            {"cameras": [{"camera": "konnik_table1", "name": name} for name in ("a", "b")]},
            "cameras.0 and cameras.1",
        ),
        (
            {"scenes": [{**TABLES["scenes"][0], "views": [POSE, POSE]}]},
            "scenes.0.views.0 and scenes.0.views.1",
        ),
        ({"grid": {"f_number": [4, 4.0]}}, "grid.f_number.0 and grid.f_number.1"),
        (
            {"grid": {"exposure_s": [1, 2], "parameters.radiance": [1, "1"]}},
            "grid.parameters.radiance.0 and grid.parameters.radiance.1",
        ),
        ({"list": [{"serial": 1}, {}]}, "list.0 and list.1"),
        ({"grid": {"serial": [5, 6, 5]}}, "grid.serial.0 and grid.serial.2"),
    ],
)
def test_two_equal_samples_are_refused_with_both_places_in_the_file(
    tables: dict[str, Any], places: str
) -> None:
    with pytest.raises(InputError, match=rf"two samples are the same: {places}; "):
        checked_counts(plan_of(**tables))


def test_draws_with_the_same_choice_of_light_share_it() -> None:
    laws = {"f_number": {"choice": [2.0, 4.0]}, "exposure_s": {"uniform": [0.1, 0.2]}}
    views = tasks_of(random={"draws": 40, "values": laws})
    assert len(views) == 2 and len({one.key for one in samples_of(views)}) == 40
    assert sorted(one.config["draw"] for one in samples_of(views)) == [*range(40)]


@pytest.mark.parametrize("rows", [[{"exposure_s": 0.1}, {}], [{"exposure_s": "auto"}], [{}]])
def test_samples_of_what_moves_share_no_light_that_was_metered_for_another_gain(
    rows: list[dict[str, Any]],
) -> None:
    scene = {**TABLES["scenes"][0], "motion": {"camera": {"velocity_m_per_s": [0.01, 0, 0]}}}
    tables: dict[str, Any] = {
        "scenes": [scene],
        "list": rows,
        "grid": {"camera.adc.black_level_dn": [10, 20]},
    }
    plan = plan_of(**tables)
    samples = samples_of([*plan.tasks()])
    metered = [one for one in samples if one.values.get("exposure_s", "auto") == "auto"]
    assert len({one.config["view"] for one in metered}) == len(metered)
    assert len(samples) == 2 * len(rows)
