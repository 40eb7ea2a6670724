"""Several sensors of one scene file: stereo pairs and rigs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive
from helpers.scenes import SKY, scene_text

import mitsuba_sensor as ms

COLUMNS, ROWS, FOV_DEG, BASELINE_M = 120, 40, 40.0, 0.2
FOCAL_PX = COLUMNS / 2 / math.tan(math.radians(FOV_DEG) / 2)
FAST = {"spp": 16, "denoise": False, "variant": "scalar_spectral", "wavelength_nm": 550.0}


def sensor(name: str, x_m: float, film: str = '<film type="hdrfilm">') -> str:
    size = f'<integer name="width" value="{COLUMNS}"/><integer name="height" value="{ROWS}"/>'
    pose = f'<lookat origin="{x_m}, 0, 4" target="{x_m}, 0, 0" up="0, 1, 0"/>'
    return (
        f'<sensor type="perspective" {name}><float name="fov" value="{FOV_DEG}"/>'
        f'<transform name="to_world">{pose}</transform>{film}{size}</film></sensor>'
    )


def scene(sensors: str, x_m: float = 0.0, depth_m: float = 3.0) -> str:
    """A small bright sphere in the dark, whose centre is so far in front of the sensors."""
    return (
        f'<scene version="3.0.0">{sensors}<shape type="sphere" id="ball">'
        f'<point name="center" x="{x_m}" y="0" z="{4 - depth_m}"/><float name="radius" value="0.05"/>'
        '<emitter type="area" id="lamp"><spectrum name="radiance" value="0.01"/></emitter></shape>'
        '<emitter type="constant" id="sky"><spectrum name="radiance" value="0.0005"/></emitter></scene>'
    )


PAIR = sensor('id="left"', -BASELINE_M / 2) + sensor('id="right"', BASELINE_M / 2)
EXPOSURE = ms.Exposure(0.01)


def ball_column(captured: ms.Capture) -> float:
    """Centroid of what is brighter than the background, in columns."""
    signal = captured.light.data.sum(axis=(0, 2), dtype=float)
    bright = np.maximum(signal - 2 * np.median(signal), 0)
    return float(bright @ np.arange(COLUMNS) / bright.sum())


@pytest.mark.parametrize(
    ("x_m", "depth_m"), [exhaustive(0.0, 3.0), (0.35, 2.0), exhaustive(-0.2, 1.4)]
)
def test_a_point_has_the_disparity_of_its_depth(x_m: float, depth_m: float) -> None:
    """f·B/z; the centroid of 16 samples per pixel is within 0.02 px, and the sphere's outline within 0.01 px."""
    captured = ms.capture(
        scene(PAIR, x_m, depth_m), "konnik_table1", EXPOSURE, sensor="all", **FAST
    )
    left, right = captured.sensors.values()
    disparity_px = ball_column(left) - ball_column(right)
    assert disparity_px == pytest.approx(FOCAL_PX * BASELINE_M / depth_m, abs=0.25)


def test_a_sensor_alone_takes_the_frame_that_it_takes_among_all() -> None:
    asked = {**FAST, "spp": 2, "seed": 7, "frames": 2, "repeatable": True}
    together = ms.capture(scene(PAIR), "konnik_table1", EXPOSURE, sensor="all", **asked)
    for name, of_all in together.sensors.items():
        alone = ms.capture(scene(PAIR), "konnik_table1", EXPOSURE, sensor=name, **asked)
        assert (alone.frames.digital == of_all.frames.digital).all()
        assert alone.metadata["sensor"] == of_all.metadata["sensor"]
        assert alone.metadata["seeds"] == of_all.metadata["seeds"]
    first = ms.capture(scene(PAIR), "konnik_table1", EXPOSURE, **asked)
    assert (first.frames.digital == together.frames.digital).all()


def test_sensors_of_one_pose_have_independent_noise_and_are_different_chips() -> None:
    """Correlation of differences of neighbours in a column, without shading: its σ is √(1.5/N) of N independent
    pixels, and 6/√N are 4.9 of it, one in a million."""
    same = sensor('id="one"', 0.0) + sensor('id="two"', 0.0)
    wall = '<shape type="rectangle"><transform name="to_world"><scale value="5"/></transform></shape>'
    flat = scene(same + wall)
    captured = ms.capture(flat, "konnik_table1", EXPOSURE, sensor="all", **FAST)
    one, two = captured.sensors.values()
    for images in (
        [part.frames.digital[0] for part in (one, two)],
        [part.light.data[..., 0] for part in (one, two)],
    ):
        beside = slice(0, COLUMNS // 3)  # of the ball
        first, second = (
            np.diff(image[:, beside].astype(float), axis=0).ravel() for image in images
        )
        assert first.std() > 0
        assert abs(np.corrcoef(first, second)[0, 1]) < 6 / math.sqrt(first.size)
    serials = [part.metadata["seeds"]["serial"] for part in (one, two)]
    assert serials == [1, 2]


def test_sensors_without_a_usable_id_go_by_their_number(tmp_path: Path) -> None:
    odd = sensor("", 0.0) + sensor('id="../up"', 0.1) + sensor('id="all"', 0.2)
    asked: Any = {**FAST, "spp": 2, "sensor": "all"}
    text = scene(odd + sensor('id="0"', 0.3))
    captured = ms.capture(text, "konnik_table1", EXPOSURE, **asked)
    assert list(captured.sensors) == ["0", "1", "2", "3"]
    captured.save(tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["0", "1", "2", "3"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_sentences_name_the_sensors() -> None:
    with pytest.raises(
        ms.InputError, match=r"no sensor 'lefft'; its sensors are left, right. Did you"
    ):
        ms.capture(scene(PAIR), "konnik_table1", EXPOSURE, sensor="lefft")
    with pytest.raises(
        ms.InputError, match=r"for frames of a scene .*; give one of left, right"
    ):
        ms.render(scene(PAIR), "konnik_table1", EXPOSURE, sensor="all")
    with pytest.raises(ms.InputError, match="must be the id of a sensor"):
        ms.capture(scene(PAIR), "konnik_table1", EXPOSURE, sensor=1.5)  # type: ignore[arg-type]
    with pytest.raises(ms.InputError, match=r"would put all 2 sensors in one place"):
        ms.capture(scene(PAIR), "konnik_table1", EXPOSURE, sensor="all", look_at="0,0,4 0,0,0")
    keys = {"camera": {"keys": [{"time_s": 0, "origin_m": [0, 0, 4], "target_m": [0, 0, 0]}]}}
    with pytest.raises(ms.InputError, match=r"the motion has a pose .* move_m and turn_deg"):
        ms.capture(scene(PAIR), "konnik_table1", EXPOSURE, sensor="all", motion=keys)


def test_the_command_writes_a_folder_for_each_sensor_or_none(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    file = tmp_path / "pair.xml"
    file.write_text(scene(PAIR))
    asked = ["--spp", "2", "--no-denoise", "--exposure-s", "0.01", "--sensor", "all"]
    asked += ["--variant", "scalar_spectral", "--wavelength-nm", "550"]
    result = cli("render", file, "-o", tmp_path / "out", *asked, "--json")
    assert result.exit_code == 0, result.output
    assert list(json.loads(result.stdout)) == ["left", "right"]
    for number, name in enumerate(("left", "right")):
        facts = json.loads((tmp_path / "out" / name / "frame.json").read_text())["sensor"]
        assert (facts["name"], facts["number"], facts["start_s"]) == (name, number, 0.0)
        position_m = np.array(facts["to_world"])[:3, 3]
        np.testing.assert_allclose(position_m, [(-0.1, 0.1)[number], 0, 4], atol=1e-6)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "right").write_text("a file")
    result = cli("render", file, "-o", tmp_path / "bad", *asked)
    assert result.exit_code == 2
    assert [path.name for path in (tmp_path / "bad").iterdir()] == ["right"]


def test_a_dict_of_two_films_keeps_the_fields_of_each() -> None:
    def of_film(bits: int) -> dict[str, object]:
        film = {
            "type": "photosensor",
            "camera": "konnik_table1",
            "adc.bits": bits,
            "exposure_s": 5e-4,
        }
        return {"type": "perspective", "film": {**film, "width": 8, "height": 8}}

    tree = {
        "type": "scene",
        "a": of_film(10),
        "b": of_film(12),
        "sky": {"type": "constant"},
    }
    captured = ms.capture(tree, sensor="all", **FAST)
    bits = [one.frames.camera.adc.bits for one in captured.sensors.values()]
    assert bits == [10, 12]


METER = (
    '<sensor type="{}"><film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/>'
    '<rfilter type="box"/></film></sensor>'
)


@pytest.mark.parametrize("kind", ["irradiancemeter", "radiancemeter", "distant"])
def test_a_sensor_without_an_image_is_refused(kind: str) -> None:
    """Alone, in a batch, on a shape and beside a camera, which can be taken."""
    meter = METER.format(kind)
    for elements, words in (
        ([meter], "takes no image"),
        ([f'<sensor type="batch">{meter}</sensor>'], "move its sensors into the scene"),
        (
            [meter, '<sensor type="perspective" id="eye"/>'],
            "another sensor of the scene: sensor='eye'",
        ),
        ([f'<shape type="sphere">{meter}</shape>'], f"no sensor but {kind} on a shape"),
    ):
        if "on a shape" in words and kind != "irradiancemeter":
            continue
        with pytest.raises(ms.InputError, match=words):
            ms.render(scene_text(SKY, *elements, sensor=""), "konnik_table1", EXPOSURE, **FAST)
