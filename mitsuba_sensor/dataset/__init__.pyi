"""The public names and the modules that they are loaded from when they are first used."""

from .exports.export import export as export
from .run import make_dataset as make_dataset
from .training import TorchDataset as TorchDataset
from .training import batches as batches

__all__: list[str]
