"""The public names and the modules that they are loaded from when they are first used."""

from .exports.export import export as export
from .read import TorchDataset as TorchDataset
from .read import batches as batches
from .run import make_dataset as make_dataset

__all__: list[str]
