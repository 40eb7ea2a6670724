"""Splits: train, test, … that share neither a scene nor a chip."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Sequence

from ..core import InputError
from .file import DatasetFile, Splits
from .keys import Facts
from .sweep import Combination, combinations, share_of

Chip = tuple[str, int]
"""Name of the camera's model, serial number."""


class SplitOf:
    """Which split a scene and a chip belong to. Raises InputError where there are too few of them for the splits.

    models : name of the camera's model, by entry.  Two entries of one model and serial number are the same chip.
    """

    def __init__(self, file: DatasetFile, models: Sequence[str]) -> None:
        self.file, self.models, self.splits = file, models, file.splits
        self._scenes: dict[Hashable, str] = {}
        self._chips: dict[Hashable, str] = {}
        if self.splits is None:
            return
        scenes, chips = dict[Hashable, None](), dict[Chip, None]()
        for one in (one for group in combinations(file) for one in group):
            scenes[self._scene(one)] = None
            chips[self._chip(one)] = None
        remedy = (
            'give more scenes, or name in by what else makes another scene: by = ["scene", "view"] deals '
            'out the poses of a scene, by = ["scene", "parameters.NAME"] the values of a parameter'
        )
        self._scenes = assigned(scenes, self.splits, file.seed, "scenes", remedy)
        if "serial" in file.varied:
            for model in dict.fromkeys(model for model, _ in chips):
                own = [chip for chip in chips if chip[0] == model]
                what = f"serial numbers of {model}"
                self._chips |= assigned(
                    own,
                    self.splits,
                    file.seed,
                    what,
                    "vary serial over more, or give chips = 1",
                )

    def serials(self, one: Combination) -> list[int]:
        """The serial numbers with which a combination is made: none where scene and chip are of different splits."""
        given = self._chip(one)[1]
        if self.splits is None:
            return [given]
        split = self.of(one)
        if self._chips:
            if self._chips[self._chip(one)] == split:
                return [given]
            return []
        chips = self.splits.chips or 1
        first = 1 + chips * list(self.splits.shares).index(split)
        return list(range(first, first + chips))

    def of(self, one: Combination) -> str:
        """The split of the combination's scene; an empty text where there are none."""
        if self.splits is None:
            return ""
        return self._scenes[self._scene(one)]

    def _chip(self, one: Combination) -> Chip:
        return self.models[one.camera], one.values.get("serial", 1)

    def _scene(self, one: Combination) -> str:
        """What tells the scene from others, as text."""
        assert self.splits is not None
        entry = self.file.scenes[one.scene]
        fixed = {
            f"{kind}.{name}": x
            for kind in ("parameters", "traverse")
            for name, x in getattr(entry, kind).items()
        }
        values: Facts = {"scene": entry.name, "view": one.view, **fixed, **one.values}
        return json.dumps([values.get(name) for name in self.splits.by])


def assigned(
    things: Iterable[Hashable], splits: Splits, seed: int, what: str, remedy: str
) -> dict[Hashable, str]:
    """Thing → split: shuffled by the seed, at least one for each split, otherwise by the shares."""
    shuffled = sorted(things, key=lambda thing: share_of(seed, "split", thing))
    names, total = list(splits.shares), len(shuffled)
    if total < len(names):
        raise InputError(
            f"splits: {total} {what} for {len(names)} splits ({', '.join(names)}); {remedy}."
        )
    free = total - len(names)
    wanted = [max(splits.shares[name] * total - 1, 0.0) for name in names]
    scale = 0.0
    if sum(wanted):
        scale = free / sum(wanted)
    sizes = [1 + int(x * scale) for x in wanted]
    order = sorted(range(len(names)), key=lambda k: int(wanted[k] * scale) - wanted[k] * scale)
    for k in order[: total - sum(sizes)]:
        sizes[k] += 1
    owners = [name for name, size in zip(names, sizes, strict=True) for _ in range(size)]
    return dict(zip(shuffled, owners, strict=True))
