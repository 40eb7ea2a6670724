"""Data for training and evaluation: datasets of raw frames, and the noise of a camera on images made elsewhere.

>>> from mitsuba_sensor.dataset import make_dataset
>>> made = make_dataset("pairs.toml", "out/pairs")          # as `mitsuba-sensor dataset run` makes it
"""

import lazy_loader

# The public names stand in __init__.pyi.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
