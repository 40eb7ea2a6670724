"""Samples of a dataset are what the public functions make of the configuration that stands in sample.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.datasets import SCENES, TABLES

import mitsuba_sensor as ms
from mitsuba_sensor.camera.camera_file import camera_from
from mitsuba_sensor.dataset.plan.file import OUTPUTS, read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.files.raw_files import read_raw

EVERYTHING = [name for name in OUTPUTS if name not in ("readouts", "companded")]
"""That a camera of one read-out has, linear."""
CORNELL = {"name": "cornell", "file": "cornell_box.xml"}


def made(folder: Path, **changes: Any) -> ms.Dataset:
    tables = {**TABLES, "scenes": [CORNELL], "cameras": [{"camera": "bayer_2mp"}], **changes}
    plan = DatasetPlan(read_dataset(tables), [SCENES], text=as_toml(tables))
    assert not run(plan, folder, workers=0).failed
    return ms.Dataset(folder)


def as_toml(tables: dict[str, Any]) -> str:
    return "".join(
        f"{name} = {json.dumps(value)}\n"
        for name, value in tables.items()
        if isinstance(value, str)
    )


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> ms.Dataset:
    grid = {"exposure_s": ["auto"], "exposure_ev": [0, -3], "serial": [4, 5]}
    random = {"draws": 1, "values": {"temperature_k": {"uniform": [280, 300]}}}
    where = tmp_path_factory.mktemp("everything") / "out"
    return made(
        where, outputs=EVERYTHING, grid=grid, random=random, render={"spp": 16, "width": 40}
    )


def test_a_sample_is_made_again_from_its_own_facts(everything: ms.Dataset) -> None:
    """From the light in irradiance.exr and sample.json, by ms.expose: every pixel."""
    assert len(everything) == 4
    for sample in everything:
        facts, light = sample.facts, ms.read_irradiance(sample.view_folder / "irradiance.exr")
        camera = camera_from(facts["config"]["camera"], "of the sample")
        exposure = ms.Exposure(facts["image"]["exposure_s"], facts["image"]["temperature_k"])
        frames = ms.expose(
            light, camera, exposure, **facts["seeds"], frames=facts["config"]["frames"]
        )
        np.testing.assert_array_equal(sample.read("raw"), frames.digital)
        np.testing.assert_array_equal(sample.read("clean"), frames.clean)
        np.testing.assert_array_equal(sample.read("variance"), frames.temporal_variance)


def test_stops_multiply_the_metered_time(everything: ms.Dataset) -> None:
    times = {one.values["exposure_ev"]: one.facts["image"]["exposure_s"] for one in everything}
    assert times[-3] == times[0] / 8
    bright, dark = (
        next(s for s in everything if s.values["exposure_ev"] == ev) for ev in (0, -3)
    )
    np.testing.assert_allclose(bright.read("electrons"), 8 * dark.read("electrons"), rtol=1e-6)
    relative = ms.read_irradiance(bright.view_folder / "irradiance.exr").relative_error
    electrons, error = bright.read("electrons"), bright.read("electrons_error")
    np.testing.assert_allclose(
        error[electrons > 0], (relative * electrons)[electrons > 0], rtol=1e-5
    )


def test_chips_share_the_light_and_not_the_fixed_pattern(everything: ms.Dataset) -> None:
    four, five = (next(s for s in everything if s.values["serial"] == n) for n in (4, 5))
    np.testing.assert_array_equal(four.read("electrons"), five.read("electrons"))
    assert (four.read("clean") != five.read("clean")).mean() > 0.5
    assert len({one.facts["seeds"]["seed"] for one in everything}) == 4


def test_all_that_is_asked_for_is_there_and_opens(everything: ms.Dataset) -> None:
    names = {
        "frame.tiff",
        "frame.dng",
        "clean.tiff",
        "electrons.tiff",
        "electrons_error.tiff",
        "frame.png",
    }
    names |= {"temporal_variance.tiff", "noise_budget.json", "sample.json", "record.json"}
    sample = everything[0]
    assert {path.name for path in sample.folder.iterdir()} == names
    assert {path.name for path in sample.view_folder.iterdir()} >= {
        "aovs.exr",
        "irradiance.exr",
        "view.json",
    }
    np.testing.assert_array_equal(
        read_raw(sample.folder / "frame.dng").frames[0], sample.read("raw")[0]
    )
    assert sample.read("depth_m").shape == sample.read("raw").shape[1:]
    budget = json.loads((sample.folder / "noise_budget.json").read_text())["sources"]
    total = sum(one["temporal_dn2"] for one in budget)
    assert total == pytest.approx(float(sample.read("variance").mean()), rel=0.02)


def test_more_outputs_change_no_pixel(everything: ms.Dataset, tmp_path: Path) -> None:
    grid = {"exposure_s": ["auto"], "exposure_ev": [0, -3], "serial": [4, 5]}
    random = {"draws": 1, "values": {"temperature_k": {"uniform": [280, 300]}}}
    fewer = made(
        tmp_path / "out",
        outputs=["raw"],
        grid=grid,
        random=random,
        render={"spp": 16, "width": 40},
    )
    for one, other in zip(everything, fewer, strict=True):
        assert one.key != other.key
        np.testing.assert_array_equal(one.read("raw"), other.read("raw"))


@pytest.mark.parametrize(
    "goal", [{"noise_ratio": 1.0, "max_spp": 64}, {"max_spp": 32}], ids=["ratio", "most"]
)
def test_a_metered_render_towards_a_goal_takes_no_samples_that_nobody_gave(
    goal: dict[str, float], tmp_path: Path
) -> None:
    """Neither the samples of the metering render nor the default of datasets stand beside ``max_spp``."""
    flat = {"name": "flat", "file": "flat_field.xml"}
    render, grid = {"width": 8, **goal}, {"exposure_s": ["auto"]}
    dataset = made(tmp_path / "out", scenes=[flat], render=render, grid=grid)
    facts = dataset[0].facts
    assert facts["view"]["config"]["render"]["spp"] is None
    assert facts["light"]["samples_per_pixel"] <= goal["max_spp"]
    assert facts["light"]["noise_ratio_asked"] == goal.get("noise_ratio")


def test_poses_parameters_and_traverse_change_the_light(tmp_path: Path) -> None:
    """Twice the radiance is twice the electrons, by either name; a pose that looks away sees something else."""
    flat = {"name": "flat", "file": "flat_field.xml", "parameters": {"radiance": 2e-4}}
    common: dict[str, Any] = {
        "cameras": [{"camera": "konnik_table1"}],
        "outputs": ["electrons"],
    }
    grid = {"exposure_s": [0.1], "parameters.radiance": [1e-4, 2e-4]}
    dim, bright = (
        one.read("electrons")
        for one in made(tmp_path / "a", scenes=[flat], **common, grid=grid)
    )
    assert bright.mean() == pytest.approx(2 * dim.mean(), rel=0.01)
    poses = [{"origin_m": [0, 1, 3.9], "target_m": [x, 1, 0]} for x in (0, 0.5)]
    scenes, grid = [{**CORNELL, "views": poses}], {"exposure_s": [0.1]}
    one, other = (
        sample.read("electrons")
        for sample in made(tmp_path / "b", scenes=scenes, **common, grid=grid)
    )
    assert np.abs(one - other).mean() > 0.05 * one.mean()


@pytest.mark.exhaustive
def test_a_moving_scene_is_exposed_for_the_time_that_it_was_rendered_for(
    tmp_path: Path,
) -> None:
    """Two stops are four times the metered time and light, and another render; two gains are metered for themselves."""
    motion = {"camera": {"rotate_deg_per_s": 5, "axis": [0, 1, 0]}}
    scenes, grid = (
        [{**CORNELL, "motion": motion}],
        {"exposure_s": ["auto"], "exposure_ev": [-2, 0]},
    )
    short, usual = made(tmp_path / "out", scenes=scenes, grid=grid, outputs=["electrons"])
    assert short.facts["view"]["key"] != usual.facts["view"]["key"]
    assert short.facts["image"]["exposure_s"] == usual.facts["image"]["exposure_s"] / 4
    assert short.read("electrons").mean() == pytest.approx(
        usual.read("electrons").mean() / 4, rel=0.2
    )  # it pans
    tables = {
        **TABLES,
        "scenes": scenes,
        "cameras": [{"camera": "sony_a7s2"}],
        "grid": {"gain": [100, 1600]},
    }
    assert len(list(DatasetPlan(read_dataset(tables), [SCENES]).views())) == 2
    tables["grid"]["exposure_s"] = [0.01]
    assert len(list(DatasetPlan(read_dataset(tables), [SCENES]).views())) == 1


def test_a_cube_is_light_for_cameras_of_other_quantum_efficiencies(tmp_path: Path) -> None:
    """Half the QE is half the electrons of the very same light."""
    half = ms.load_camera("konnik_table1").quantum_efficiency.curves["mono"][0] / 2
    cameras = [
        {"camera": "konnik_table1", "name": name, "set": x}
        for name, x in (("a", {}), ("b", {"quantum_efficiency.value": half}))
    ]
    render, grid = {"spp": 16, "width": 16, "spectral": "cube"}, {"exposure_s": [0.1]}
    one, other = made(
        tmp_path / "out", render=render, cameras=cameras, grid=grid, outputs=["electrons"]
    )
    assert one.facts["view"]["key"] == other.facts["view"]["key"]
    np.testing.assert_allclose(one.read("electrons"), 2 * other.read("electrons"), rtol=1e-5)
    assert one.facts["electrons_error_of"] == "a detector that is flat over the band"


def test_levels_and_waveforms_of_light_groups_vary_without_another_render(
    tmp_path: Path,
) -> None:
    """The frames are those of the same light, relit: whole periods of a pulse are the mean."""
    grid = {"exposure_s": [0.01], "lights.other": [0, 1, 2, "2 pwm(100, 0.5)"]}
    render = {"spp": 16, "width": 16, "light_groups": "auto"}
    outputs = ["raw", "electrons"]
    dataset = made(tmp_path / "out", outputs=outputs, render=render, grid=grid)
    assert len({sample.facts["view"]["key"] for sample in dataset}) == 1  # render
    off, on, twice, flickering = (sample.read("electrons") for sample in dataset)
    assert not off.any() and on.any()
    np.testing.assert_allclose(twice, 2 * on, rtol=1e-5)
    np.testing.assert_allclose(flickering, twice, rtol=1e-5)


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        (-1, "the level of lamp is -1"),
        ("pwm(0, 1)", "frequency_hz"),
        ("table(a.csv)", "from a file"),
    ],
)
def test_a_light_that_cannot_be_is_refused_before_anything_is_rendered(
    value: object, sentence: str
) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        read_dataset({**TABLES, "grid": {"lights.lamp": [value]}})
