"""The public names and the modules that they are loaded from when they are first used."""

from .run.run import make_dataset as make_dataset

__all__: list[str]
