"""Batches of NumPy arrays from a dataset, in its order or shuffled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ..read.reader import Sample


def batches(
    samples: Sequence[Sample],
    names: Sequence[str] = ("raw", "clean"),
    size: int = 8,
    *,
    seed: int | None = None,
    epoch: int = 0,
) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield batches by name, (B, …) with the shapes of :meth:`Sample.read`; the last one may be smaller.

    samples : a :class:`dataset.read.reader.Dataset`.  seed, epoch : of the order, which is another one in every epoch;
        None is the order of the samples.
    Raises InputError where the arrays of a batch differ in shape.
    """
    order = np.arange(len(samples))
    if seed is not None:
        order = np.random.default_rng((seed, epoch)).permutation(order)
    for first in range(0, len(order), size):
        chosen = [samples[int(number)] for number in order[first : first + size]]
        arrays = {name: [one.read(name) for one in chosen] for name in names}
        for name, found in arrays.items():
            if len({one.shape for one in found}) > 1:
                raise InputError(
                    f"the {name} of a batch have shapes {sorted({x.shape for x in found})}; take size=1."
                )
        yield {name: np.stack(found) for name, found in arrays.items()}
