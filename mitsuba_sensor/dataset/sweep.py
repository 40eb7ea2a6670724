"""What varies from sample to sample: every combination, rows, random draws and poses, each found by its number."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache, partial
from typing import NamedTuple, TypeVar

import numpy as np
import scipy

from ..core import Float64Array, InputError
from ..core.types import NumpyArray
from ..render.scene.motion import KeyPose
from .file import DatasetFile, Distribution, SceneEntry, Value, View
from .keys import Config, Facts

Values = Facts
SENSOR = "sensor"
"""Name of the sensor of a scene file, among the values of a sample."""
OF_LIGHT = ("f_number", "focus_m", SENSOR)
OF_CAMERA = tuple(
    f"camera.{part}" for part in ("lens.", "sensor.", "pixel.pitch", "quantum_efficiency.")
)
OF_LIGHT_PREFIXES = ("parameters.", "traverse.", *OF_CAMERA)
EXPOSED = ("exposure_s", "exposure_ev", "temperature_k")
"""What decides the light, too, where something moves."""
METERED = ("gain", "camera.")
"""What decides it as well where the exposure is metered, or a noise ratio is asked for."""
MOST_SORTED = 10**6
"""Draws that are sorted by their light."""
CELLS_KEPT = 1000
PARALLEL = 1e-9
"""Sine of the smallest angle between the view and up, as of KeyPose."""
DIGITS = 6  # of a random number, so that it can be typed
TIME_DIGITS = 9
"""Of a time on a path [s]: nanoseconds."""
VECTORS = ("origin_m", "target_m", "up")
Thing = TypeVar("Thing")


class Combination(NamedTuple):
    """What one sample is made of.

    scene, camera : numbers of the entries of the dataset file.  view : number of the pose in the scene, from 0.
    pose : of the camera, and when it has it; None is that of the scene file.
    values : name of what varies → its value.  draw : number of the random draw, −1 where there is none.
    """

    scene: int
    camera: int
    view: int
    pose: View | None
    values: Values
    draw: int


class Poses:
    """The poses of the camera in a scene, by number; None is that of the scene file. Raises InputError."""

    def __init__(self, scene: SceneEntry) -> None:
        self.name, self.path, self.given = scene.name, scene.path, scene.views or (None,)

    def __len__(self) -> int:
        return self.path.views if self.path else len(self.given)

    def __getitem__(self, number: int) -> View | None:
        if not 0 <= number < len(self):
            raise IndexError(number)
        if self.path is None:
            return self.given[number]
        times_s, poses = self._of_path
        view: Facts = {"time_s": float(times_s[number])}
        if poses is not None:
            view |= zip(VECTORS, map(tuple, poses[number].tolist()), strict=True)
        return View.model_construct(**view)

    @cached_property
    def _of_path(self) -> tuple[Float64Array, Float64Array | None]:
        """Times [s] of all poses of the path, and origin, target and up of each, (N, 3, 3)."""
        assert self.path is not None
        keys = self.path.keys
        first, last = keys[0], keys[-1]
        steps = max(self.path.views - (not _is_loop(first, last)), 1)
        period_s = (last.time_s - first.time_s) / steps
        times_s = _rounded(first.time_s + np.arange(self.path.views) * period_s, TIME_DIGITS)
        if not self.path.has_poses:
            return times_s, None
        of_keys = np.array([[getattr(key, name) for name in VECTORS] for key in keys])
        key_times_s = [key.time_s for key in keys]
        columns = [np.interp(times_s, key_times_s, x) for x in of_keys.reshape(len(keys), 9).T]
        poses = _rounded(np.array(columns).T.reshape(-1, 3, 3), DIGITS)
        forward, up = poses[:, 1] - poses[:, 0], poses[:, 2]
        lengths = np.linalg.norm(forward, axis=1) * np.linalg.norm(up, axis=1)
        no_pose = ~(np.linalg.norm(np.cross(up, forward), axis=1) > PARALLEL * lengths)
        if no_pose.any():  # the keys were checked, and this pose is between them
            number = int(np.argmax(no_pose))
            origin, target, _ = poses[number].tolist()
            raise InputError(
                f"view {number} on the path of scene {self.name!r} is at {origin} and looks at {target}: that is one "
                "point, or straight along up; move a key, or give it another up."
            )
        return times_s, poses


def _rounded(values: NumpyArray, digits: int) -> Float64Array:
    """Numbers with so many decimals, never −0."""
    return np.asarray(np.round(values, digits) + 0.0)


def _is_loop(first: KeyPose, last: KeyPose) -> bool:
    """Whether a path ends with the pose that it begins with, which is made once."""
    return first.origin_m is not None and (first.origin_m, first.target_m, first.up) == (
        last.origin_m,
        last.target_m,
        last.up,
    )


class Light(NamedTuple):
    """What the samples of one light have in common.  view, pose : as of a combination.  values : of the grid.
    draws : numbers of the random draws."""

    view: int
    pose: View | None
    values: Values
    draws: Sequence[int]


class SceneSweep:
    """What the samples of one scene are made of, by number: a light, a row and a camera, and what the light is exposed
    with.

    file : the dataset.  scene : number of its entry.  later : whether a camera has exposures one after the other, so
    that all that changes it changes the light of what moves.  sensors : that take pictures, by name; none where it is
    the first one alone.  draws : how many random draws there are; the samples of one light have all, where they do not
    change the light; each alone, where a law of what does is continuous; else those with the same choices.
    Serial numbers are for splits to deal out (splits.py).  Raises InputError for too many.
    """

    def __init__(
        self, file: DatasetFile, scene: int, later: bool, sensors: tuple[str, ...] = ()
    ) -> None:
        self.file, self.scene, self.entry = file, scene, file.scenes[scene]
        self.poses = Poses(self.entry)
        also = names_of_timed_light(file, self.entry, later)
        grid = {name: values for name, values in file.grid.items() if name != "serial"}
        if sensors:
            grid = {SENSOR: sensors, **grid}
        self.of_light = {name: x for name, x in grid.items() if changes_light(name, also)}
        self._of_exposure = {name: x for name, x in grid.items() if name not in self.of_light}
        self.rows: Sequence[Values] = file.list or ({},)
        laws = file.random.values if file.random else {}
        self.draws = file.random.draws if file.random else 1
        self._laws = {name: law for name, law in laws.items() if changes_light(name, also)}
        self._are_alone = any(
            x.choice is None and x.integer is None for x in self._laws.values()
        )
        self._groups: list[Sequence[int]] = [range(self.draws)]
        if self._laws and not self._are_alone:
            self._groups = self._draws_by_light()
        self.groups = self.draws if self._are_alone else len(self._groups)
        self.lights = len(self.poses) * cells(self.of_light) * self.groups
        self.cells_of_exposure = cells(self._of_exposure)
        self._exposed = lru_cache(CELLS_KEPT)(partial(values_of_cell, self._of_exposure))
        self.drawn = lru_cache(CELLS_KEPT)(partial(drawn_values, file, self.entry.name))

    def light(self, number: int) -> Light:
        """The light of this number."""
        number, group = divmod(number, self.groups)
        view, cell = divmod(number, cells(self.of_light))
        values = values_of_cell(self.of_light, cell)
        return Light(view, self.poses[view], values, self.draws_of(group))

    def draws_of(self, group: int) -> Sequence[int]:
        """The draws of a light."""
        return (group,) if self._are_alone else self._groups[group]

    def exposures(self, light: Light) -> int:
        """How many samples a light has of each row, camera and serial number."""
        return len(light.draws) * self.cells_of_exposure

    def combination(self, light: Light, row: int, camera: int, exposure: int) -> Combination:
        """What one sample is made of, but for its serial number.  exposure : number among those of the light."""
        place, cell = divmod(exposure, self.cells_of_exposure)
        draw = light.draws[place]
        values = light.values | self.rows[row] | self._exposed(cell) | self.drawn(draw)
        if self.file.random is None:
            draw = -1
        return Combination(self.scene, camera, light.view, light.pose, values, draw)

    def _draws_by_light(self) -> list[Sequence[int]]:
        if self.draws > MOST_SORTED:
            raise InputError(
                f"random.draws is {self.draws}; at most {MOST_SORTED} where choices or whole numbers change the light: "
                "put them into [grid]."
            )
        together: dict[object, list[int]] = {}
        for draw in range(self.draws):
            values = drawn_values(self.file, self.entry.name, draw)
            together.setdefault(tuple(map(values.get, self._laws)), []).append(draw)
        return [*together.values()]


def names_of_timed_light(file: DatasetFile, entry: SceneEntry, later: bool) -> tuple[str, ...]:
    """Beginnings of the names that change the light of a scene beside the usual ones, because time does."""
    if entry.motion is None and "noise_ratio" not in file.render:
        return ()
    drawn_names = file.random.values if file.random else {}
    is_given = "exposure_s" in file.grid or "exposure_s" in drawn_names
    is_given |= bool(file.list) and all("exposure_s" in row for row in file.list)
    is_metered = "auto" in possible_values(file, "exposure_s") or not is_given
    if later or "noise_ratio" in file.render or is_metered:
        return EXPOSED + METERED
    return EXPOSED


def possible_values(file: DatasetFile, name: str) -> Iterator[Value]:
    """The values of something that varies which stand in the file."""
    yield from file.grid.get(name, ())
    yield from (row[name] for row in file.list if name in row)
    if file.random and name in file.random.values:
        yield from ends(file.random.values[name], file.random.draws)


def whole_values(file: DatasetFile, name: str) -> list[int]:
    """The whole numbers among these."""
    return [value for value in possible_values(file, name) if isinstance(value, int)]


def cells(grid: Mapping[str, Sequence[Value]]) -> int:
    """How many combinations there are of the values of a grid."""
    return math.prod(len(values) for values in grid.values())


def values_of_cell(grid: Mapping[str, Sequence[Value]], number: int) -> Facts:
    """The combination of this number; those of the last name change fastest."""
    found: Facts = {}
    for name in reversed([*grid]):
        number, place = divmod(number, len(grid[name]))
        found[name] = grid[name][place]
    return {name: found[name] for name in grid}


def changes_light(name: str, also: Iterable[str] = ()) -> bool:
    """Whether the light must be rendered anew where this varies.  also : beginnings of other names that do."""
    return name in OF_LIGHT or name.startswith((*OF_LIGHT_PREFIXES, *also))


def of_kind(kind: str, values: Config) -> Facts:
    """Values of ``kind.NAME`` by NAME."""
    return {
        name.partition(".")[2]: x for name, x in values.items() if name.startswith(f"{kind}.")
    }


def drawn_values(file: DatasetFile, scene: str, draw: int) -> Facts:
    """The values of a random draw: a function of seed, scene, name and number."""
    if file.random is None:
        return {}
    laws = file.random.values.items()
    return {name: drawn(law, share_of(file.seed, scene, name, draw)) for name, law in laws}


def drawn(distribution: Distribution, share: float) -> Value:
    """The value below which this share of the distribution lies, with six digits.  share : 0 … 1, both left out."""
    if distribution.choice is not None:
        return distribution.choice[int(share * len(distribution.choice))]
    if distribution.integer is not None:
        first, last = distribution.integer
        return first + int(share * (last - first + 1))
    if distribution.normal is not None:
        mean, sigma = distribution.normal
        return _typed(mean + sigma * float(scipy.special.ndtri(share)))
    low, high = distribution.uniform or map(math.log, distribution.log_uniform or ())
    value = low + share * (high - low)
    return _typed(value if distribution.uniform else math.exp(value))


def ends(distribution: Distribution, draws: int) -> Sequence[Value]:
    """Every choice, or the smallest and the largest value; of a normal distribution those that one of 1000 datasets of
    so many draws goes beyond."""
    if distribution.choice is not None:
        return distribution.choice
    rare = 1e-15
    if distribution.normal is not None:
        rare = 0.5e-3 / draws
    return drawn(distribution, rare), drawn(distribution, 1 - rare)


def share_of(*names: object) -> float:
    """A number evenly over 0 … 1, both left out, that belongs to these names: of BLAKE2, so the same for ever."""
    digest = hashlib.blake2b("/".join(map(str, names)).encode(), digest_size=8).digest()
    return ((int.from_bytes(digest, "little") >> 11) + 0.5) / 2**53


def _typed(value: float) -> float:
    """A number with the digits that a person would type."""
    return float(f"{value:.{DIGITS}g}")


def evenly_chosen(things: Sequence[Thing], most: int) -> list[Thing]:
    """At most so many of them, evenly chosen, in their order."""
    places = np.linspace(0, len(things) - 1, min(most, len(things)))
    return [things[place] for place in np.unique(places.astype(int)).tolist()]
