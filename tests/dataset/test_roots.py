"""Files that a dataset file may read: any named file; with --untrusted only files in some folders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import plan_of
from helpers.scenes import SKY, scene_text

import mitsuba_sensor as ms
from mitsuba_sensor.camera.shipped import SHIPPED
from mitsuba_sensor.dataset.plan import load_plan

FILE = """name = "test"
seed = 1
outputs = ["raw"]
[[scenes]]
name = "one"
file = "scene.xml"
{scene}
[[cameras]]
camera = "{camera}"
{more}
[grid]
exposure_s = [0.01]
"""
CURVES = "wavelength_nm,G_percent\n400,10\n600,50\n700,10\n"
SECRET = '<shape type="ply"><string name="filename" value="{}"/></shape>'


def planned(
    folder: Path,
    *roots: Path,
    scene: str = "",
    camera: str = "konnik_table1",
    more: str = "",
    untrusted: bool = True,
) -> int:
    (folder / "dataset.toml").write_text(
        FILE.format(scene=scene, camera=camera, more=more), "utf-8"
    )
    return len(list(load_plan(folder / "dataset.toml", roots, untrusted).tasks()))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    (tmp_path / "in").mkdir()
    (tmp_path / "out" / "qe.csv").write_text(CURVES)
    (tmp_path / "in" / "scene.xml").write_text(scene_text(SKY))
    return tmp_path / "in"


def test_a_mesh_of_a_scene_is_below_the_roots(folder: Path) -> None:
    assert planned(folder) == 1
    (folder / "scene.xml").write_text(scene_text(SKY, SECRET.format("../out/qe.csv")))
    with pytest.raises(ms.InputError, match=r"outside of the folders.*roots="):
        planned(folder)
    assert planned(folder, untrusted=False) == 1
    assert planned(folder, folder.parent / "out") == 1


def test_the_value_of_a_parameter_that_varies_is_below_the_roots(folder: Path) -> None:
    (folder / "scene.xml").write_text(
        scene_text('<default name="mesh" value="scene.xml"/>', SKY, SECRET.format("$mesh"))
    )
    assert planned(folder) == 1
    elsewhere = 'parameters = {mesh = "../out/qe.csv"}'
    with pytest.raises(ms.InputError, match="outside of the folders"):
        planned(folder, scene=elsewhere)
    assert planned(folder, scene=elsewhere, untrusted=False) == 1


def test_what_is_in_a_file_that_a_parameter_names_is_in_the_key(folder: Path) -> None:
    defaults = '<default name="mesh" value="a.ply"/><default name="level" value="1"/>'
    (folder / "scene.xml").write_text(scene_text(defaults, SKY, SECRET.format("$mesh")))
    rows = [{"parameters.mesh": "a.ply"}, {"parameters.mesh": "b.ply"}, {"parameters.level": 2}]
    tables: dict[str, Any] = {"scenes": [{"name": "one", "file": "scene.xml"}], "list": rows}
    keys = []
    for content in ("one", "other"):
        (folder / "a.ply").write_text("a")
        (folder / "b.ply").write_text(content)
        keys.append([task.light_key for task in plan_of(folder, **tables).tasks()])
    assert [one == other for one, other in zip(*keys, strict=True)] == [True, False, True]


@pytest.mark.parametrize("how", ["in the camera file", "by name", "as a table"])
def test_the_curves_of_a_camera_are_below_the_roots(how: str, folder: Path) -> None:
    camera, more = "konnik_table1", ""
    if how == "in the camera file":
        text = (SHIPPED / "konnik_table1.toml").read_text("utf-8")
        (folder / "mine.toml").write_text(
            text.replace("[quantum_efficiency]", '[quantum_efficiency]\nfile = "../out/qe.csv"')
        )
        camera = "mine.toml"
    else:
        key = '"quantum_efficiency.file"' if how == "by name" else "quantum_efficiency.file"
        more = f'set = {{{key} = "../out/qe.csv"}}'
    with pytest.raises(ms.InputError, match="roots="):
        planned(folder, camera=camera, more=more)
    if how != "in the camera file":  # which has curves of its own, too
        assert planned(folder, camera=camera, more=more, untrusted=False) == 1


@pytest.mark.parametrize("how", ["..", "absolute", "link"])
def test_a_scene_elsewhere_is_read_where_the_file_is_trusted(how: str, folder: Path) -> None:
    """Untrusted files are rejected."""
    place = folder / "scene.xml"
    place.rename(folder.parent / "out" / "other.xml")
    name = {"..": "../out/other.xml", "absolute": f"{folder.parent}/out/other.xml"}.get(
        how, "a.xml"
    )
    (folder / "a.xml").symlink_to(folder.parent / "out" / "other.xml")
    text = FILE.format(scene="", camera="konnik_table1", more="").replace("scene.xml", name)
    (folder / "dataset.toml").write_text(text, "utf-8")
    (task,) = load_plan(folder / "dataset.toml").tasks()
    assert task.samples
    with pytest.raises(ms.InputError, match="roots="):
        [*load_plan(folder / "dataset.toml", untrusted=True).tasks()]


def test_a_file_with_a_near_name_is_suggested_first_and_never_if_untrusted(
    folder: Path,
) -> None:
    (folder / "scene.xml").rename(folder / "scenes.xml")
    with pytest.raises(ms.InputError, match=r"Did you mean 'scenes.xml'\? Otherwise .*roots="):
        planned(folder, untrusted=False)
    (folder / "mine.toml").touch()
    with pytest.raises(ms.InputError, match=r"Did you mean 'mine.toml'\?"):
        planned(folder, camera="mine.tml", untrusted=False)
    with pytest.raises(ms.InputError, match=r"no such file; .*roots="):
        planned(folder)


def test_a_missing_file_is_told_with_each_folder_once_by_its_whole_path(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "scene.xml").unlink()
    monkeypatch.chdir(folder)
    with pytest.raises(ms.InputError) as caught:
        planned(Path("."), Path("."))
    said = str(caught.value)
    assert said.count(str(folder)) == 1 and "., ." not in said and said.endswith(f"{folder}).")
