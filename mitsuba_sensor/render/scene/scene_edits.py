"""Changes of a scene beyond its file: parameters by their names in ``mi.traverse``, and another pose of the camera."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...core import InputError, nearest
from ...core.llvm import drjit
from ..variants import MitsubaObject, mitsuba
from .asked import NUMBERS_MAX, AskedInfrared, Numbers
from .motion import KeyPose

BLOCK_SIDE = 16  # pixels
NAMES_LISTED_MAX = 20  # in a message
UNNAMED = re.compile(r"object_\d+")
"""Mitsuba's name for an element without an id: its address, which changes in each run."""


@dataclass(frozen=True)
class SceneEdits:
    """Changes of a scene that are made when it is built.

    traverse : numbers of parameters by name.  look_at : origin_m, target_m and up of the camera, or None.
    repeatable : True if the number of threads must not change the image, see :func:`samples.pass_plan`.
    infrared : rule for RGB colours beyond 700 nm, see :func:`lint.infrared.ruled_colours`.
    """

    traverse: Mapping[str, Numbers] = field(default_factory=dict)
    look_at: Mapping[str, Numbers] | None = None
    repeatable: bool = False
    infrared: AskedInfrared = field(default_factory=dict)

    @classmethod
    def of(cls, checked: Mapping[str, Any]) -> SceneEdits:
        """Return the changes that checked options ask for; the variant must be set. Raises InputError."""
        if checked["repeatable"] and (variant := mitsuba().variant()).startswith("cuda"):
            raise InputError(
                f"repeatable is given and the variant is {variant}; take an llvm or scalar variant."
            )
        return cls(
            checked["traverse"] or {},
            checked["look_at"],
            checked["repeatable"],
            checked["infrared"] or {},
        )

    def without_parameters(self, prefixes: tuple[str, ...]) -> SceneEdits:
        """Return the changes without the parameters whose names start with these prefixes."""
        kept = {key: x for key, x in self.traverse.items() if not key.startswith(prefixes)}
        return replace(self, traverse=kept)

    def digest(self) -> bytes:
        """Return the bytes that represent the changes in the digest of a scene; empty without changes."""
        changes: list[object] = [sorted(self.traverse.items()), self.look_at]
        if self.infrared:
            changes.append(self.infrared)
        return json.dumps(changes).encode() if any(changes) else b""

    def set_pose(self, sensor: MitsubaObject, unit_m: float) -> None:
        """Set the pose in the properties of a sensor, and keep its scale.  unit_m : metres per scene unit."""
        if self.look_at is None:
            return
        pose: Any = KeyPose(time_s=0, **self.look_at).pose
        pose[:3, 3] /= unit_m
        if "to_world" in sensor:
            before = np.array(sensor["to_world"].matrix, dtype=float).reshape(4, 4)[:3, :3]
            pose[:3, :3] *= np.linalg.norm(before, axis=0)
            pose[:3, 0] *= np.sign(np.linalg.det(before))
        sensor["to_world"] = mitsuba().ScalarTransform4f(pose)

    def fix_blocks(self, root: MitsubaObject, integrators: list[MitsubaObject]) -> None:
        """Give integrators a block size that does not depend on the number of threads: scalar variants choose one
        otherwise, and seed the sampler for each block."""
        if not (self.repeatable and mitsuba().variant().startswith("scalar")):
            return
        for node in integrators:
            if "block_size" not in node.props:
                node.props["block_size"] = BLOCK_SIDE
        if not integrators and "integrator" not in root:
            root["integrator"] = mitsuba().load_dict({"type": "path", "block_size": BLOCK_SIDE})

    def apply(self, scene: MitsubaObject) -> None:
        """Set the parameters of a built scene. Raises InputError."""
        if not self.traverse:
            return
        parameters = mitsuba().traverse(scene)
        for key, numbers in self.traverse.items():
            if problem := self._problem(parameters, key):
                raise InputError(f"traverse names {key!r}, {problem}")
            parameters[key] = _changed(f"traverse of {key!r}", parameters[key], numbers)
        parameters.update()

    def _problem(self, parameters: MitsubaObject, key: str) -> str:
        """Return why a parameter cannot be set and what to do instead; empty if it can be set."""
        if UNNAMED.match(key):
            return (
                "whose element has another name in each run; give an id to the shape, emitter or material that stands "
                "directly in <scene>."
            )
        if key not in parameters:
            names = [name for name, _ in parameters if not self._problem(parameters, name)]
            listed = f": it has {', '.join(names)}" if len(names) <= NAMES_LISTED_MAX else ""
            if not names:
                listed = ", in which no element has an id"
            end = f".{key.partition('.')[2]}"  # e.g. of glow.radiance.value, glow in the shape lamp
            nested = next((f" Did you mean {x!r}?" for x in names if x.endswith(end)), "")
            return (
                f"which the scene does not have{listed}; a name begins with the id of an element that stands directly "
                f"in <scene>, e.g. lamp.emitter.radiance.value.{nearest(key, names) or nested}"
            )
        if {"film", "sampler"} & set(key.split(".")[1:-1]):
            return "which belongs to film or sampler, and these are replaced; take width, camera or spp."
        is_pose = key.endswith(".to_world") and isinstance(
            parameters.properties[key][2], mitsuba().Sensor
        )
        if is_pose and self.look_at is not None:
            return "and look_at sets the same pose; remove one of the two."
        if not _count(parameters[key]):
            return f"which is not a number, or more than {NUMBERS_MAX} numbers; change the scene file instead."
        return ""


def _is_transform(value: MitsubaObject) -> bool:
    # The matrix of an array is a permutation of its components.
    return hasattr(value, "matrix") and not drjit().is_array_v(value)


def _count(value: MitsubaObject) -> int:
    """Return how many numbers a parameter has; 0 if it cannot be set (whole numbers, images, large arrays)."""
    dr = drjit()
    if isinstance(value, float):
        return 1
    if _is_transform(value):
        return len(value.matrix) ** 2
    usable = dr.is_array_v(value) and dr.is_float_v(value) and not dr.is_tensor_v(value)
    count = len(value) * (dr.width(value) if dr.depth_v(value) > 1 else 1) if usable else 0
    return count if count <= NUMBERS_MAX else 0


def _changed(what: str, value: MitsubaObject, numbers: Numbers) -> MitsubaObject:
    """Return the numbers as a parameter of the type of ``value``. Raises InputError."""
    if len(numbers) != (count := _count(value)):
        raise InputError(f"{what} is {list(numbers)}; the number of values must be {count}.")
    if isinstance(value, float):
        return numbers[0]
    if not _is_transform(value):
        return type(value)(list(numbers))
    side = len(value.matrix)
    matrix = np.array(numbers).reshape(side, side)
    if not np.linalg.det(matrix) or (matrix[-1] != np.eye(side)[-1]).any():
        raise InputError(
            f"{what} is not a transform; its last row must be 0 … 0 1, and it must have an inverse."
        )
    return type(value)(matrix)
