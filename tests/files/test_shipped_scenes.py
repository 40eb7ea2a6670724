"""The scenes that ship with the package: found by name from anywhere, described, copied, and whole in the wheel."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT
from helpers.marks import one_in
from helpers.scenes import SKY, scene_text
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.cli import app
from mitsuba_sensor.dataset.plan import load_plan
from mitsuba_sensor.files.scene_copies import copy_scene
from mitsuba_sensor.files.scene_references import scene_references
from mitsuba_sensor.files.shipped_scenes import (
    MOTION,
    SCENE,
    list_scenes,
    scene_description,
    scene_file,
    scene_parameters,
    scenes_folder,
    shipped_file,
)
from mitsuba_sensor.render.scene.motion import read_motion
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

NAMES = list_scenes()
NO_TIMES = {"width": 8, "spp": 16, "variant": "scalar_spectral", "denoise": False}
DATASET = """name = "named"
[[scenes]]
name = "one"
file = "{file}"
[[cameras]]
camera = "konnik_table1"
"""


def test_all_scenes_have_names() -> None:
    files = sorted(path.stem for path in (ROOT / "scenes").glob("*.xml"))
    assert files == NAMES and "first_frame" in NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_described_by_one_sentence_and_its_parameters(name: str) -> None:
    """The parameters are those that a <default> gives, whatever comment stands above them."""
    described, parameters = scene_description(name), scene_parameters(name)
    assert re.fullmatch(r"[A-Z][^<>]{20,150}\.", described)
    written = re.findall(r'<default name="(\w+)"', scene_file(name).read_text("utf-8"))
    assert [one.name for one in parameters] == written
    assert "--" not in "".join(one.meaning for one in parameters)
    meanings = {one.name: one.meaning for one in parameters}
    assert meanings["width"] == meanings["height"], "a comment is for all below it"


def test_a_name_is_a_scene_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flat_field").mkdir()  # a folder for the frames, perhaps
    named = ms.render("flat_field", "konnik_table1", ms.Exposure(0.1), **NO_TIMES)
    by_path = ms.render(
        scenes_folder() / "flat_field.xml", "konnik_table1", ms.Exposure(0.1), **NO_TIMES
    )
    np.testing.assert_array_equal(named.data, by_path.data)


def test_a_file_of_that_name_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert shipped_file("flat_field", SCENE) == scenes_folder() / "flat_field.xml"
    assert shipped_file("flat_field", SCENE, [tmp_path]) == scenes_folder() / "flat_field.xml"
    (tmp_path / "flat_field").write_text(scene_text(SKY))
    assert shipped_file("flat_field", SCENE, [tmp_path]) is None
    monkeypatch.chdir(tmp_path)
    assert shipped_file("flat_field", SCENE) is None


@pytest.mark.parametrize(
    "name",
    ["../scenes/flat_field", "flat_field.xml", "parts/still_life", Path("flat_field"), "", 3],
)
def test_only_a_name_is_looked_up(name: object) -> None:
    assert shipped_file(name, SCENE) is None


def test_a_motion_has_the_name_of_its_scene() -> None:
    assert shipped_file("rolling_fan", MOTION) == scenes_folder() / "rolling_fan.toml"
    assert "fan" in read_motion("rolling_fan").objects


@pytest.mark.parametrize("given", ["frist_frame", "scenes/first_frame.xml", "firstframe.xml"])
def test_a_wrong_name_is_answered_with_all_names(given: str, tmp_path: Path) -> None:
    with pytest.raises(ms.InputError) as raised:
        ms.render(str(tmp_path / given) if "/" in given else given, "konnik_table1")
    assert "Did you mean 'first_frame'?" in str(raised.value)
    assert all(name in str(raised.value) for name in NAMES)


def test_a_dataset_names_a_scene(tmp_path: Path) -> None:
    """Its key does not depend on where the package is installed, nor on what else may be read."""
    (tmp_path / "set.toml").write_text(DATASET.format(file="still_life"))
    (named,) = load_plan(tmp_path / "set.toml").tasks()
    (elsewhere,) = load_plan(tmp_path / "set.toml", [ROOT]).tasks()
    assert Path(named.scene_file) == scenes_folder() / "still_life.xml"
    assert named.key == elsewhere.key
    (tmp_path / "still_life").write_text(scene_text(SKY))
    (own,) = load_plan(tmp_path / "set.toml").tasks()
    assert Path(own.scene_file) == tmp_path / "still_life"


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_has_all_that_the_scene_reads(name: str, tmp_path: Path) -> None:
    copied = copy_scene(name, tmp_path / "new" / "mine")
    assert copied[0] == tmp_path / "new" / "mine" / f"{name}.xml"
    read = {path.relative_to(copied[0].parent) for path in scene_references(copied[0], {})}
    assert read <= {path.relative_to(copied[0].parent) for path in copied}
    for path in copied:
        original = scenes_folder() / path.relative_to(copied[0].parent)
        assert path.read_bytes() == original.read_bytes()


def test_a_copy_does_not_write_over_what_was_changed(tmp_path: Path) -> None:
    """Two scenes that share a file can be copied into one folder."""
    scene, part = copy_scene("still_life", tmp_path)
    copy_scene("first_frame", tmp_path)
    part.write_text("changed")
    scene.unlink()
    with pytest.raises(ms.InputError, match=r"still_life\.xml exists already.*force=True"):
        copy_scene("still_life", tmp_path)
    assert part.read_text() == "changed" and not scene.exists()
    copy_scene("still_life", tmp_path, force=True)
    assert "changed" not in part.read_text("utf-8")[:10] and scene.exists()


def test_the_wheel_has_every_file_that_a_scene_reads() -> None:
    wheel = pytest.importorskip("hatchling.builders.wheel")
    files = {
        Path(one.distribution_path).as_posix()
        for one in wheel.WheelBuilder(str(ROOT)).recurse_included_files()
    }
    read = {
        path.resolve().relative_to(ROOT).as_posix()
        for name in NAMES
        for path in scene_references(ROOT / "scenes" / f"{name}.xml", {})
    }
    assert {f"mitsuba_sensor/{path}" for path in read} <= files
    assert "mitsuba_sensor/scenes/rolling_fan.toml" in files
    assert not any(
        path.startswith("mitsuba_sensor/scenes/") and path.endswith(".py") for path in files
    )


@pytest.mark.exhaustive
def test_an_installed_wheel_renders_a_scene_by_its_name(tmp_path: Path) -> None:
    """From another folder, without the checkout: as after pip install."""
    build = pytest.importorskip("hatchling.builders.wheel")
    (path,) = build.WheelBuilder(str(ROOT)).build(
        directory=str(tmp_path), versions=["standard"]
    )
    with zipfile.ZipFile(path) as wheel:
        wheel.extractall(tmp_path / "site")
    (tmp_path / "empty").mkdir()
    command = [sys.executable, "-m", "mitsuba_sensor", "render", "first_frame"]
    done = subprocess.run(
        [*command, "-o", "out", "--width", "24", "--spp", "16"],
        cwd=tmp_path / "empty",
        env={**os.environ, "PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "empty" / "out" / "frame.json").read_text("utf-8")
    assert str(tmp_path / "site" / "mitsuba_sensor" / "scenes" / "first_frame.xml") in text


@pytest.mark.parametrize("name", one_in(4, list_scenes()))
def test_the_emitters_that_are_shown_are_those_that_mitsuba_loads(name: str) -> None:
    """Ids and plugin types, as `--light-groups` matches them, those of included files too."""
    shown = json.loads(CliRunner().invoke(app, ["scenes", "show", name, "--json"]).stdout)
    use(choose_variant("scalar_spectral"))
    parser, emitter = mitsuba().parser, mitsuba().ObjectType.Emitter
    state = parser.parse_file(parser.ParserConfig("scalar_spectral"), str(scene_file(name)))
    found = [
        (node.props.id(), node.props.plugin_name())
        for node in state.nodes
        if node.type == emitter
    ]
    assert found and sorted(found) == sorted(
        (one["id"], one["type"]) for one in shown["emitters"]
    )
