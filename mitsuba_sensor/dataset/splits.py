"""Splits: train, test, … that share neither a scene nor a sensor unit."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Iterator, Sequence
from itertools import chain, product, repeat
from typing import TypeVar

from ..core import InputError
from .file import DatasetFile, Splits
from .keys import Facts
from .sweep import Light, SceneSweep, cells, share_of, values_of_cell

Thing = TypeVar("Thing", bound=Hashable)
SCENES_MAX = 10**6
"""Scenes, as splits.by distinguishes them."""
DRAWN_SERIAL = -1
"""Stands for a random serial number."""
REMEDY = (
    'give more scenes, or name in by what else makes a separate scene: by = ["scene", "view"] '
    'distributes the poses of a scene, by = ["scene", "parameters.NAME"] the values of a parameter; a smaller block '
    "makes more scenes"
)


class SplitOf:
    """The split of each scene and sensor unit. Raises InputError if there are fewer of them than splits.

    models : name of the camera model of each entry. Two entries with one model and serial number are one sensor unit.
    """

    def __init__(
        self, file: DatasetFile, models: Sequence[str], sweeps: Sequence[SceneSweep]
    ) -> None:
        self.file, self.models, self.splits = file, models, file.splits
        self.is_drawn = bool(file.random and "serial" in file.random.values)
        self._chips: dict[tuple[str, int], str] = {}
        if self.splits is None:
            return
        self._block = self.splits.block or 1
        random = file.random.values if file.random else {}
        self._is_by_draw = any(name in random for name in self.splits.by)
        scenes = (scene for sweep in sweeps for scene in self._scenes_of(sweep))
        self._scenes = distributed(scenes, self.splits, file.seed, "scenes", REMEDY)
        if self.is_drawn:
            raise InputError(
                "splits cannot distribute random serial numbers; give them in [grid] or [[list]], or remove serial and "
                "set splits.chips."
            )
        if "serial" in file.varied:
            remedy = "vary serial over more, or give chips = 1"
            for model in dict.fromkeys(models):
                rows = sweeps[0].rows
                units = ((model, serial) for row in rows for serial in self.given(row))
                what = f"serial numbers of {model}"
                self._chips |= distributed(units, self.splits, file.seed, what, remedy)

    @property
    def names(self) -> list[str]:
        """Names of the splits; one empty text without splits."""
        return [*self.splits.shares] if self.splits else [""]

    def given(self, row: Facts) -> Sequence[int]:
        """Return the serial numbers of a row in the dataset file."""
        grid: Sequence[int] = self.file.grid.get("serial", ())  # type: ignore[assignment]
        return grid or [row.get("serial", 1)]

    def serials(self, split: str, row: Facts, camera: int) -> Sequence[int]:
        """Return the serial numbers of a row and a camera in a split, perhaps none."""
        if self.is_drawn:
            return [DRAWN_SERIAL]
        if self.splits is None:
            return self.given(row)
        if self._chips:
            model = self.models[camera]
            return [x for x in self.given(row) if self._chips[model, x] == split]
        chips = self.splits.chips or 1
        first = 1 + chips * self.names.index(split)
        return range(first, first + chips)

    def of(self, sweep: SceneSweep, light: Light, row: int) -> str:
        """Return the split of a scene; an empty text without splits."""
        if self.splits is None:
            return ""
        first_pose = light.view // self._block * self._block
        values = {"view": first_pose, **light.values, **sweep.rows[row]}
        if self._is_by_draw:
            values |= sweep.drawn(light.draws[0])
        return self._scenes[self._scene(sweep, values)]

    def _scenes_of(self, sweep: SceneSweep) -> Iterator[str]:
        """Yield each scene, as ``by`` distinguishes them, perhaps several times."""
        assert self.splits is not None
        by = self.splits.by
        grid = {name: values for name, values in sweep.of_light.items() if name in by}
        blocks = range(0, len(sweep.poses) if "view" in by else 1, self._block)
        groups = range(sweep.groups if self._is_by_draw else 1)
        if (most := len(blocks) * cells(grid) * len(sweep.rows) * len(groups)) > SCENES_MAX:
            raise InputError(
                f"splits.by distinguishes {most} scenes; it can distinguish at most {SCENES_MAX}: name less in by."
            )
        for group, view, cell in product(groups, blocks, range(cells(grid))):
            drawn = sweep.drawn(sweep.draws_of(group)[0]) if self._is_by_draw else {}
            for row in sweep.rows:
                values = values_of_cell(grid, cell)
                yield self._scene(sweep, {"view": view, **values, **row, **drawn})

    def _scene(self, sweep: SceneSweep, varied: Facts) -> str:
        """Return what distinguishes the scene, as text."""
        assert self.splits is not None
        entry = sweep.entry
        fixed: Facts = {f"parameters.{name}": x for name, x in entry.parameters.items()}
        fixed |= {f"traverse.{name}": x for name, x in entry.traverse.items()}
        values = {"scene": entry.name, **fixed, **varied}
        return json.dumps([values.get(name) for name in self.splits.by])


def distributed(
    things: Iterable[Thing], splits: Splits, seed: int, what: str, remedy: str
) -> dict[Thing, str]:
    """Return the split of each thing: shuffled by the seed, at least one thing for each split, otherwise by the
    fractions. Raises InputError for fewer things than splits."""
    shuffled = sorted({*things}, key=lambda thing: share_of(seed, "split", thing))
    names = [*splits.shares]
    if len(shuffled) < len(names):
        raise InputError(
            f"splits {', '.join(names)} need at least {len(names)} {what}, and the dataset has {len(shuffled)}; "
            f"{remedy}."
        )
    sizes = split_sizes(len(shuffled), [*splits.shares.values()])
    return dict(zip(shuffled, chain.from_iterable(map(repeat, names, sizes)), strict=True))


def split_sizes(total: int, shares: Sequence[float]) -> list[int]:
    """Divide ``total`` things by fractions: at least one for each, otherwise to the nearest whole numbers."""
    free = total - len(shares)
    wanted = [max(share * total - 1, 0.0) for share in shares]
    scale = free / sum(wanted) if sum(wanted) else 0.0
    sizes = [1 + int(x * scale) for x in wanted]
    order = sorted(range(len(shares)), key=lambda k: int(wanted[k] * scale) - wanted[k] * scale)
    for k in order[: total - sum(sizes)]:
        sizes[k] += 1
    return sizes
