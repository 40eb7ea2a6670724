"""Cameras from geometric calibrations: a scene seen by the imported camera has the calibration of the file again.

OpenCV's own writer and projections are asked where it is installed.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive
from helpers.scenes import SKY, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.dataset.exports.nerfstudio import intrinsics as frame_of
from mitsuba_sensor.dataset.exports.opencv import calibration_text
from mitsuba_sensor.dataset.exports.ros import camera_info
from mitsuba_sensor.optics.calibration import Calibration, calibration_of
from mitsuba_sensor.optics.distortion import distortion_of
from mitsuba_sensor.optics.intrinsics import image_distance_m, intrinsics
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.render.motion.aovs import load_for_rays
from mitsuba_sensor.render.options import SceneOptions
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.variants import choose_variant, use

GIVEN = Calibration(
    640, 480, (501.25, 501.25), (325.5, 231.0625), (-0.21, 0.06, 0.004, -1e-5, -0.01)
)
TEXTS = {
    "a.yml": calibration_text(GIVEN),
    "a.yaml": camera_info(GIVEN, "left"),
    "transforms.json": json.dumps({"camera_model": "OPENCV", "frames": [frame_of(GIVEN)]}),
}
SENSOR = """<scene version="3.0.0"><sensor type="perspective">{}<film type="hdrfilm">
<integer name="width" value="{}"/><integer name="height" value="{}"/></film></sensor>{}</scene>"""


def imported(folder: Path, name: str, text: str) -> ms.Camera:
    path = folder / name
    path.write_text(text, "utf-8")
    return import_camera(path)


def view(folder: Path, camera: ms.Camera) -> Any:
    """The view of a scene whose sensor has what the description of the camera says."""
    use(choose_variant(skip_unless_usable("scalar_spectral")))
    said = re.findall(r"(fov|principal_point_offset_[xy]) ([-+.\de]*\d)", camera.description)
    assert [name for name, _ in said] == [
        "fov",
        "principal_point_offset_x",
        "principal_point_offset_y",
    ]
    numbers = "".join(f'<float name="{name}" value="{value}"/>' for name, value in said)
    text = SENSOR.format(numbers, camera.sensor.columns, camera.sensor.rows, SKY)
    parsed = parse(write_scene(folder, text), complete(SceneOptions, {}))
    return load_for_rays(parsed, camera, None, None).view


@pytest.mark.parametrize("name", TEXTS)
def test_a_scene_seen_by_an_imported_camera_has_the_calibration_of_the_file(
    tmp_path: Path, name: str
) -> None:
    camera = imported(tmp_path, name, TEXTS[name])
    found = calibration_of(intrinsics(view(tmp_path, camera), camera), camera.pixel.pitch_x_um)
    assert (found.columns, found.rows, found.distortion) == (640, 480, GIVEN.distortion)
    np.testing.assert_allclose(found.matrix, GIVEN.matrix, rtol=1e-6, atol=1e-4)
    assert camera.sources["lens.distortion"].startswith(f"{name}: ")
    assert ms.load_camera(camera.to_toml()).lens == camera.lens


def test_files_that_opencv_writes_are_read(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    for name in ("b.yml", "b.xml"):
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        for key, value in (
            ("image_width", 640),
            ("image_height", 480),
            ("flags", 0),
            ("camera_matrix", GIVEN.matrix),
        ):
            storage.write(key, value)
        storage.write("distortion_coefficients", np.array(GIVEN.distortion)[:, None])
        storage.release()
        camera = import_camera(tmp_path / name)
        assert (camera.sensor.columns, camera.sensor.rows, camera.lens.distortion) == (
            640,
            480,
            GIVEN.distortion,
        )


RATIONAL = (0.35, 0.02, 0.001, -0.002, 0.004, 0.62, 0.07, 0.003)
"""k1, k2, p1, p2, k3, k4, k5, k6"""


def points_of(camera: ms.Camera, seen: Any, tangents: Any) -> Any:
    """Pixels of points at tangents to the right and down, by our own model."""
    distortion = distortion_of(camera.lens, image_distance_m(seen, camera) * 1e3)
    matrix = np.array(intrinsics(seen, camera)["matrix"])
    x, y, *_ = distortion.real(*tangents.T)  # type: ignore[union-attr]
    return np.stack([matrix[0, 0] * x + matrix[0, 2], matrix[1, 1] * y + matrix[1, 2]], axis=-1)


def test_a_rational_polynomial_is_fitted_as_well_as_the_note_says(tmp_path: Path) -> None:
    text = (
        TEXTS["a.yaml"]
        .replace("plumb_bob", "rational_polynomial")
        .replace("cols: 5", "cols: 8")
    )
    text = text.replace(
        text.split("data: [")[2].partition("]")[0], ", ".join(map(str, RATIONAL))
    )
    camera = imported(tmp_path, "a.yaml", text)
    misfit = float(
        re.search(r"fitted to more coefficients, to ([\d.e-]+) px", camera.description)[1]
    )  # type: ignore[index]
    tangents = np.random.default_rng(3).uniform(-0.45, 0.45, (400, 2))
    x, y = tangents.T
    r2 = x**2 + y**2
    k1, k2, p1, p2, k3, k4, k5, k6 = RATIONAL
    g = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u, v = (
        x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
        y * g + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
    )
    expected = np.stack([501.25 * u + 325.5, 501.25 * v + 231.0625], axis=-1)
    found = points_of(camera, view(tmp_path, camera), tangents)
    assert 0 < misfit < 0.5
    assert np.abs(found - expected).max() < 1.2 * misfit + 1e-3


@pytest.mark.parametrize("format", ["ROS", exhaustive("nerfstudio")])
def test_a_fisheye_lens_becomes_a_table_of_image_heights(tmp_path: Path, format: str) -> None:
    """r = θ·(1 + k1·θ² + …), to 0.05 px of 640."""
    k = (-0.03, 0.004, -0.001, 0.0002)
    text = TEXTS["a.yaml"].replace("plumb_bob", "equidistant").replace("cols: 5", "cols: 4")
    text = text.replace(text.split("data: [")[2].partition("]")[0], ", ".join(map(str, k)))
    if format == "nerfstudio":
        coefficients = dict(zip(("k1", "k2", "k3", "k4"), k, strict=True), p1=0.0, p2=0.0)
        text = json.dumps(
            json.loads(TEXTS["transforms.json"])
            | coefficients
            | {"camera_model": "OPENCV_FISHEYE"}
        )
    camera = imported(tmp_path, "transforms.json" if format == "nerfstudio" else "a.yaml", text)
    angle, turn = np.random.default_rng(3).uniform(0, (0.78, 2 * np.pi), (400, 2)).T
    direction = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    radius = angle * (1 + k[0] * angle**2 + k[1] * angle**4 + k[2] * angle**6 + k[3] * angle**8)
    found = points_of(camera, view(tmp_path, camera), np.tan(angle)[:, None] * direction)
    np.testing.assert_allclose(
        found, 501.25 * radius[:, None] * direction + (325.5, 231.0625), atol=0.05
    )


def test_a_camera_without_distortion_and_a_blender_angle_are_read(tmp_path: Path) -> None:
    """camera_angle_x is the field of view along the rows, as in the synthetic scenes of NeRF."""
    camera = imported(
        tmp_path,
        "t.json",
        json.dumps({"camera_angle_x": 0.8, "w": 64, "h": 32, "frames": [{}]}),
    )
    assert camera.lens.distortion is None and (camera.sensor.columns, camera.sensor.rows) == (
        64,
        32,
    )
    assert f"fov {np.degrees(0.8):.7g}, principal_point_offset_x 0," in camera.description


PLAIN, JSON = TEXTS["a.yaml"], {"fl_x": 100, "w": 640, "h": 480}
WIDE = PLAIN.replace("plumb_bob", "fisheye").replace("501.25", "90.0").replace(", -0.01]", "]")
WRONG = {
    "no YAML": ("a.yml", "a: [1, 2", "YAML"),
    "long": ("a.yml", "#" * 5_000_000, "5000000"),
    "object": ("a.yml", "!!python/object/apply:os.system ['true']", "table"),
    "other": ("a.yml", "a: 1", "camera_matrix"),
    "size": ("a.yml", PLAIN.replace("image_width: 640", "image_width: 640.5"), "640.5"),
    "model": ("a.yml", PLAIN.replace("plumb_bob", "division"), "'division'"),
    "focal length": ("a.yml", PLAIN.replace("501.25", "-1.0"), "fx is -1"),
    "not finite": ("a.yml", PLAIN.replace("-0.21", ".nan"), "'.nan'"),
    "too many": ("a.yml", PLAIN.replace("-0.21", ", ".join("0" * 15)), "14"),
    "no XML": ("a.xml", "<opencv_storage><a>", "XML"),
    "wide": ("a.yml", WIDE, "85°"),
    "folds": ("t.json", json.dumps(JSON | {"k1": -0.2, "k4": -0.1}), "folds"),
    "JSON model": ("t.json", json.dumps(JSON | {"camera_model": "EQUI"}), "EQUI"),
    "no size": ("t.json", json.dumps({"fl_x": 100}), "w is None"),
    "other JSON": ("t.json", json.dumps({"frames": [{"fl": 1}]}), "fl_x"),
}


@pytest.mark.parametrize("case", WRONG.values(), ids=WRONG)
def test_a_wrong_calibration_is_refused_in_one_sentence(
    tmp_path: Path, case: tuple[str, str, str]
) -> None:
    name, text, message = case
    with pytest.raises(ms.InputError, match=re.escape(message)) as caught:
        imported(tmp_path, name, text)
    assert "\n" not in str(caught.value)
