"""Batches of the samples of a dataset: NumPy arrays, and tensors of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

from ..core import InputError
from ..core.types import NumpyArray
from .read import Sample

INTEGER_ARRAY = "shape_index"


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
    """Yield batches: name → array, shape (B, …) with the shape of :meth:`Sample.read`; the last one may be smaller.

    samples : a :class:`Dataset`.  seed, epoch : of the order, which differs in every epoch; None keeps the order of the
        samples.
    The arrays of a batch must have one shape; size=1 reads any.
    """
    order = np.arange(len(samples))
    if seed is not None:
        order = np.random.default_rng((seed, epoch)).permutation(order)
    for first in range(0, len(order), size):
        chosen = [samples[int(number)] for number in order[first : first + size]]
        yield {name: np.stack([sample.read(name) for sample in chosen]) for name in names}


class TorchDataset:
    """A dataset for torch.utils.data.DataLoader: samples as tuples of tensors, passed through ``transform``.

    names : of the arrays, see :meth:`Sample.read`; shape_index becomes int64, all others float32.
    transform : takes a tuple of tensors.  Raises InputError without PyTorch.
    """

    def __init__(
        self,
        samples: Sequence[Sample],
        names: Sequence[str] = ("raw", "clean"),
        transform: Callable[[tuple[Any, ...]], Any] | None = None,
    ) -> None:
        if find_spec("torch") is None:
            raise InputError("TorchDataset needs PyTorch, which is missing; pip install torch.")
        self.samples, self.names, self.transform = samples, tuple(names), transform

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, number: int) -> Any:
        import torch

        sample, tensors = self.samples[number], []
        for name in self.names:
            kind = "int64" if name == INTEGER_ARRAY else "float32"
            tensors.append(torch.from_numpy(sample.read(name).astype(kind)))
        return tuple(tensors) if self.transform is None else self.transform(tuple(tensors))
