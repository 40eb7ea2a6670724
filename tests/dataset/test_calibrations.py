"""Calibrations of lenses: the coefficients of other programs project surface points of a scene onto their pixels.

The AOVs have one ray through the middle of each pixel, so the middle of pixel (column, row) is known exactly; float32
positions are good to 1e-3 px. OpenCV and COLMAP are asked; test_exports.py has the files of whole datasets.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import SKY, scene_text, skip_unless_usable, write_scene
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.exports.colmap import camera_line
from mitsuba_sensor.dataset.exports.poses import rigid_pose
from mitsuba_sensor.optics.calibration import Calibration, calibration_of
from mitsuba_sensor.optics.intrinsics import intrinsics
from mitsuba_sensor.optics.shutter import shutter_of
from mitsuba_sensor.render.motion.aovs import aovs_of, load_for_rays
from mitsuba_sensor.render.options import SceneOptions
from mitsuba_sensor.render.scene.motion import KeyPose, Motion
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.variants import choose_variant, use

Floats: TypeAlias = NDArray[np.float64]
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
HEIGHTS = np.linspace(0, 1.2, 41)
TABLE_FOCAL_MM = 60 / 2 / np.tan(np.radians(25)) * PITCH_UM * 1e-3
LENSES: dict[str, tuple[dict[str, Any], Any]] = {
    "pinhole": ({}, (0, 0, 0, 0, 0)),
    "k1, k2": (
        {"lens.distortion": [-0.21, 0.06, 0.004, -0.003, 0.0]},
        (-0.21, 0.06, 0.004, -0.003, 0),
    ),
    "k3": (
        {"lens.distortion": [-0.21, 0.06, 0.004, -0.003, -0.01]},
        (-0.21, 0.06, 0.004, -0.003, -0.01),
    ),
    "table": (
        {
            "lens.distortion_percent": (100 * (-0.2 * HEIGHTS**2 + 0.05 * HEIGHTS**4)).tolist(),
            "lens.distortion_heights_mm": (HEIGHTS * TABLE_FOCAL_MM).tolist(),
        },
        (-0.2, 0.05, 0, 0, 0),
    ),
    "prescription": (
        {
            "lens.prescription": "double_gauss",
            "lens.f_number": 8.0,
            "lens.focal_length_mm": 0.3216,
            "lens.focus_m": 9.0,
        },
        None,
    ),
}
"""Lens → known k1, k2, p1, p2, k3; the coefficients of a table are fitted."""


def seen(folder: Path, lens: dict[str, Any]) -> tuple[dict[str, Any], Floats, Floats]:
    """Return intrinsics of the image, surface points of its pixels, and (column, row) of their centres."""
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


def projected(calibration: Calibration, to_world: Any, points: Floats) -> Floats:
    """Project points with OpenCV."""
    cv2 = pytest.importorskip("cv2")
    from_world = np.linalg.inv(rigid_pose(to_world))
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(from_world[:3, :3]))
    coefficients = np.array(calibration.distortion)
    place = from_world[:3, 3]
    return cv2.projectPoints(points, turn, place, calibration.matrix, coefficients)[0][:, 0]


@pytest.mark.parametrize("name", one_in(2, reversed(LENSES)))
def test_a_lens_has_the_coefficients_that_project_points_to_their_pixels(
    tmp_path: Path, name: str
) -> None:
    """The coefficients of a table and of a prescription are fitted, with their misfit."""
    lens, coefficients = LENSES[name]
    found, points, middles = seen(tmp_path, lens)
    calibration = calibration_of(found, PITCH_UM)
    assert len(points) > 1700 and calibration.misfit_px < 0.01
    if coefficients is not None:
        np.testing.assert_allclose(calibration.distortion, coefficients, atol=2e-3)
    fitted_px = 0.02 if name == "prescription" else 0.01
    np.testing.assert_allclose(projected(calibration, pose(), points), middles, atol=fitted_px)


@pytest.mark.exhaustive
def test_the_statistics_of_a_render_have_the_pose_at_the_start_in_metres(
    tmp_path: Path,
) -> None:
    """A scene in centimetres; a key of the motion puts the camera elsewhere before the first row opens."""
    skip_unless_usable("scalar_spectral")
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
    calibration = calibration_of(statistics["intrinsics"], 5.0)
    lit = np.isfinite(found.depth_m)
    middles = np.stack(np.meshgrid(*map(np.arange, lit.shape[::-1])), axis=-1)[lit]
    points = found.position_m[lit].astype(float)
    where = projected(calibration, statistics["camera_to_world"], points)
    np.testing.assert_allclose(where, middles, atol=0.01)


@pytest.mark.parametrize(
    "coefficients",
    [(0.0,) * 5, (-0.2, 0.05, 0.001, -0.002, 0.0), (-0.2, 0.05, 0.001, -1e-5, 0.01)],
)
def test_colmap_projects_as_opencv(coefficients: tuple[float, ...]) -> None:
    """PINHOLE, OPENCV and FULL_OPENCV, whose pixel centres are at half integers."""
    pycolmap = pytest.importorskip("pycolmap")
    given = Calibration(50, 36, (61.25, 60.0), (24.125, 1e-5), coefficients)  # type: ignore[arg-type]
    model, columns, rows, *parameters = camera_line(given)
    camera = pycolmap.Camera(model=model, width=columns, height=rows, params=parameters)
    points = np.random.default_rng(1).uniform((-2, -1, 5), (2, 2, 9), (50, 3))
    expected = projected(given, np.diag([-1, -1, 1, 1]), points)
    np.testing.assert_allclose(camera.img_from_cam(points) - 0.5, expected, atol=1e-9)


def test_a_scale_in_a_pose_is_left_out_and_a_mirror_is_refused() -> None:
    """The axes of a scene's camera are left, up, forward; the axes of a pose are right, down, forward."""
    expected = pose() @ np.diag([-1.0, -1.0, 1.0, 1.0])
    scaled = pose() @ np.diag([3.0, 3.0, 3.0, 1.0])
    np.testing.assert_allclose(rigid_pose(scaled), expected, atol=1e-12)
    mirrored = pose() @ np.diag([-1.0, 1.0, 1.0, 1.0])
    for wrong in (mirrored, np.zeros((4, 4)), np.full((4, 4), np.nan), np.eye(3)):
        with pytest.raises(ms.InputError):
            rigid_pose(wrong)
    with pytest.raises(ms.InputError, match="orthographic"):
        calibration_of({"matrix": None, "image_size": [4, 3]}, PITCH_UM)
