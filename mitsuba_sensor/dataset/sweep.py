"""What varies from sample to sample: combinations, rows, random draws and poses, each found by its number."""

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
from .file import DatasetFile, Distribution, SceneEntry, Value, View
from .keys import Config, Facts

SENSOR = "sensor"
"""Name of the sensor of a scene file, among the values of a sample."""
LIGHT_FIELDS = ("f_number", "focus_m", SENSOR)
LIGHT_PREFIXES = (
    *("parameters.", "traverse."),
    *(f"camera.{x}" for x in ("lens.", "sensor.", "pixel.pitch", "quantum_efficiency.")),
)
EXPOSED = ("exposure_s", "exposure_ev", "temperature_k")
"""Fields that also decide the light if something moves."""
METERED = ("gain", "camera.")
"""Fields that also decide the light if the exposure is metered, or with a noise ratio."""
SORTED_DRAWS_MAX = 10**6
"""Draws that are sorted by their light."""
CELLS_KEPT = 1000
PARALLEL_SINE = 1e-9
"""Sine of the smallest angle between the view and up, as in KeyPose."""
VALUE_DIGITS = 6  # of a random number, so a person can type it
TIME_DIGITS = 9
"""Of a time on a path [s]: nanoseconds."""
RARE_FRACTION = 1e-15
VECTORS = ("origin_m", "target_m", "up")
Thing = TypeVar("Thing")


class Combination(NamedTuple):
    """The settings of one sample, except its serial number.

    scene, camera : numbers of the entries of the dataset file.  view : number of the pose in the scene, from 0.
    pose : of the camera, and its time; None for the pose of the scene file.
    values : name of each varied field → its value.  draw : number of the random draw, −1 without one.
    """

    scene: int
    camera: int
    view: int
    pose: View | None
    values: Facts
    draw: int


class Poses:
    """The poses of the camera in a scene, by number; None for the pose of the scene file. Raises InputError."""

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
        """Times [s] of all poses of the path, and origin, target and up of each, shape (N, 3, 3)."""
        assert self.path is not None
        keys, views = self.path.keys, self.path.views
        first, last = ([getattr(key, x) for x in VECTORS] for key in (keys[0], keys[-1]))
        is_loop = self.path.has_poses and first == last  # the first pose is made once
        period_s = (keys[-1].time_s - keys[0].time_s) / max(views - (not is_loop), 1)
        times_s = _rounded(keys[0].time_s + np.arange(views) * period_s, TIME_DIGITS)
        if not self.path.has_poses:
            return times_s, None
        vectors = np.array([[getattr(key, x) for x in VECTORS] for key in keys])
        key_times_s = [key.time_s for key in keys]
        columns = [np.interp(times_s, key_times_s, x) for x in vectors.reshape(-1, 9).T]
        poses = _rounded(np.array(columns).T.reshape(-1, 3, 3), VALUE_DIGITS)
        forward, up = poses[:, 1] - poses[:, 0], poses[:, 2]
        lengths = np.linalg.norm(forward, axis=1) * np.linalg.norm(up, axis=1)
        is_pose = np.linalg.norm(np.cross(up, forward), axis=1) > PARALLEL_SINE * lengths
        if not is_pose.all():  # the keys were checked, but this pose is between them
            number = int(np.argmin(is_pose))
            origin, target, _ = poses[number].tolist()
            raise InputError(
                f"view {number} on the path of scene {self.name!r} is at {origin} and looks at {target}, which is the "
                "same point or straight along up; move a key, or give it another up."
            )
        return times_s, poses


def _rounded(values: NumpyArray, digits: int) -> Float64Array:
    """Round to this many decimals, without −0."""
    return np.asarray(np.round(values, digits) + 0.0)


class Light(NamedTuple):
    """What the samples of one light share.  view, pose : as in a combination.  values : of the grid.
    draws : numbers of the random draws."""

    view: int
    pose: View | None
    values: Facts
    draws: Sequence[int]


class SceneSweep:
    """The combinations of one scene, by number: a light, a row, a camera, and an exposure of this light.

    file : the dataset.  scene : number of its entry.  is_staggered : True if a camera has exposures one after the
    other, so all that changes them changes the light of what moves.  sensors : names of the sensors that take images;
    empty for only the first sensor.  draws : number of random draws. The samples of one light have all draws if the
    draws do not change the light, one draw if a continuous distribution does, else the draws with the same choices.
    splits.py distributes the serial numbers.  Raises InputError for too many draws.
    """

    def __init__(
        self, file: DatasetFile, scene: int, is_staggered: bool, sensors: tuple[str, ...] = ()
    ) -> None:
        self.file, self.scene, self.entry = file, scene, file.scenes[scene]
        self.poses = Poses(self.entry)
        timed = names_of_timed_light(file, self.entry, is_staggered)
        grid = {name: values for name, values in file.grid.items() if name != "serial"}
        if sensors:
            grid = {SENSOR: sensors, **grid}
        self.of_light = {x: values for x, values in grid.items() if changes_light(x, timed)}
        self.of_exposure = {x: y for x, y in grid.items() if x not in self.of_light}
        self.rows: Sequence[Facts] = file.list or ({},)
        random = file.random.values if file.random else {}
        self.draws = file.random.draws if file.random else 1
        self._of_light = {x: y for x, y in random.items() if changes_light(x, timed)}
        self._are_alone = any(
            x.choice is None and x.integer is None for x in self._of_light.values()
        )
        self._groups: list[Sequence[int]] = [range(self.draws)]
        if self._of_light and not self._are_alone:
            self._groups = self._draws_by_light()
        self.groups = self.draws if self._are_alone else len(self._groups)
        self.lights = len(self.poses) * cells(self.of_light) * self.groups
        self.cells_of_exposure = cells(self.of_exposure)
        self._exposed = lru_cache(CELLS_KEPT)(partial(values_of_cell, self.of_exposure))
        self.drawn = lru_cache(CELLS_KEPT)(partial(drawn_values, file, self.entry.name))

    def light(self, number: int) -> Light:
        """Return the light with this number."""
        number, group = divmod(number, self.groups)
        view, cell = divmod(number, cells(self.of_light))
        values = values_of_cell(self.of_light, cell)
        return Light(view, self.poses[view], values, self.draws_of(group))

    def draws_of(self, group: int) -> Sequence[int]:
        """Return the draws of a light."""
        return (group,) if self._are_alone else self._groups[group]

    def exposures(self, light: Light) -> int:
        """Return the number of samples of a light for each row, camera and serial number."""
        return len(light.draws) * self.cells_of_exposure

    def combination(self, light: Light, row: int, camera: int, exposure: int) -> Combination:
        """Return the settings of one sample.  exposure : number among the exposures of the light."""
        place, cell = divmod(exposure, self.cells_of_exposure)
        draw = light.draws[place]
        values = light.values | self.rows[row] | self._exposed(cell) | self.drawn(draw)
        draw = draw if self.file.random else -1
        return Combination(self.scene, camera, light.view, light.pose, values, draw)

    def entries(self, light: int, exposure: int) -> dict[str, int]:
        """Return the places of the values of a sample in the dataset file: name of a list → number in it."""
        numbers = {f"scenes.{self.scene}.views": self.light(light).view}
        axes = places_of_cell(self.of_light, light // self.groups % cells(self.of_light))
        axes |= places_of_cell(self.of_exposure, exposure % self.cells_of_exposure)
        return numbers | {f"grid.{name}": place for name, place in axes.items()}

    def _draws_by_light(self) -> list[Sequence[int]]:
        if self.draws > SORTED_DRAWS_MAX:
            raise InputError(
                f"random.draws is {self.draws}; at most {SORTED_DRAWS_MAX} if choices or whole numbers change the "
                "light: put these into [grid]."
            )
        together: dict[object, list[int]] = {}
        for draw in range(self.draws):
            values = drawn_values(self.file, self.entry.name, draw)
            together.setdefault(tuple(map(values.get, self._of_light)), []).append(draw)
        return [*together.values()]


def names_of_timed_light(
    file: DatasetFile, entry: SceneEntry, is_staggered: bool
) -> tuple[str, ...]:
    """Return prefixes of further names that change the light of a scene, because time does."""
    has_ratio = "noise_ratio" in file.render
    if entry.motion is None and not has_ratio:
        return ()
    is_given = "exposure_s" in {**file.grid, **(file.random.values if file.random else {})}
    is_given |= bool(file.list) and all("exposure_s" in row for row in file.list)
    is_metered = "auto" in possible_values(file, "exposure_s") or not is_given
    return EXPOSED + METERED if is_staggered or has_ratio or is_metered else EXPOSED


def possible_values(file: DatasetFile, name: str) -> Iterator[Value]:
    """Yield the values of a field in the file; of a distribution its ends."""
    yield from file.grid.get(name, ())
    yield from (row[name] for row in file.list if name in row)
    if file.random and name in file.random.values:
        yield from ends(file.random.values[name], file.random.draws)


def most_frames(file: DatasetFile) -> int:
    """Return the largest number of frames of a sample."""
    return max([1, *(x for x in possible_values(file, "frames") if isinstance(x, int))])


def cells(grid: Mapping[str, Sequence[Value]]) -> int:
    """Return the number of combinations of a grid."""
    return math.prod(map(len, grid.values()))


def places_of_cell(grid: Mapping[str, Sequence[Value]], number: int) -> dict[str, int]:
    """Return name → place of its value, for the combination with this number; the last name changes fastest."""
    places = {}
    for name in reversed([*grid]):
        number, places[name] = divmod(number, len(grid[name]))
    return {name: places[name] for name in grid}


def values_of_cell(grid: Mapping[str, Sequence[Value]], number: int) -> Facts:
    """Return the combination with this number."""
    return {name: grid[name][place] for name, place in places_of_cell(grid, number).items()}


def changes_light(name: str, timed: Iterable[str] = ()) -> bool:
    """Return True if a field changes the light.  timed : prefixes of further such names."""
    return name in LIGHT_FIELDS or name.startswith((*LIGHT_PREFIXES, *timed))


def of_kind(kind: str, values: Config) -> Facts:
    """Return the values of ``kind.NAME`` by NAME."""
    names = (name for name in values if name.startswith(f"{kind}."))
    return {name.partition(".")[2]: values[name] for name in names}


def drawn_values(file: DatasetFile, scene: str, draw: int) -> Facts:
    """Return the values of a random draw: a function of seed, scene, name and number."""
    random = file.random.values if file.random else {}
    return {
        name: drawn(distribution, share_of(file.seed, scene, name, draw))
        for name, distribution in random.items()
    }


def drawn(distribution: Distribution, share: float) -> Value:
    """Return the quantile of a distribution with six digits.  share : 0 … 1, exclusive."""
    if distribution.choice is not None:
        return distribution.choice[int(share * len(distribution.choice))]
    if distribution.integer is not None:
        first, last = distribution.integer
        return first + int(share * (last - first + 1))
    if distribution.normal is not None:
        mean, sigma = distribution.normal
        value = mean + sigma * float(scipy.special.ndtri(share))
    elif distribution.uniform is not None:
        low, high = distribution.uniform
        value = low + share * (high - low)
    else:
        low, high = map(math.log, distribution.log_uniform or ())
        value = math.exp(low + share * (high - low))
    return float(f"{value:.{VALUE_DIGITS}g}")


def ends(distribution: Distribution, draws: int) -> Sequence[Value]:
    """Return every choice, or the smallest and the largest value; one in 1000 datasets with this many draws exceeds the
    ends of a normal distribution."""
    if distribution.choice is not None:
        return distribution.choice
    rare = RARE_FRACTION if distribution.normal is None else 0.5e-3 / draws
    return drawn(distribution, rare), drawn(distribution, 1 - rare)


def share_of(*names: object) -> float:
    """Return a number from 0 to 1, exclusive, that belongs to these names: by BLAKE2, so it never changes."""
    digest = hashlib.blake2b("/".join(map(str, names)).encode(), digest_size=8).digest()
    return ((int.from_bytes(digest, "little") >> 11) + 0.5) / 2**53


def evenly_chosen(things: Sequence[Thing], most: int) -> list[Thing]:
    """Return at most this many things, evenly chosen, in their order."""
    places = np.linspace(0, len(things) - 1, min(most, len(things)))
    return [things[place] for place in np.unique(places.astype(int)).tolist()]
