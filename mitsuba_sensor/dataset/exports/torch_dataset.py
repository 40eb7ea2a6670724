"""A dataset for PyTorch: a map-style dataset of tensors, for torch.utils.data.DataLoader with any number of workers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..read.reader import Sample


class TorchDataset:
    """Samples as tuples of tensors, and what ``transform`` makes of them.

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
        if self.transform is None:
            return found
        return self.transform(found)
