"""Rigs and times of datasets: each sensor of a scene sees each pose, at its own time.

Oracles: poses by their definition, a ball that moves evenly, a lamp that flickers. test_exports.py exports rigs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.datasets import toml_text
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.plan import DatasetPlan, load_plan

BASELINE_M = 0.2
SENSOR = """<sensor type="perspective" id="{name}"><float name="fov" value="{fov}"/>
<film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film>
<transform name="to_world"><lookat origin="{x}, 0, 3" target="{x}, 0, 0" up="0, 1, 0"/></transform></sensor>"""
SCENE = f"""<scene version="3.0.0"><default name="baseline" value="{BASELINE_M}"/><integrator type="direct"/>
{SENSOR.format(name="left", fov=50, x=0)}
{SENSOR.format(name="right", fov=45, x="$baseline")}
<shape type="sphere" id="ball"><point name="center" x="0" y="0.3" z="0.5"/><float name="radius" value="0.3"/></shape>
<shape type="rectangle" id="wall"><transform name="to_world"><scale value="9"/><rotate y="1" angle="20"/>
<translate z="-1"/></transform></shape>
<emitter type="constant" id="sky"/></scene>"""
BALL_M, RADIUS_M, VELOCITY_M_PER_S = np.array([0, 0.3, 0.5]), 0.3, np.array([0.5, 0, 0])
MOVES = {"objects": {"ball": {"velocity_m_per_s": VELOCITY_M_PER_S.tolist()}}}
THERE, BACK = ([0, 0, 3], [0, 0, 0]), ([0.4, 0.2, 3], [0.1, 0, 0])
KEYS = [
    {"time_s": time_s, "origin_m": origin, "target_m": target}
    for time_s, (origin, target) in zip((1.0, 1.5, 2.0, 2.5), (THERE, BACK) * 2, strict=True)
]
PATH = {"views": 4, "keys": KEYS}
TABLES: dict[str, Any] = {
    "name": "rig",
    "outputs": ["raw", "aovs"],
    "render": {"spp": 2, "denoise": False},
    "cameras": [{"camera": "konnik_table1"}],
    "grid": {"exposure_s": [1e-4]},
}


def written(folder: Path, tables: dict[str, Any] | None = None, **scene: Any) -> Path:
    """Write the file of a dataset with one scene and two sensors."""
    (folder / "pair.xml").write_text(SCENE, "utf-8")
    entry = {"name": "pair", "file": "pair.xml", **scene}
    (folder / "rig.toml").write_text(
        toml_text({**TABLES, **(tables or {}), "scenes": [entry]}), "utf-8"
    )
    return folder / "rig.toml"


def plan_of(folder: Path, tables: dict[str, Any] | None = None, **scene: Any) -> DatasetPlan:
    return load_plan(written(folder, tables, **scene), [folder])


def made(folder: Path, tables: dict[str, Any] | None = None, **scene: Any) -> list[ms.Sample]:
    make_dataset(written(folder, tables, **scene), folder / "made", roots=[folder], workers=0)
    return [*ms.Dataset(folder / "made")]


def test_each_pose_is_seen_by_each_sensor_at_its_time(tmp_path: Path) -> None:
    """A moving object has its place at this time; sensors are different sensor units, with different noise."""
    samples = made(tmp_path, sensors="all", motion=MOVES, path={"views": 2, "keys": KEYS[:2]})
    assert [(x.values["view"], x.values["sensor"], x.values["time_s"]) for x in samples] == [
        (view, sensor, 1 + view / 2) for view in range(2) for sensor in ("left", "right")
    ]
    for sample in samples:
        pose = np.array(sample.facts["light"]["camera_to_world"])
        origin, target = (THERE, BACK)[sample.values["view"] % 2]
        forward = np.subtract(target, origin) / np.linalg.norm(np.subtract(target, origin))
        across = np.cross(forward, [0, 1, 0]) / np.linalg.norm(np.cross(forward, [0, 1, 0]))
        beside_m = BASELINE_M * (sample.values["sensor"] == "right")
        np.testing.assert_allclose(pose[:3, 3], origin + beside_m * across, atol=1e-6)
        np.testing.assert_allclose(pose[:3, 2], forward, atol=1e-6)
        assert sample.facts["view"]["config"]["start_s"] == sample.values["time_s"]
        assert sample.values["pose"]["origin_m"] == origin
        points, shape = sample.read("position").astype(float), sample.read("shape_index")
        on_ball = points[shape == sample.aovs().shapes.index("ball")]
        centre = BALL_M + sample.values["time_s"] * VELOCITY_M_PER_S
        distance = np.linalg.norm(on_ball - centre, axis=1)
        assert len(on_ball) > 5
        np.testing.assert_allclose(distance, RADIUS_M, atol=1e-5)
    serials = {x.values["sensor"]: x.facts["seeds"]["serial"] for x in samples}
    assert serials["left"] == 1 and serials["right"] > 2**32
    assert len({x.facts["seeds"]["seed"] for x in samples}) == 4
    assert {x.values["serial"] for x in samples} == {1}


def test_lamps_flicker_on_from_view_to_view(tmp_path: Path) -> None:
    tables = {
        "outputs": ["raw", "electrons"],
        "render": {"spp": 2, "denoise": False, "light_groups": "auto"},
        "grid": {"exposure_s": [0.01], "lights.sky": ["1 pwm(1, 0.5)"]},
    }
    samples = made(
        tmp_path, tables, path={"views": 4, "keys": [{"time_s": 0.2}, {"time_s": 1.7}]}
    )
    assert [sample.values["time_s"] for sample in samples] == [0.2, 0.7, 1.2, 1.7]
    assert "pose" not in samples[0].values
    means_e = [sample.read("electrons").mean() for sample in samples]
    assert means_e[1] == means_e[3] == 0 and min(means_e[0], means_e[2]) > 100


def test_sensors_are_placed_named_and_listed_as_the_file_says(tmp_path: Path) -> None:
    """Sensors are named by id or number, in the given order; a parameter of the scene moves one of them."""
    tables = {"grid": {"parameters.baseline": [0.1, 0.3], "exposure_s": [1e-4]}}
    view = {"origin_m": [0, 2, 0], "target_m": [0, 0, 0], "up": [0, 0, 1]}
    poses = [
        x.config["look_at"]
        for x in plan_of(tmp_path, tables, sensors="all", views=[view]).tasks()
    ]
    right = [[-0.1, 2, 0], [-0.3, 2, 0]]  # forward × up is −x
    np.testing.assert_allclose([x["origin_m"] for x in poses], [[0, 2, 0], [0, 2, 0], *right])
    named = plan_of(tmp_path, sensors=["1", "left"]).tasks()
    assert [x.config["sensor"] for x in named] == ["right", "left"]
    (first, *_) = plan_of(tmp_path, sensors="right", path=PATH).tasks()
    assert list(first.config["look_at"]["origin_m"]) == THERE[0]
    pose = {"origin_m": [0, 0, 3], "target_m": [0, 0, 0]}
    again = plan_of(tmp_path, views=[{**pose, "time_s": 0}, {**pose, "time_s": 0.5}, pose])
    assert len({task.light_key for task in again.tasks()}) == 3


@pytest.mark.parametrize(
    ("scene", "sentence"),
    [
        ({"sensors": ["left", "0"]}, r"sensors names 'left' twice"),
        ({"sensors": "lefft"}, r"no sensor 'lefft'.*Did you mean 'left'"),
        (
            {"sensors": "all", "motion": {"camera": {"keys": KEYS[:2]}}},
            r"the motion has a pose of the camera in the world, which would put all 2 sensors",
        ),
        ({"views": [{"up": [0, 1, 0]}]}, r"a pose needs origin_m and target_m"),
        (
            {"path": {"views": 2, "keys": [{"time_s": 0}, KEYS[0]]}},
            r"keys of a path need origin_m and target_m.*or all of them only time_s",
        ),
        ({"views": [{"time_s": 1}, {"time_s": 1}]}, r"are the same: scenes\.0\.views\.0 and"),
        (
            {"path": PATH, "render": {"spp": 2, "start_s": 0.5}},
            r"\[render\] has start_s, but the views of scene",
        ),
    ],
)
def test_what_no_rig_and_no_time_can_be_is_refused(
    tmp_path: Path, scene: dict[str, Any], sentence: str
) -> None:
    scene = dict(scene)
    tables = {"render": scene.pop("render")} if "render" in scene else None
    with pytest.raises(ms.InputError, match=sentence):
        make_dataset(written(tmp_path, tables, **scene), tmp_path / "out", roots=[tmp_path])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("by", one_in(2, [["scene", "view"], ["scene", "parameters.baseline"]]))
def test_splits_count_the_samples_of_rigs(tmp_path: Path, by: list[str]) -> None:
    tables = {
        "grid": {"parameters.baseline": [0.1, 0.2, 0.3], "exposure_s": [1e-4, 2e-4]},
        "splits": {"shares": {"train": 0.5, "test": 0.5}, "by": by, "chips": 2},
    }
    plan = plan_of(tmp_path, tables, sensors="all", path=PATH)
    samples = [sample for task in plan.tasks() for sample in task.samples]
    assert len(samples) == 4 * 2 * 3 * 2 * 2
    chips: dict[str, set[int]] = {"train": set(), "test": set()}
    for sample in samples:
        chips[sample.split].add(sample.config["serial"])
    assert len(chips["train"] | chips["test"]) == 8 and chips["train"].isdisjoint(chips["test"])
