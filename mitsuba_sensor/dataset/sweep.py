"""What varies from sample to sample: every combination, rows, random draws and poses, in a fixed order."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from ..render.motion.motion import KeyPose
from .file import DatasetFile, Distribution, RandomSweep, SceneEntry, Value, View
from .keys import Config, Facts
from .values import check_value

Values = Config
OF_LIGHT = ("f_number", "focus_m")
OF_CAMERA = tuple(
    f"camera.{part}" for part in ("lens.", "sensor.", "pixel.pitch", "quantum_efficiency.")
)
OF_LIGHT_PREFIXES = ("parameters.", "traverse.", *OF_CAMERA)
DIGITS = 6  # of a random number, so that it can be typed


class Combination(NamedTuple):
    """What one sample is made of.

    scene, camera : numbers of the entries of the dataset file.  view : number of the pose in the scene, from 0.
    pose : of the camera; None is that of the scene file.
    values : name of what varies → its value.  draw : number of the random draw, −1 where there is none.
    """

    scene: int
    camera: int
    view: int
    pose: View | None
    values: Values
    draw: int


def combinations(file: DatasetFile) -> Iterator[list[Combination]]:
    """All samples in groups: no two groups have the same light, unless random numbers coincide."""
    outer, inner = (
        {name: x for name, x in file.grid.items() if changes_light(name) is wanted}
        for wanted in (True, False)
    )
    rows: Sequence[Values] = file.list or ({},)
    for number, scene in enumerate(file.scenes):
        draws = _draws(file.random, file.seed, scene.name)
        for (view, pose), of_light, alike in product(
            enumerate(poses(scene)), _grid(outer), draws
        ):
            yield [
                Combination(
                    number, camera, view, pose, {**of_light, **row, **cell, **drawn}, draw
                )
                for (draw, drawn), row, camera, cell in product(
                    alike, rows, range(len(file.cameras)), _grid(inner)
                )
            ]


def count(file: DatasetFile) -> int:
    """How many combinations there are, before splits leave any out."""
    views = sum(len(poses(scene)) for scene in file.scenes)
    cells = math.prod(len(values) for values in file.grid.values())
    return (
        views
        * cells
        * max(len(file.list), 1)
        * len(file.cameras)
        * (file.random.draws if file.random else 1)
    )


def changes_light(name: str) -> bool:
    """Whether the light must be rendered anew where this varies."""
    return name in OF_LIGHT or name.startswith(OF_LIGHT_PREFIXES)


def of_kind(kind: str, values: Values) -> Facts:
    """Values of ``kind.NAME`` by NAME."""
    return {
        name.partition(".")[2]: x for name, x in values.items() if name.startswith(f"{kind}.")
    }


def poses(scene: SceneEntry) -> Sequence[View | None]:
    """The poses of the camera; None is that of the scene file."""
    if scene.path is None:
        return scene.views or (None,)
    keys, times = scene.path.keys, [key.time_s for key in scene.path.keys]
    loop = _is_loop(keys[0], keys[-1])
    at = np.linspace(times[0], times[-1], scene.path.views, endpoint=not loop)

    def along(vectors: Sequence[object]) -> list[tuple[float, ...]]:
        axes = [np.interp(at, times, axis) for axis in np.array(vectors, dtype=float).T]
        return [
            tuple(round(float(x), DIGITS) for x in point) for point in zip(*axes, strict=True)
        ]

    points = (
        along([getattr(key, name) for key in keys]) for name in ("origin_m", "target_m", "up")
    )
    return [
        View(origin_m=origin, target_m=target, up=up)
        for origin, target, up in zip(*points, strict=True)
    ]


def _is_loop(first: KeyPose, last: KeyPose) -> bool:
    """Whether a path ends with the pose that it begins with, which is made once."""
    return (first.origin_m, first.target_m, first.up) == (last.origin_m, last.target_m, last.up)


def drawn(distribution: Distribution, share: float) -> Value:
    """The value below which this share of the distribution lies, with six digits.  share : 0 … 1, both left out."""
    if distribution.choice is not None:
        return distribution.choice[int(share * len(distribution.choice))]
    if distribution.integer is not None:
        first, last = distribution.integer
        return first + int(share * (last - first + 1))
    if distribution.normal is not None:
        mean, sigma = distribution.normal
        return _rounded(mean + sigma * float(scipy.special.ndtri(share)))
    low, high = distribution.uniform or map(math.log, distribution.log_uniform or ())
    value = low + share * (high - low)
    return _rounded(value if distribution.uniform else math.exp(value))


def share_of(*names: object) -> float:
    """A number evenly over 0 … 1, both left out, that belongs to these names: of BLAKE2, so the same for ever."""
    digest = hashlib.blake2b("/".join(map(str, names)).encode(), digest_size=8).digest()
    return ((int.from_bytes(digest, "little") >> 11) + 0.5) / 2**53


def _grid(values: Mapping[str, Sequence[Value]]) -> Iterator[Facts]:
    """Every combination of the values."""
    return (dict(zip(values, cell, strict=True)) for cell in product(*values.values()))


def _draws(sweep: RandomSweep | None, seed: int, scene: str) -> list[list[tuple[int, Values]]]:
    """(number, values) of every draw, those of the same light together."""
    if sweep is None:
        return [[(-1, {})]]
    found: dict[object, list[tuple[int, Values]]] = {}
    for draw in range(sweep.draws):
        values = {
            name: drawn(law, share_of(seed, scene, name, draw))
            for name, law in sweep.values.items()
        }
        for name, value in values.items():
            check_value(name, value)
        light = tuple(x for name, x in values.items() if changes_light(name))
        found.setdefault(light, []).append((draw, values))
    return list(found.values())


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
