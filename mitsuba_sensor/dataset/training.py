"""Batches of the samples of a dataset: NumPy arrays, and tensors of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

from ..core import InputError
from ..core.errors import require_seed, shown
from ..core.types import NumpyArray
from .read import PAGED, Sample

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
    The arrays of a batch must have one shape; size=1 reads any. Raises InputError for other shapes and wrong arguments.
    """
    if isinstance(size, bool) or not isinstance(size, int | np.integer) or size < 1:
        raise InputError(
            f"size is {shown(size)}; it must be a whole number of at least 1, e.g. 8."
        )
    if seed is not None:
        require_seed("seed", seed)
    require_seed("epoch", epoch)
    return _batches(samples, _checked(names), int(size), seed, epoch)


def _batches(
    samples: Sequence[_Readable], names: Sequence[str], size: int, seed: int | None, epoch: int
) -> Iterator[dict[str, NumpyArray]]:
    order = np.arange(len(samples))
    if seed is not None:
        order = np.random.default_rng((seed, epoch)).permutation(order)
    for first in range(0, len(order), size):
        chosen = [samples[int(number)] for number in order[first : first + size]]
        yield {name: _stacked(name, [sample.read(name) for sample in chosen]) for name in names}


def _checked(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of arrays. Raises InputError for one text, or values that are no texts."""
    if isinstance(names, str):
        raise InputError(f'names is {names!r}; pass ("{names}",).')
    given = tuple(names) if isinstance(names, Iterable) else ()
    if not given or not all(isinstance(name, str) for name in given):
        raise InputError(
            f'names is {shown(names)}; pass names of arrays, e.g. ("raw", "clean").'
        )
    return given


def _stacked(name: str, arrays: Sequence[NumpyArray]) -> NumpyArray:
    """Return arrays of one shape as an array. Raises InputError for different shapes."""
    shapes = sorted({array.shape for array in arrays})
    if len(shapes) == 1:
        return np.stack(arrays)
    sizes = sorted({shape[1:] if name in PAGED else shape[:2] for shape in shapes})
    if len(sizes) > 1:
        first, last = (" × ".join(map(str, size)) for size in (sizes[0], sizes[-1]))
        raise InputError(
            f"samples of this batch have {first} and {last} pixels; use one scene at a time (where(scene=…)) or equal "
            "film sizes."
        )
    raise InputError(
        f"samples of this batch have {name} of shape {shapes[0]} and {shapes[-1]}; use one camera and number of "
        "frames at a time, e.g. where(frames=…)."
    )


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
        self.samples, self.names, self.transform = samples, _checked(names), transform

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, number: int) -> Any:
        import torch

        sample, tensors = self.samples[number], []
        for name in self.names:
            kind = "int64" if name == INTEGER_ARRAY else "float32"
            tensors.append(torch.from_numpy(sample.read(name).astype(kind)))
        return tuple(tensors) if self.transform is None else self.transform(tuple(tensors))
