"""Rigs and times of datasets: each pose is seen by each sensor of a scene, at a time of its own.

Oracles: OpenCV triangulates what pykitti and PyYAML read; a plane, a ball that moves evenly, a lamp that flickers.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.exports.export import export
from mitsuba_sensor.dataset.file import read_dataset
from mitsuba_sensor.dataset.plan import DatasetPlan, load_plan
from mitsuba_sensor.dataset.run import run

Floats = NDArray[np.float64]
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
MOST_PX, MOST_M = 1e-4, 2e-4
"""Of a triangulated point beside where both cameras show it, and in space: positions are float32, and 1e-5 px are
z²/(26 px · 0.2 m) · 1e-5 in depth, 1.2e-4 m for the farthest points of the wall at 8 m."""
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


def plan_of(folder: Path, tables: dict[str, Any] | None = None, **scene: Any) -> DatasetPlan:
    """The plan of a dataset of one scene with two sensors."""
    (folder / "pair.xml").write_text(SCENE, "utf-8")
    entry = {"name": "pair", "file": "pair.xml", **scene}
    return DatasetPlan(read_dataset({**TABLES, **(tables or {}), "scenes": [entry]}), [folder])


def made(folder: Path, tables: dict[str, Any] | None = None, **scene: Any) -> Path:
    """The same, made."""
    plan_of(folder)
    entry = {"name": "pair", "file": "pair.xml", **scene}
    text = json.dumps({**TABLES, **(tables or {}), "scenes": [entry]})
    (folder / "rig.toml").write_text(toml(json.loads(text)), "utf-8")
    run(load_plan(folder / "rig.toml", [folder]), folder / "made", workers=0)
    return folder / "made"


def toml(tables: dict[str, Any]) -> str:
    """TOML of tables, each value on its line."""
    return "\n".join(f"{name} = {inline(value)}" for name, value in tables.items())


def inline(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{json.dumps(n)} = {inline(x)}' for n, x in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(inline, value))}]"
    return json.dumps(value)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("rig"), sensors="all", motion=MOVES, path=PATH)


def test_each_pose_is_seen_by_each_sensor_at_its_time(rig: Path) -> None:
    samples = list(ms.Dataset(rig))
    assert [(x.values["view"], x.values["sensor"], x.values["time_s"]) for x in samples] == [
        (view, sensor, 1 + view / 2) for view in range(4) for sensor in ("left", "right")
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
    first = samples[1].folder.relative_to(rig)
    assert str(first) == (
        "samples/pair/view_0000/konnik_table1,sensor=right,exposure_s=0.0001,serial=1"
    )


def test_what_moves_is_where_it_is_at_the_time_of_each_view(rig: Path) -> None:
    for sample in ms.Dataset(rig):
        points, shape = sample.read("position_m").astype(float), sample.read("shape_index")
        names = sample.aovs().shapes
        on_ball = points[shape == names.index("ball")]
        centre = BALL_M + sample.values["time_s"] * VELOCITY_M_PER_S
        assert len(on_ball) > 5
        distance = np.linalg.norm(on_ball - centre, axis=1)
        np.testing.assert_allclose(distance, RADIUS_M, atol=1e-5)


def test_sensors_are_other_chips_and_have_other_noise(rig: Path) -> None:
    serials = {x.values["sensor"]: x.facts["seeds"]["serial"] for x in ms.Dataset(rig)}
    assert serials["left"] == 1 and serials["right"] > 2**32
    assert len({x.facts["seeds"]["seed"] for x in ms.Dataset(rig)}) == 8
    assert {x.values["serial"] for x in ms.Dataset(rig)} == {1}


def plane_points(sample: ms.Sample) -> tuple[Floats, Floats]:
    """Pixels (N, 2) that show the wall, and its points there (N, 3)."""
    wall = sample.read("shape_index") == sample.aovs().shapes.index("wall")
    rows, columns = np.nonzero(wall)
    return np.stack([columns, rows], -1).astype(float), sample.read("position_m")[wall].astype(
        float
    )


def pixels_of(sample: ms.Sample, points: Floats) -> Floats:
    """Where a sample shows points of the wall (N, 2): by the homography from the plane to its own pixels."""
    cv2 = pytest.importorskip("cv2")
    pixels, known = plane_points(sample)
    homography, _ = cv2.findHomography(known[:, :2], pixels)
    return cv2.perspectiveTransform(points[:, None, :2], homography)[:, 0]


def require_triangulated(
    samples: tuple[ms.Sample, ms.Sample], projections: list[Floats], from_world: Floats
) -> None:
    """Points that both show are where both show them.  projections : 3 × 4 of both, from points before the body."""
    cv2 = pytest.importorskip("cv2")
    pixels, points = plane_points(samples[0])
    places = [pixels, pixels_of(samples[1], points)]
    before = cv2.triangulatePoints(*projections, *(place.T for place in places))
    before = (before[:3] / before[3]).T
    for place, projection in zip(places, projections, strict=True):
        again = np.c_[before, np.ones(len(before))] @ projection.T
        off_px = np.abs(again[:, :2] / again[:, 2:] - place).max()
        print(f"{off_px:.2g} px")
        assert off_px < MOST_PX
    expected = points @ from_world[:3, :3].T + from_world[:3, 3]
    off_m = np.abs(before - expected).max()
    print(f"{off_m:.2g} m")
    assert off_m < MOST_M


def pairs_of(made: Path, said: dict[str, Any]) -> list[tuple[ms.Sample, ms.Sample]]:
    """Both samples of each frame of a sequence of sequences.json."""
    samples = {sample.key: sample for sample in ms.Dataset(made)}
    left, right = ([samples[x["key"]] for x in one["frames"]] for one in said["cameras"])
    return list(zip(left, right, strict=True))


def test_pykitti_reads_a_stereo_pair_with_its_baseline_and_times(
    rig: Path, tmp_path: Path
) -> None:
    pykitti = pytest.importorskip("pykitti")
    assert export(rig, "kitti", tmp_path / "out").remarks == []
    about = json.loads((tmp_path / "out/sequences.json").read_text("utf-8"))
    assert list(about) == ["00"]
    said = about["00"]
    assert [x["camera"] for x in said["cameras"]] == [
        "konnik_table1 left",
        "konnik_table1 right",
    ]
    assert [x["time_s"] for x in said["cameras"][1]["frames"]] == [1, 1.5, 2, 2.5]
    found = pykitti.odometry(str(tmp_path / "out"), "00")
    assert [time.total_seconds() for time in found.timestamps] == [0, 0.5, 1, 1.5]
    assert len(found.cam0_files) == len(found.cam1_files) == 4
    assert found.calib.b_gray == pytest.approx(BASELINE_M, abs=1e-6)
    world = np.array(said["world_from_first_camera"])
    projections = [found.calib.P_rect_00, found.calib.P_rect_10]
    for pose, pair in zip(found.poses, pairs_of(rig, said), strict=True):
        require_triangulated(pair, projections, np.linalg.inv(world @ pose))


def test_evo_reads_times_and_the_body_and_both_cameras_are_on_it(
    rig: Path, tmp_path: Path
) -> None:
    interface = pytest.importorskip("evo.tools.file_interface")
    export(rig, "euroc", tmp_path / "out")
    about = json.loads((tmp_path / "out/sequences.json").read_text("utf-8"))
    folder = tmp_path / "out/pair_00/mav0"
    states = str(folder / "state_groundtruth_estimate0/data.csv")
    trajectory = interface.read_euroc_csv_trajectory(states)
    assert trajectory.timestamps.tolist() == [0, 0.5, 1, 1.5]
    projections = []
    for number in range(2):
        sensor = yaml.safe_load((folder / f"cam{number}/sensor.yaml").read_text("utf-8"))
        body_from_camera = np.reshape(sensor["T_BS"]["data"], (4, 4))
        np.testing.assert_allclose(
            body_from_camera[:3, 3], [number * BASELINE_M, 0, 0], atol=1e-6
        )
        fu, fv, cu, cv = sensor["intrinsics"]
        matrix = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
        projections.append(matrix @ np.linalg.inv(body_from_camera)[:3])
        with (folder / f"cam{number}/data.csv").open(encoding="utf-8") as opened:
            (_, *rows) = csv.reader(opened)
        assert [int(row[0]) for row in rows] == [0, 5 * 10**8, 10**9, 15 * 10**8]
    pairs = pairs_of(rig, about["pair_00"])
    for pose, pair in zip(trajectory.poses_se3, pairs, strict=True):
        require_triangulated(pair, projections, np.linalg.inv(pose))


def test_cameras_that_turn_each_by_itself_are_no_rig(tmp_path: Path) -> None:
    turning = {"camera": {"rotate_deg_per_s": 20, "axis": [0, 1, 0]}}
    times = {"views": 2, "keys": [{"time_s": 0}, {"time_s": 1}]}
    made_of = made(tmp_path, {"outputs": ["raw"]}, sensors="all", motion=turning, path=times)
    found = export(made_of, "euroc", tmp_path / "out")
    (remark,) = found.remarks
    assert remark == (
        "cameras of pair do not keep their places beside each other: each has a sequence of its own"
    )
    about = json.loads((tmp_path / "out/sequences.json").read_text("utf-8"))
    assert [len(x["cameras"]) for x in about.values()] == [1, 1]
    together = {"camera": {**turning["camera"], "pivot_m": [0, 0, 0]}}
    (tmp_path / "again").mkdir()
    made_of = made(
        tmp_path / "again", {"outputs": ["raw"]}, sensors="all", motion=together, path=times
    )
    assert export(made_of, "euroc", tmp_path / "again/out").remarks == []


def test_lamps_flicker_on_from_view_to_view(tmp_path: Path) -> None:
    tables = {
        "outputs": ["raw", "electrons"],
        "render": {"spp": 2, "denoise": False, "light_groups": "auto"},
        "grid": {"exposure_s": [0.01], "lights.sky": ["1 pwm(1, 0.5)"]},
    }
    times = {"views": 4, "keys": [{"time_s": 0.2}, {"time_s": 1.7}]}
    samples = list(ms.Dataset(made(tmp_path, tables, path=times)))
    assert [sample.values["time_s"] for sample in samples] == [0.2, 0.7, 1.2, 1.7]
    assert "pose" not in samples[0].values
    means_e = [sample.read("electrons").mean() for sample in samples]
    assert means_e[1] == means_e[3] == 0 and min(means_e[0], means_e[2]) > 100


def test_a_parameter_that_moves_a_sensor_moves_it_beside_the_first(tmp_path: Path) -> None:
    tables = {"grid": {"parameters.baseline": [0.1, 0.3], "exposure_s": [1e-4]}}
    view = {"origin_m": [0, 2, 0], "target_m": [0, 0, 0], "up": [0, 0, 1]}
    plan = plan_of(tmp_path, tables, sensors="all", views=[view])
    poses = [x.config["look_at"] for x in plan.tasks()]
    right = [[-0.1, 2, 0], [-0.3, 2, 0]]  # forward × up is −x
    origins = [pose["origin_m"] for pose in poses]
    np.testing.assert_allclose(origins, [[0, 2, 0], [0, 2, 0], *right])


def test_sensors_are_named_by_id_or_number_and_listed_in_the_order_given(
    tmp_path: Path,
) -> None:
    assert [x.config["sensor"] for x in plan_of(tmp_path, sensors=["1", "left"]).tasks()] == [
        "right",
        "left",
    ]
    alone = plan_of(tmp_path, sensors="right", path=PATH)
    (first, *_) = alone.tasks()
    assert list(first.config["look_at"]["origin_m"]) == THERE[0]


@pytest.mark.parametrize(
    ("scene", "sentence"),
    [
        (
            {"sensors": ["left", "0"]},
            r"scene 'pair' of the dataset: sensors names 'left' twice",
        ),
        (
            {"sensors": "lefft"},
            r"no sensor 'lefft'; its sensors are left, right\. Did you mean 'left'",
        ),
        ({"sensors": []}, r"sensors is empty; give names, all, or leave it out"),
        (
            {
                "sensors": "all",
                "motion": {"camera": {"keys": [KEYS[0], KEYS[1]]}},
            },
            r"the motion has a pose of the camera in the world, where all 2 sensors",
        ),
        ({"views": [{"up": [0, 1, 0]}]}, r"a pose needs origin_m and target_m"),
        ({"views": [{}]}, r"must have origin_m and target_m, or time_s, or both"),
        (
            {"path": {"views": 2, "keys": [{"time_s": 0}, KEYS[0]]}},
            r"keys of a path need origin_m and target_m.*or all of them time_s alone",
        ),
        (
            {"views": [{"origin_m": [0, 0, 3], "target_m": [0, 0, 0]}] * 2},
            r"are the same \(scene pair, view 1\).*give views another time_s",
        ),
        ({"views": [{"time_s": 1}, {"time_s": 1}]}, r"are the same \(scene pair, view 1\)"),
    ],
)
def test_what_no_rig_and_no_time_can_be_is_refused(
    tmp_path: Path, scene: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ms.InputError, match=sentence):
        _ = plan_of(tmp_path, **scene).scenes


@pytest.mark.parametrize(
    ("times_s", "order", "apart_s"), [((3, 1, 2), (1, 2, 0), 1.0), ((1, 1, 2), (0, 1, 2), 0.1)]
)
def test_frames_are_in_the_order_of_time_and_none_is_lost_where_two_have_the_same(
    times_s: Sequence[float], order: Sequence[int], apart_s: float, tmp_path: Path
) -> None:
    views = [
        {"time_s": time_s, "origin_m": [number, 0, 3], "target_m": [number, 0, 0]}
        for number, time_s in enumerate(times_s)
    ]
    found = made(tmp_path, {"outputs": ["raw"]}, views=views)
    export(found, "kitti", tmp_path / "kitti")
    times = np.loadtxt(tmp_path / "kitti/sequences/00/times.txt")
    np.testing.assert_allclose(times, np.arange(3) * apart_s)
    moved_m = np.loadtxt(tmp_path / "kitti/poses/00.txt")[:, 3]
    np.testing.assert_allclose(moved_m, np.subtract(order, order[0]), atol=1e-6)
    assert len(export(found, "euroc", tmp_path / "euroc").remarks) == (apart_s == 0.1)
    assert len([*(tmp_path / "euroc").rglob("data/*.png")]) == 3


def test_a_pose_again_at_another_time_is_another_view(tmp_path: Path) -> None:
    pose = {"origin_m": [0, 0, 3], "target_m": [0, 0, 0]}
    plan = plan_of(tmp_path, views=[{**pose, "time_s": 0}, {**pose, "time_s": 0.5}, pose])
    assert plan.scenes and len({view.key for task in plan.tasks()}) == 3


def test_start_s_of_the_render_beside_times_of_views_is_refused(tmp_path: Path) -> None:
    render = {"spp": 2, "start_s": 0.5}
    with pytest.raises(ms.InputError, match=r"\[render\] has start_s, and the views of scene"):
        plan_of(tmp_path, {"render": render}, path=PATH)


@pytest.mark.parametrize("by", [["scene", "view"], ["scene", "parameters.baseline"]])
def test_splits_count_the_samples_of_rigs(tmp_path: Path, by: list[str]) -> None:
    tables = {
        "grid": {"parameters.baseline": [0.1, 0.2, 0.3], "exposure_s": [1e-4, 2e-4]},
        "splits": {"shares": {"train": 0.5, "test": 0.5}, "by": by, "chips": 2},
    }
    plan = plan_of(tmp_path, tables, sensors="all", path=PATH)
    samples = [sample for task in plan.tasks() for sample in task.samples]
    assert plan.samples == len(samples) == 4 * 2 * 3 * 2 * 2
    chips: dict[str, set[int]] = {"train": set(), "test": set()}
    for sample in samples:
        chips[sample.split].add(sample.config["serial"])
    assert len(chips["train"] | chips["test"]) == 8 and chips["train"].isdisjoint(chips["test"])
