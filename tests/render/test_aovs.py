"""AOVs of a scene against analytic geometry: a ball before a wall, seen by a pinhole of 60°.

No sampling is involved: bounds are those of float32 rays (2⁻²³ of the coordinates, a few of them in a row).
"""

from __future__ import annotations

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from helpers.scenes import (
    SKY,
    both_variants,
    scalar_first,
    scene_text,
    skip_unless_usable,
    write_scene,
)
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.output.exr import read_aovs_exr, read_irradiance_exr, write_aovs_exr
from mitsuba_sensor.render.light.bands import choose_bands
from mitsuba_sensor.render.load.scene import load_scene
from mitsuba_sensor.render.motion.aovs import Aovs, render_aovs
from mitsuba_sensor.render.samples import hashed_seed
from mitsuba_sensor.render.scene.motion import read_motion
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA = ms.load_camera("konnik_table1")
ROLLING = CAMERA.replace(**{"sensor.shutter": "rolling", "sensor.row_time_us": 1000.0})
COLUMNS, ROWS, FOCAL_PX = 30, 20, 15 / math.tan(math.radians(30))
POSE = '<transform name="to_world"><lookat origin="1, 2, -3" target="0, 0.5, 4" up="0, 1, 0.3"/></transform>'
SENSOR = f"""<sensor type="{{kind}}">{{{{more}}}}<film type="hdrfilm"><integer name="width" value="{COLUMNS}"/>
<integer name="height" value="{ROWS}"/>{{{{film}}}}</film>{{fields}}</sensor>"""
PINHOLE = SENSOR.format(kind="perspective", fields='<float name="fov" value="60"/>')
RED = '<bsdf type="diffuse"><spectrum name="reflectance" value="400:0.1, 600:0.1, 600.001:0.7, 700:0.7"/></bsdf>'
GREY = '<bsdf type="diffuse"><spectrum name="reflectance" value="360:0.4, 830:0.4"/></bsdf>'
BALL = f'<shape type="sphere" id="ball"><point name="center" value="0.3, 0.1, 4"/>{RED}</shape>'
WALL = f"""<shape type="rectangle" id="wall"><transform name="to_world"><scale x="90" y="90"/>
<rotate y="1" angle="180"/><translate z="6"/></transform>{GREY}</shape>"""
ARRAYS = ("depth_m", "position_m", "normal", "albedo", "shape_index", "flow_px")
Floats = NDArray[np.float64]


def aovs_of(
    folder: Path,
    *elements: str,
    sensor: str = PINHOLE,
    film: str = "",
    more: str = "",
    **how: Any,
) -> Aovs:
    use(choose_variant(skip_unless_usable(how.pop("variant", "scalar_spectral"))))
    path = write_scene(folder, scene_text(SKY, *elements, sensor=sensor, film=film, more=more))
    return render_aovs(path, how.pop("camera", CAMERA), **how)


def tangents(x: Floats, y: Floats) -> Floats:
    """Direction (left, up, 1) of places on the film [pixels], of a pinhole in Mitsuba's frame."""
    return np.stack(
        [(COLUMNS / 2 - x) / FOCAL_PX, (ROWS / 2 - y) / FOCAL_PX, np.ones_like(x)], axis=-1
    )


def centres() -> tuple[Floats, Floats]:
    x, y = np.meshgrid(np.arange(COLUMNS) + 0.5, np.arange(ROWS) + 0.5)
    return x, y


def ball_and_wall(origin: Floats, ray: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Whether rays hit the ball, and their distance in units of ``ray`` to ball or wall."""
    centre = np.array([0.3, 0.1, 4]) - origin
    a, b, c = (ray**2).sum(-1), ray @ centre, centre @ centre - 1
    root = b**2 - a * c
    ball = (b - np.sqrt(np.maximum(root, 0))) / a
    return root > 0, np.where(root > 0, ball, (6 - origin[2]) / ray[..., 2])


@both_variants
@pytest.mark.parametrize("posed", [False, True], ids=["at the origin", "posed"])
def test_depth_position_normal_and_shape_have_their_closed_forms(
    tmp_path: Path, posed: bool, variant: str
) -> None:
    """Depth is along the optical axis, position and normal are in the world, to 5e-6 of 10 m."""
    aovs = aovs_of(tmp_path, BALL, WALL, more=POSE if posed else "", variant=variant)
    matrix = np.eye(4)
    if posed:
        forward = np.array([-1, -1.5, 7]) / np.linalg.norm([-1, -1.5, 7])
        left = np.cross([0, 1, 0.3], forward)
        left /= np.linalg.norm(left)
        matrix[:3] = np.column_stack([left, np.cross(forward, left), forward, [1, 2, -3]])
    ray = tangents(*centres()) @ matrix[:3, :3].T
    ball, depth = ball_and_wall(matrix[:3, 3], ray)
    position = matrix[:3, 3] + depth[..., None] * ray
    normal = np.where(ball[..., None], position - [0.3, 0.1, 4], [0, 0, -1])
    assert 20 < ball.sum() < 300
    np.testing.assert_array_equal(aovs.shape_index, np.where(ball, 0, 1))
    np.testing.assert_allclose(aovs.depth_m, depth, atol=5e-5)
    np.testing.assert_allclose(aovs.position_m, position, atol=5e-5)
    np.testing.assert_allclose(aovs.normal, normal, atol=2e-5)
    np.testing.assert_allclose(np.linalg.norm(aovs.normal, axis=-1), 1, atol=1e-6)
    assert aovs.shapes == ("ball", "wall")
    assert all(getattr(aovs, name).dtype == np.float32 for name in ARRAYS)


@scalar_first
def test_albedo_is_the_diffuse_reflectance_in_three_bands_and_none_of_metal(
    tmp_path: Path, variant: str
) -> None:
    """0.7 in red and 0.1 elsewhere; metal has none, rough or not; whatever light there is."""
    mirror = '<shape type="sphere"><point name="center" value="-1.5, 0, 4"/><bsdf type="roughconductor"/></shape>'
    aovs = aovs_of(tmp_path, BALL, WALL, mirror, variant=variant)
    for number, albedo in ((0, (0.7, 0.1, 0.1)), (1, (0.4, 0.4, 0.4)), (2, (0.0, 0.0, 0.0))):
        mine = aovs.albedo[aovs.shape_index == number]
        assert len(mine) > 5
        np.testing.assert_allclose(mine, np.broadcast_to(albedo, mine.shape), atol=1e-6)
    assert aovs.shapes[2] == "sphere 2"


def image_of(points: Floats) -> Floats:
    """Places on the film of points in the camera's frame."""
    return np.array([COLUMNS / 2, ROWS / 2]) - FOCAL_PX * points[..., :2] / points[..., 2:]


@scalar_first
def test_flow_of_a_camera_that_shifts_is_v_t_f_over_z(tmp_path: Path, variant: str) -> None:
    """3 m/s to the left for 20 ms: 0.06·f/Z pixels to the right, to 0.001 px; straight ahead, away from the axis."""
    _, depth = ball_and_wall(np.zeros(3), tangents(*centres()))
    side = {
        "motion": read_motion({"camera": {"velocity_m_per_s": [3, 0, 0]}}),
        "exposure": ms.Exposure(0.02),
    }
    flow = aovs_of(tmp_path, BALL, WALL, variant=variant, **side).flow_px
    np.testing.assert_allclose(flow[..., 0], 0.06 * FOCAL_PX / depth, atol=1e-3)
    np.testing.assert_allclose(flow[..., 1], 0, atol=1e-3)
    ahead = {
        "motion": read_motion({"camera": {"velocity_m_per_s": [0, 0, 10]}}),
        "exposure": ms.Exposure(0.02),
    }
    flow = aovs_of(tmp_path, BALL, WALL, variant=variant, **ahead).flow_px
    away = np.stack(centres(), axis=-1) - [COLUMNS / 2, ROWS / 2]
    np.testing.assert_allclose(flow, away * (depth / (depth - 0.2) - 1)[..., None], atol=1e-3)


def test_flow_of_a_camera_that_turns_is_that_of_directions_and_the_background_is_far(
    tmp_path: Path,
) -> None:
    """A turn by 3° about the vertical moves every picture point alike, whatever its depth."""
    turn = read_motion({"camera": {"rotate_deg_per_s": 30, "axis": [0, 1, 0]}})
    flow = aovs_of(tmp_path, BALL, motion=turn, exposure=ms.Exposure(0.1)).flow_px
    a, ray = math.radians(3), tangents(*centres())
    back = (
        ray
        @ np.array([[math.cos(a), 0, -math.sin(a)], [0, 1, 0], [math.sin(a), 0, math.cos(a)]]).T
    )
    np.testing.assert_allclose(flow, image_of(back) - np.stack(centres(), axis=-1), atol=1e-3)
    side = read_motion({"camera": {"velocity_m_per_s": [3, 0, 0]}})
    shifted = aovs_of(tmp_path, BALL, motion=side, exposure=ms.Exposure(0.1))
    np.testing.assert_allclose(shifted.flow_px[shifted.shape_index < 0], 0, atol=1e-3)


@scalar_first
def test_normals_of_a_mesh_turn_with_it(tmp_path: Path, variant: str) -> None:
    """A cube turned by 30° about the vertical before the row opens: its faces look 30° and 60° beside the axis."""
    cube = '<shape type="cube" id="it"><transform name="to_world"><translate z="5"/></transform></shape>'
    key = {"time_s": 0, "turn_deg": 30, "axis": [0, 1, 0]}
    turn = read_motion({"objects": {"it": {"pivot_m": [0, 0, 5], "keys": [key]}}})
    normal = aovs_of(
        tmp_path, cube, motion=turn, exposure=ms.Exposure(0.1), variant=variant
    ).normal[ROWS // 2]
    faces = {tuple(n) for n in np.round(normal.astype(float), 3).tolist()} - {(0.0, 0.0, 0.0)}
    assert faces == {(-0.5, 0.0, -0.866), (0.866, 0.0, -0.5)}


def test_flow_goes_through_a_distorting_lens(tmp_path: Path) -> None:
    """Positions and flow of 20 % of barrel distortion: each place is f·t·(1 + k₁t²), t the tangent, to 0.01 px.

    (The flow of points that stay on the film.)
    """
    k1 = -0.2
    camera = CAMERA.replace(**{"lens.distortion": [k1, 0.0, 0.0, 0.0, 0.0]})
    side = {
        "motion": read_motion({"camera": {"velocity_m_per_s": [3, 1, 0]}}),
        "exposure": ms.Exposure(0.1),
    }
    aovs = aovs_of(tmp_path, BALL, WALL, variant="llvm_ad_spectral", camera=camera, **side)

    def seen(points: Floats) -> Floats:
        t = points[..., :2] / points[..., 2:]
        return np.array([COLUMNS / 2, ROWS / 2]) - FOCAL_PX * t * (
            1 + k1 * (t**2).sum(-1, keepdims=True)
        )

    position = aovs.position_m.astype(float)
    np.testing.assert_allclose(seen(position), np.stack(centres(), axis=-1), atol=0.01)
    after = seen(position - [0.3, 0.1, 0])
    stays = ((after > 0) & (after < [COLUMNS, ROWS])).all(axis=-1)
    assert stays.mean() > 0.9
    np.testing.assert_allclose(aovs.flow_px[stays], (after - seen(position))[stays], atol=0.01)


@scalar_first
def test_rows_of_a_rolling_shutter_are_seen_when_they_open(
    tmp_path: Path, variant: str
) -> None:
    """Camera 2 m/s to the left, ball 5 m/s up, 1 ms a row: row r is the still scene at r ms."""
    moves = {"ball": {"velocity_m_per_s": [0, 5, 0]}}
    motion = read_motion({"camera": {"velocity_m_per_s": [2, 0, 0]}, "objects": moves})
    how: dict[str, Any] = {"motion": motion, "exposure": ms.Exposure(0.002), "variant": variant}
    rolling = aovs_of(tmp_path, BALL, WALL, camera=ROLLING, **how)
    ray, when = tangents(*centres()), np.arange(ROWS) * 1e-3
    for row in range(ROWS):
        relative = np.array([2 * when[row], -5 * when[row], 0])
        ball, depth = ball_and_wall(relative, ray[row])
        np.testing.assert_array_equal(rolling.shape_index[row], np.where(ball, 0, 1))
        np.testing.assert_allclose(rolling.depth_m[row], depth, atol=2e-5)
        np.testing.assert_allclose(
            rolling.position_m[row, :, 0], 2 * when[row] + depth * ray[row, :, 0], atol=2e-5
        )
        shift = np.where(ball, -0.01, 0) * FOCAL_PX / depth
        np.testing.assert_allclose(rolling.flow_px[row, :, 1], shift, atol=1e-3)


def test_the_aovs_lie_on_the_rendered_frame(tmp_path: Path) -> None:
    """A glowing ball on black: a pixel that is lit over 95 % of it is the ball's, one below 5 % is not."""
    glow = BALL.replace(
        RED, '<emitter type="area"><spectrum name="radiance" value="360:1, 830:1"/></emitter>'
    )
    aovs = aovs_of(tmp_path, glow)
    scene = load_scene(tmp_path / "scene.xml", choose_bands(CAMERA, 550.0, 10.0, "auto"), {})
    lit = scene.render(hashed_seed(1, 0, 0), 64, (0, ROWS))[..., 0] / 10
    sky = 2e-4
    cover = (lit - sky) / (1 - sky)
    assert (aovs.shape_index[cover > 0.95] == 0).all() and (
        aovs.shape_index[cover < 0.05] == -1
    ).all()
    mask = aovs.shape_index == 0
    for axis in (0, 1):
        places = np.indices(mask.shape)[axis]
        assert np.average(places, weights=cover) == pytest.approx(
            np.average(places, weights=mask), abs=0.2
        )
    assert cover.sum() == pytest.approx(mask.sum(), rel=0.05)


def test_a_telecentric_sensor_sees_and_moves_without_perspective(tmp_path: Path) -> None:
    """Orthographic, 4 m across: depth is the z of the point, a shift of 0.2 m is 1.5 of 30 pixels at any depth."""
    zoom = '<transform name="to_world"><scale x="2" y="2"/></transform>'
    sensor = SENSOR.format(kind="orthographic", fields=zoom)
    side = {
        "motion": read_motion({"camera": {"velocity_m_per_s": [2, 0, 0]}}),
        "exposure": ms.Exposure(0.1),
    }
    aovs = aovs_of(tmp_path, BALL, WALL, sensor=sensor, **side)
    np.testing.assert_allclose(aovs.depth_m, aovs.position_m[..., 2], atol=1e-5)
    assert set(np.unique(aovs.shape_index)) == {0, 1}
    np.testing.assert_allclose(
        aovs.flow_px, np.broadcast_to([1.5, 0], aovs.flow_px.shape), atol=1e-3
    )


def test_lengths_are_metres_whatever_the_unit_of_the_scene(tmp_path: Path) -> None:
    """A scene in millimetres with the same motion in metres: depth, position and flow are those of the metre scene."""
    turn = {"rotate_deg_per_s": 9, "axis": [0, 1, 0], "pivot_m": [0, 0, 1]}
    motion = read_motion({"camera": {"velocity_m_per_s": [1, 0, 0], **turn}})
    how: dict[str, Any] = {"motion": motion, "exposure": ms.Exposure(0.1)}
    metres = aovs_of(tmp_path, BALL, WALL, **how)
    big = BALL.replace("0.3, 0.1, 4", "300, 100, 4000").replace(
        "/>", '/><float name="radius" value="1000"/>', 1
    )
    far = WALL.replace('z="6"', 'z="6000"').replace('"90"', '"90000"')
    clip = '<float name="near_clip" value="10"/><float name="far_clip" value="1e7"/>'
    millimetres = aovs_of(tmp_path, big, far, more=clip, scene_unit="mm", **how)
    for name in ARRAYS:
        np.testing.assert_allclose(
            getattr(millimetres, name), getattr(metres, name), atol=3e-4, err_msg=name
        )


def test_written_and_read_aovs_are_the_same(tmp_path: Path) -> None:
    """Float32 to the bit, NaN and infinity too; the header says the units and the shapes; others' files are refused."""
    turn = read_motion({"camera": {"rotate_deg_per_s": 30, "axis": [0, 1, 0]}})
    aovs = aovs_of(tmp_path, BALL, motion=turn, exposure=ms.Exposure(0.1))
    write_aovs_exr(tmp_path / "aovs.exr", aovs)
    back = read_aovs_exr(tmp_path / "aovs.exr")
    for field in fields(Aovs):
        np.testing.assert_array_equal(
            getattr(back, field.name), getattr(aovs, field.name), err_msg=field.name
        )
    with OpenEXR.File(str(tmp_path / "aovs.exr"), separate_channels=True) as file:
        header, names = dict(file.header()), set(file.channels())
    assert {
        "depth_m",
        "position_m.X",
        "normal.Z",
        "albedo.R",
        "shape_index",
        "flow_px.Y",
    } <= names and len(names) == 13
    assert json.loads(header["shapes"]) == ["ball"] and json.loads(header["units"])[
        "depth_m"
    ].startswith("m along")
    with pytest.raises(ms.InputError, match=r"cannot read .*none\.exr"):
        read_aovs_exr(tmp_path / "none.exr")
    with pytest.raises(ms.InputError, match="not the focal-plane irradiance"):
        read_irradiance_exr(tmp_path / "aovs.exr")
    cut = tmp_path / "cut.exr"
    cut.write_bytes((tmp_path / "aovs.exr").read_bytes()[:500])
    with pytest.raises(ms.InputError, match="cannot be read as an OpenEXR file"):
        read_aovs_exr(cut)
