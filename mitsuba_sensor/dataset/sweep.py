"""What varies from sample to sample: every combination, rows, random draws and poses, each found by its number."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
import scipy

from ..core import InputError
from ..render.scene.motion import KeyPose
from .file import DatasetFile, Distribution
from .keys import Config, Facts
from .scene_entry import SceneEntry, Value, View

Values = Config
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
DIGITS = 6  # of a random number, so that it can be typed
TIME_DIGITS = 9
"""Of a time on a path [s]: nanoseconds."""
VECTORS = ("origin_m", "target_m", "up")


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
    """The poses of the camera in a scene, by number; None is that of the scene file."""

    def __init__(self, scene: SceneEntry) -> None:
        self.name, self.path, self.given = scene.name, scene.path, scene.views or (None,)

    def __len__(self) -> int:
        return self.path.views if self.path else len(self.given)

    def __getitem__(self, number: int) -> View | None:
        if not 0 <= number < len(self):
            raise IndexError(number)
        if self.path is None:
            return self.given[number]
        keys = self.path.keys
        first, last = keys[0], keys[-1]
        steps = self.path.views - (not _is_loop(first, last))
        period_s = (last.time_s - first.time_s) / max(steps, 1)
        time_s = _rounded_to(TIME_DIGITS, first.time_s + number * period_s)
        if not self.path.has_poses:
            return View(time_s=time_s)
        times_s = [key.time_s for key in keys]
        pose = {
            name: tuple(
                _rounded_to(DIGITS, np.interp(time_s, times_s, coordinates))
                for coordinates in zip(*(getattr(key, name) for key in keys), strict=True)
            )
            for name in VECTORS
        }
        try:
            return View(**pose, time_s=time_s)
        except ValueError:  # the keys were checked, and this pose is between them
            raise InputError(
                f"view {number} on the path of scene {self.name!r} is at {[*pose['origin_m']]} and looks at "
                f"{[*pose['target_m']]}: that is one point, or straight along up; move a key, or give it another up."
            ) from None


def _rounded_to(digits: int, value: float) -> float:
    """A number with so many decimals, never −0."""
    return float(np.round(value, digits)) + 0.0


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
    the first one alone.  Serial numbers are for splits to deal out (splits.py).
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
        self.of_exposure = {name: x for name, x in grid.items() if name not in self.of_light}
        self.rows: Sequence[Values] = file.list or ({},)
        self.draws = LightDraws(file, self.entry.name, also)
        self.lights = len(self.poses) * cells(self.of_light) * len(self.draws)
        self.cells_of_exposure = cells(self.of_exposure)

    def light(self, number: int) -> Light:
        """The light of this number."""
        number, draw = divmod(number, len(self.draws))
        view, cell = divmod(number, cells(self.of_light))
        values = values_of_cell(self.of_light, cell)
        return Light(view, self.poses[view], values, self.draws.of(draw))

    def exposures(self, light: Light) -> int:
        """How many samples a light has of each row, camera and serial number."""
        return len(light.draws) * self.cells_of_exposure

    def combination(self, light: Light, row: int, camera: int, exposure: int) -> Combination:
        """What one sample is made of, but for its serial number.  exposure : number among those of the light."""
        place, cell = divmod(exposure, self.cells_of_exposure)
        draw = int(light.draws[place])
        values = {
            **light.values,
            **self.rows[row],
            **values_of_cell(self.of_exposure, cell),
            **drawn_values(self.file, self.entry.name, draw),
        }
        if self.file.random is None:
            draw = -1
        return Combination(self.scene, camera, light.view, light.pose, values, draw)


class LightDraws:
    """The random draws of a scene, those of one light together: all, where they do not change the light; each alone,
    where a law of what does is continuous; else by its choices.

    also : see :func:`changes_light`.  Raises InputError for too many.
    """

    def __init__(self, file: DatasetFile, scene: str, also: Sequence[str]) -> None:
        laws = file.random.values if file.random else {}
        self.all = file.random.draws if file.random else 1
        of_light = {name: law for name, law in laws.items() if changes_light(name, also)}
        self.alone = any(
            law.choice is None and law.integer is None for law in of_light.values()
        )
        self._bounds = [0, self.all]
        self._order: Sequence[int] = range(self.all)
        if of_light and not self.alone:
            self._sort(file.seed, scene, of_light)

    def __len__(self) -> int:
        return self.all if self.alone else len(self._bounds) - 1

    def of(self, number: int) -> Sequence[int]:
        """The draws of a light."""
        if self.alone:
            return range(number, number + 1)
        return self._order[self._bounds[number] : self._bounds[number + 1]]

    def _sort(self, seed: int, scene: str, of_light: Mapping[str, Distribution]) -> None:
        if self.all > MOST_SORTED:
            raise InputError(
                f"random.draws is {self.all}; at most {MOST_SORTED} where choices or whole numbers change the light: "
                "put them into [grid]."
            )
        together: dict[object, list[int]] = {}
        for draw in range(self.all):
            values = (drawn(x, share_of(seed, scene, n, draw)) for n, x in of_light.items())
            together.setdefault(tuple(values), []).append(draw)
        groups = list(together.values())
        self._bounds = list(accumulate(map(len, groups), initial=0))
        self._order = [draw for group in groups for draw in group]


def names_of_timed_light(file: DatasetFile, entry: SceneEntry, later: bool) -> tuple[str, ...]:
    """Beginnings of the names that change the light of a scene beside the usual ones, because time does."""
    if not is_timed(file, entry):
        return ()
    times, drawn_names = (
        [*possible_values(file, "exposure_s")],
        file.random and file.random.values,
    )
    given = "exposure_s" in file.grid or "exposure_s" in (drawn_names or ())
    given = given or (bool(file.list) and all("exposure_s" in row for row in file.list))
    if later or "noise_ratio" in file.render or "auto" in times or not given:
        return EXPOSED + METERED
    return EXPOSED


def is_timed(file: DatasetFile, entry: SceneEntry) -> bool:
    """Whether the exposure decides the light."""
    return entry.motion is not None or "noise_ratio" in file.render


def possible_values(file: DatasetFile, name: str) -> Iterator[Value]:
    """The values of something that varies which stand in the file."""
    yield from file.grid.get(name, ())
    yield from (row[name] for row in file.list if name in row)
    if file.random and name in file.random.values:
        yield from ends(file.random.values[name], file.random.draws)


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


def of_kind(kind: str, values: Values) -> Facts:
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
        return _rounded(mean + sigma * float(scipy.special.ndtri(share)))
    low, high = distribution.uniform or map(math.log, distribution.log_uniform or ())
    value = low + share * (high - low)
    return _rounded(value if distribution.uniform else math.exp(value))


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


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
