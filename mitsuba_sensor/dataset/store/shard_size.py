"""How the samples of a dataset are kept: each in a folder, or many in a shard."""

from __future__ import annotations

NUMBERS = 10_000
"""Of samples, that a part of the index is of; shards are whole fractions of it."""
MOST_FOLDERS, USUAL = 10_000, 1000
"""Samples that have a folder each where a dataset file does not say how they are kept; and samples of a shard."""


def shard_samples(asked: int | None, samples: int) -> int:
    """How many samples a shard has; 0 where each has a folder.  asked : by the dataset file.  samples : in all."""
    if asked is not None:
        return asked
    if samples > MOST_FOLDERS:
        return USUAL
    return 0
