"""Motion during an exposure: blur and skew against closed forms, weights that add up, poses that come back.

The picture is a bright half plane on black, seen by a perspective sensor of 24 columns and 60°: one metre beside the
axis, at distance Z, is f/Z = 20.78/Z pixels. A column of the ramp has, with 8 passes of 16 samples and random instants,
a standard error of at most 0.01 of the brightness, an edge found from a row of it at most 0.03 px, and 0.04 px with 4
passes: every bound below is more than five of them, and the seeds are fixed.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import (
    SCENES,
    SKY,
    scalar_first,
    scene_text,
    skip_unless_usable,
    write_scene,
)
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.options import complete
from mitsuba_sensor.optics.shutter import STEP_PX, Shutter, subframes
from mitsuba_sensor.render.light.bands import choose_bands
from mitsuba_sensor.render.load.scene import Scene, load_scene
from mitsuba_sensor.render.motion.moving_scene import (
    AnimatedTransforms,
    MovingScene,
)
from mitsuba_sensor.render.options import RenderOptions
from mitsuba_sensor.render.samples import hashed_seed
from mitsuba_sensor.render.scene.motion import Motion, read_motion
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

GLOBAL = ms.load_camera("konnik_table1")
ROLLING = GLOBAL.replace(**{"sensor.shutter": "rolling", "sensor.row_time_us": 1000.0})
COLUMNS, ROWS, FOCAL_PX = 24, 16, 12 / math.tan(math.radians(30))
SENSOR = f"""<sensor type="perspective"><float name="fov" value="60"/>{{more}}<film type="hdrfilm">
<integer name="width" value="{COLUMNS}"/><integer name="height" value="{ROWS}"/>{{film}}</film></sensor>"""
GLOW = '<emitter type="area"><spectrum name="radiance" value="360:1, 830:1"/></emitter>'
EDGE = f"""<shape type="rectangle" id="edge"><transform name="to_world"><scale x="50" y="50"/>
<rotate y="1" angle="180"/><translate x="50" z="4"/></transform>{GLOW}</shape>"""
SPEED_M_PER_S = 10.0
SPEED_PX_PER_S = SPEED_M_PER_S * FOCAL_PX / 4
RIGHT = {  # what moves the edge to the right of the picture: world −x, because a camera's x axis points to the left
    "camera": read_motion({"camera": {"velocity_m_per_s": [SPEED_M_PER_S, 0, 0]}}),
    "object": read_motion({"objects": {"edge": {"velocity_m_per_s": [-SPEED_M_PER_S, 0, 0]}}}),
}


def loaded(
    folder: Path, *elements: str, film: str = "", variant: str = "scalar_spectral"
) -> Scene:
    use(choose_variant(skip_unless_usable(variant)))
    text = scene_text(*elements, sensor=SENSOR, film=film)
    return load_scene(write_scene(folder, text), choose_bands(GLOBAL, 550.0, 10.0, "auto"), {})


def picture(
    scene: Scene | MovingScene, passes: int = 8, samples: int = 16
) -> NDArray[np.float64]:
    """Mean of some passes over the brightness of the edge, (rows, columns)."""
    rows, frames = (0, scene.view.crop_size[1]), []
    for k in range(passes):
        if isinstance(scene, MovingScene):
            scene.begin_pass(1, k)
        frames.append(scene.render(hashed_seed(1, 0, k), samples, rows)[..., 0])
    return np.mean(frames, axis=0, dtype=np.float64) / 10.0  # L dλ over 10 nm


def ramp(edge_px: NDArray[np.float64], blur_px: float) -> NDArray[np.float64]:
    """Mean over the pixels of an edge, bright on its left, that moves by ``blur_px`` to end at ``edge_px``."""
    fine = (np.arange(COLUMNS * 64) + 0.5) / 64
    shade = np.clip((np.asarray(edge_px)[..., None] - fine) / blur_px, 0, 1)
    return shade.reshape(*shade.shape[:-1], COLUMNS, 64).mean(axis=-1)


def width_px(row: NDArray[np.float64]) -> float:
    """Length of the ramp: that of a box with the second moment of the slope, less the pixel's own 1/12."""
    slope, at = -np.diff(row), np.arange(len(row) - 1)
    mean = np.average(at, weights=slope)
    return math.sqrt(
        12 * np.average((at - mean) ** 2, weights=slope) - 2
    )  # a difference of two pixels: 1/12 twice


@scalar_first
@pytest.mark.parametrize("who", one_in(2, ["camera", "object"]))
def test_a_moving_edge_blurs_by_speed_times_time(
    tmp_path: Path, who: str, variant: str
) -> None:
    """10 m/s at 4 m in 0.1 s: 5.2 px, within 0.25 px, and every pixel of the ramp within 0.05 of the closed form."""
    moving = MovingScene(
        loaded(tmp_path, EDGE, variant=variant), RIGHT[who], GLOBAL, ms.Exposure(0.1)
    )
    mean = picture(moving).mean(axis=0)
    blur = SPEED_PX_PER_S * 0.1
    assert width_px(mean) == pytest.approx(blur, abs=0.25)
    np.testing.assert_allclose(mean, ramp(np.array(COLUMNS / 2 + blur), blur), atol=0.05)


@scalar_first
def test_a_rolling_shutter_skews_by_speed_times_row_time_times_rows(
    tmp_path: Path, variant: str
) -> None:
    """15 rows of 1 ms at 52 px/s: 0.78 px from top to bottom, times ten; each row to 0.25 px, and blurred by v·t."""
    fast = read_motion({"objects": {"edge": {"velocity_m_per_s": [-60.0, 0, 0]}}})
    speed = 60 * FOCAL_PX / 4
    moving = MovingScene(
        loaded(tmp_path, EDGE, variant=variant), fast, ROLLING, ms.Exposure(0.008)
    )
    frame = picture(moving, 4)
    edges = frame.sum(axis=1)
    skew = np.polyfit(np.arange(ROWS), edges, 1)[0] * ROWS
    assert skew == pytest.approx(speed * 1e-3 * ROWS, abs=0.25)
    ends = COLUMNS / 2 + speed * (np.arange(ROWS) * 1e-3 + 0.008)
    np.testing.assert_allclose(edges, ends - speed * 0.008 / 2, atol=0.25)
    np.testing.assert_allclose(frame, ramp(ends, speed * 0.008), atol=0.2)
    aligned = np.mean(
        [
            np.interp(np.arange(-6, 7) + edge, np.arange(COLUMNS) + 0.5, row)
            for edge, row in zip(edges, frame, strict=True)
        ],
        axis=0,
    )
    assert width_px(aligned) == pytest.approx(speed * 0.008, abs=0.5)


def test_an_exposure_shorter_than_a_row_is_skewed_as_much_and_hardly_blurred(
    tmp_path: Path,
) -> None:
    """Rows share the sub-frames within half a pixel of motion: each edge to 0.25 px, in at most three per pixel."""
    moving = MovingScene(loaded(tmp_path, EDGE), RIGHT["object"], ROLLING, ms.Exposure(1e-5))
    edges = picture(moving, 4).sum(axis=1)
    np.testing.assert_allclose(
        edges, COLUMNS / 2 + SPEED_PX_PER_S * np.arange(ROWS) * 1e-3, atol=0.25
    )
    frozen = MovingScene(loaded(tmp_path, EDGE), RIGHT["object"], GLOBAL, ms.Exposure(0.0))
    np.testing.assert_allclose(picture(frozen), picture(loaded(tmp_path, EDGE)), atol=1e-6)


def test_a_crop_sees_the_rows_of_the_full_frame_at_their_own_times(tmp_path: Path) -> None:
    """Row r of the film opens at r·t_row, whichever rows are rendered."""
    crop = "".join(
        f'<integer name="crop_{k}" value="{v}"/>'
        for k, v in (("width", COLUMNS), ("height", 4), ("offset_x", 0), ("offset_y", 10))
    )
    fast = read_motion({"objects": {"edge": {"velocity_m_per_s": [-60.0, 0, 0]}}})
    moving = MovingScene(loaded(tmp_path, EDGE, film=crop), fast, ROLLING, ms.Exposure(0.004))
    middle_s = np.arange(10, 14) * 1e-3 + 0.002
    np.testing.assert_allclose(
        picture(moving).sum(axis=1), COLUMNS / 2 + 60 * FOCAL_PX / 4 * middle_s, atol=0.25
    )


@scalar_first
@pytest.mark.parametrize("camera", one_in(2, [ROLLING, GLOBAL]), ids=["rolling", "global"])
def test_motion_through_even_light_changes_nothing(
    tmp_path: Path, camera: Any, variant: str
) -> None:
    """Energy is kept: under a uniform sky each pixel of each pass is what it is at rest, to float32."""
    still = loaded(tmp_path, SKY, variant=variant)
    motion = read_motion(
        {"camera": {"velocity_m_per_s": [3, 2, 1], "rotate_deg_per_s": 900, "axis": [1, 1, 0]}}
    )
    moving = MovingScene(still, motion, camera, ms.Exposure(0.02))
    np.testing.assert_allclose(picture(moving, 1, 9), picture(still, 1, 9), rtol=1e-6)


def test_an_infinite_value_saturates_its_own_rows_only(tmp_path: Path) -> None:
    """Rows 8 and on are infinite whenever they are looked at; the rows above, closed or open, are not touched."""
    moving = MovingScene(loaded(tmp_path, SKY), RIGHT["camera"], ROLLING, ms.Exposure(0.02))
    render = moving.scene.render

    class Glaring:
        view = moving.view

        def render(self, seed: int, samples: int, rows: tuple[int, int]) -> NDArray[np.float32]:
            frame = render(seed, samples, rows)
            frame[max(8 - rows[0], 0) :] = np.inf
            return frame

    moving.scene = Glaring()  # type: ignore[assignment]
    frame = moving.render(1, 4, (0, ROWS))
    assert np.isfinite(frame[:8]).all() and np.isposinf(frame[8:]).all()


def test_the_weights_of_every_row_add_up_to_one_and_lie_in_its_own_exposure() -> None:
    shutter, rows = Shutter(open_s=0.01, row_time_s=0.0007), (5, 45)
    for count in (1, 3, 8):
        step = shutter.step_s(count, math.inf, rows)
        for phase in (0.0, 0.37, 0.999999):
            times_s, weights = subframes(shutter, rows, count, step, phase)
            assert (weights.sum(axis=1) == pytest.approx(1.0, abs=1e-15)) and weights.shape == (
                40,
                len(times_s),
            )
            assert weights[:, 0].any() and weights[:, -1].any()
            late = times_s - shutter.start_s(np.arange(*rows))[:, None]
            assert (late[weights > 0] > -1e-12).all() and (
                late[weights > 0] < 0.01 + 1e-12
            ).all()


@pytest.mark.parametrize("row_time_s", [0.0, 0.0007])
def test_over_the_passes_every_instant_of_an_exposure_has_the_same_chance(
    row_time_s: float,
) -> None:
    """With 50 even phases the instants of a row are (i + ½)·t/(50·m) from its start: no ghosts, no preferred time."""
    shutter, count = Shutter(0.01, row_time_s), 4
    step = shutter.step_s(count, math.inf, (0, 20))
    cuts = [subframes(shutter, (0, 20), count, step, (j + 0.5) / 50) for j in range(50)]
    for row in (0, 7, 19):
        instants = np.sort(
            np.concatenate([times_s[weights[row] > 0] for times_s, weights in cuts])
        )
        even = row * row_time_s + (np.arange(200) + 0.5) * 0.01 / 200
        np.testing.assert_allclose(instants, even, atol=0.01 / 200 / 2 + 1e-12)
        assert instants.mean() == pytest.approx(row * row_time_s + 0.005, abs=0.01 / 400)


def test_rows_share_a_sub_frame_where_the_picture_moves_less_than_half_a_pixel() -> None:
    """Centred on the middle of the exposure, over the phases; and never more sub-frames than motion asks for."""
    shutter, speed = Shutter(1e-4, 1e-3), 20.0
    step = shutter.step_s(1, speed, (0, 200))
    assert step == STEP_PX / speed
    cuts = [subframes(shutter, (0, 200), 1, step, (j + 0.5) / 64) for j in range(64)]
    seen = np.mean([times_s[weights.argmax(axis=1)] for times_s, weights in cuts], axis=0)
    np.testing.assert_allclose(seen, np.arange(200) * 1e-3 + 5e-5, atol=step / 64)
    assert all(len(times_s) <= 200e-3 / step + 2 for times_s, _ in cuts)
    assert shutter.step_s(1, 0.0, (0, 200)) == pytest.approx(199e-3 + 1e-4)


@pytest.mark.parametrize("who", one_in(2, ["camera", "object"]))
def test_the_fastest_thing_decides_how_many_sub_frames(tmp_path: Path, who: str) -> None:
    """52 px/s: in 0.1 s 5.2 px, 11 sub-frames of half a pixel, 16 of the 16 samples; the notes tell."""
    moving = MovingScene(loaded(tmp_path, EDGE), RIGHT[who], GLOBAL, ms.Exposure(0.1))
    assert moving.speed_px_per_s == pytest.approx(SPEED_PX_PER_S, rel=0.01)
    moving.render(1, 16, (0, 2))
    assert moving.notes[-1] == (
        "16 sub-frames per exposure and pass; the image moves up to 5.2 px while a row is open"
    )
    few = MovingScene(loaded(tmp_path, EDGE), RIGHT[who], GLOBAL, ms.Exposure(0.1), subframes=3)
    few.render(1, 16, (0, 2))
    assert few.notes[-1].startswith("4 sub-frames") and "11 would be smooth" in few.notes[-1]


KINDS = {
    "sphere": '<shape type="sphere" id="it"><point name="center" value="0,0,5"/>{glow}</shape>',
    "mesh": '<shape type="cube" id="it"><transform name="to_world"><translate z="5"/></transform>{glow}</shape>',
    "flat": '<shape type="rectangle" id="it"><transform name="to_world"><translate z="4"/></transform>{glow}</shape>',
    "instance": '<shape type="shapegroup" id="group"><shape type="cube"/></shape><shape type="instance" id="it">'
    '<ref id="group"/><transform name="to_world"><translate z="5"/></transform></shape>',
}


def distance_m(scene: Scene) -> float:
    mi = mitsuba()
    hit = scene.mitsuba_scene.ray_intersect(mi.Ray3f(mi.Point3f(0, 0, 0), mi.Vector3f(0, 0, 1)))
    return float(np.ravel(hit.t)[0])


@scalar_first
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_shape_moves_turns_and_comes_back(
    tmp_path: Path, kind: str, variant: str
) -> None:
    """One metre away in 0.1 s, and a quarter turn about a pivot beside it takes it out of the ray."""
    scene = loaded(tmp_path, SKY, KINDS[kind].format(glow=GLOW), variant=variant)
    before = distance_m(scene)
    away = read_motion({"objects": {"it": {"velocity_m_per_s": [0, 0, 10]}}})
    with AnimatedTransforms(scene, away) as transforms:
        transforms.set_time(0.1)
        assert distance_m(scene) == pytest.approx(before + 1, abs=1e-4)
    assert distance_m(scene) == pytest.approx(before, abs=1e-6)
    turn = {"rotate_deg_per_s": 90, "axis": [0, 1, 0], "pivot_m": [20, 0, 5]}
    with AnimatedTransforms(scene, read_motion({"objects": {"it": turn}})) as transforms:
        transforms.set_time(1.0)
        assert math.isinf(distance_m(scene))
    assert distance_m(scene) == pytest.approx(before, abs=1e-6)


@scalar_first
def test_a_spot_light_moves_turns_and_comes_back(tmp_path: Path, variant: str) -> None:
    """The patch that it lights goes where it goes: out of the picture, and half a turn takes the light away from it."""
    spot = '<emitter type="spot" id="beam"><transform name="to_world"><translate z="1"/></transform></emitter>'
    wall = '<shape type="rectangle" id="wall"><transform name="to_world"><scale value="9"/><rotate y="1" angle="180"/>'
    scene = loaded(
        tmp_path, spot, wall + '<translate z="4"/></transform></shape>', variant=variant
    )

    def lit(moves: dict[str, Any], time_s: float) -> float:
        motion = read_motion({"objects": {"beam": moves}})
        with AnimatedTransforms(scene, motion) as transforms:
            transforms.set_time(time_s)
            return float(scene.render(1, 16, (0, ROWS)).max())

    away = {"velocity_m_per_s": [100, 0, 0]}
    turn = {"rotate_deg_per_s": 180, "axis": [0, 1, 0], "pivot_m": [0, 0, 1]}
    before = lit(away, 0)
    assert before > 0 and lit(away, 1) == 0 and lit(turn, 1) == 0
    assert lit(turn, 2) == pytest.approx(before, rel=1e-4)


def test_steady_velocities_have_their_closed_form() -> None:
    """A quarter turn about z through (1, 0, 0) takes the origin to (1, −1, 0); then the shift is added."""
    body = read_motion(
        {
            "objects": {
                "it": {
                    "rotate_deg_per_s": 90,
                    "axis": [0, 0, 2],
                    "pivot_m": [1, 0, 0],
                    "velocity_m_per_s": [0, 0, 3],
                }
            }
        }
    ).objects["it"]
    np.testing.assert_allclose(body.displacement(1.0) @ [0, 0, 0, 1], [1, -1, 3, 1], atol=1e-12)
    np.testing.assert_array_equal(body.displacement(0.0), np.eye(4))


def test_keys_are_joined_by_straight_lines_and_shorter_arcs_and_held_at_the_ends() -> None:
    keys = [
        {"time_s": 0.0},
        {"time_s": 2.0, "move_m": [4, 0, 0], "turn_deg": 90, "axis": [0, 0, 1]},
    ]
    body = read_motion({"objects": {"it": {"pivot_m": [0, 1, 0], "keys": keys}}}).objects["it"]
    half = body.displacement(1.0)
    np.testing.assert_allclose(half @ [0, 1, 0, 1], [2, 1, 0, 1], atol=1e-12)
    np.testing.assert_allclose(
        half[:2, :2], np.array([[1, -1], [1, 1]]) / math.sqrt(2), atol=1e-12
    )
    np.testing.assert_array_equal(body.displacement(-1.0), body.displacement(0.0))
    np.testing.assert_array_equal(body.displacement(9.0), body.displacement(2.0))
    within_float32 = read_motion(
        {"camera": {"keys": [{"time_s": 0, "move_m": [1, 2, 3]}]}}
    ).camera
    assert within_float32 is not None
    np.testing.assert_array_equal(within_float32.displacement(5.0)[:3, 3], [1, 2, 3])


def test_a_camera_key_is_the_pose_that_mitsuba_makes_of_the_same_values() -> None:
    """Whatever pose, zoom or mirror the scene's camera begins with."""
    mi = use(choose_variant("scalar_spectral"))
    look = {"origin": [1, 2, 3], "target": [0, 0.5, -1], "up": [0, 0, 1]}
    wanted = np.array(mi.ScalarTransform4f().look_at(**look).matrix)
    fields = {
        "time_s": 0,
        "origin_m": look["origin"],
        "target_m": look["target"],
        "up": look["up"],
    }
    for zoom in (np.eye(4), np.diag([2.0, 2.0, 1.0, 1.0]), np.diag([-1.0, 1.0, 1.0, 1.0])):
        base = (
            np.array(
                mi.ScalarTransform4f()
                .look_at(origin=[5, 0, 1], target=[0, 1, 0], up=[0, 1, 0])
                .matrix
            )
            @ zoom
        )
        for key in (fields, {"time_s": 0, "to_world": wanted.tolist()}):
            camera = read_motion({"camera": {"keys": [key]}}).camera
            assert camera is not None
            np.testing.assert_allclose(
                camera.displacement(3.0, base) @ base, wanted @ zoom, atol=1e-6
            )


TURN = {"rotate_deg_per_s": 90, "axis": [0, 1, 0]}
MISTAKES: dict[str, tuple[Any, str]] = {
    "nothing": ({}, r"moves nothing; give it a table \[camera\] or \[objects\.ID\]"),
    "both ways": ({"camera": {**TURN, "keys": [{"time_s": 0}]}}, "or keys, and not both"),
    "no axis": (
        {"camera": {"rotate_deg_per_s": 9}},
        "has rotate_deg_per_s and no axis; a rotation needs both",
    ),
    "a null axis": (
        {"camera": {"rotate_deg_per_s": 9, "axis": [0, 0, 0]}},
        r"axis is \[0, 0, 0\]; give a",
    ),
    "no pivot": (
        {"objects": {"fan": TURN}},
        r"objects\.fan: rotates and has no pivot_m; give its fixed point",
    ),
    "no time": (
        {"camera": {"keys": [{"move_m": [0, 0, 1]}]}},
        r"camera\.keys\.0\.time_s is missing; add it, e\.g\. 0\.01",
    ),
    "an order": (
        {"camera": {"keys": [{"time_s": 1}, {"time_s": 1}]}},
        "has time_s 1 after 1; the times must increase",
    ),
    "a place of an object": (
        {"objects": {"it": {"keys": [{"time_s": 0, "to_world": np.eye(4).tolist()}]}}},
        "has to_world, which belongs to the camera",
    ),
    "half a place": (
        {"camera": {"keys": [{"time_s": 0, "origin_m": [0, 0, 0]}]}},
        "one of move_m and turn_deg, origin_m",
    ),
    "a stretch": (
        {"camera": {"keys": [{"time_s": 0, "to_world": np.diag([2.0, 1, 1, 1]).tolist()}]}},
        "is not a rotation and a translation; remove scale, shear and mirroring",
    ),
    "up": (
        {"camera": {"keys": [{"time_s": 0, "origin_m": [0, 0, 0], "target_m": [0, 1, 0]}]}},
        "target_m is at origin_m, or up is along the view",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_in_a_motion_has_its_sentence(name: str) -> None:
    data, sentence = MISTAKES[name]
    with pytest.raises(ms.InputError, match=sentence):
        read_motion(data)
    assert read_motion(RIGHT["camera"]) is RIGHT["camera"]


def test_a_motion_file_that_is_not_there_or_not_toml_or_not_of_this_scene_is_said_so(
    tmp_path: Path,
) -> None:
    with pytest.raises(
        ms.InputError, match=r"motion file '.*none\.toml' cannot be read: No such file"
    ):
        read_motion(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("camera = [", encoding="utf-8")
    with pytest.raises(ms.InputError, match="is not valid TOML"):
        read_motion(tmp_path / "bad.toml")
    wrong = read_motion({"objects": {"edg": {"velocity_m_per_s": [1, 0, 0]}}})
    with pytest.raises(
        ms.InputError,
        match=r"'edg', which is neither a shape of the scene .* the ids are edge\. Did you mean 'edge'",
    ):
        MovingScene(loaded(tmp_path, EDGE), wrong, GLOBAL, ms.Exposure(0.1))
    for bad in (0, 2.5, "many"):
        with pytest.raises(ms.InputError, match="subframes is"):
            complete(RenderOptions, {"subframes": bad})


def test_the_shipped_example_is_a_fan_that_turns(tmp_path: Path) -> None:
    motion = read_motion(SCENES / "rolling_fan.toml")
    use(choose_variant("scalar_spectral"))
    small = load_scene(
        SCENES / "rolling_fan.xml",
        choose_bands(GLOBAL, 550.0, 10.0, "auto"),
        {"width": 24, "height": 16},
    )
    frame = picture(
        MovingScene(
            small, motion, ROLLING.replace(**{"sensor.row_time_us": 15.0}), ms.Exposure(0.002)
        ),
        1,
        4,
    )
    assert isinstance(motion, Motion) and motion.objects and frame.min() > 0
