"""Vertices of a mesh are found and moved under the names of Mitsuba 3.9 and of 3.10, which renames them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.bands import choose_bands
from mitsuba_sensor.render.motion.motion import read_motion
from mitsuba_sensor.render.motion.moving_scene import AnimatedTransforms
from mitsuba_sensor.render.scene.scene import load_scene
from mitsuba_sensor.render.scene.scene_edits import NORMALS, POSITIONS
from mitsuba_sensor.render.variants import choose_variant, use

GLOW = '<emitter type="area"><spectrum name="radiance" value="360:1, 830:1"/></emitter>'
MOVED = {
    "velocity_m_per_s": [0.5, 0, 0],
    "rotate_deg_per_s": 30,
    "axis": [0, 0, 1],
    "pivot_m": [0, 0, 5],
}
TURNED = read_motion({"objects": {"it": MOVED}})


class Renamed:
    """The parameters of a scene, its meshes as Mitsuba 3.10 has them: other names, arrays of (N, 3)."""

    def __init__(self, mi: Any, parameters: Any) -> None:
        self._mi, self._parameters = mi, parameters
        self._old = {new: old for old, new in (POSITIONS, NORMALS)}

    def _old_key(self, key: str) -> str:
        shape, _, name = key.rpartition(".")
        return f"{shape}.{self._old[name]}" if name in self._old else key

    def __iter__(self) -> Iterator[Any]:
        return iter(self._parameters)

    def __contains__(self, key: str) -> bool:
        return (
            not key.endswith(tuple(self._old.values()))
            and self._old_key(key) in self._parameters
        )

    def __getitem__(self, key: str) -> Any:
        value = self._parameters[self._old_key(key)]
        return (
            value
            if self._old_key(key) == key
            else self._mi.TensorXf(np.array(value).reshape(-1, 3))
        )

    def __setitem__(self, key: str, value: Any) -> None:
        old = self._old_key(key)
        assert old == key or np.shape(value) == np.shape(self[key])
        self._parameters[old] = (
            value if old == key else type(self._parameters[old])(np.array(value).ravel())
        )

    def keep(self, keys: list[str]) -> None:
        self._parameters.keep([self._old_key(key) for key in keys])

    def update(self) -> None:
        self._parameters.update()


@pytest.mark.parametrize("variant", ["scalar_spectral", "llvm_ad_spectral"])
def test_a_mesh_moves_alike_under_either_pair_of_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variant: str
) -> None:
    """A cube that is shifted and turned: the same picture, bit for bit, and not the picture at rest."""
    mi = use(choose_variant(skip_unless_usable(variant)))
    cube = f'<shape type="cube" id="it"><transform name="to_world"><translate z="5"/></transform>{GLOW}</shape>'
    bands = choose_bands(ms.load_camera("konnik_table1"), 550.0, 10.0, "auto")
    scene = load_scene(write_scene(tmp_path, scene_text(cube)), bands, {})
    with AnimatedTransforms(scene, TURNED) as transforms:
        at_rest = scene.render(1, 4, (0, 8))
        transforms.set_time(1.0)
        moved = scene.render(1, 4, (0, 8))
    traverse = mi.traverse
    monkeypatch.setattr(mi, "traverse", lambda node: Renamed(mi, traverse(node)))
    with AnimatedTransforms(scene, TURNED) as transforms:
        transforms.set_time(1.0)
        renamed = scene.render(1, 4, (0, 8))
    np.testing.assert_array_equal(renamed, moved)
    assert (moved != at_rest).any()
    np.testing.assert_array_equal(scene.render(1, 4, (0, 8)), at_rest)
