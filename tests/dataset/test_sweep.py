"""What varies in a dataset: every combination once, random numbers of the asked law, poses on a path, shared light."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import scipy.stats
from helpers.datasets import SCENES, TABLES

from mitsuba_sensor.dataset.plan.configured import PlannedSample
from mitsuba_sensor.dataset.plan.file import Distribution, read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, PlannedView
from mitsuba_sensor.dataset.plan.sweep import Poses, drawn, share_of
from mitsuba_sensor.dataset.run.run import numbers_of_shard

POSE = {"origin_m": [0, 0, 1], "target_m": [0, 0, 0]}


def planned(**changes: Any) -> list[PlannedView]:
    return list(DatasetPlan(read_dataset({**TABLES, **changes}), [SCENES]).views())


def samples(views: list[PlannedView]) -> list[PlannedSample]:
    return [sample for view in views for sample in view.samples]


def test_a_hundred_exposures_of_five_chips_are_one_render() -> None:
    grid = {"exposure_s": [0.001 * k for k in range(1, 101)], "serial": [1, 2, 3, 4, 5]}
    views = planned(grid=grid)
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
    views = planned(grid={name: values})
    assert (len(views), len(samples(views))) == (renders, 2)


def test_a_cube_is_shared_by_cameras_of_one_band_and_lens() -> None:
    cameras = [
        {"camera": "konnik_table1", "name": "a", "set": {"quantum_efficiency.value": 0.6}},
        {"camera": "konnik_table1", "name": "b", "set": {"quantum_efficiency.value": 0.3}},
    ]
    assert len(planned(cameras=cameras)) == 2
    assert len(planned(cameras=cameras, render={"spectral": "cube", "spp": 16})) == 1


def test_every_combination_is_made_once() -> None:
    file = read_dataset(
        {
            **TABLES,
            "grid": {"exposure_s": [0.1, 0.2], "parameters.radiance": [1e-4, 2e-4, 3e-4]},
            "list": [{"serial": 1, "temperature_k": 280}, {"serial": 2, "temperature_k": 300}],
            "random": {"draws": 4, "values": {"exposure_ev": {"uniform": [-1, 1]}}},
        }
    )
    plan = DatasetPlan(file, [SCENES])
    views = list(plan.views())
    found = samples(views)
    assert len(found) == plan.numbers == 2 * 3 * 2 * 4
    assert len({tuple(sorted(one.values.items())) for one in found}) == len(found)
    assert len(views) == 3 and len({one.key for one in samples(views)}) == plan.samples == 48


def test_a_sample_does_not_depend_on_what_else_is_in_the_dataset() -> None:
    values = {"temperature_k": {"uniform": [270, 300]}}
    alone = planned(grid={"exposure_s": [0.1]}, random={"draws": 1, "values": values})
    among = planned(
        description="another text",
        licence="CC0-1.0",
        scenes=[{"name": "wedge", "file": "step_wedge.xml"}, *TABLES["scenes"]],
        grid={"exposure_s": [0.2, 0.1]},
        random={"draws": 7, "values": values},
    )
    assert samples(alone)[0].key in {one.key for one in samples(among)}


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
    assert samples(planned(**usual))[0].key != samples(planned(**{**usual, **change}))[0].key


def test_names_and_texts_for_people_are_not_in_the_key() -> None:
    usual = samples(planned(grid={"exposure_s": [0.1]}))[0].key
    named = [{"camera": "konnik_table1", "name": "mine", "set": {}}]
    other = planned(
        grid={"exposure_s": [0.1]},
        cameras=named,
        scenes=[{"name": "other", "file": "flat_field.xml"}],
        name="b",
    )
    assert samples(other)[0].key == usual


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
    file = read_dataset(
        {
            **TABLES,
            "scenes": [{"name": name, "file": "flat_field.xml"} for name in ("a", "b")],
            "cameras": [{"camera": "konnik_table1"}, {"camera": "bayer_2mp"}],
            "random": {"draws": 5, "values": {"exposure_s": {"log_uniform": [0.01, 1]}}},
        }
    )
    found: dict[tuple[str, int], set[float]] = {}
    for one in samples(list(DatasetPlan(file, [SCENES]).views())):
        scene_and_draw = one.values["scene"], one.config["draw"]
        found.setdefault(scene_and_draw, set()).add(one.values["exposure_s"])
    assert all(len(values) == 1 for values in found.values())
    assert len(set.union(*found.values())) == 10


def test_a_path_goes_through_its_keys_in_even_steps() -> None:
    keys = [
        {"time_s": 0, "origin_m": [0, 0, 4], "target_m": [0, 0, 0]},
        {"time_s": 1, "origin_m": [2, 0, 4], "target_m": [0, 1, 0]},
        {"time_s": 3, "origin_m": [2, 4, 4], "target_m": [0, 1, 0]},
    ]
    file = read_dataset(
        {**TABLES, "scenes": [{**TABLES["scenes"][0], "path": {"views": 7, "keys": keys}}]}
    )
    found = [view for view in Poses(file.scenes[0]) if view is not None]
    origins = np.array([view.origin_m for view in found])
    expected = [[0, 0, 4], [1, 0, 4], [2, 0, 4], [2, 1, 4], [2, 2, 4], [2, 3, 4], [2, 4, 4]]
    np.testing.assert_allclose(origins, expected, atol=1e-6)
    np.testing.assert_allclose(
        [view.target_m[1] for view in found], [0, 0.5, 1, 1, 1, 1, 1], atol=1e-6
    )


def test_a_loop_has_each_pose_once() -> None:
    corners = [[1, 0, 1], [1, 0, -1], [-1, 0, -1], [-1, 0, 1], [1, 0, 1]]
    keys = [
        {"time_s": n, "origin_m": corner, "target_m": [0, 0, 0]}
        for n, corner in enumerate(corners)
    ]
    scene = TABLES["scenes"][0]
    loop = read_dataset({**TABLES, "scenes": [{**scene, "path": {"views": 8, "keys": keys}}]})
    found = [view.origin_m for view in Poses(loop.scenes[0]) if view is not None]
    middles = [[1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1]]
    expected = [place for pair in zip(corners, middles, strict=False) for place in pair]
    np.testing.assert_allclose(found, expected, atol=1e-6)
    turned = [*keys[:-1], {**keys[-1], "up": [0, 1, 1]}]
    no_loop = read_dataset(
        {**TABLES, "scenes": [{**scene, "path": {"views": 9, "keys": turned}}]}
    )
    np.testing.assert_allclose(
        [view.origin_m for view in Poses(no_loop.scenes[0]) if view], [*expected, corners[0]]
    )


LARGE: dict[str, dict[str, Any]] = {
    "one view": {
        "grid": {
            "repetition": [*range(10_000)],
            "exposure_s": [0.001 * k for k in range(1, 1001)],
        }
    },
    "draws of other light": {
        "random": {
            "draws": 10**7,
            "values": {"parameters.radiance": {"log_uniform": [1e-5, 1e-3]}},
        }
    },
}


@pytest.mark.parametrize("name", LARGE)
def test_a_sample_of_ten_million_is_found_by_its_number(name: str) -> None:
    """And is the same, whatever part of the dataset is asked for."""
    plan = DatasetPlan(read_dataset({**TABLES, **LARGE[name]}), [SCENES])
    assert plan.samples == plan.numbers == 10**7
    some = samples(list(plan.views(7_654_990, 7_655_010)))
    alone = [samples(list(plan.views(n, n + 1))) for n in range(7_654_990, 7_655_010)]
    assert len(some) == 20 and [[one] for one in some] == alone
    assert len({one.key for one in some}) == 20


def test_samples_of_a_view_with_many_are_several_tasks_of_one_light() -> None:
    views = planned(grid={"repetition": [*range(2500)]})
    assert [len(view.samples) for view in views] == [1000, 1000, 500]
    assert len({view.key for view in views}) == 1 and not any(view.is_whole for view in views)
    assert all(view.lead == views[0].samples[0].config for view in views)


def test_draws_with_the_same_choice_of_light_share_it() -> None:
    laws = {"f_number": {"choice": [2.0, 4.0]}, "exposure_s": {"uniform": [0.1, 0.2]}}
    views = planned(random={"draws": 40, "values": laws})
    assert len(views) == 2 and len({one.key for one in samples(views)}) == 40
    assert sorted(one.config["draw"] for one in samples(views)) == [*range(40)]


@pytest.mark.parametrize("shards", [1, 4, 5, 12, 13])
def test_shards_split_a_view_into_parts_of_equal_size(shards: int) -> None:
    """They are disjoint and together all; a dataset of one view, too."""
    grid = {"exposure_s": [0.1, 0.2, 0.3, 0.4], "serial": [1, 2, 3]}
    plan = DatasetPlan(read_dataset({**TABLES, "grid": grid}), [SCENES])
    numbers = [numbers_of_shard(plan, (k, shards)) for k in range(1, shards + 1)]
    parts = [samples(list(plan.views(part.start, part.stop))) for part in numbers]
    assert {len(part) for part in parts} <= {12 // shards, -(-12 // shards)}
    assert [one for part in parts for one in part] == samples(list(plan.views()))


@pytest.mark.parametrize("rows", [[{"exposure_s": 0.1}, {}], [{"exposure_s": "auto"}], [{}]])
def test_samples_of_what_moves_share_no_light_that_was_metered_for_another_gain(
    rows: list[dict[str, Any]],
) -> None:
    """Each sample names the light that its own configuration asks for."""
    scene = {**TABLES["scenes"][0], "motion": {"camera": {"velocity_m_per_s": [0.01, 0, 0]}}}
    tables = {
        **TABLES,
        "scenes": [scene],
        "list": rows,
        "grid": {"camera.adc.black_level_dn": [10, 20]},
    }
    plan = DatasetPlan(read_dataset(tables), [SCENES])
    views = list(plan.views())
    for scene_of in plan.scenes:
        sweep = scene_of.sweep
        for number in range(sweep.lights):
            light = sweep.light(number)
            for row in range(len(rows)):
                keys = set()
                for exposure in range(sweep.exposures(light)):
                    one = sweep.combination(light, row, 0, exposure)
                    keys.add(plan.light_key(one, plan.cameras.of(one))[1])
                assert len(keys) == 1
    assert len(samples(views)) == 2 * len(rows)
