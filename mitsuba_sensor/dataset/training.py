"""Batches of the samples of a dataset: NumPy arrays, and tensors of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from ..core.types import NumpyArray
from .read import Sample


class _Readable(Protocol):
    def read(self, name: str, /) -> NumpyArray: ...


def batches(
    samples: Sequence[_Readable],
    names: Sequence[str] = ("raw", "clean"),
    size: int = 8,
    *,
    seed: int | None = None,
    epoch: int = 0,
) -> Iterator[dict[str, NumpyArray]]:
    """Yield batches by name, (B, …) with the shapes of :meth:`Sample.read`; the last one may be smaller.

    samples : a :class:`Dataset`.  seed, epoch : of the order, which is another one in every epoch; None is the order of
        the samples.
    The arrays of a batch must have one shape; with size=1 all can be read.
    """
    order = np.arange(len(samples))
    if seed is not None:
        order = np.random.default_rng((seed, epoch)).permutation(order)
    for first in range(0, len(order), size):
        chosen = [samples[int(number)] for number in order[first : first + size]]
        yield {name: np.stack([sample.read(name) for sample in chosen]) for name in names}


class TorchDataset:
    """A dataset for torch.utils.data.DataLoader: samples as tuples of tensors, and what ``transform`` makes of them.

    names : of the arrays, see :meth:`Sample.read`; shape_index becomes int64, all others float32.
    transform : takes and returns a tuple of tensors.
    """

    def __init__(
        self,
        samples: Sequence[Sample],
        names: Sequence[str] = ("raw", "clean"),
        transform: Callable[[tuple[Any, ...]], Any] | None = None,
    ) -> None:
        self.samples, self.names, self.transform = samples, tuple(names), transform

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, number: int) -> Any:
        import torch

        sample, kinds = self.samples[number], {"shape_index": "int64"}
        arrays = (sample.read(name).astype(kinds.get(name, "float32")) for name in self.names)
        found = tuple(map(torch.from_numpy, arrays))
        return found if self.transform is None else self.transform(found)
