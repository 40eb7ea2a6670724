"""Files that scenes read are found, kept below the folders that may be read, and digested; no code beside them runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from helpers.scenes import BALL, SCENES, SHIPPED, SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.files.scene_references import (
    camera_references,
    check_below,
    files_digest,
    scene_references,
)

CAMERA = """name = "mine"
[quantum_efficiency]
file = "curves/qe.csv"
[lens]
prescription = "lens.dat"
"""
MESH = '<shape type="ply"><string name="filename" value="{}"/></shape>'


def scene_digest(path: Path, parameters: dict[str, Any], roots: list[Path]) -> str:
    """Of all files that a scene reads below the roots."""
    return files_digest(scene_references(path, parameters, roots), roots)


def written(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")


def names(folder: Path, **parameters: object) -> list[str]:
    found = scene_references(folder / "scene.xml", parameters)
    return sorted({os.path.relpath(path, folder) for path in found})


def test_every_kind_of_file_is_found(tmp_path: Path) -> None:
    """Includes, meshes, textures, spectra, those found through a <path>, the camera and what it names."""
    body = """<default name="mesh" value="none"/><path value="assets"/>
    <include filename="parts/more.xml"/><shape type="obj"><string name="filename" value="$mesh.obj"/></shape>
    <bsdf type="diffuse"><spectrum name="reflectance" filename="white.spd"/></bsdf>
    <sensor type="camera"><film type="photosensor"><string name="camera" value="my.toml"/></film></sensor>"""
    files = {
        "scene.xml": f"<scene>{body}</scene>",
        "my.toml": CAMERA,
        "curves/qe.csv": "",
        "lens.dat": "",
    }
    files |= {
        "parts/more.xml": f"<scene>{MESH.format('deep.ply')}</scene>",
        "ball.obj": "",
        "other.obj": "",
        "unused": "",
    }
    files |= {
        "assets/deep.ply": "",
        "assets/white.spd": "",
        "deep.ply": "another that Mitsuba could take",
    }
    written(tmp_path, files)
    assert names(tmp_path, mesh="ball") == sorted(set(files) - {"unused", "other.obj"})
    assert "other.obj" in names(tmp_path, mesh="other")
    assert camera_references(tmp_path / "my.toml")[1:] == [
        tmp_path / "curves/qe.csv",
        tmp_path / "lens.dat",
    ]
    with pytest.raises(ms.InputError, match=r"line 2: there is no file 'none.obj' in .*assets"):
        names(tmp_path)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_scenes_lie_in_their_folder(name: str) -> None:
    assert len(scene_digest(SCENES / f"{name}.xml", {}, [SCENES])) == 64


def test_the_digest_is_of_contents_and_of_names_below_the_root(tmp_path: Path) -> None:
    """The same tree elsewhere has the same digest; any byte of any file changes it; unread files do not."""
    trees = [tmp_path / one for one in ("a", "b")]
    for tree in trees:
        written(
            tree,
            {
                "s/scene.xml": f"<scene>{MESH.format('../m.ply')}</scene>",
                "m.ply": "1",
                "x": str(tree),
            },
        )
    first, second = (scene_digest(tree / "s/scene.xml", {}, [tree]) for tree in trees)
    assert first == second
    (trees[1] / "m.ply").write_text("2")
    os.utime(trees[1] / "m.ply", ns=(0, 0))
    assert scene_digest(trees[1] / "s/scene.xml", {}, [trees[1]]) != first
    (trees[0] / "x").write_text("2")
    assert scene_digest(trees[0] / "s/scene.xml", {}, [trees[0]]) == first


@pytest.mark.parametrize(
    "how",
    [
        "..",
        "absolute",
        "link",
        "folder link",
        "path",
        "include",
        "parameter",
        "camera",
        "default",
    ],
)
def test_files_outside_of_the_roots_are_refused_and_their_folder_can_be_named(
    how: str, tmp_path: Path
) -> None:
    out, root = tmp_path / "out", tmp_path / "in"
    secret = out / "secret.xml"
    written(out, {"secret.xml": "<scene/>"})
    root.mkdir()
    (root / "link.xml").symlink_to(secret)
    (root / "linked").symlink_to(out)
    name = {
        "..": "../out/secret.xml",
        "absolute": str(secret),
        "link": "link.xml",
        "folder link": "linked/secret.xml",
    }
    body = {
        "path": '<path value="../out"/>' + MESH.format("secret.xml"),
        "include": '<include filename="../out/secret.xml"/>',
        "parameter": '<default name="n" value="x"/>' + MESH.format("$n/secret.xml"),
        "default": '<default name="up" value="../out"/>' + MESH.format("$up/secret.xml"),
        "camera": '<film type="photosensor"><string name="camera" value="my.toml"/></film>',
    }.get(how, MESH.format(name.get(how)))
    written(
        root,
        {
            "scene.xml": f"<scene>{body}</scene>",
            "my.toml": CAMERA.replace("lens.dat", "../out/secret.xml"),
        },
    )
    parameters = {"n": "../out"} if how == "parameter" else {}
    with pytest.raises(
        ms.InputError, match=r"outside of the folders that may be read.*roots="
    ) as caught:
        scene_digest(root / "scene.xml", parameters, [root])
    assert "secret.xml" in str(caught.value) and "\n" not in str(caught.value)
    assert scene_digest(root / "scene.xml", parameters, [root, out])


def test_a_name_that_stays_inside_may_go_up(tmp_path: Path) -> None:
    written(
        tmp_path, {"a/scene.xml": f"<scene>{MESH.format('../b/m.ply')}</scene>", "b/m.ply": ""}
    )
    assert [name for name, _ in check_below([tmp_path / "a/../b/m.ply"], [tmp_path])] == [
        "b/m.ply"
    ]
    assert scene_digest(tmp_path / "a/scene.xml", {}, [tmp_path])


BILLION = '<!DOCTYPE x [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><scene>&b;</scene>'
METAL = '<bsdf type="conductor"><string name="material" value="../../x"/></bsdf>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BILLION, "has a <!DOCTYPE>"),
        ("<a>" * 70 + "</a>" * 70, "more than 24 deep"),
        ('<scene><include filename="scene.xml"/></scene>', "15 levels"),
        (
            '<scene><include filename="one.xml"/><include filename="one.xml"/></scene>',
            "1000 included files",
        ),
        ("<scene>", "XML"),
        ("", "XML"),
        ('<scene><bsdf type="../evil"/></scene>', "name of a plugin"),
        (f"<scene>{METAL}</scene>", "name of a metal"),
        (
            '<scene><film><string name="camera" value="../mine.toml"/></film></scene>',
            "there is no file",
        ),
        (
            '<scene><film><string name="quantum_efficiency.file" value="qe"/></film></scene>',
            "there is no file",
        ),
        (f"<scene>{MESH.format('$mesh')}</scene>", "a parameter without a value"),
        (f"<scene>{MESH.format('a' * 300)}</scene>", "there is no file"),
        ('<scene><path value="nowhere"/></scene>', "there is no folder"),
        (f"<scene>{MESH.format('pipe')}</scene>", "there is no file"),
        ('<scene><include filename="pipe"/></scene>', "there is no file"),
    ],
)
def test_scenes_that_would_keep_a_reader_busy_or_run_code_are_refused(
    text: str, said: str, tmp_path: Path
) -> None:
    inner = '<scene><include filename="{0}"/><include filename="{0}"/></scene>'
    written(
        tmp_path,
        {
            "scene.xml": text,
            "one.xml": inner.format("two.xml"),
            "two.xml": inner.format("one.xml"),
        },
    )
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ms.InputError, match=said) as caught:
        names(tmp_path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 700


def test_no_native_code_beside_a_scene_is_run(tmp_path: Path) -> None:
    """Mitsuba looks for plugins/TYPE.so beside the scene; a file that is none would be an error if it were loaded."""
    camera, options = (
        ms.load_camera("konnik_table1"),
        {"spp": 4, "wavelength_nm": 550, "variant": "scalar_spectral"},
    )
    scene = write_scene(tmp_path, scene_text(SKY, BALL.format(bsdf='<bsdf type="diffuse"/>')))
    written(tmp_path, {"plugins/diffuse.so": "", "plugins/evil.so": "", "evil.so": ""})
    assert ms.render(scene, camera, ms.Exposure(0.01), **options).data.any()
    with pytest.raises(ms.InputError, match="native code"):
        scene_references(scene, {})
    for kind, said in (
        ("evil", "native code that would be run"),
        ("../evil", "not a plugin name"),
    ):
        scene = write_scene(
            tmp_path, scene_text(SKY, BALL.format(bsdf=f'<bsdf type="{kind}"/>'))
        )
        with pytest.raises(ms.InputError, match=said):
            ms.render(scene, camera, ms.Exposure(0.01), **options)


def test_deep_nesting_is_refused_before_mitsuba_reads_it(tmp_path: Path) -> None:
    """Mitsuba 3.9.1 ends the process at ten thousand."""
    deep = '<bsdf type="twosided">' * 10_000 + "</bsdf>" * 10_000
    with pytest.raises(ms.InputError, match="more than 24 deep"):
        ms.render(
            write_scene(tmp_path, scene_text(SKY, deep)),
            ms.load_camera("konnik_table1"),
            ms.Exposure(0.01),
        )


def test_only_changed_files_are_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, {"scene.xml": f"<scene>{MESH.format('m.ply')}</scene>", "m.ply": "1"})
    digest = scene_digest(tmp_path / "scene.xml", {}, [tmp_path])
    monkeypatch.setattr(Path, "read_text", None)
    monkeypatch.setattr(Path, "open", None)
    assert scene_digest(tmp_path / "scene.xml", {"unused": 1}, [tmp_path]) == digest
