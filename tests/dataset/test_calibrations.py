"""Exported calibrations: surface points of a scene are where other programs project them to.

The AOVs have one ray through the middle of each pixel, so the middle of pixel (column, row) is known exactly; float32
positions are good to 1e-3 px. OpenCV and COLMAP (pycolmap) are asked where they are installed; the formulas that they
publish are written here, too.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from helpers.marks import one_in
from helpers.scenes import SKY, scene_text, skip_unless_usable, write_scene
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.exports.colmap import colmap_model
from mitsuba_sensor.dataset.exports.nerfstudio import transforms
from mitsuba_sensor.dataset.exports.opencv import opencv_xml, opencv_yaml
from mitsuba_sensor.dataset.exports.poses import (
    PosedImage,
    camera_to_world,
    rigid_pose,
    world_to_camera,
)
from mitsuba_sensor.dataset.exports.ros import camera_info
from mitsuba_sensor.optics.calibration import Calibration, calibration_of
from mitsuba_sensor.optics.intrinsics import intrinsics
from mitsuba_sensor.optics.shutter import shutter_of
from mitsuba_sensor.render.motion.aovs import aovs_of, load_for_rays
from mitsuba_sensor.render.motion.motion import KeyPose, Motion
from mitsuba_sensor.render.options import SceneOptions
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.variants import choose_variant, use

Floats = NDArray[np.float64]
ORIGIN, TARGET, UP = (1.0, 2.0, -3.0), (0.0, 0.5, 4.0), (0.0, 1.0, 0.3)
SENSOR = """<sensor type="perspective"><float name="fov" value="50"/>{more}
<float name="principal_point_offset_x" value="0.07"/><float name="principal_point_offset_y" value="-0.04"/>
<transform name="to_world"><lookat origin="1, 2, -3" target="0, 0.5, 4" up="0, 1, 0.3"/></transform>
<film type="hdrfilm"><integer name="width" value="60"/><integer name="height" value="40"/>
<integer name="crop_width" value="50"/><integer name="crop_height" value="36"/>
<integer name="crop_offset_x" value="7"/><integer name="crop_offset_y" value="3"/>{film}</film></sensor>"""
BALL = '<shape type="sphere"><point name="center" value="0.3, 0.1, 4"/></shape>'
WALL = """<shape type="rectangle"><transform name="to_world"><scale x="90" y="90"/><rotate y="1" angle="180"/>
<translate z="9"/></transform></shape>"""
PITCH_UM = 5.0
COEFFICIENTS = [-0.21, 0.06, 0.004, -0.003, -0.01]
LENSES: dict[str, dict[str, Any]] = {
    "pinhole": {},
    "k1, k2": {"lens.distortion": [-0.21, 0.06, 0.004, -0.003, 0.0]},
    "k1, k2, k3": {"lens.distortion": COEFFICIENTS},
}


def seen(folder: Path, lens: dict[str, Any]) -> tuple[dict[str, Any], Floats, Floats]:
    """Intrinsics of the picture; surface points of its pixels and (column, row) of their middles."""
    use(choose_variant(skip_unless_usable("scalar_spectral")))
    pixels = {"pixel.pitch_x_um": PITCH_UM, "pixel.pitch_y_um": PITCH_UM}
    camera = ms.load_camera("konnik_table1").replace(**pixels, **lens)
    path = write_scene(folder, scene_text(SKY, BALL, WALL, sensor=SENSOR))
    loaded = load_for_rays(parse(path, complete(SceneOptions, {})), camera, None, None)
    found = aovs_of(loaded, Motion(), 1.0, shutter_of(camera, ms.Exposure(0.01)))
    rows, columns = found.depth_m.shape
    middles = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    points, lit = (
        found.position_m.reshape(-1, 3).astype(float),
        np.isfinite(found.depth_m).ravel(),
    )
    return intrinsics(loaded.view, camera), points[lit], middles[lit].astype(float)


def pose() -> Floats:
    matrix = KeyPose(time_s=0, origin_m=ORIGIN, target_m=TARGET, up=UP).pose
    assert matrix is not None
    return matrix


def projected(
    tangents: Floats, matrix: Floats, k1: float, k2: float, p1: float, p2: float, k3: float
) -> Floats:
    """Brown and Conrady as OpenCV, COLMAP and nerfstudio have it: (N, 2) tangents to the right and down → pixels."""
    x, y = tangents.T
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    x, y = (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
        y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
    )
    return np.stack([matrix[0, 0] * x + matrix[0, 2], matrix[1, 1] * y + matrix[1, 2]], axis=-1)


@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_every_format_projects_the_points_of_the_scene_to_their_pixels(
    tmp_path: Path, lens: dict[str, Any]
) -> None:
    found, points, middles = seen(tmp_path, lens)
    assert len(points) > 1700
    calibration = calibration_of(found, PITCH_UM)
    image = PosedImage("images/a.png", calibration, pose())
    for name, where in (
        ("formula", by_formula(image, points)),
        ("nerfstudio", by_nerfstudio(transforms([image]), points)),
        ("COLMAP", by_colmap(colmap_model([image]), points)),
        ("ROS", by_ros(camera_info(calibration, "left"), image, points)),
    ):
        np.testing.assert_allclose(where, middles, atol=0.01, err_msg=name)


def by_formula(image: PosedImage, points: Floats) -> Floats:
    turn, move = world_to_camera(image.pose)
    inside = points @ turn.T + move
    return projected(
        inside[:, :2] / inside[:, 2:], image.calibration.matrix, *image.calibration.distortion
    )


def by_nerfstudio(data: dict[str, Any], points: Floats) -> Floats:
    """OpenGL's axes (x right, y up, looking along −z), and pixels whose middles are at half numbers."""
    data = json.loads(json.dumps(data))
    assert data["camera_model"] == "OPENCV" and (data["w"], data["h"]) == (50, 36)
    inside = (
        np.c_[points, np.ones(len(points))]
        @ np.linalg.inv(data["frames"][0]["transform_matrix"]).T
    )[:, :3]
    tangents = inside[:, :2] / -inside[:, 2:] * (1, -1)
    matrix = np.array([[data["fl_x"], 0, data["cx"]], [0, data["fl_y"], data["cy"]], [0, 0, 1]])
    return (
        projected(tangents, matrix, *(data[name] for name in ("k1", "k2", "p1", "p2", "k3")))
        - 0.5
    )


def by_colmap(texts: dict[str, str], points: Floats) -> Floats:
    """Quaternion by Hamilton's formula; pixels whose middles are at half numbers."""
    (camera,) = [
        line.split() for line in texts["cameras.txt"].splitlines() if not line.startswith("#")
    ]
    image, observations = [
        line for line in texts["images.txt"].splitlines() if not line.startswith("#")
    ]
    assert observations == "" and texts["points3D.txt"].startswith("#")
    _, w, x, y, z, *rest = image.split()
    assert rest[3:] == [camera[0], "images/a.png"]
    w, x, y, z = (float(number) for number in (w, x, y, z))  # type: ignore[assignment]
    turn = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]  # type: ignore[operator]
    )
    inside = points @ turn.T + [float(number) for number in rest[:3]]
    assert camera[2:4] == ["50", "36"]
    fx, fy, cx, cy, *more = (float(number) for number in camera[4:])
    assert len(more) == {"PINHOLE": 0, "OPENCV": 4, "FULL_OPENCV": 8}[camera[1]]
    k1, k2, p1, p2, k3 = [*more[:5], *[0.0] * (5 - len(more[:5]))]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return projected(inside[:, :2] / inside[:, 2:], matrix, k1, k2, p1, p2, k3) - 0.5


def by_ros(text: str, image: PosedImage, points: Floats) -> Floats:
    data = yaml.safe_load(text)
    matrix, model = (
        np.reshape(data["camera_matrix"]["data"], (3, 3)),
        data["distortion_coefficients"]["data"],
    )
    assert (data["image_width"], data["image_height"], data["camera_name"]) == (50, 36, "left")
    assert data["distortion_model"] == "plumb_bob" and np.shape(
        data["projection_matrix"]["data"]
    ) == (12,)
    turn, move = world_to_camera(image.pose)
    inside = points @ turn.T + move
    return projected(inside[:, :2] / inside[:, 2:], matrix, *model)


@pytest.mark.parametrize(
    "motion", one_in(3, [None, {"camera": {"velocity_m_per_s": [0.3, 0, 0]}}, "keys"])
)
def test_the_statistics_of_a_render_have_the_pose_at_the_start_in_metres(
    tmp_path: Path, motion: Any
) -> None:
    """A scene in centimetres; a key of the motion puts the camera elsewhere before the first row opens."""
    skip_unless_usable("scalar_spectral")
    if motion == "keys":
        keys = [
            {"time_s": 0, "origin_m": [0.002, 0.01, -0.02], "target_m": [0, 0, 0.04]},
            {"time_s": 1, "move_m": [9, 0, 0]},
        ]
        motion = {"camera": {"keys": keys}}
    path = write_scene(tmp_path, scene_text(SKY, BALL, WALL, sensor=SENSOR))
    camera = ms.load_camera("konnik_table1")
    options: dict[str, Any] = {
        "scene_unit": "cm",
        "motion": motion,
        "spp": 4,
        "wavelength_nm": 550,
    }
    shot = ms.capture(
        path,
        camera,
        ms.Exposure(0.01),
        variant="scalar_spectral",
        aovs=True,
        denoise=False,
        **options,
    )
    statistics, found = shot.light.statistics.to_dict(), shot.aovs
    assert found is not None
    image = PosedImage(
        "a",
        calibration_of(statistics["intrinsics"], 5.0),
        np.array(statistics["camera_to_world"]),
    )
    lit = np.isfinite(found.depth_m)
    middles = np.stack(np.meshgrid(*map(np.arange, lit.shape[::-1])), axis=-1)[lit]
    np.testing.assert_allclose(
        by_formula(image, found.position_m[lit].astype(float)), middles, atol=0.01
    )


IMAGE = PosedImage(
    "a b.png",
    Calibration(50, 36, (61.25, 60.0), (24.125, 1e-5), (-0.21, 0.06, 0.004, -1e-5, -0.01)),
    KeyPose(time_s=0, origin_m=ORIGIN, target_m=TARGET, up=UP).pose,
)


@pytest.mark.parametrize("kind", ["yml", "xml"])
def test_opencv_reads_its_files_and_projects_alike(tmp_path: Path, kind: str) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / f"camera.{kind}"
    path.write_text(
        (opencv_xml if kind == "xml" else opencv_yaml)(IMAGE.calibration, [IMAGE, IMAGE]),
        "utf-8",
    )
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    size = [int(storage.getNode(name).real()) for name in ("image_width", "image_height")]
    matrix, coefficients, poses = (
        storage.getNode(name).mat()
        for name in ("camera_matrix", "distortion_coefficients", "extrinsic_parameters")
    )
    names = storage.getNode("images")
    assert size == [50, 36] and [names.at(i).string() for i in range(names.size())] == [
        "a b.png",
        "a b.png",
    ]
    np.testing.assert_array_equal(matrix, IMAGE.calibration.matrix)
    assert coefficients.ravel().tolist() == list(
        IMAGE.calibration.distortion
    ) and poses.shape == (2, 6)
    points = np.random.default_rng(1).uniform((-2, -1, 5), (2, 2, 9), (50, 3))
    where, _ = cv2.projectPoints(points, poses[1, :3], poses[1, 3:], matrix, coefficients)
    np.testing.assert_allclose(where[:, 0], by_formula(IMAGE, points), atol=1e-9)


@pytest.mark.parametrize(
    "coefficients",
    [(0.0,) * 5, (-0.2, 0.05, 0.001, -0.002, 0.0), (-0.2, 0.05, 0.001, 0.0, 0.01)],
)
def test_colmap_reads_its_model_and_projects_alike(
    tmp_path: Path, coefficients: tuple[float, ...]
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    calibration = Calibration(50, 36, (61.25, 60.0), (24.125, 18.5), coefficients)  # type: ignore[arg-type]
    image = PosedImage("images/a.png", calibration, IMAGE.pose)
    for name, text in colmap_model([image]).items():
        (tmp_path / name).write_text(text, "utf-8")
    model = pycolmap.Reconstruction(str(tmp_path))
    (found,) = model.images.values()
    assert found.name == image.name and model.num_points3D() == 0
    points = np.random.default_rng(1).uniform((-2, -1, 5), (2, 2, 9), (50, 3))
    where = np.array([found.project_point(point) for point in points])
    np.testing.assert_allclose(where - 0.5, by_formula(image, points), atol=1e-9)


def test_a_table_of_distortion_becomes_coefficients_whose_misfit_is_said(
    tmp_path: Path,
) -> None:
    """The table is k1 = −0.2 and k2 = 0.05 at eleven heights; between them it is a curve of its own."""
    focal_mm = 60 / 2 / np.tan(np.radians(25)) * PITCH_UM * 1e-3
    heights = np.linspace(0, 1.2, 41) * focal_mm
    r2 = (heights / focal_mm) ** 2
    table = {
        "lens.distortion_percent": (100 * (-0.2 * r2 + 0.05 * r2**2)).tolist(),
        "lens.distortion_heights_mm": heights.tolist(),
    }
    found, points, middles = seen(tmp_path, table)
    calibration = calibration_of(found, PITCH_UM)
    np.testing.assert_allclose(calibration.distortion, (-0.2, 0.05, 0, 0, 0), atol=2e-3)
    assert calibration.misfit_px < 0.01
    where = by_formula(PosedImage("a.png", calibration, pose()), points)
    np.testing.assert_allclose(where, middles, atol=0.01)


def test_a_prescription_becomes_coefficients_whose_misfit_is_said(tmp_path: Path) -> None:
    lens = {
        "lens.prescription": "double_gauss",
        "lens.f_number": 8.0,
        "lens.focal_length_mm": 0.3216,
        "lens.focus_m": 9.0,
    }
    found, points, middles = seen(tmp_path, lens)
    calibration = calibration_of(found, PITCH_UM)
    where = by_formula(PosedImage("a.png", calibration, pose()), points)
    assert calibration.distortion[0] < -0.05 and calibration.misfit_px < 0.01
    np.testing.assert_allclose(where, middles, atol=0.02)


def test_cameras_that_differ_are_told_apart() -> None:
    other = PosedImage("b.png", Calibration(40, 30, (50.0, 50.0), (20.0, 15.0)), IMAGE.pose)
    first = PosedImage("a.png", IMAGE.calibration, IMAGE.pose)
    data = transforms([first, other, first])
    assert "fl_x" not in data and [frame["w"] for frame in data["frames"]] == [50, 40, 50]
    lines = colmap_model([first, other, first])["images.txt"].splitlines()[2::2]
    assert [line.split()[-2:] for line in lines] == [
        ["1", "a.png"],
        ["2", "b.png"],
        ["1", "a.png"],
    ]


def test_a_scale_in_a_pose_is_left_out_and_a_mirror_is_refused() -> None:
    scaled = IMAGE.pose @ np.diag([3.0, 3.0, 3.0, 1.0])
    np.testing.assert_allclose(rigid_pose(scaled), IMAGE.pose, atol=1e-12)
    np.testing.assert_allclose(camera_to_world(scaled, (-1.0, -1.0, 1.0))[:3, 3], ORIGIN)
    for wrong in (
        IMAGE.pose @ np.diag([-1.0, 1.0, 1.0, 1.0]),
        np.zeros((4, 4)),
        np.full((4, 4), np.nan),
        np.eye(3),
    ):
        with pytest.raises(ms.InputError):
            rigid_pose(wrong)


def test_what_no_format_can_say_is_refused() -> None:
    with pytest.raises(ms.InputError, match="space"):
        colmap_model([IMAGE])
    with pytest.raises(ms.InputError, match="orthographic"):
        calibration_of({"matrix": None, "image_size": [4, 3]}, PITCH_UM)
