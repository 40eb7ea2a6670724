"""Changes of a scene beyond its file: parameters by their names in ``mi.traverse``, and another pose of the camera."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from ...camera.datasheet_errors import sentence
from ...core import InputError, nearest
from ...core.llvm import drjit
from ..infrared.materials import AskedInfrared, checked_infrared
from ..motion.motion import KeyPose
from ..variants import MitsubaObject, mitsuba

MOST_NUMBERS = 16  # of one parameter: a transform
LARGEST = float(np.finfo(np.float32).max)
BLOCK_SIDE = 16  # pixels
LISTED = 20  # names in a message
EXAMPLE = "{'lamp.emitter.radiance.value': 2.0}"
POSE_FIELDS = ("origin_m", "target_m", "up")
POSE_EXAMPLE = "'0,1,4 0,1,0', or {'origin_m': [0, 1, 4], 'target_m': [0, 1, 0]}"
UNNAMED = re.compile(
    r"object_\d+"
)  # what Mitsuba calls an element without an id; an address, new in each run

Numbers = tuple[float, ...]


def checked_traverse(name: str, given: object) -> dict[str, Numbers]:
    """Names and numbers of the option ``traverse``; a single number is a list of one. Raises InputError."""
    if not isinstance(given, Mapping):
        raise InputError(f"{name} is {given!r}; pass names and numbers, e.g. {EXAMPLE}.")
    return {
        str(key): _numbers(f"{name} of {str(key)!r}", value) for key, value in given.items()
    }


def _numbers(what: str, given: object) -> Numbers:
    value = given.tolist() if hasattr(given, "tolist") else given
    listed: Sequence[object] = value if isinstance(value, list | tuple) else (value,)
    flat = [
        one for row in listed for one in (row if isinstance(row, list | tuple) else (row,))
    ]  # rows of a matrix
    for one in flat:
        if isinstance(one, bool) or not isinstance(one, int | float) or not abs(one) <= LARGEST:
            raise InputError(
                f"{what} is {given!r}; it must be a finite number, or a list of them."
            )
    if not 1 <= len(flat) <= MOST_NUMBERS:
        raise InputError(
            f"{what} has {len(flat)} numbers; a parameter has from 1 to {MOST_NUMBERS}."
        )
    return tuple(float(one) for one in flat)


def checked_look_at(name: str, given: object) -> dict[str, Numbers]:
    """The fields of the option ``look_at``: where the camera is, what it looks at [m], and what is up. Raises
    InputError."""
    if isinstance(given, str):
        given = _of_text(name, given)
    if not isinstance(given, Mapping):
        raise InputError(f"{name} is {given!r}; pass {POSE_EXAMPLE}.")
    for key in given:
        if key not in POSE_FIELDS:
            raise InputError(
                f"{name} has {key!r}; it has {', '.join(POSE_FIELDS)}.{nearest(str(key), POSE_FIELDS)}"
            )
    for key in POSE_FIELDS[:2]:
        if given.get(key) is None:
            raise InputError(f"{name} has no {key}; pass {POSE_EXAMPLE}.")
    try:
        pose = KeyPose(time_s=0, **given)
    except ValidationError as error:
        raise InputError(sentence(error, KeyPose, name, "pose")) from None
    return {key: getattr(pose, key) for key in POSE_FIELDS}


def _of_text(name: str, text: str) -> dict[str, list[float]]:
    """ "0,1,4 0,1,0 0,1,0" → origin, target and up."""
    points = text.split()
    try:
        numbers = [[float(number) for number in point.split(",")] for point in points]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or any(len(point) != 3 for point in numbers):
        raise InputError(
            f"{name} is {text!r}; write origin, target and, if need be, up, e.g. '0,1,4 0,1,0'."
        )
    return dict(zip(POSE_FIELDS, numbers, strict=False))


@dataclass(frozen=True)
class SceneEdits:
    """What is changed in a scene when it is built.

    traverse : by name, the numbers of a parameter.  look_at : origin_m, target_m and up of the camera, or None.
    repeatable : whether threads must not change the picture, see :func:`samples.pass_plan`.
    infrared : what RGB colours are beyond 700 nm, see :func:`infrared.rules.ruled_colours`.
    """

    traverse: Mapping[str, Numbers] = field(default_factory=dict)
    look_at: Mapping[str, Numbers] | None = None
    repeatable: bool = False
    infrared: AskedInfrared = field(default_factory=dict)

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> SceneEdits:
        """Those that are asked for; the variant must be set. options : of :class:`render.options.RenderOptions`, or
        some of them. Raises InputError."""
        traverse, look_at, repeatable, infrared = (
            options.get(name) for name in ("traverse", "look_at", "repeatable", "infrared")
        )
        if repeatable and (variant := mitsuba().variant()).startswith("cuda"):
            raise InputError(
                f"repeatable is given and the variant is {variant}; take an llvm or scalar variant."
            )
        return cls(
            {} if traverse is None else checked_traverse("traverse", traverse),
            None if look_at is None else checked_look_at("look_at", look_at),
            bool(repeatable),
            {} if infrared is None else checked_infrared("infrared", infrared),
        )

    def without_parameters(self, prefixes: tuple[str, ...]) -> SceneEdits:
        """The same without the parameters whose names begin so."""
        kept = {
            key: value for key, value in self.traverse.items() if not key.startswith(prefixes)
        }
        return replace(self, traverse=kept)

    def digest(self) -> bytes:
        """What stands for them in the digest of a scene; nothing where there are none."""
        changes: list[object] = [sorted(self.traverse.items()), self.look_at]
        if self.infrared:
            changes.append(self.infrared)
        return json.dumps(changes).encode() if any(changes) else b""

    def set_pose(self, sensor: MitsubaObject, unit_m: float) -> None:
        """Put the pose into the properties of a sensor; a scale of its own stays.  unit_m : metres per scene unit."""
        if self.look_at is None:
            return
        mi = mitsuba()
        pose: Any = KeyPose(time_s=0, **self.look_at).pose
        pose[:3, 3] /= unit_m
        if "to_world" in sensor:
            own = np.array(sensor["to_world"].matrix, dtype=float).reshape(4, 4)[:3, :3]
            pose[:3, :3] *= np.linalg.norm(own, axis=0)
            pose[:3, 0] *= np.sign(np.linalg.det(own))
        sensor["to_world"] = mi.ScalarTransform4f(pose)

    def fix_blocks(self, root: MitsubaObject, integrators: list[MitsubaObject]) -> None:
        """Give the integrators of a scene blocks of a size that does not depend on the number of threads: scalar
        variants choose one otherwise, and seed the sampler block by block."""
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
        """Why a parameter cannot be set and what to do instead; empty if it can."""
        if UNNAMED.match(key):
            return "an element without an id, which has another name in each run; give it an id in the scene file."
        if key not in parameters:
            known = [one for one, _ in parameters if not self._problem(parameters, one)]
            few = f": it has {', '.join(known)}" if 0 < len(known) <= LISTED else ""
            way_out = "elements are named by the id that they have in the scene file"
            return f"which the scene does not have{few}; {way_out}.{nearest(key, known)}"
        mi, node = mitsuba(), parameters.properties[key][2]
        if {"film", "sampler"} & set(key.split(".")[1:-1]):
            return "which belongs to film or sampler, and these are replaced; take width, camera or spp."
        if (
            self.look_at is not None
            and isinstance(node, mi.Sensor)
            and key.endswith(".to_world")
        ):
            return "and look_at is given, which is the same; leave one of them out."
        if not _count(parameters[key]):
            return f"which is no number, or more than {MOST_NUMBERS} of them; change the scene file instead."
        return ""


def _is_transform(value: MitsubaObject) -> bool:
    return hasattr(value, "matrix") and not drjit().is_array_v(
        value
    )  # of an array it is a permutation of components


def _count(value: MitsubaObject) -> int:
    """How many numbers a parameter has; 0 if it may not be set: whole numbers, images, large arrays."""
    dr = drjit()
    if isinstance(value, float):
        return 1
    if _is_transform(value):
        return len(value.matrix) ** 2
    usable = dr.is_array_v(value) and dr.is_float_v(value) and not dr.is_tensor_v(value)
    count = len(value) * (dr.width(value) if dr.depth_v(value) > 1 else 1) if usable else 0
    return count if count <= MOST_NUMBERS else 0


def _changed(what: str, value: MitsubaObject, numbers: Numbers) -> MitsubaObject:
    """The numbers as a parameter of the same type. Raises InputError."""
    if len(numbers) != (count := _count(value)):
        takes = "one number" if count == 1 else f"{count} numbers"
        raise InputError(f"{what} has {len(numbers)} numbers; it takes {takes}.")
    if isinstance(value, float):
        return numbers[0]
    if not _is_transform(value):
        return type(value)(list(numbers))
    side = len(value.matrix)
    matrix = np.array(numbers).reshape(side, side)
    if not np.linalg.det(matrix) or (matrix[-1] != np.eye(side)[-1]).any():
        raise InputError(
            f"{what} is no transform; its last row is 0 … 0 1, and it has an inverse."
        )
    return type(value)(matrix)
