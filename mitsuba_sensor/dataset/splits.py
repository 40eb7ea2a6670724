"""Splits: train, test, … that share neither a scene nor a chip."""

from __future__ import annotations

import json
from bisect import bisect_left
from collections.abc import Hashable, Iterable, Iterator, Sequence
from itertools import product

import numpy as np

from ..core import InputError
from .file import DatasetFile, Splits
from .sweep import Light, SceneSweep, Values, cells, share_of, values_of_cell

MOST_SCENES = 10**6
"""Scenes, as splits.by tells them apart, that are dealt out."""
AS_DRAWN = -1
"""Stands for a serial number that is drawn at random."""
REMEDY = (
    'give more scenes, or name in by what else makes another scene: by = ["scene", "view"] deals '
    'out the poses of a scene, by = ["scene", "parameters.NAME"] the values of a parameter; a smaller block makes more '
    "of them"
)


class SplitOf:
    """Which split a scene and a chip belong to. Raises InputError where there are too few of them for the splits.

    models : name of the camera's model, by entry.  Two entries of one model and serial number are the same chip.
    """

    def __init__(
        self, file: DatasetFile, models: Sequence[str], sweeps: Sequence[SceneSweep]
    ) -> None:
        self.file, self.models, self.splits = file, models, file.splits
        self._chips: dict[str, Shares] = {}
        if self.splits is None:
            return
        scenes = (scene for sweep in sweeps for scene in self._scenes_of(sweep))
        self._scenes = Shares(scenes, self.splits, file.seed, "scenes", REMEDY)
        if file.random and "serial" in file.random.values:
            raise InputError(
                "splits cannot deal out serial numbers that are drawn at random; give them in [grid] or [[list]], or "
                "leave serial out and give splits.chips."
            )
        if "serial" in file.varied:
            remedy = "vary serial over more, or give chips = 1"
            for model in dict.fromkeys(models):
                own = ((model, serial) for serial in self._given())
                what = f"serial numbers of {model}"
                self._chips[model] = Shares(own, self.splits, file.seed, what, remedy)

    @property
    def names(self) -> list[str]:
        """Names of the splits; an empty text where there are none."""
        return [*self.splits.shares] if self.splits else [""]

    def serials(self, split: str, row: Values, camera: int) -> Sequence[int]:
        """The serial numbers with which a row and a camera are exposed in a split, perhaps none."""
        given: Sequence[int] = self.file.grid.get("serial", ())  # type: ignore[assignment]
        if self.file.random and "serial" in self.file.random.values:
            return [AS_DRAWN]
        if "serial" not in self.file.grid:
            given = [row.get("serial", 1)]
        if self.splits is None:
            return given
        if self._chips:
            model = self.models[camera]
            return [one for one in given if self._chips[model].of((model, one)) == split]
        chips = self.splits.chips or 1
        first = 1 + chips * self.names.index(split)
        return range(first, first + chips)

    def of(self, sweep: SceneSweep, light: Light, row: int) -> str:
        """The split of a scene; an empty text where there are none."""
        if self.splits is None:
            return ""
        first_pose = light.view // self._block * self._block
        values = {"view": first_pose, **light.values, **sweep.rows[row]}
        if self._by_draw():
            values |= sweep.drawn(light.draws[0])
        return self._scenes.of(self._scene(sweep, values))

    @property
    def _block(self) -> int:
        """Neighbouring poses that are in one split."""
        return (self.splits and self.splits.block) or 1

    def _given(self) -> Iterator[int]:
        if "serial" in self.file.grid:
            yield from self.file.grid["serial"]  # type: ignore[misc]
        else:
            yield from (row.get("serial", 1) for row in self.file.list)  # type: ignore[misc]

    def _by_draw(self) -> bool:
        """Whether a random draw makes another scene of it."""
        assert self.splits is not None
        names = self.file.random.values if self.file.random else {}
        return any(name in names for name in self.splits.by)

    def _scenes_of(self, sweep: SceneSweep) -> Iterator[str]:
        """Each scene, as ``by`` tells them apart, perhaps several times."""
        assert self.splits is not None
        by = self.splits.by
        grid = {name: values for name, values in sweep.of_light.items() if name in by}
        blocks = range(0, len(sweep.poses) if "view" in by else 1, self._block)
        by_draw = self._by_draw()
        lights = range(sweep.groups if by_draw else 1)
        if (most := len(blocks) * cells(grid) * len(sweep.rows) * len(lights)) > MOST_SCENES:
            raise InputError(
                f"splits.by tells {most} scenes apart; splits deal out at most {MOST_SCENES}: name less in by."
            )
        for light, view, cell in product(lights, blocks, range(cells(grid))):
            drawn = sweep.drawn(sweep.draws_of(light)[0]) if by_draw else {}
            for row in sweep.rows:
                yield self._scene(
                    sweep, {"view": view, **values_of_cell(grid, cell), **row, **drawn}
                )

    def _scene(self, sweep: SceneSweep, varied: Values) -> str:
        """What tells the scene from others, as text."""
        assert self.splits is not None
        entry = sweep.entry
        fixed = {
            f"{kind}.{name}": x
            for kind in ("parameters", "traverse")
            for name, x in getattr(entry, kind).items()
        }
        values = {"scene": entry.name, **fixed, **varied}
        return json.dumps([values.get(name) for name in self.splits.by])


class Shares:
    """Which split a thing belongs to: shuffled by the seed, at least one for each split, otherwise by the shares.

    Only where in the shuffled order each split ends is kept.
    """

    def __init__(
        self, things: Iterable[Hashable], splits: Splits, seed: int, what: str, remedy: str
    ) -> None:
        self.names, self.seed = list(splits.shares), seed
        shuffled = np.unique(np.fromiter(map(self._place, things), float))
        total = len(shuffled)
        if total < len(self.names):
            names = ", ".join(self.names)
            raise InputError(
                f"splits: {total} {what} for {len(self.names)} splits ({names}); {remedy}."
            )
        sizes = split_sizes(total, [splits.shares[name] for name in self.names])
        self.ends = [float(shuffled[end - 1]) for end in np.cumsum(sizes)]

    def of(self, thing: Hashable) -> str:
        """The split of one of the things."""
        return self.names[bisect_left(self.ends, self._place(thing))]

    def _place(self, thing: Hashable) -> float:
        return share_of(self.seed, "split", thing)


def split_sizes(total: int, shares: Sequence[float]) -> list[int]:
    """How many of ``total`` things each share gets: at least one, otherwise as near as whole numbers come."""
    free = total - len(shares)
    wanted = [max(share * total - 1, 0.0) for share in shares]
    scale = 0.0
    if sum(wanted):
        scale = free / sum(wanted)
    sizes = [1 + int(x * scale) for x in wanted]
    order = sorted(range(len(shares)), key=lambda k: int(wanted[k] * scale) - wanted[k] * scale)
    for k in order[: total - sum(sizes)]:
        sizes[k] += 1
    return sizes
