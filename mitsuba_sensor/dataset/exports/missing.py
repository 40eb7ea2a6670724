"""What a dataset does not have of the samples that its file plans."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

from ...core import InputError
from ..index.origin import require_origin
from ..index.part import OpenPart, all_parts, parts_of
from ..index.same_origin import plan_of
from ..read.reader import Dataset
from ..store.shard_size import NUMBERS

MOST_NAMED = 3
"""Keys in the sentence."""


def missing_samples(folder: Path) -> str:
    """How many samples of a dataset are missing and which, for a sentence; empty where it is complete. Raises
    InputError where it is not what it was made from."""
    origin = require_origin(folder)
    number = origin.samples - len(Dataset(folder))
    if number <= 0:
        return ""
    named = ""
    with suppress(InputError):  # its scenes may be elsewhere: then nobody knows the keys
        keys = [*islice(_missing_keys(folder), MOST_NAMED)]
        more = ", …" * (number > len(keys))
        named = f" ({', '.join(keys)}{more})"
    return f"{number} of {origin.samples} samples are missing{named}"


def _missing_keys(folder: Path) -> Iterator[str]:
    """Keys that are in no part of the index, in the order of the plan. Raises InputError where that cannot be read."""
    plan = plan_of(folder, None)
    parts = parts_of(require_origin(folder).digest, all_parts(folder))
    for number in range(-(-plan.numbers // NUMBERS)):
        part, known = parts.get(number), set[str]()
        if part is not None:
            if part.is_whole:
                continue
            known = {line.key for line in OpenPart(folder, part).lines()}
        for view in plan.views(number * NUMBERS, (number + 1) * NUMBERS):
            yield from (sample.key for sample in view.samples if sample.key not in known)
