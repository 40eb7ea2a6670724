"""How the samples of a dataset are kept: each in a folder, or many in a shard."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from ..stages.datasheet import FileTable, optional

NUMBERS = 10_000
"""Of samples, that a part of the index is of; shards are whole fractions of it."""
MOST_FOLDERS, USUAL = 10_000, 1000
"""Samples that have a folder each where a dataset file does not say how they are kept; and samples of a shard."""


def _whole_fraction(samples: int) -> int:
    if samples and NUMBERS % samples:
        raise ValueError(
            f"is {samples}; it must be 0, for a folder for each sample, or divide {NUMBERS}, e.g. {USUAL}"
        )
    return samples


class StoreTable(FileTable):
    """How the samples are kept on the disk."""

    shard_samples: (
        Annotated[int, Field(ge=0, le=NUMBERS, strict=True), AfterValidator(_whole_fraction)]
        | None
    ) = optional(
        f"samples of each shard, a tar file; 0 for a folder for each sample; by default folders up to {MOST_FOLDERS} "
        f"samples, else shards of {USUAL}",
        USUAL,
    )


def shard_samples(asked: int | None, samples: int) -> int:
    """How many samples a shard has; 0 where each has a folder.  asked : by the dataset file.  samples : in all."""
    if asked is not None:
        return asked
    if samples > MOST_FOLDERS:
        return USUAL
    return 0
